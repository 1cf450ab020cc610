//! Measured angles between beams, from CSV.
//!
//! One line a measurement under a heading that names the columns in any order: `from_m`, `from_n`,
//! `to_m`, `to_n` (the two beams), `axis` (`horizontal`, or `vertical` for a module that was rolled
//! by a quarter turn), `repeat`, `angle_deg`; optional `u_deg`, `wavelength_nm` and
//! `u_wavelength_nm`. An optional column is there for all lines or for none. Empty lines and what
//! follows `#` are passed over.

use crate::pattern::Order;

/// What is wrong in which line; line 1 is the first.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{line}: {reason}")]
pub struct MeasuredError {
    /// The line.
    pub line: usize,
    /// What is wrong.
    pub reason: String,
}

/// Which of the module's directions lies in the plane in which the stage turns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum StageAxis {
    /// Rows: the module stands as it is used.
    Horizontal,
    /// Columns: the module is rolled by a quarter turn in its fixture.
    Vertical,
}

impl StageAxis {
    /// The name in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Horizontal => "horizontal",
            Self::Vertical => "vertical",
        }
    }
}

/// How far the stage turned between two beams, once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredAngle {
    /// The beam that stood at the reference place first.
    pub from: Order,
    /// The beam that was brought there.
    pub to: Order,
    /// How the module stood.
    pub axis: StageAxis,
    /// Which repetition.
    pub repeat: u32,
    /// How far the stage turned, radians, above 0: which way it counts does not matter.
    pub angle: f64,
    /// Standard uncertainty of that which differs from measurement to measurement, radians.
    pub u: Option<f64>,
    /// Wavelength in vacuum read at it, nanometres.
    pub wavelength_nm: Option<f64>,
    /// Standard uncertainty of that reading by itself, nanometres; what all readings share is apart.
    pub u_wavelength_nm: f64,
}

const KNOWN: [&str; 10] = [
    "from_m",
    "from_n",
    "to_m",
    "to_n",
    "axis",
    "repeat",
    "angle_deg",
    "u_deg",
    "wavelength_nm",
    "u_wavelength_nm",
];

/// Where the columns are.
struct Heading {
    /// Index in a line of each of [`KNOWN`].
    places: [Option<usize>; 10],
    count: usize,
}

/// Reads the measurements, in the order of the file. Angles become radians.
///
/// # Errors
/// [`MeasuredError`].
pub fn read_measured(text: &str) -> Result<Vec<MeasuredAngle>, MeasuredError> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut lines = text
        .lines()
        .enumerate()
        .map(|(i, l)| (i + 1, l.split('#').next().unwrap_or_default().trim()))
        .filter(|(_, l)| !l.is_empty());
    let fault = |line: usize, reason: String| MeasuredError { line, reason };
    let (at, first) = lines.next().ok_or_else(|| fault(1, "the table is empty".to_owned()))?;
    let heading = Heading::of(first).map_err(|reason| fault(at, reason))?;
    let mut all: Vec<MeasuredAngle> = Vec::new();
    for (at, line) in lines {
        let one = heading.angle(line).map_err(|reason| fault(at, reason))?;
        let is_same = |a: &&MeasuredAngle| {
            (a.from, a.to, a.axis, a.repeat) == (one.from, one.to, one.axis, one.repeat)
        };
        if all.iter().any(|a| is_same(&a)) {
            return Err(fault(
                at,
                format!("column `repeat`: {} of this pair is there", one.repeat),
            ));
        }
        all.push(one);
    }
    if all.is_empty() {
        return Err(fault(at, "there is no measurement below the heading".to_owned()));
    }
    Ok(all)
}

