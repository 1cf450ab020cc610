//! `pattern.yaml`, the format of the exchange folder.

use serde::Deserialize;

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

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PatternFile {
    version: u32,
    columns: u32,
    rows: u32,
    reference_wavelength_nm: f64,
    model: ModelFile,
    u: PatternUncertainty,
    #[serde(default)]
    zero_order_relative_intensity: Option<f64>,
}

/// [`PatternModel`] as files write it.
#[derive(Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum ModelFile {
    RadialGrid { pitch_mm: f64, k1_per_mm2: f64, distance_mm: f64 },
    Table(TableForm),
}

/// A table stands in the pattern file itself or in a file that it names.
#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum TableForm {
    Tangents(Vec<[f64; 2]>),
    File(String),
}

/// Reads a `pattern.yaml` that stands alone: one whose table is in another file is refused.
///
/// # Errors
/// [`PatternFileError`].
pub fn read_pattern(text: &str) -> Result<Pattern, PatternFileError> {
    read_pattern_with(text, |file, _| Err(format!("the table of beams is in another file: {file}")))
}

/// Reads `pattern.yaml`. This crate opens no files: where the model is `table: {file: ...}`,
/// `table_file` is given that name and the numbers of columns and rows, and gives back
/// [`PatternModel::Table`]'s tangents.
///
/// # Errors
/// [`PatternFileError`]; what `table_file` says is a [`PatternFileError::Value`].
pub fn read_pattern_with(
    text: &str,
    table_file: impl FnOnce(&str, [u32; 2]) -> Result<Vec<[f64; 2]>, String>,
) -> Result<Pattern, PatternFileError> {
    let file: PatternFile =
        serde_yaml::from_str(text).map_err(|e| PatternFileError::Syntax(e.to_string()))?;
    check(&file).map_err(PatternFileError::Value)?;
    let model = match file.model {
        ModelFile::RadialGrid { pitch_mm, k1_per_mm2, distance_mm } => {
            PatternModel::RadialGrid { pitch_mm, k1_per_mm2, distance_mm }
        }
        ModelFile::Table(TableForm::Tangents(tangents)) => PatternModel::Table { tangents },
        ModelFile::Table(TableForm::File(name)) => {
            let tangents =
                table_file(&name, [file.columns, file.rows]).map_err(PatternFileError::Value)?;
            PatternModel::Table { tangents }
        }
    };
    let pattern = Pattern {
        columns: file.columns,
        rows: file.rows,
        reference_wavelength_nm: file.reference_wavelength_nm,
        model,
        u: file.u,
        zero_order_relative_intensity: file.zero_order_relative_intensity,
    };
    whole(&pattern).map_err(PatternFileError::Value)?;
    Ok(pattern)
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
    Ok(())
}

/// A table has every beam.
fn whole(pattern: &Pattern) -> Result<(), String> {
    let expected = (pattern.rows * pattern.columns) as usize;
    match &pattern.model {
        PatternModel::Table { tangents } if tangents.len() != expected => {
            Err(format!("the table has {} beams, expected {expected}", tangents.len()))
        }
        PatternModel::Table { .. } | PatternModel::RadialGrid { .. } => Ok(()),
    }
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
                tangents.iter().map(|t| format!("        - [{:e}, {:e}]", t[0], t[1])).collect();
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
