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
            Self::Prompt { name, .. } => write!(f, "ask for {name}"),
            Self::Capture { id, cameras } => write!(f, "capture {id} with {}", names(cameras)),
        }
    }
}
