//! What a run acquires, and the trait of whoever keeps it.

use std::fmt;

use async_trait::async_trait;
use serde::{Deserialize, Serialize};

use crate::clock::Stamp;
use crate::ids::{CaptureId, InstrumentName, SessionId, StepNumber};

/// A physical quantity with its unit: what a number in a reading means.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Hash,
    PartialOrd,
    Ord,
    Serialize,
    Deserialize,
    schemars::JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// A position along an axis, millimetres.
    Position,
    /// An angle about an axis, degrees.
    Angle,
    /// Wavelength in vacuum, nanometres.
    Wavelength,
    /// Temperature, degrees Celsius.
    Temperature,
    /// Current, milliamperes.
    Current,
}

impl Quantity {
    /// The unit as a key's suffix, as in `rail_mm`.
    #[must_use]
    pub const fn suffix(self) -> &'static str {
        match self {
            Self::Position => "mm",
            Self::Angle => "deg",
            Self::Wavelength => "nm",
            Self::Temperature => "degc",
            Self::Current => "ma",
        }
    }

    /// The quantity's name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::Angle => "angle",
            Self::Wavelength => "wavelength",
            Self::Temperature => "temperature",
            Self::Current => "current",
        }
    }
}

impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}_{}", self.name(), self.suffix())
    }
}

/// One number read from an instrument, in the unit of its quantity.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Reading {
    /// Which quantity, hence which unit.
    pub quantity: Quantity,
    /// The number.
    pub value: f64,
    /// Its standard uncertainty, where the rig declares one.
    pub standard_uncertainty: Option<f64>,
    /// When it was read.
    pub at: Stamp,
}

/// One camera's picture within a capture.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// The camera's name in the rig.
    pub camera: InstrumentName,
    /// The camera's own bytes.
    pub bytes: Vec<u8>,
    /// When its trigger was sent.
    pub requested: Stamp,
    /// When it was here.
    pub delivered: Stamp,
}

/// One trigger of all cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct CaptureRecord {
    /// Its name within the session.
    pub id: CaptureId,
    /// Where every axis was told to be, keyed as `rail_mm`; also loop counters such as `pass`.
    pub setpoints: std::collections::BTreeMap<String, f64>,
    /// What the axes and sensors read nearest to the trigger, keyed as `rail_mm`, `wavemeter_nm`; of
    /// a quantity that one sensor alone read also as `wavelength_nm`.
    pub readings: std::collections::BTreeMap<String, f64>,
    /// The pictures, in the order of the cameras' names.
    pub pictures: Vec<Picture>,
}

/// How a step ended.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "outcome", rename_all = "snake_case")]
pub enum StepOutcome {
    /// As planned.
    Done,
    /// It failed; the reason says with which instrument and why.
    Failed {
        /// Why.
        reason: String,
    },
    /// It failed, and the plan says to pass it over.
    PassedOver {
        /// Why it failed.
        reason: String,
    },
    /// It was not run: the plan's `run_if` said no.
    Skipped,
}

impl StepOutcome {
    /// Whether a run goes on behind it: it need not be done again.
    #[must_use]
    pub const fn is_settled(&self) -> bool {
        !matches!(self, Self::Failed { .. })
    }
}

/// A value that should be there and is not: a fact of its own, never a number that stands for it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Missing {
    /// The instrument that did not give it.
    pub instrument: InstrumentName,
    /// Why.
    pub reason: String,
}

/// What an operator said.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Answer {
    /// What the plan calls it.
    pub name: String,
    /// As given: text, a number, one of the choices, `yes` or `no`.
    pub value: String,
    /// Who gave it: `terminal`, `answers file`, `default`.
    pub by: String,
}

/// One look of a closing-in (an `align` step): where the axis stood, and the dot in the picture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Look {
    /// When the picture was here.
    pub at: Stamp,
    /// Where the axis was told to be, in its unit.
    pub commanded: f64,
    /// What its encoder read.
    pub read: f64,
    /// The dot in the picture, pixels at full size; `None` where it was not found.
    pub dot_px: Option<[f64; 2]>,
}

/// Everything that one step acquired and how it ended: one durable transaction.
#[derive(Debug, Clone, PartialEq)]
pub struct StepRecord {
    /// The step's place in the plan.
    pub number: StepNumber,
    /// What it does, for people: `pass 2, rail 300 mm: capture`.
    pub label: String,
    /// Its kind: `move`, `capture`.
    pub kind: String,
    /// When it began.
    pub started: Stamp,
    /// When it ended.
    pub finished: Stamp,
    /// How it ended.
    pub outcome: StepOutcome,
    /// Readings taken, each with the instrument that gave it.
    pub readings: Vec<(InstrumentName, Reading)>,
    /// The capture taken, if it is a capture step.
    pub capture: Option<CaptureRecord>,
    /// What should have been read or taken and is missing, where the plan allows that.
    pub missing: Vec<Missing>,
    /// What the operator said, if somebody was asked.
    pub answer: Option<Answer>,
    /// The looks of a closing-in, in their order.
    pub looks: Vec<Look>,
    /// What else happened: laser switched, axis moved.
    pub events: Vec<Event>,
}

/// Something that happened, for the journal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// When.
    pub at: Stamp,
    /// What.
    pub kind: EventKind,
    /// In words, for people.
    pub message: String,
}

