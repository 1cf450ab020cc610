//! Steps: a plan expanded to a flat, numbered, printable, hashable list. Only the engine has
//! effects; a step is plain data.

use std::collections::BTreeMap;
use std::fmt;

use beampose_core::instrument::AxisUnit;
use beampose_core::units::Second;
use beampose_core::{CaptureId, InstrumentName, StepNumber};
use serde::{Deserialize, Serialize};

use crate::policy::{Asks, Policy};

/// Where in a run a step belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Section {
    /// The experiment itself.
    Main,
    /// Runs however the main steps ended.
    Finally,
}

/// What a step does. Closed: the engine is one `match`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Action {
    /// Starts emission and waits until light comes out.
    LaserOn {
        /// Which laser.
        laser: InstrumentName,
    },
    /// Ends emission and reads back that it ended.
    LaserOff {
        /// Which laser.
        laser: InstrumentName,
    },
    /// Lets time pass.
    Wait {
        /// How much.
        duration: Second,
    },
    /// Moves an axis and waits until it stands; its encoder is then read.
    Move {
        /// Which axis.
        axis: InstrumentName,
        /// Where to, in the axis' unit.
        target: f64,
        /// The axis' unit.
        unit: AxisUnit,
    },
    /// Reads instruments (sensors, or the encoders of axes), one after another.
    Read {
        /// Which ones.
        instruments: Vec<InstrumentName>,
    },
    /// Turns an axis until a dot stands at a pixel of a camera's picture, and reads the encoder
    /// there. Pixels are those of the camera's full size.
    Align {
        /// What the last picture is called within the session.
        id: CaptureId,
        /// Which axis.
        axis: InstrumentName,
        /// Its unit.
        unit: AxisUnit,
        /// Which camera.
        camera: InstrumentName,
        /// The dot by its beam: columns to the right and rows down from the zero order.
        dot: [i32; 2],
        /// Where it is to stand.
        target_px: [f64; 2],
        /// How far off it may stand, along the way that the axis moves it.
        tolerance_px: f64,
        /// After so many moves it is given up.
        moves: u32,
        /// Roughly how far a dot moves in the picture for each unit of the axis.
        px_per_unit: [f64; 2],
        /// Roughly where the axis stands when the zero order is at the pixel.
        zero: f64,
        /// How roughly.
        within: f64,
        /// The axis' way for a beam one degree further to the right: 1 or -1 degrees.
        sense: f64,
    },
    /// Asks the operator.
    Prompt {
        /// What the answer is called.
        name: String,
        /// The question.
        text: String,
        /// What would be an answer.
        asks: Asks,
        /// The answer when nobody gave one in time.
        default: Option<String>,
    },
    /// Triggers the cameras together.
    Capture {
        /// The capture's name within the session.
        id: CaptureId,
        /// Which cameras.
        cameras: Vec<InstrumentName>,
    },
}

impl Action {
    /// The kind, as in the plan file.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::LaserOn { .. } | Self::LaserOff { .. } => "laser",
            Self::Wait { .. } => "wait",
            Self::Move { .. } => "move",
            Self::Read { .. } => "read",
            Self::Align { .. } => "align",
            Self::Prompt { .. } => "prompt",
            Self::Capture { .. } => "capture",
        }
    }
}

/// One step of an expanded plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Its place, counted from 1.
    pub number: StepNumber,
    /// Main or finally.
    pub section: Section,
    /// Loop counters and sweep values in force, keyed with unit: `pass` 2, `rail_mm` 300.
    pub context: BTreeMap<String, f64>,
    /// What it does.
    pub action: Action,
    /// After so long it has failed.
    pub deadline: Second,
    /// How long it is expected to take.
    pub expected: Second,
    /// What holds for it beside.
    #[serde(default, skip_serializing_if = "Policy::is_usual")]
    pub policy: Policy,
}

impl fmt::Display for Step {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (key, value) in &self.context {
            write!(f, "{key} {value}, ")?;
        }
        write!(f, "{}", self.action)
    }
}

impl fmt::Display for Action {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = |list: &[InstrumentName]| {
            list.iter().map(InstrumentName::as_str).collect::<Vec<_>>().join(", ")
        };
        match self {
            Self::LaserOn { laser } => write!(f, "{laser} on"),
            Self::LaserOff { laser } => write!(f, "{laser} off"),
            Self::Wait { duration } => write!(f, "wait {duration}"),
            Self::Move { axis, target, unit } => {
                let unit = if *unit == AxisUnit::Millimetre { "mm" } else { "deg" };
                write!(f, "move {axis} to {target} {unit}")
            }
            Self::Read { instruments } => write!(f, "read {}", names(instruments)),
            Self::Align { axis, camera, dot: [m, n], .. } => {
                write!(f, "align beam {m} {n} in {camera} with {axis}")
            }
            Self::Prompt { name, .. } => write!(f, "ask for {name}"),
            Self::Capture { id, cameras } => write!(f, "capture {id} with {}", names(cameras)),
        }
    }
}
