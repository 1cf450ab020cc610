//! What the report is made from: plain data that the app fills from the store.

use std::collections::BTreeMap;

use beampose_core::{
    CaptureId, Identity, InstrumentName, Pose, Quantity, Reading, SessionId, SessionOutcome, Stamp,
};
use beampose_photogrammetry::solve::{CaptureSolution, Method, MethodResult, StageSeconds};
use beampose_photogrammetry::{GrayImage, Wavelength};
use serde::Serialize;

use crate::beam_angles::BeamAngles;
use crate::score::MethodScore;
use crate::side_by_side::Evaluation;
use crate::translation::TranslationResult;
use crate::verdict::Verdict;
use crate::wavelength_drift::WavelengthDrift;

/// Everything that a report shows.
#[derive(Debug, Clone)]
pub struct ReportInput {
    /// The plan's title.
    pub title: String,
    /// The experiment's kind, as in `translation`.
    pub experiment: String,
    /// The verdict on the session: [`Verdict::of_session`].
    pub verdict: Verdict,
    /// Why, one sentence each (for a translation test its `reasons`; else the session's).
    pub reasons: Vec<String>,
    /// The methods asked for, also those that gave nothing.
    pub methods: Vec<Method>,
    /// The captures in the order in which they were taken, solved or not.
    pub captures: Vec<ReportCapture>,
    /// The result, if the experiment is a translation test.
    pub translation: Option<TranslationResult>,
    /// The session evaluated in several ways, if it is a translation test that was; in the order in
    /// which they are shown, those of one processing together.
    pub side_by_side: Vec<Evaluation>,
    /// The result and its series, if the experiment is a wavelength drift.
    pub drift: Option<WavelengthDrift>,
    /// The fan, if the experiment is a beam-angle calibration.
    pub angles: Option<BeamAngles>,
    /// Against the truth, if somebody knows it; empty otherwise.
    pub scores: BTreeMap<Method, MethodScore>,
    /// Decoded pictures to show; one capture, all cameras is a good choice. They are reduced to
    /// about [`super::PICTURE_WIDTH`] pixels of width.
    pub pictures: Vec<ReportPicture>,
    /// Width and height of each camera's pictures in pixels, for the residual plots.
    pub frames_px: BTreeMap<String, [usize; 2]>,
    /// Readings over the session, one trace per instrument and quantity; any quantity.
    pub environment: Vec<Trace>,
    /// Where it all comes from.
    pub provenance: Provenance,
    /// Where the session was interrupted and went on, in order of time.
    pub interruptions: Vec<Interruption>,
    /// Remarks on the session as a whole.
    pub notes: Vec<String>,
}

/// A time in which a session did not run.
#[derive(Debug, Clone, PartialEq)]
pub struct Interruption {
    /// When the last thing that is known of the run happened.
    pub stopped: Stamp,
    /// When the session went on.
    pub resumed: Stamp,
    /// How the run had ended.
    pub reason: String,
    /// What was re-established before the first step, for people.
    pub restored: Vec<String>,
    /// Steps that were done again.
    pub redone: Vec<RedoneStep>,
}

impl Interruption {
    /// How long it lasted, by the session's own clock, which never goes back.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        self.resumed.monotonic.saturating_sub(self.stopped.monotonic).as_secs_f64()
    }
}

/// A step that was done again after an interruption.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RedoneStep {
    /// Its number in the plan.
    pub number: u32,
    /// What it does, for people.
    pub label: String,
    /// How it had ended before.
    pub before: String,
}

/// One capture in the report.
#[derive(Debug, Clone)]
pub struct ReportCapture {
    /// Its name.
    pub id: CaptureId,
    /// When it was triggered, if known.
    pub at: Option<Stamp>,
    /// Setpoints and loop counters, keyed as `rail_mm`, `pass`.
    pub setpoints: BTreeMap<String, f64>,
    /// Readings nearest to the trigger, keyed as `rail_mm`, `wavelength_nm`.
    pub readings: BTreeMap<String, f64>,
    /// What is known of the wavelength there when all captures are adjusted together; `None` where
    /// nobody says.
    pub wavelength: Option<Wavelength>,
    /// What solving gave, or why nothing was solved at all.
    pub solution: Result<CaptureSolution, String>,
    /// Where the time went; zeros where nobody looked at a clock.
    pub seconds: StageSeconds,
}