/// The kinds of events. Closed: whoever handles events handles them all.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// The session began.
    Opened,
    /// An instrument was asked who it is.
    Identified,
    /// The laser was switched on.
    LaserOn,
    /// The laser was switched off, and read back as off.
    LaserOff,
    /// Nobody knows whether the laser is on: assume it is.
    LaserUnknown,
    /// The contact of a laser that was on was open, or could not be read.
    InterlockTripped,
    /// An axis moved.
    Moved,
    /// The session goes on after it was stopped or died.
    Resumed,
    /// The operator or a signal asked to stop, in one of the ways there are.
    AbortRequested,
    /// The run stands, everything safe, until somebody lets it go on.
    Paused,
    /// It goes on.
    Continued,
    /// A condition does not hold: the run waits for it.
    Suspended,
    /// The condition holds again.
    Released,
    /// A step failed.
    StepFailed,
    /// It failed and is tried again, or what helps is done first.
    Retried,
    /// It was passed over, as the plan says.
    Skipped,
    /// A value is missing, as the plan allows.
    Missing,
    /// A reading is outside the limits that the plan accepts.
    OutOfLimits,
    /// The wall clock was set: times of day before and after do not compare.
    ClockJumped,
    /// What a step acquired could not be stored; it is kept and offered again.
    StoreFailed,
    /// The operator was asked.
    Asked,
    /// The answer, or what stands in for it.
    Answered,
    /// The session ended.
    Closed,
}

/// How a session ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SessionOutcome {
    /// All steps done.
    Completed,
    /// Ended early, tidily: the step under way was finished, then `finally` ran.
    Stopped,
    /// Broken off by the operator or a signal: made safe, then `finally` ran.
    Aborted,
    /// Broken off at once: made safe, and nothing else.
    Halted,
    /// Ended by an error.
    Error,
}

impl SessionOutcome {
    /// The word in the store and in reports.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::Stopped => "stopped",
            Self::Aborted => "aborted",
            Self::Halted => "halted",
            Self::Error => "error",
        }
    }
}

/// A file that what solving is told was read from: by its hash it is known where it comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UsedFile {
    /// The camera that it calibrates; `None` for the fan's pattern.
    pub camera: Option<InstrumentName>,
    /// Its name, as the rig has it, or as it was given.
    pub file: String,
    /// BLAKE3 of its bytes, in hexadecimal.
    pub blake3: String,
}

impl UsedFile {
    /// A file by what was read of it.
    #[must_use]
    pub fn of(camera: Option<&InstrumentName>, file: &str, text: &str) -> Self {
        let blake3 = blake3::hash(text.as_bytes()).to_hex().to_string();
        Self { camera: camera.cloned(), file: file.to_owned(), blake3 }
    }
}

/// What is known of a session before its first step.
#[derive(Debug, Clone, PartialEq)]
pub struct SessionHeader {
    /// Its id.
    pub id: SessionId,
    /// The plan's title.
    pub title: String,
    /// The experiment's kind, as in `translation`.
    pub experiment: String,
    /// The plan's text as run.
    pub plan_text: String,
    /// The rig's text as run.
    pub rig_text: String,
    /// Everything that solving needs beside pictures, self-contained, as JSON: camera
    /// calibrations, pattern, artefact, prior, methods. `app` writes and reads it.
    pub measurement_json: String,
    /// The files that calibrations and pattern of it were read from.
    pub files: Vec<UsedFile>,
    /// BLAKE3 over the expanded steps, in hexadecimal.
    pub plan_hash: String,
    /// Where plan and rig came from and what the command line changed, as JSON, so that the session
    /// can be resumed; `app` writes and reads it. `None` for an imported session.
    pub origin_json: Option<String>,
    /// The program's version.
    pub software: String,
    /// The simulation's seed, if simulated.
    pub seed: Option<u64>,
    /// Number of steps, `finally` included.
    pub steps: u32,
    /// When it began.
    pub opened: Stamp,
}

/// The time between the end of a run and the moment in which its session goes on.
#[derive(Debug, Clone, PartialEq)]
pub struct Gap {
    /// When the last thing that is known of the run happened.
    pub stopped: Stamp,
    /// When the session goes on.
    pub resumed: Stamp,
    /// How the run had ended: its outcome, or that it died.
    pub reason: String,
    /// Steps that were begun or done before and are done again.
    pub redone: Vec<StepNumber>,
    /// What is re-established before the first step, for people.
    pub restored: Vec<String>,
}

/// Why what was acquired could not be kept.
#[derive(Debug, Clone, thiserror::Error)]
#[error("failed to store {what}: {reason}")]
pub struct SinkError {
    /// What was to be stored.
    pub what: String,
    /// Why it was not.
    pub reason: String,
}

/// Whoever keeps what a run acquires. The engine goes on only when a step is kept.
#[async_trait]
pub trait RunSink: Send + Sync {
    /// A session begins.
    ///
    /// # Errors
    /// [`SinkError`] when it is not durable.
    async fn open(&self, header: &SessionHeader) -> Result<(), SinkError>;
    /// A session goes on. What the steps to be done again left is kept as an earlier attempt.
    ///
    /// # Errors
    /// [`SinkError`] when it is not durable.
    async fn reopen(&self, session: SessionId, gap: &Gap) -> Result<(), SinkError>;
    /// A step ended: all it acquired and the fact that it ended, durable when this returns.
    ///
    /// # Errors
    /// [`SinkError`] when it is not durable.
    async fn step(&self, session: SessionId, record: &StepRecord) -> Result<(), SinkError>;
    /// A session ends.
    ///
    /// # Errors
    /// [`SinkError`] when it is not durable.
    async fn close(
        &self,
        session: SessionId,
        outcome: SessionOutcome,
        events: &[Event],
        at: Stamp,
    ) -> Result<(), SinkError>;
    /// How many bytes can still be kept; `None` where that cannot be told.
    fn free_bytes(&self) -> Option<u64> {
        None
    }
}
