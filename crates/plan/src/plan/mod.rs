//! The plan: as written in [`mod@file`], as understood here. Only [`read_plan`] makes one.

mod drift;
pub mod file;
mod policies;
pub mod policy;
mod sweep;
mod validate;

use beampose_core::units::{Millimetre, Nanometre, Second};
use beampose_core::{InstrumentName, Quantity};
use serde::Serialize;

use policy::PatienceFile;

pub use file::{BeamAngleLimits, DriftLimits, Experiment, Limits, Method, PlanFile, Switch};
pub(crate) use validate::axis_key;

use crate::fault::{AsRead, At, Fault, Faults, Mark, Source};
use crate::policy::{Asks, OnError, Retry};
use crate::quantity::AxisPosition;

/// The version of the plan format that this program reads.
pub const PLAN_VERSION: u32 = 1;

/// A valid plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The file it was read from.
    pub source: Source,
    /// What the report calls it.
    pub title: String,
    /// Why it is done.
    pub purpose: Option<String>,
    /// The rig that is taken unless another one is named, relative to the plan's file.
    pub rig: Option<At<String>>,
    /// The kind of experiment.
    pub experiment: Experiment,
    /// What is done.
    pub steps: Vec<PlanStep>,
    /// What is done however the steps ended.
    pub finally: Vec<PlanStep>,
    /// What holds for all main steps, where they say nothing else.
    pub policy: PlanPolicy,
    /// What must hold before each main step.
    pub conditions: Vec<PlanCondition>,
    /// How far apart the triggers of a capture may be.
    pub max_skew: Second,
    /// With which methods the poses are found; none for none.
    pub methods: Vec<Method>,
    /// What is made of them.
    pub analyse: Option<Analyse>,
    /// When the verdict is pass.
    pub accept: Accept,
    /// What is not wrong, but odd.
    pub warnings: Vec<Fault>,
}

/// One step and where it was written.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanStep {
    /// Where.
    pub mark: Mark,
    /// What.
    pub kind: PlanStepKind,
    /// What holds for it, and for the steps in it.
    pub policy: PlanPolicy,
}

/// What holds for a step or a block, before the rig is known.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PlanPolicy {
    /// After this time it has failed.
    pub timeout: Option<Second>,
    /// How often it is tried again, and what becomes of the error then.
    pub on_error: Option<At<(Option<Retry>, OnError)>>,
    /// What is done before each retry.
    pub recover: Option<Vec<PlanStep>>,
    /// Limits of what is read, and where they are written.
    pub accept: Vec<At<PlanBand>>,
    /// Without this it is skipped.
    pub run_if: Option<PlanRunIf>,
}

/// Limits of a reading, before the rig is known.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanBand {
    /// Whose.
    pub instrument: At<InstrumentName>,
    /// What it is to read.
    pub quantity: Quantity,
    /// The lower limit.
    pub above: Option<f64>,
    /// The upper limit.
    pub below: Option<f64>,
}

/// Whether a step runs, before the rig is known.
#[derive(Debug, Clone, PartialEq)]
pub enum PlanRunIf {
    /// The operator answered so.
    Answer {
        /// The name of the prompt.
        name: String,
        /// The answer.
        is: String,
    },
    /// The last reading is within limits.
    Reading(PlanBand),
}

/// A condition, before the rig is known.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanCondition {
    /// What must hold.
    pub what: PlanHolds,
    /// For how long, how often it is looked at, and with what patience.
    pub patience: PatienceFile,
}

/// What a condition is of, before the rig is known.
#[derive(Debug, Clone, PartialEq)]
pub enum PlanHolds {
    /// A reading is within limits.
    Reading(PlanBand),
    /// A laser's interlock is closed.
    Interlock(At<InstrumentName>),
    /// So many bytes of disk are free.
    DiskFree(f64),
}

