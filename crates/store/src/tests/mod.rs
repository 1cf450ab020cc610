//! The store on a file of its own for each test.

mod batches;
mod calibrations;
mod cut_short;
mod keeping;
mod opening;
mod sessions;
mod solving;
mod transferring;
mod views;

use std::collections::BTreeMap;
use std::time::Duration;

use beampose_core::{
    CaptureId, CaptureRecord, Event, EventKind, InstrumentName, Picture, Quantity, Reading,
    RunSink, SessionHeader, SessionId, SessionOutcome, Stamp, StepNumber, StepOutcome, StepRecord,
    UsedFile,
};

use crate::Store;

/// A store in a folder that goes with it.
struct Fresh {
    store: Store,
    folder: tempfile::TempDir,
}

async fn fresh() -> Fresh {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(&folder.path().join("beampose.db")).await.unwrap();
    Fresh { store, folder }
}

fn at(milliseconds: u64) -> Stamp {
    let monotonic = Duration::from_millis(milliseconds);
    let start: jiff::Timestamp = "2026-03-01T08:00:00Z".parse().unwrap();
    Stamp { monotonic, utc: start + jiff::SignedDuration::try_from(monotonic).unwrap() }
}

fn header(id: SessionId) -> SessionHeader {
    SessionHeader {
        id,
        title: "rail test".to_owned(),
        experiment: "translation".to_owned(),
        plan_text: "version: 1".to_owned(),
        rig_text: "version: 1 # rig".to_owned(),
        measurement_json: "{\"version\":1}".to_owned(),
        files: vec![used(Some("cam_a"), "version: 1 # camera")],
        plan_hash: "00ff".to_owned(),
        origin_json: None,
        software: "0.1.0".to_owned(),
        seed: Some(u64::MAX),
        steps: 2,
        opened: at(0),
    }
}

fn picture(camera: &str, bytes: &[u8]) -> Picture {
    let camera = InstrumentName::from(camera);
    Picture { camera, bytes: bytes.to_vec(), requested: at(1500), delivered: at(2500) }
}

/// A file with this text, as a rig names it.
fn used(camera: Option<&str>, text: &str) -> UsedFile {
    let blake3 = blake3::hash(text.as_bytes()).to_hex().to_string();
    let file = format!("{}.yaml", camera.unwrap_or("fan"));
    UsedFile { camera: camera.map(InstrumentName::from), file, blake3 }
}

/// A capture step with a reading and an event.
fn step(number: u32, capture: &str, pictures: Vec<Picture>) -> StepRecord {
    let reading = Reading {
        quantity: Quantity::Wavelength,
        value: 658.02,
        standard_uncertainty: Some(0.01),
        at: at(1250),
    };
    StepRecord {
        number: StepNumber(number),
        label: format!("capture {capture}"),
        kind: "capture".to_owned(),
        started: at(1000),
        finished: at(3000),
        outcome: StepOutcome::Done,
        readings: vec![("wavemeter".into(), reading)],
        capture: Some(CaptureRecord {
            id: capture.into(),
            setpoints: BTreeMap::from([("rail_mm".to_owned(), 300.0)]),
            readings: BTreeMap::from([("rail_mm".to_owned(), 300.0 + 1.0 / 3.0)]),
            pictures,
        }),
        missing: Vec::new(),
        answer: None,
        looks: Vec::new(),
        events: vec![event(EventKind::LaserOn, "laser on (step 1)")],
    }
}

fn event(kind: EventKind, message: &str) -> Event {
    Event { at: at(1100), kind, message: message.to_owned() }
}

/// A closed session with the captures `p000` and `p001`, which share a picture.
async fn session(store: &Store) -> SessionId {
    let id = SessionId::fresh();
    store.open(&header(id)).await.unwrap();
    let first = vec![picture("cam_a", b"wall"), picture("cam_b", b"dots")];
    store.step(id, &step(1, "p000", first)).await.unwrap();
    store.step(id, &step(2, "p001", vec![picture("cam_a", b"wall")])).await.unwrap();
    let end = [event(EventKind::Closed, "session closed: completed")];
    RunSink::close(store, id, SessionOutcome::Completed, &end, at(9000)).await.unwrap();
    id
}

fn p000() -> CaptureId {
    "p000".into()
}
