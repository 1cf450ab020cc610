//! `beampose import`.

use std::path::PathBuf;

use beampose_core::{
    CaptureRecord, Clock as _, Event, EventKind, InstrumentName, Picture, RunSink as _,
    SessionHeader, SessionId, SessionOutcome, StepNumber, StepOutcome, StepRecord,
};
use beampose_engine::RealClock;
use beampose_exchange::{Folder, ForeignCapture, ForeignSession, picture_kind};
use beampose_store::Store;

use super::{Database, Ended, close};
use crate::output::{Exit, complain, print};
use crate::pipeline::SOFTWARE;

/// Make a session from pictures that another program took
///
/// FOLDER holds `session.yaml`, the cameras' calibrations as ROS `camera_info` YAML, the pattern and
/// the pictures (JPEG or PNG, kept as they are; at most 200 MB each). Nothing outside of FOLDER is
/// read: absolute paths, `..` and links that lead out are refused. All faults are told at once, and
/// nothing is stored then.
///
/// The pattern's `table: {file: beams.csv}` names a CSV file with the heading `m,n,x,y` (beam (m, n)
/// goes through (x, y, 1) in the module frame: x right, y down, z forward) or `m,n,x,y,z` (through
/// (x, y, z)).
///
/// What the format does not say is taken from the published repeatability of such calibrations:
/// standard uncertainties of 1.6 um for the focal length and 1.4 and 0.6 um for the principal point
/// (x, y) at 6 mm focal length and 1.7 um pixels, hence 0.94, 0.82 and 0.35 pixels at fx = 3529
/// pixels, in proportion to fx for others; and 0.1 nm for the wavelength reading.
///
/// The session is not solved yet: `beampose solve latest --method virtual-camera --json`.
#[derive(clap::Args)]
pub struct Import {
    /// The folder with session.yaml
    folder: PathBuf,
    /// Print one JSON object: captures, pictures, session
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

impl Import {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let folder = Folder::open(&self.folder).map_err(Ended::input)?;
        let foreign =
            beampose_exchange::read(&folder).map_err(|faults| Ended::input(faults.to_string()))?;
        let store = self.database.open().await?;
        let kept = keep(&store, &folder, &foreign).await;
        close(store).await;
        let session = kept?;
        let captures = foreign.captures.len();
        let pictures: usize = foreign.captures.iter().map(|c| c.pictures.len()).sum();
        if self.json {
            let object = serde_json::json!({
                "title": foreign.title,
                "captures": captures,
                "pictures": pictures,
                "session": session.to_string(),
            });
            print(&object.to_string());
        } else {
            print(&format!("session {session}: {captures} captures, {pictures} pictures imported"));
        }
        Ok(Exit::Success)
    }
}

/// Stores it as a session of one step a capture. A session that fails half-way is closed as such.
async fn keep(
    store: &Store,
    folder: &Folder,
    foreign: &ForeignSession,
) -> anyhow::Result<SessionId> {
    let clock = RealClock::start();
    let header = header(foreign, &clock)?;
    store.open(&header).await?;
    let kept = keep_captures(store, header.id, folder, foreign, &clock).await;
    let (outcome, message) = match &kept {
        Ok(()) => (SessionOutcome::Completed, "imported".to_owned()),
        Err(error) => (SessionOutcome::Error, format!("import failed: {error}")),
    };
    let at = clock.now();
    let event = Event { at, kind: EventKind::Closed, message };
    let closed = store.close(header.id, outcome, &[event], at).await;
    // Why it failed says more than that it cannot be closed.
    kept?;
    closed?;
    Ok(header.id)
}

fn header(foreign: &ForeignSession, clock: &RealClock) -> anyhow::Result<SessionHeader> {
    Ok(SessionHeader {
        id: SessionId::fresh(),
        title: foreign.title.clone(),
        experiment: "acquisition".to_owned(),
        // No plan was run: reports tell an imported session by that.
        plan_text: String::new(),
        rig_text: foreign.text.clone(),
        measurement_json: serde_json::to_string(&foreign.setup)?,
        files: foreign.files.clone(),
        plan_hash: blake3::hash(foreign.text.as_bytes()).to_hex().to_string(),
        origin_json: None,
        software: SOFTWARE.to_owned(),
        seed: None,
        steps: u32::try_from(foreign.captures.len())?,
        opened: clock.now(),
    })
}

async fn keep_captures(
    store: &Store,
    session: SessionId,
    folder: &Folder,
    foreign: &ForeignSession,
    clock: &RealClock,
) -> anyhow::Result<()> {
    for (number, capture) in (1..).zip(&foreign.captures) {
        let record = step(StepNumber(number), folder, capture, clock)?;
        store.step(session, &record).await?;
    }
    Ok(())
}

/// One capture with its pictures. When it was taken the format does not say: its times are those of
/// the import.
fn step(
    number: StepNumber,
    folder: &Folder,
    capture: &ForeignCapture,
    clock: &RealClock,
) -> anyhow::Result<StepRecord> {
    let started = clock.now();
    let mut pictures = Vec::new();
    for (camera, name) in &capture.pictures {
        pictures.push(picture(folder, camera, name, clock)?);
    }
    Ok(StepRecord {
        number,
        label: format!("import {}", capture.id),
        kind: "import".to_owned(),
        started,
        finished: clock.now(),
        outcome: StepOutcome::Done,
        readings: Vec::new(),
        capture: Some(CaptureRecord {
            id: capture.id.clone(),
            setpoints: capture.setpoints.clone(),
            readings: capture.readings.clone(),
            pictures,
        }),
        missing: Vec::new(),
        answer: None,
        looks: Vec::new(),
        events: Vec::new(),
    })
}

fn picture(
    folder: &Folder,
    camera: &InstrumentName,
    name: &str,
    clock: &RealClock,
) -> anyhow::Result<Picture> {
    let shown = folder.shown(name);
    let requested = clock.now();
    let bytes = folder.bytes(name).map_err(|why| anyhow::anyhow!("{shown}: {why}"))?;
    if picture_kind(&bytes).is_none() {
        // The other cameras may do: solving says what it is without.
        complain(&format!("{shown}: warning: neither JPEG nor PNG; it cannot be solved"));
    }
    Ok(Picture { camera: camera.clone(), bytes, requested, delivered: clock.now() })
}