/// What a step of a plan is, before loops are unrolled.
#[derive(Debug, Clone, PartialEq)]
pub enum PlanStepKind {
    /// Switches a laser; without a name the rig's only one.
    Laser {
        /// Which.
        name: Option<At<InstrumentName>>,
        /// How.
        switch: Switch,
    },
    /// Lets time pass.
    Wait(Second),
    /// Moves an axis.
    Move {
        /// Which.
        axis: At<InstrumentName>,
        /// Where to.
        target: At<AxisPosition>,
    },
    /// Reads sensors and encoders.
    Read(Vec<At<InstrumentName>>),
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
        /// How long to wait for one.
        deadline: Option<Second>,
    },
    /// Does steps, for what holds for all of them.
    Block(Vec<PlanStep>),
    /// Turns the goniometer until a dot stands at its reference pixel.
    Align {
        /// Its beam: columns to the right and rows down from the zero order.
        dot: [i32; 2],
        /// How far off it may stand, pixels.
        tolerance_px: f64,
        /// After so many moves it is given up.
        moves: u32,
    },
    /// Triggers cameras; without names all of the rig.
    Capture(Option<Vec<At<InstrumentName>>>),
    /// Does steps several times.
    Repeat {
        /// How many times, at least once.
        times: u32,
        /// What the turns are called.
        name: Option<String>,
        /// What is done in each.
        steps: Vec<PlanStep>,
    },
    /// Does steps at each of several places of an axis.
    Sweep {
        /// Which axis.
        axis: At<InstrumentName>,
        /// The places, at least one, all of one kind.
        values: Vec<At<AxisPosition>>,
        /// What is done at each.
        steps: Vec<PlanStep>,
    },
}

/// What is made of poses and readings.
#[derive(Debug, Clone, PartialEq)]
pub enum Analyse {
    /// Travelled distances against those of an axis.
    Translation {
        /// The axis.
        axis: At<InstrumentName>,
        /// The loop whose turns are compared: a key of the captures' setpoints.
        pass: String,
        /// The key of the axis in the captures' setpoints, as `rail_mm`.
        axis_key: String,
    },
    /// The wavelength after the laser was switched on.
    WavelengthDrift(WavelengthDrift),
    /// The angles between the module's beams.
    BeamAngles {
        /// The sensor of the wavelength.
        wavelength: Option<At<InstrumentName>>,
    },
}

/// How the drift of the wavelength is analysed.
#[derive(Debug, Clone, PartialEq)]
pub struct WavelengthDrift {
    /// The sensor of the wavelength.
    pub wavelength: At<InstrumentName>,
    /// The sensor of the diode's temperature.
    pub diode_temperature: Option<At<InstrumentName>>,
    /// The sensor of the room's temperature.
    pub room_temperature: Option<At<InstrumentName>>,
    /// How far the module stands from what it shines on.
    pub distance: Millimetre,
    /// How long a measurement lasts that follows the warm-up.
    pub measurement: Second,
    /// By how much the wavelength may change meanwhile.
    pub settled_within: Nanometre,
}

/// When the verdict is pass.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Accept {
    /// Limits by method.
    pub limits: std::collections::BTreeMap<Method, Limits>,
    /// The least fraction of captures that must be solved, by each method.
    pub min_solved_fraction: Option<f64>,
    /// Limits of the wavelength's drift.
    pub drift: Option<DriftLimits>,
    /// Limits of a calibration of beam angles.
    pub beam_angles: Option<BeamAngleLimits>,
}

/// Reads a plan. `name` is how the file is called in faults.
///
/// # Errors
/// Every fault that the text has.
pub fn read_plan(name: &str, bytes: &[u8]) -> Result<Plan, Faults> {
    let AsRead { value, faults } = read_plan_as_it_is(name, bytes);
    faults.into_result(value, name)
}

/// Reads a plan as far as it can be understood: beside its faults, what the rest says, so that it
/// can be held against a rig all the same. See [`crate::check_both`].
#[must_use]
pub fn read_plan_as_it_is(name: &str, bytes: &[u8]) -> AsRead<Plan> {
    let read = crate::source::utf8(name, bytes)
        .map_err(Faults::from)
        .and_then(|source| crate::reader::document::<PlanFile>(&source));
    let (file, mut reader) = match read {
        Ok(read) => read,
        Err(faults) => return AsRead { value: None, faults },
    };
    let plan = file.and_then(|file| validate::plan(file, &mut reader));
    let warnings = reader.unused_parameters();
    AsRead { value: plan.map(|plan| Plan { warnings, ..plan }), faults: reader.faults }
}
