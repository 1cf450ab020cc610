//! What the store gives and takes beside the words of `core`: plain data.

use std::collections::BTreeMap;
use std::fmt;

use beampose_core::{
    CaptureId, Event, InstrumentName, Pose, Reading, SessionHeader, SessionId, SessionOutcome,
    Stamp, StepNumber, StepOutcome, UsedFile,
};
use serde::{Deserialize, Serialize};

/// One session in a list.
#[derive(Debug, Clone, PartialEq)]
pub struct SessionSummary {
    /// Its id.
    pub id: SessionId,
    /// The plan's title.
    pub title: String,
    /// The experiment's kind.
    pub experiment: String,
    /// When it began.
    pub opened: Stamp,
    /// When it ended; `None` while it runs, or where the program died.
    pub closed: Option<Stamp>,
    /// How it ended.
    pub outcome: Option<SessionOutcome>,
    /// Steps in its plan.
    pub steps: u32,
    /// Steps stored.
    pub steps_stored: u64,
    /// Captures stored.
    pub captures: u64,
    /// Captures with at least one pose in the latest processing.
    pub solved: u64,
    /// True where it has a simulation's seed.
    pub simulated: bool,
    /// Its tags, by their names.
    pub tags: Vec<String>,
    /// The verdict of its newest result, a word; `None` where nothing was analysed yet.
    pub verdict: Option<String>,
}

/// What somebody wrote of a session.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Note {
    /// When.
    pub written: jiff::Timestamp,
    /// What.
    pub text: String,
}

/// A step as it ended before a gap; it was done again after it.
#[derive(Debug, Clone, PartialEq)]
pub struct Attempt {
    /// Which of the session's gaps, counted from 0 in their order.
    pub gap: usize,
    /// The step as it was.
    pub step: StoredStep,
    /// True where it had taken a capture.
    pub captured: bool,
}

/// A session's header and how it ended.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredSession {
    /// As it was opened.
    pub header: SessionHeader,
    /// When it ended, if it did.
    pub closed: Option<Stamp>,
    /// How it ended.
    pub outcome: Option<SessionOutcome>,
}

/// A step that was run.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredStep {
    /// Its place in the plan.
    pub number: StepNumber,
    /// What it did, for people.
    pub label: String,
    /// Its kind.
    pub kind: String,
    /// When it began.
    pub started: Stamp,
    /// When it ended.
    pub finished: Stamp,
    /// How it ended.
    pub outcome: StepOutcome,
}

/// An event with the step in whose transaction it was stored.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredEvent {
    /// The step; `None` when the session closed.
    pub step: Option<StepNumber>,
    /// What happened.
    pub event: Event,
}

/// A reading with who gave it in which step.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredReading {
    /// In which step.
    pub step: StepNumber,
    /// Who gave it.
    pub instrument: InstrumentName,
    /// What was read.
    pub reading: Reading,
}

/// A capture without its pictures' bytes.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredCapture {
    /// Its name within the session.
    pub id: CaptureId,
    /// The step that took it.
    pub step: StepNumber,
    /// Where every axis was told to be, keyed as `rail_mm`; also loop counters.
    pub setpoints: BTreeMap<String, f64>,
    /// What was read nearest to the trigger, keyed as `rail_mm`.
    pub readings: BTreeMap<String, f64>,
    /// When the first camera was triggered.
    pub triggered: Stamp,
    /// Its pictures, by the cameras' names.
    pub pictures: Vec<PictureInfo>,
}

/// A stored picture, without its bytes.
#[derive(Debug, Clone, PartialEq)]
pub struct PictureInfo {
    /// Which camera took it.
    pub camera: InstrumentName,
    /// BLAKE3 of its bytes, in hexadecimal.
    pub blake3: String,
    /// How many bytes it has.
    pub size_bytes: u64,
    /// When its trigger was sent.
    pub requested: Stamp,
    /// When it was here.
    pub delivered: Stamp,
}

/// The number of a processing in its database.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(transparent)]
pub struct ProcessingId(pub i64);

impl fmt::Display for ProcessingId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.0)
    }
}

/// What is known of a processing before its first capture.
#[derive(Debug, Clone, PartialEq)]
pub struct NewProcessing {
    /// The session that is solved.
    pub session: SessionId,
    /// When.
    pub created: jiff::Timestamp,
    /// The program's version.
    pub software: String,
    /// Methods and their options, JSON.
    pub options_json: String,
    /// Hashes of what went in: pictures, calibrations, pattern; JSON.
    pub lineage_json: String,
    /// What solving was told, where that is not what the session was run with; JSON.
    pub measurement_json: Option<String>,
    /// The files that calibrations and pattern of it were read from; none where it is the session's.
    pub files: Vec<UsedFile>,
    /// The command that began it, with others perhaps; `None` beside a run.
    pub batch: Option<String>,
}