/// One decoded picture.
#[derive(Debug, Clone)]
pub struct ReportPicture {
    /// Which capture.
    pub capture: CaptureId,
    /// Which camera, by its name in the solution.
    pub camera: String,
    /// The picture at full size.
    pub image: GrayImage,
}

/// One instrument's readings of one quantity over the session.
#[derive(Debug, Clone)]
pub struct Trace {
    /// The instrument.
    pub instrument: InstrumentName,
    /// What it reads.
    pub quantity: Quantity,
    /// The readings in order of time.
    pub readings: Vec<Reading>,
}

/// Where a report comes from.
#[derive(Debug, Clone)]
pub struct Provenance {
    /// The session.
    pub session: SessionId,
    /// How the session ended.
    pub outcome: SessionOutcome,
    /// When it began.
    pub opened: Stamp,
    /// When it ended, if it did.
    pub closed: Option<Stamp>,
    /// The processing shown: its id in the store.
    pub processing: String,
    /// The program's version that acquired.
    pub acquired_with: String,
    /// The program's version that solved.
    pub processed_with: String,
    /// The options of the processing, name and value.
    pub options: BTreeMap<String, String>,
    /// Hashes by what they are of: `plan`, `inputs`, `calibration`.
    pub hashes: BTreeMap<String, String>,
    /// The files that solving was told, and where they come from.
    pub inputs: Vec<InputOrigin>,
    /// The simulation's seed, if simulated.
    pub seed: Option<u64>,
    /// The instruments and what they said of themselves.
    pub instruments: BTreeMap<InstrumentName, Identity>,
    /// The plan's text as run; empty for an imported session.
    pub plan_text: String,
    /// The rig's text as run; empty for an imported session.
    pub rig_text: String,
}

/// A file that solving was told.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct InputOrigin {
    /// The camera that it calibrates; `None` for the pattern.
    pub camera: Option<String>,
    /// Its name.
    pub file: String,
    /// BLAKE3 of its bytes.
    pub blake3: String,
    /// The recorded calibration that it is, if it is one.
    pub calibration: Option<CalibrationOrigin>,
}

/// A recorded calibration.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CalibrationOrigin {
    /// What it is known by: BLAKE3 of its file.
    pub blake3: String,
    /// Its name.
    pub name: String,
    /// How it was made.
    pub method: String,
    /// When, RFC 3339.
    pub created_utc: String,
    /// The program's version.
    pub software: String,
    /// From what.
    pub made_from: Vec<SourceOrigin>,
}

/// What a calibration was made from.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum SourceOrigin {
    /// A session.
    Session {
        /// Its id.
        session: String,
        /// Its title.
        title: String,
        /// BLAKE3 over its expanded steps.
        plan_blake3: String,
        /// When the processing was begun that it was made from, RFC 3339; `None` where readings
        /// alone were used.
        processing_utc: Option<String>,
        /// Where the session is now: `stored`, `deleted` and when, `not in this database`.
        state: String,
    },
    /// A file.
    File {
        /// Its name.
        name: String,
        /// BLAKE3 of its bytes.
        blake3: String,
    },
}

impl ReportCapture {
    /// A method's result, solved or not.
    #[must_use]
    pub fn result(&self, method: Method) -> Option<&MethodResult> {
        self.solution.as_ref().ok()?.results.iter().find(|r| r.method == method)
    }

    /// A method's pose, if it gave one.
    #[must_use]
    pub fn pose(&self, method: Method) -> Option<&Pose> {
        self.result(method)?.pose.as_ref().ok()
    }
}
