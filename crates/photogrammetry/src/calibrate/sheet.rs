//! The sheet of dots, and the small YAML that describes it.
//!
//! ```yaml
//! version: 1
//! rows: 8
//! columns: 10
//! pitch_mm: 25
//! dot_diameter_mm: 15
//! control_marks:              # optional: ring-coded targets that fix the orientation
//!   - {code: 45, x_mm: 50, y_mm: 75, radius_mm: 3}
//! ```

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use crate::detect::{is_usable_code, usable_codes};

/// Rows and columns that a sheet has at least: fewer show no grid.
const LEAST_DOTS: u32 = 3;
/// And at most: more is a slip.
const MOST_DOTS: u32 = 200;

/// A ring-coded target on the sheet.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlMark {
    /// Its code.
    pub code: u16,
    /// Its centre along the rows, from the first dot, millimetres.
    pub x_mm: f64,
    /// Its centre down the columns, millimetres.
    pub y_mm: f64,
    /// Radius of its centre disc, millimetres.
    pub radius_mm: f64,
}

/// A flat sheet with a square grid of dots.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sheet {
    /// Rows of dots.
    pub rows: u32,
    /// Columns of dots.
    pub columns: u32,
    /// Distance of neighbours, millimetres.
    pub pitch_mm: f64,
    /// Diameter of a dot, millimetres.
    pub dot_diameter_mm: f64,
    /// Coded targets that fix the orientation; without them the sheet is a plain grid.
    #[serde(default)]
    pub control_marks: Vec<ControlMark>,
}

/// Why a sheet's description cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SheetError {
    /// It is not YAML of the right form; the reader's words hold line and column.
    #[error("{0}")]
    Syntax(String),
    /// Numbers that no sheet has; every one of them.
    #[error("{}", .0.join("\n"))]
    Values(Vec<String>),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SheetFile {
    version: u64,
    rows: u32,
    columns: u32,
    pitch_mm: f64,
    dot_diameter_mm: f64,
    #[serde(default)]
    control_marks: Vec<ControlMark>,
}

/// Reads the description of a sheet.
///
/// # Errors
/// [`SheetError`], with every wrong number at once.
pub fn read_sheet(text: &str) -> Result<Sheet, SheetError> {
    let file: SheetFile =
        serde_yaml::from_str(text).map_err(|error| SheetError::Syntax(error.to_string()))?;
    let sheet = Sheet {
        rows: file.rows,
        columns: file.columns,
        pitch_mm: file.pitch_mm,
        dot_diameter_mm: file.dot_diameter_mm,
        control_marks: file.control_marks,
    };
    let mut faults = sheet.faults();
    if file.version != 1 {
        faults.insert(0, format!("version is {}, this program reads version 1", file.version));
    }
    if faults.is_empty() { Ok(sheet) } else { Err(SheetError::Values(faults)) }
}

impl Sheet {
    /// Radius of a dot, millimetres.
    #[must_use]
    pub fn dot_radius_mm(&self) -> f64 {
        0.5 * self.dot_diameter_mm
    }

    /// The centre of a dot, millimetres.
    #[must_use]
    pub fn dot(&self, column: u32, row: u32) -> Vector2<f64> {
        Vector2::new(f64::from(column), f64::from(row)) * self.pitch_mm
    }

    /// The mark that stands in the place of a dot, if one does.
    #[must_use]
    pub fn mark_at(&self, column: u32, row: u32) -> Option<&ControlMark> {
        let dot = self.dot(column, row);
        let place = |mark: &&ControlMark| (mark.place() - dot).norm() < 0.25 * self.pitch_mm;
        self.control_marks.iter().find(place)
    }

    /// Everything that no sheet has.
    fn faults(&self) -> Vec<String> {
        let mut faults = Vec::new();
        for (name, count) in [("rows", self.rows), ("columns", self.columns)] {
            if !(LEAST_DOTS..=MOST_DOTS).contains(&count) {
                faults.push(format!("{name} is {count}, expected {LEAST_DOTS} to {MOST_DOTS}"));
            }
        }
        if !(self.pitch_mm.is_finite() && self.pitch_mm > 0.0) {
            faults.push(format!("pitch_mm is {}, expected more than 0", self.pitch_mm));
        }
        let touching = self.dot_diameter_mm < 0.8 * self.pitch_mm;
        if !(self.dot_diameter_mm > 0.0 && touching) {
            faults.push(format!(
                "dot_diameter_mm is {}, expected more than 0 and less than 0.8 of the pitch: dots that \
                 nearly touch cannot be told apart",
                self.dot_diameter_mm
            ));
        }
        for (i, mark) in self.control_marks.iter().enumerate() {
            if self.control_marks[..i].iter().any(|other| other.code == mark.code) {
                faults.push(format!("control mark {} is there twice", mark.code));
            }
            faults.extend(mark.fault());
        }
        faults
    }
}

impl ControlMark {
    /// Its centre on the sheet, millimetres.
    #[must_use]
    pub fn place(&self) -> Vector2<f64> {
        Vector2::new(self.x_mm, self.y_mm)
    }

    fn fault(&self) -> Option<String> {
        if !is_usable_code(self.code) {
            let near = usable_codes().into_iter().min_by_key(|code| code.abs_diff(self.code));
            let near = near.unwrap_or_default();
            return Some(format!(
                "code {} serves badly; the nearest that does is {near}",
                self.code
            ));
        }
        let is_sound = self.x_mm.is_finite() && self.y_mm.is_finite() && self.radius_mm > 0.0;
        (!is_sound).then(|| format!("control mark {}: its radius must be above 0", self.code))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "version: 1\nrows: 8\ncolumns: 10\npitch_mm: 25\ndot_diameter_mm: 15\n";

    #[test]
    fn a_sheet_is_read_with_and_without_marks() {
        let plain = read_sheet(GOOD).unwrap();
        assert_eq!((plain.rows, plain.columns, plain.dot_radius_mm()), (8, 10, 7.5));
        assert_eq!(plain.dot(9, 7), Vector2::new(225.0, 175.0));
        let marks = "control_marks:\n  - {code: 45, x_mm: 51, y_mm: 74, radius_mm: 3}\n";
        let marked = read_sheet(&format!("{GOOD}{marks}")).unwrap();
        assert_eq!(marked.mark_at(2, 3).unwrap().code, 45);
        assert_eq!(marked.mark_at(3, 3), None);
    }

    #[test]
    fn every_wrong_number_is_told_at_once() {
        let text = "version: 2\nrows: 1\ncolumns: 10\npitch_mm: 25\ndot_diameter_mm: 24\n\
                    control_marks:\n  - {code: 44, x_mm: 0, y_mm: 0, radius_mm: 3}\n";
        let SheetError::Values(faults) = read_sheet(text).unwrap_err() else {
            panic!("it is sound YAML")
        };
        assert_eq!(faults.len(), 4, "{faults:?}");
        assert!(faults[3].contains("nearest that does is 43"), "{}", faults[3]);
    }

    #[test]
    fn an_unknown_key_is_refused_with_its_place() {
        let SheetError::Syntax(said) = read_sheet(&format!("{GOOD}pich: 3\n")).unwrap_err() else {
            panic!("the key is unknown")
        };
        assert!(said.contains("pich") && said.contains('6'), "{said}");
    }
}