/// Writes measurements as [`read_measured`] takes them, in their order.
#[must_use]
pub fn write_measured(measured: &[MeasuredAngle]) -> String {
    use std::fmt::Write as _;
    let has_u = measured.iter().all(|a| a.u.is_some());
    let has_wavelength = measured.iter().all(|a| a.wavelength_nm.is_some());
    let mut text = "from_m,from_n,to_m,to_n,axis,repeat,angle_deg".to_owned();
    text.push_str(if has_u { ",u_deg" } else { "" });
    text.push_str(if has_wavelength { ",wavelength_nm,u_wavelength_nm\n" } else { "\n" });
    for a in measured {
        let (from, to, axis) = (a.from, a.to, a.axis.name());
        let angle = a.angle.to_degrees();
        // A String takes everything.
        let _ = write!(text, "{},{},{},{},{axis},{},{angle}", from.m, from.n, to.m, to.n, a.repeat);
        if let Some(u) = a.u.filter(|_| has_u) {
            let _ = write!(text, ",{}", u.to_degrees());
        }
        if let Some(nm) = a.wavelength_nm.filter(|_| has_wavelength) {
            let _ = write!(text, ",{nm},{}", a.u_wavelength_nm);
        }
        text.push('\n');
    }
    text
}

impl Heading {
    fn of(line: &str) -> Result<Self, String> {
        let names: Vec<&str> = line.split(',').map(str::trim).collect();
        if let Some(strange) = names.iter().find(|name| !KNOWN.contains(name)) {
            return Err(format!(
                "unknown column `{strange}`; those known are {}",
                KNOWN.join(", ")
            ));
        }
        let twice = names.iter().enumerate().find(|(i, name)| names[..*i].contains(name));
        if let Some((_, name)) = twice {
            return Err(format!("column `{name}` is there twice"));
        }
        let places = KNOWN.map(|name| names.iter().position(|n| *n == name));
        if let Some(missing) = (0..7).find(|i| places[*i].is_none()) {
            return Err(format!("there is no column `{}`", KNOWN[missing]));
        }
        Ok(Self { places, count: names.len() })
    }

    fn angle(&self, line: &str) -> Result<MeasuredAngle, String> {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        if cells.len() != self.count {
            return Err(format!("expected {} values, found {}", self.count, cells.len()));
        }
        let cells = Cells { cells: &cells, places: &self.places };
        let order =
            |at: usize| Ok::<_, String>(Order { m: cells.whole(at)?, n: cells.whole(at + 1)? });
        let (from, to) = (order(0)?, order(2)?);
        let axis = match cells.text(4) {
            Some("horizontal") => StageAxis::Horizontal,
            Some("vertical") => StageAxis::Vertical,
            other => {
                let found = other.unwrap_or_default();
                return Err(format!(
                    "column `axis`: expected horizontal or vertical, found `{found}`"
                ));
            }
        };
        let moved = match axis {
            StageAxis::Horizontal => to.m - from.m,
            StageAxis::Vertical => to.n - from.n,
        };
        if moved == 0 {
            let (name, order) =
                if axis == StageAxis::Horizontal { ("to_m", "m") } else { ("to_n", "n") };
            return Err(format!(
                "column `{name}`: a {} angle is between beams of different {order}",
                axis.name()
            ));
        }
        let angle = cells.number(6)?.ok_or("column `angle_deg` is missing")?.abs().to_radians();
        if !(angle > 0.0 && angle < std::f64::consts::PI) {
            return Err("column `angle_deg`: expected more than 0 and less than 180".to_owned());
        }
        let u = cells.above_zero(7)?.map(f64::to_radians);
        let wavelength_nm = cells.number(8)?;
        if wavelength_nm.is_some_and(|nm| !(200.0..=2000.0).contains(&nm)) {
            return Err("column `wavelength_nm`: expected 200 to 2000".to_owned());
        }
        let u_wavelength_nm = cells.number(9)?.unwrap_or(0.0);
        if u_wavelength_nm < 0.0 {
            return Err("column `u_wavelength_nm` must not be below 0".to_owned());
        }
        let repeat = cells.whole(5)?;
        let repeat = u32::try_from(repeat).map_err(|_| "column `repeat` must not be below 0")?;
        Ok(MeasuredAngle { from, to, axis, repeat, angle, u, wavelength_nm, u_wavelength_nm })
    }
}

/// The values of a line.
struct Cells<'a> {
    cells: &'a [&'a str],
    places: &'a [Option<usize>; 10],
}