/// A stored processing.
#[derive(Debug, Clone, PartialEq)]
pub struct Processing {
    /// Its number.
    pub id: ProcessingId,
    /// How it began.
    pub start: NewProcessing,
    /// When it ended; `None` while it runs, or where the program died.
    pub finished: Option<jiff::Timestamp>,
}

/// All that solving one capture gives, for one transaction.
#[derive(Debug, Clone, PartialEq)]
pub struct SolutionRow {
    /// Which capture.
    pub capture: CaptureId,
    /// Seconds per stage, JSON.
    pub seconds_json: String,
    /// The solution, compact JSON; without the observations where those are given apart.
    pub solution_json: String,
    /// One row for each method.
    pub poses: Vec<PoseRow>,
    /// Each camera's observations, a JSON array by the camera's name.
    pub observations_json: BTreeMap<String, String>,
}

/// One method's pose for one capture.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseRow {
    /// Which capture.
    pub capture: CaptureId,
    /// The method's name, as in `virtual-camera`.
    pub method: String,
    /// The pose, or why there is none.
    pub pose: Result<Pose, String>,
    /// Beams that took part.
    pub beams_used: u64,
    /// Root of the a posteriori variance of unit weight; not a number where there is none.
    pub sigma0: f64,
    /// The wavelength used, nanometres in vacuum; not a number where there is none.
    pub wavelength_nm: f64,
    /// Whence the wavelength was known before: `read`, `interpolated` and so on; `None` where
    /// nothing recorded it.
    pub wavelength_source: Option<String>,
    /// Its standard uncertainty then, nanometres.
    pub wavelength_u_nm: Option<f64>,
    /// Seconds between the capture and the nearest reading that was used; `None` where that was
    /// taken at the capture, or none was used.
    pub wavelength_age_s: Option<f64>,
    /// True where the prior decided between labellings.
    pub ambiguous: bool,
}

/// A result as reports are made from.
#[derive(Debug, Clone, PartialEq)]
pub struct ResultRow {
    /// The processing that it was computed from.
    pub processing: ProcessingId,
    /// When.
    pub created: jiff::Timestamp,
    /// The result, JSON.
    pub result_json: String,
}

/// What a calibration is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CalibrationKind {
    /// The fan of beams.
    Pattern,
    /// A camera.
    Camera,
}

/// What a calibration was made from.
#[derive(Debug, Clone, PartialEq)]
pub enum CalibrationSource {
    /// A session.
    Session {
        /// Its id.
        id: SessionId,
        /// Its title.
        title: String,
        /// BLAKE3 over its expanded steps, in hexadecimal.
        plan_hash: String,
        /// When the processing that it was made from was begun: numbers of processings mean nothing
        /// in another database. `None` where it was made from readings alone.
        processing: Option<jiff::Timestamp>,
        /// Whether it is still there; of what is recorded anew it is not asked.
        kept: Kept,
    },
    /// A file.
    File {
        /// Its name.
        name: String,
        /// BLAKE3 of its bytes, in hexadecimal.
        blake3: String,
    },
}

/// Where a session that something was made from is now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kept {
    /// In this database.
    Here,
    /// It was deleted here, then.
    Deleted(jiff::Timestamp),
    /// In the database that the calibration came from, perhaps.
    Elsewhere,
}

/// A recorded calibration without what is in it.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationHead {
    /// BLAKE3 of its file, in hexadecimal: what it is known by.
    pub blake3: String,
    /// What it is of.
    pub kind: CalibrationKind,
    /// Its name, as of its files.
    pub name: String,
    /// How it was made, as in `rotation stage`.
    pub method: String,
    /// When it was recorded.
    pub created: jiff::Timestamp,
    /// The program's version.
    pub software: String,
    /// What it was made from, in order.
    pub sources: Vec<CalibrationSource>,
}

/// A recorded calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Where it comes from.
    pub head: CalibrationHead,
    /// Options of the method, JSON.
    pub options_json: String,
    /// The file, as rigs take it.
    pub content: String,
    /// Its parameters, a JSON array of objects with `name`, `value` and `u`.
    pub parameters_json: String,
    /// Their covariance, a JSON array of rows.
    pub covariance_json: String,
    /// All that came out, JSON.
    pub result_json: String,
}

/// What a verification found.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Verification {
    /// Pictures whose bytes were hashed again.
    pub pictures: u64,
    /// Their bytes, together.
    pub bytes: u64,
    /// Steps that were accounted for.
    pub steps: u64,
    /// What is wrong, a sentence each; empty where all is well.
    pub problems: Vec<String>,
}

impl Verification {
    /// True where nothing is wrong.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        self.problems.is_empty()
    }
}
