//! What the store did not take is written beside the report, so that nothing is lost.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use beampose_core::{Picture, Reading, StepOutcome, StepRecord};
use serde_json::{Value, json};

/// Writes steps that could not be stored into `folder/rescued`: a JSON file for each, beside its
/// pictures as the cameras delivered them. Returns that folder.
///
/// # Errors
/// When it cannot be written: what, and why.
pub fn rescue(folder: &Path, records: &[StepRecord]) -> anyhow::Result<PathBuf> {
    let rescued = folder.join("rescued");
    std::fs::create_dir_all(&rescued).with_context(|| rescued.display().to_string())?;
    for record in records {
        let name = format!("step-{:05}", record.number.0);
        let write = |end: &str, bytes: &[u8]| {
            let path = rescued.join(format!("{name}{end}"));
            std::fs::write(&path, bytes).with_context(|| path.display().to_string())
        };
        for picture in record.capture.iter().flat_map(|capture| &capture.pictures) {
            write(&format!("-{}{}", picture.camera, ending(picture)), &picture.bytes)?;
        }
        write(".json", serde_json::to_string_pretty(&shown(record))?.as_bytes())?;
    }
    Ok(rescued)
}

fn ending(picture: &Picture) -> &'static str {
    if picture.bytes.starts_with(b"\x89PNG") { ".png" } else { ".jpg" }
}

fn shown(record: &StepRecord) -> Value {
    let reading = |(instrument, reading): &(beampose_core::InstrumentName, Reading)| json!({ "instrument": instrument, "reading": reading });
    let capture = record.capture.as_ref().map(|capture| {
        let picture = |p: &Picture| {
            json!({ "camera": p.camera, "requested": p.requested, "delivered": p.delivered })
        };
        json!({
            "id": capture.id,
            "setpoints": capture.setpoints,
            "readings": capture.readings,
            "pictures": capture.pictures.iter().map(picture).collect::<Vec<_>>(),
        })
    });
    let (outcome, reason) = match &record.outcome {
        StepOutcome::Done => ("done", None),
        StepOutcome::Failed { reason } => ("failed", Some(reason)),
        StepOutcome::PassedOver { reason } => ("passed_over", Some(reason)),
        StepOutcome::Skipped => ("skipped", None),
    };
    json!({
        "number": record.number,
        "label": record.label,
        "kind": record.kind,
        "started": record.started,
        "finished": record.finished,
        "outcome": outcome,
        "reason": reason,
        "readings": record.readings.iter().map(reading).collect::<Vec<_>>(),
        "capture": capture,
        "missing": record.missing,
        "answer": record.answer,
        "events": record.events,
    })
}