impl Cells<'_> {
    fn text(&self, column: usize) -> Option<&str> {
        self.places[column].map(|at| self.cells[at])
    }

    fn whole(&self, column: usize) -> Result<i32, String> {
        let text = self.text(column).unwrap_or_default();
        let number = text.parse::<i32>().ok().filter(|n| n.abs() <= 10_000);
        number.ok_or_else(|| {
            format!("column `{}`: expected a whole number, found `{text}`", KNOWN[column])
        })
    }

    fn number(&self, column: usize) -> Result<Option<f64>, String> {
        let Some(text) = self.text(column) else { return Ok(None) };
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(Some(value)),
            _ => Err(format!("column `{}`: expected a number, found `{text}`", KNOWN[column])),
        }
    }

    fn above_zero(&self, column: usize) -> Result<Option<f64>, String> {
        match self.number(column)? {
            Some(value) if value <= 0.0 => {
                Err(format!("column `{}` must be above 0", KNOWN[column]))
            }
            value => Ok(value),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADING: &str = "from_m,from_n,to_m,to_n,axis,repeat,angle_deg";

    #[test]
    fn columns_may_stand_in_any_order_and_the_stage_may_count_either_way() {
        let text = "# a stage\naxis, repeat, angle_deg, from_m, from_n, to_m, to_n, wavelength_nm\n\
                    vertical, 2, -2.9, 0, -1, 0, 0, 658.1 # read back\n";
        let read = read_measured(text).unwrap();
        assert_eq!(read.len(), 1);
        assert_eq!((read[0].from, read[0].to), (Order { m: 0, n: -1 }, Order { m: 0, n: 0 }));
        assert_eq!((read[0].axis, read[0].repeat), (StageAxis::Vertical, 2));
        assert!((read[0].angle - 2.9f64.to_radians()).abs() < 1e-15);
        assert_eq!((read[0].u, read[0].wavelength_nm), (None, Some(658.1)));
    }

    #[test]
    fn a_table_that_is_wrong_is_refused_with_line_and_column() {
        let cases = [
            (String::new(), "1: the table is empty"),
            (HEADING.to_owned(), "1: there is no measurement below the heading"),
            ("from_m,from_n,to_m,to_n,axis,repeat".to_owned(), "1: there is no column `angle_deg`"),
            (format!("{HEADING},repeat"), "1: column `repeat` is there twice"),
            (format!("{HEADING}\n0,0,1,0,horizontal,1"), "2: expected 7 values, found 6"),
            (
                format!("{HEADING}\n0,0,1,0,across,1,2.9"),
                "2: column `axis`: expected horizontal or vertical, found `across`",
            ),
            (
                format!("{HEADING}\n0,0,1,0,vertical,1,2.9"),
                "2: column `to_n`: a vertical angle is between beams of different n",
            ),
            (
                format!("{HEADING}\n0,0,1,0,horizontal,1,NaN"),
                "2: column `angle_deg`: expected a number, found `NaN`",
            ),
            (
                format!("{HEADING}\n\n0,0,1.5,0,horizontal,1,2.9"),
                "3: column `to_m`: expected a whole number, found `1.5`",
            ),
            (
                format!("{HEADING}\n0,0,1,0,horizontal,1,0"),
                "2: column `angle_deg`: expected more than 0 and less than 180",
            ),
            (
                format!("{HEADING},u_deg\n0,0,1,0,horizontal,1,2.9,0"),
                "2: column `u_deg` must be above 0",
            ),
            (
                format!("{HEADING}\n0,0,1,0,horizontal,1,2.9\n0,0,1,0,horizontal,1,2.9"),
                "3: column `repeat`: 1 of this pair is there",
            ),
        ];
        for (text, expected) in cases {
            assert_eq!(read_measured(&text).unwrap_err().to_string(), expected);
        }
        let strange = read_measured("sharpness\n").unwrap_err().to_string();
        assert!(strange.starts_with("1: unknown column `sharpness`"), "{strange}");
    }
}
