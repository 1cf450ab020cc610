//! Calibrations as they are recorded: the file, what it is worth, and what it was made from.
//!
//! To record another kind of calibration: a function here that makes the record, called where its
//! files are written.

use beampose_analysis::{
    CalibrationReport, FanReport, InputFile, ReportInput, SessionFanReport, calibration_json,
    fan_json, nearest_grid_covariance, session_fan_json,
};
use beampose_core::SessionHeader;
use beampose_photogrammetry::calibrate::{Interior, write_calibration};
use beampose_photogrammetry::pattern::write_pattern;
use beampose_store::{
    Calibration, CalibrationHead, CalibrationKind, CalibrationSource, Kept, Store, StoreError,
};
use serde_json::{Value, json};

use crate::angle_report::measured_csv;
use crate::pipeline::SOFTWARE;

/// Characters of a hash that people are shown: enough to tell calibrations apart.
const SHOWN: usize = 12;

/// The beginning of a calibration's hash, for people.
pub fn short(blake3: &str) -> &str {
    blake3.get(..SHOWN).unwrap_or(blake3)
}

/// The name under which people find a recorded calibration.
pub fn told(record: &Calibration) -> String {
    format!("calibration {} {}", short(&record.head.blake3), record.head.name)
}

/// A fan measured on a stage, from the report's files and these sessions.
pub fn of_stage(report: &FanReport, sessions: Vec<CalibrationSource>) -> Calibration {
    let (result, options) = (fan_json(report), report.options);
    let told = json!({
        "command": report.command,
        "model": report.found.fit.model.name(),
        "reference_wavelength_nm": options.reference_wavelength_nm,
        "wavelength_was_read": report.wavelength_was_read,
        "plane_mm": options.geometry.distance,
        "u_offset_mm": options.u_offset,
        "u_wavelength_nm": options.u_wavelength_nm,
        "u_stage_deg": options.u_stage.to_degrees(),
    });
    let fit = |key: &str| result["fit"][key].clone();
    let sources = sessions.into_iter().chain(files(report.inputs)).collect();
    Draft {
        kind: CalibrationKind::Pattern,
        name: &report.name,
        method: "rotation stage",
        content: write_pattern(&report.found.pattern),
        options: told,
        parameters: fit("parameters"),
        covariance: fit("covariance"),
        result,
        sources,
    }
    .record()
}

/// A fan from the photographs of sessions.
pub fn of_photographs(report: &SessionFanReport, sessions: Vec<CalibrationSource>) -> Calibration {
    let result = session_fan_json(report);
    Draft {
        kind: CalibrationKind::Pattern,
        name: &report.name,
        method: "photographs of sessions",
        content: write_pattern(&report.found.pattern),
        options: json!({ "prior": result["prior"] }),
        parameters: result["radial_grid"].clone(),
        covariance: json!(nearest_grid_covariance(report.found)),
        result,
        sources: sessions,
    }
    .record()
}

/// A camera from pictures of a sheet, or from points.
pub fn of_sheet(report: &CalibrationReport) -> Calibration {
    let result = calibration_json(report);
    let found = report.found;
    let parameter = |p: Interior| {
        let u = found.standard_deviation(p);
        json!({ "name": p.name(), "value": p.of(&found.camera), "u": u })
    };
    Draft {
        kind: CalibrationKind::Camera,
        name: &report.name,
        method: "sheet of dots",
        content: write_calibration(&report.name, found),
        options: json!({ "command": report.options }),
        parameters: found.unknowns.iter().map(parameter).collect(),
        covariance: result["covariance"].clone(),
        result,
        sources: files(report.inputs).collect(),
    }
    .record()
}

/// The fan that a session measured, if it did.
pub fn of_run(input: &ReportInput, header: &SessionHeader) -> Option<Calibration> {
    let angles = input.angles.as_ref()?;
    let inputs = [measured_csv(angles, header.id).1];
    let fan = angles.fan("fan", &inputs, format!("session {}", header.id), SOFTWARE)?;
    Some(of_stage(&fan, vec![session(header, None)]))
}

/// Records the fan that a session measured, if it did.
///
/// # Errors
/// When the store fails.
pub async fn record_run(
    store: &Store,
    input: &ReportInput,
    header: &SessionHeader,
) -> Result<Option<Calibration>, StoreError> {
    let record = of_run(input, header);
    if let Some(record) = &record {
        store.record_calibration(record).await?;
    }
    Ok(record)
}

/// A session that something is made from; the processing by when it was begun.
pub fn session(header: &SessionHeader, processing: Option<jiff::Timestamp>) -> CalibrationSource {
    CalibrationSource::Session {
        id: header.id,
        title: header.title.clone(),
        plan_hash: header.plan_hash.clone(),
        processing,
        kept: Kept::Here,
    }
}

fn files(inputs: &[InputFile]) -> impl Iterator<Item = CalibrationSource> {
    inputs
        .iter()
        .map(|i| CalibrationSource::File { name: i.name.clone(), blake3: i.blake3.clone() })
}

/// What differs from method to method.
struct Draft<'a> {
    kind: CalibrationKind,
    name: &'a str,
    method: &'a str,
    content: String,
    options: Value,
    parameters: Value,
    covariance: Value,
    result: Value,
    sources: Vec<CalibrationSource>,
}

impl Draft<'_> {
    fn record(self) -> Calibration {
        Calibration {
            head: CalibrationHead {
                blake3: blake3::hash(self.content.as_bytes()).to_hex().to_string(),
                kind: self.kind,
                name: self.name.to_owned(),
                method: self.method.to_owned(),
                created: jiff::Timestamp::now(),
                software: SOFTWARE.to_owned(),
                sources: self.sources,
            },
            options_json: self.options.to_string(),
            content: self.content,
            parameters_json: self.parameters.to_string(),
            covariance_json: self.covariance.to_string(),
            result_json: self.result.to_string(),
        }
    }
}
