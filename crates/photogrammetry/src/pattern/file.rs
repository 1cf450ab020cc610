//! `pattern.yaml`, the format of the exchange folder.

use serde::{Deserialize, Serialize};

use super::{Pattern, PatternModel, PatternUncertainty};

/// Why a pattern file cannot be used.
#[derive(Debug, Clone, thiserror::Error)]
pub enum PatternFileError {
    /// Not YAML of the right form; the reader's words hold line and column.
    #[error("{0}")]
    Syntax(String),
    /// A number that makes no sense.
    #[error("{0}")]
    Value(String),
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PatternFile {
    version: u32,
    columns: u32,
    rows: u32,
    reference_wavelength_nm: f64,
    model: PatternModel,
    u: PatternUncertainty,
    #[serde(default)]
    zero_order_relative_intensity: Option<f64>,
}

/// Reads `pattern.yaml`.
///
/// # Errors
/// [`PatternFileError`].
pub fn read_pattern(text: &str) -> Result<Pattern, PatternFileError> {
    let file: PatternFile =
        serde_yaml::from_str(text).map_err(|e| PatternFileError::Syntax(e.to_string()))?;
    check(&file).map_err(PatternFileError::Value)?;
    Ok(Pattern {
        columns: file.columns,
        rows: file.rows,
        reference_wavelength_nm: file.reference_wavelength_nm,
        model: file.model,
        u: file.u,
        zero_order_relative_intensity: file.zero_order_relative_intensity,
    })
}

fn check(file: &PatternFile) -> Result<(), String> {
    let odd = |name: &str, n: u32| match n {
        3..=201 if n % 2 == 1 => Ok(()),
        _ => Err(format!("{name} is {n}, expected an odd number from 3 to 201")),
    };
    if file.version != 1 {
        return Err(format!("version is {}, this program reads version 1", file.version));
    }
    odd("columns", file.columns)?;
    odd("rows", file.rows)?;
    if !(200.0..=2000.0).contains(&file.reference_wavelength_nm) {
        return Err(format!(
            "reference_wavelength_nm is {}, expected 200 to 2000",
            file.reference_wavelength_nm
        ));
    }
    if !(file.u.angle_deg > 0.0 && file.u.common_relative >= 0.0) {
        return Err("u.angle_deg must be above 0 and u.common_relative not below 0".to_owned());
    }
    if let PatternModel::Table { tangents } = &file.model
        && tangents.len() != (file.rows * file.columns) as usize
    {
        return Err(format!(
            "the table has {} beams, expected {}",
            tangents.len(),
            file.rows * file.columns
        ));
    }
    Ok(())
}

/// Writes `pattern.yaml` (JSON is YAML: numbers keep all their digits).
#[must_use]
pub fn write_pattern(pattern: &Pattern) -> String {
    use std::fmt::Write as _;
    let model = match &pattern.model {
        PatternModel::RadialGrid { pitch_mm, k1_per_mm2, distance_mm } => format!(
            "radial_grid: {{pitch_mm: {pitch_mm}, k1_per_mm2: {k1_per_mm2:e}, distance_mm: {distance_mm}}}"
        ),
        PatternModel::Table { tangents } => {
            let rows: Vec<String> =
                tangents.iter().map(|t| format!("    - [{:e}, {:e}]", t[0], t[1])).collect();
            format!("table:\n      tangents:\n{}", rows.join("\n"))
        }
    };
    let mut text = format!(
        "version: 1\ncolumns: {}\nrows: {}\nreference_wavelength_nm: {}\nmodel:\n  {model}\n\
         u: {{angle_deg: {}, common_relative: {}}}\n",
        pattern.columns,
        pattern.rows,
        pattern.reference_wavelength_nm,
        pattern.u.angle_deg,
        pattern.u.common_relative
    );
    if let Some(z) = pattern.zero_order_relative_intensity {
        let _ = writeln!(text, "zero_order_relative_intensity: {z}");
    }
    text
}
