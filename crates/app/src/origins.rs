//! Where what solving was told comes from: from a processing's files to recorded calibrations, and to
//! the sessions that those were made from.

use beampose_analysis::report::{CalibrationOrigin, InputOrigin, SourceOrigin};
use beampose_core::UsedFile;
use beampose_store::{
    CalibrationHead, CalibrationSource, Kept, Processing, Store, StoreError, StoredSession,
};

/// The files of a processing: its own, else those that the session was run with.
pub fn files_of<'a>(session: &'a StoredSession, processing: &'a Processing) -> &'a [UsedFile] {
    let own = &processing.start.files;
    if own.is_empty() { &session.header.files } else { own }
}

/// The origin of each file.
///
/// # Errors
/// When the store fails.
pub async fn origins(store: &Store, files: &[UsedFile]) -> Result<Vec<InputOrigin>, StoreError> {
    let mut all = Vec::new();
    for used in files {
        let calibration = store.calibration_of_file(&used.blake3).await?;
        all.push(InputOrigin {
            camera: used.camera.as_ref().map(|camera| camera.as_str().to_owned()),
            file: used.file.clone(),
            blake3: used.blake3.clone(),
            calibration: calibration.as_ref().map(origin),
        });
    }
    Ok(all)
}

/// A recorded calibration as reports tell of it.
pub fn origin(head: &CalibrationHead) -> CalibrationOrigin {
    CalibrationOrigin {
        blake3: head.blake3.clone(),
        name: head.name.clone(),
        method: head.method.clone(),
        created_utc: head.created.to_string(),
        software: head.software.clone(),
        made_from: head.sources.iter().map(source).collect(),
    }
}

fn source(source: &CalibrationSource) -> SourceOrigin {
    match source {
        CalibrationSource::Session { id, title, plan_hash, processing, kept } => {
            SourceOrigin::Session {
                session: id.to_string(),
                title: title.clone(),
                plan_blake3: plan_hash.clone(),
                processing_utc: processing.map(|at| at.to_string()),
                state: state(*kept),
            }
        }
        CalibrationSource::File { name, blake3 } => {
            SourceOrigin::File { name: name.clone(), blake3: blake3.clone() }
        }
    }
}

fn state(kept: Kept) -> String {
    match kept {
        Kept::Here => "stored".to_owned(),
        Kept::Deleted(at) => format!("deleted {at}"),
        Kept::Elsewhere => "not in this database".to_owned(),
    }
}
