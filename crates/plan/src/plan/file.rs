//! The plan as written.

use std::collections::BTreeMap;

use beampose_core::InstrumentName;
use beampose_core::units::{Degree, Millimetre, Nanometre, Second};
use schemars::{Schema, SchemaGenerator, json_schema};
use serde::Serialize;

use super::policy::{ConditionFile, OnErrorFile, PromptFile, StepEntry};
use crate::fault::At;
use crate::quantity::{AxisPosition, Pixel};
use crate::reader::{Maybe, Needed, Parameters, Read, Reader, fraction, positive};
use crate::tree::{Node, Value};

record! {
    /// A plan: what is to be done. With which instruments, the rig says.
    ///
    /// Wherever a number or a quantity stands, `$name` stands for one of the plan's parameters.
    pub struct PlanFile {
        /// The version of this format: 1.
        version: Needed<At<u32>>,
        /// What the report calls it.
        title: Needed<String>,
        /// Why it is done, for whoever reads the report.
        purpose: Option<String>,
        /// The rig that is taken unless another one is named, relative to this file.
        rig: Option<At<String>>,
        /// The kind of experiment.
        experiment: Needed<At<Experiment>>,
        /// Named quantities that steps refer to as `$name`.
        parameters: Parameters,
        /// What is done, in this order.
        steps: Needed<Vec<At<StepEntry>>>,
        /// What is done however the steps ended: laser off, axes home.
        finally: Option<Vec<At<StepEntry>>>,
        /// What must hold before each step; the run waits for it.
        conditions: Option<Vec<At<ConditionFile>>>,
        /// What becomes of an error, where a step says nothing else.
        on_error: Option<At<OnErrorFile>>,
        /// What is done before each retry, where a step says nothing else.
        recover: Option<Vec<At<StepFile>>>,
        /// After this time the plan has failed.
        timeout: Option<At<Second>>,
        /// How far apart the triggers of a capture's cameras may be; without it 50 ms.
        max_skew: Option<Second> => positive,
        /// With which methods the poses are found.
        solve: Option<At<SolveFile>>,
        /// What is made of the poses.
        analyse: Option<At<AnalyseFile>>,
        /// The limits within which the verdict is pass.
        accept: Option<AcceptFile>,
    }
}

words! {
    /// The kind of experiment: it says what is analysed and how it is reported.
    pub enum Experiment ("a kind of experiment") {
        /// The module moves along a linear axis; the travelled distances are compared with it.
        "translation" => Translation,
        /// The laser is switched on from cold; what its wavelength does then is followed.
        "wavelength-drift" => WavelengthDrift,
        /// The angles between the module's beams, on a goniometer.
        "beam-angle-calibration" => BeamAngles,
        /// Pictures and readings are taken and solved; nothing is analysed.
        "acquisition" => Acquisition,
    }
}

choice! {
    /// One step: a map with one key that says what is done.
    pub enum StepFile ("a step") {
        /// Switches the laser: `on` or `off`, or `{name: on}` where the rig has several.
        "laser" => Laser(LaserFile),
        /// Lets time pass: `2 s`.
        "wait" => Wait(At<Second>),
        /// Moves axes, one after another in the order of their names: `{rail: 300 mm}`.
        "move" => Move(BTreeMap<String, At<At<AxisPosition>>>),
        /// Reads sensors and encoders, one after another.
        "read" => Read(Vec<At<InstrumentName>>),
        /// Triggers cameras together.
        "capture" => Capture(CaptureFile),
        /// Turns the rig's goniometer until one dot after another stands at its reference pixel, and
        /// reads the encoder there.
        "align" => Align(AlignFile),
        /// Asks the operator.
        "prompt" => Prompt(PromptFile),
        /// Does the steps inside: what stands beside it holds for all of them.
        "block" => Block(Vec<At<StepEntry>>),
        /// Does the steps inside several times.
        "repeat" => Repeat(RepeatFile),
        /// Moves an axis from value to value and does the steps inside at each.
        "sweep" => Sweep(SweepFile),
    }
}

words! {
    /// Whether the laser is to emit.
    pub enum Switch ("`on` or `off`") {
        /// It is.
        "on" => On,
        /// It is not.
        "off" => Off,
    }
}

/// Which laser to switch, and how.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LaserFile {
    /// The rig's only one.
    Only(Switch),
    /// These, by name.
    Named(BTreeMap<String, At<Switch>>),
}

impl Read for LaserFile {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        match node.value {
            Value::Map(_) => Read::read(node, reader).map(Self::Named),
            _ => Read::read(node, reader).map(Self::Only),
        }
    }

    fn schema(generator: &mut SchemaGenerator) -> Schema {
        let only = Switch::schema(generator);
        let named = <BTreeMap<String, At<Switch>>>::schema(generator);
        json_schema!({ "anyOf": [only, named] })
    }
}

record! {
    /// A capture.
    pub struct CaptureFile {
        /// `all` cameras of the rig, or a list of names.
        cameras: CamerasFile,
    }
}

record! {
    /// A closing-in for each of some dots, one after another.
    pub struct AlignFile {
        /// The dots by their beams, `[columns to the right, rows down]`, from the zero order as the
        /// module sees it. All in its row, or all in its column with the module rolled.
        dots: Needed<At<Vec<At<[f64; 2]>>>>,
        /// How far from the reference pixel, along the way that the axis moves it, a dot may stand;
        /// without it 0.05 px.
        tolerance: Option<At<Pixel>>,
        /// After so many moves it is given up; without it 12.
        moves: Option<At<u32>>,
    }
}

/// Which cameras to trigger.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CamerasFile {
    /// All of the rig.
    All,
    /// These.
    Named(Vec<At<InstrumentName>>),
}

impl Read for CamerasFile {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        match &node.value {
            Value::Text(text) if text == "all" => Some(Self::All),
            Value::List(_) => Read::read(node, reader).map(Self::Named),
            _ => reader.expected(node, "`all` or a list of cameras"),
        }
    }

    fn schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "anyOf": [
            { "const": "all" }, { "type": "array", "items": { "type": "string" } }
        ] })
    }
}

record! {
    /// Steps that are done several times.
    pub struct RepeatFile {
        /// How many times.
        times: Needed<At<u32>>,
        /// What the turns are called; they count from 1 and stand with every capture.
        name as "as": Option<At<String>>,
        /// What is done in each.
        steps: Needed<Vec<At<StepEntry>>>,
    }
}

record! {
    /// An axis moved from value to value: `from`, `to` and `step`, or `values`.
    pub struct SweepFile {
        /// Which axis.
        axis: Needed<At<InstrumentName>>,
        /// The first value.
        from: Maybe<At<AxisPosition>>,
        /// The last value.
        to: Maybe<At<AxisPosition>>,
        /// From one value to the next.
        step: Maybe<At<AxisPosition>>,
        /// The values themselves, in this order.
        values: Maybe<At<Vec<At<AxisPosition>>>>,
        /// What is done at each.
        steps: Needed<Vec<At<StepEntry>>>,
    }
}

words! {
    /// How poses are found from pictures.
    pub enum Method ("a method") {
        /// From the angles between beams, each capture alone.
        "inter-beam-angles" => InterBeamAngles,
        /// The same angles, weighted by their full covariance.
        "inter-beam-angles-gls" => InterBeamAnglesGls,
        /// From the distances of the dots from their beams, each capture alone.
        "ray-fit" => RayFit,
        /// The module as one more camera of a bundle adjustment, each capture alone.
        "virtual-camera" => VirtualCamera,
        /// All captures of the session in one adjustment, when the last is taken.
        "session-adjustment" => SessionAdjustment,
    }
}

record! {
    /// How poses are found.
    pub struct SolveFile {
        /// With which methods; each gives its own poses.
        methods: At<Vec<At<Method>>>,
    }
}

choice! {
    /// What is made of poses and readings.
    pub enum AnalyseFile ("an analysis") {
        /// Travelled distances against those of an axis.
        "translation" => Translation(TranslationFile),
        /// The wavelength after the laser was switched on, and what its change does to a measurement.
        "wavelength-drift" => WavelengthDrift(WavelengthDriftFile),
        /// The fan of beams from the angles that the plan's closings-in measure.
        "beam-angle-calibration" => BeamAngles(BeamAnglesFile),
    }
}

record! {
    /// Distances between module positions against those of an axis.
    pub struct TranslationFile {
        /// The axis; one of the steps sweeps it.
        axis: At<InstrumentName>,
        /// The name of the `repeat` whose turns are compared.
        pass: At<String>,
    }
}

record! {
    /// The wavelength over time and temperature.
    pub struct WavelengthDriftFile {
        /// The sensor of the wavelength; one of the steps reads it.
        wavelength: At<InstrumentName>,
        /// The sensor of the diode's temperature; without it there is no temperature coefficient.
        diode_temperature: Option<At<InstrumentName>>,
        /// The sensor of the room's temperature.
        room_temperature: Option<At<InstrumentName>>,
        /// How far the module stands from what it shines on, for what is said of its position.
        distance: Millimetre => positive,
        /// How long a measurement lasts that follows the warm-up.
        measurement: Second => positive,
        /// By how much the wavelength may change during such a measurement: the recommended warm-up
        /// is the shortest after which it does not change by more.
        settled_within: Nanometre => positive,
    }
}

record! {
    /// The angles between neighbouring beams, each from two closings-in that follow each other.
    pub struct BeamAnglesFile {
        /// The sensor of the wavelength; without it the angles hold at the laser's own wavelength,
        /// whatever that was.
        wavelength: Option<At<InstrumentName>>,
    }
}

record! {
    /// The limits within which the verdict is pass.
    pub struct AcceptFile {
        /// For the virtual camera.
        virtual_camera as "virtual-camera": Option<At<Limits>>,
        /// For the inter-beam angles.
        inter_beam_angles as "inter-beam-angles": Option<At<Limits>>,
        /// For the weighted inter-beam angles.
        inter_beam_angles_gls as "inter-beam-angles-gls": Option<At<Limits>>,
        /// For the ray fit.
        ray_fit as "ray-fit": Option<At<Limits>>,
        /// For the adjustment of the whole session.
        session_adjustment as "session-adjustment": Option<At<Limits>>,
        /// For the drift of the wavelength.
        wavelength_drift as "wavelength-drift": Option<At<DriftLimits>>,
        /// For a calibration of beam angles.
        beam_angles as "beam-angle-calibration": Option<At<BeamAngleLimits>>,
        /// The least fraction of captures that must be solved, by each method.
        min_solved_fraction: Option<f64> => fraction,
    }
}

record! {
    /// The limits for the results of one method.
    pub struct Limits {
        /// Of the mean difference to the axis at any of its positions.
        max_abs_mean_difference: Option<Millimetre> => positive,
    }
}

record! {
    /// The limits for a calibration of beam angles.
    pub struct BeamAngleLimits {
        /// Of the standard deviation of one angle, from its repetitions.
        max_standard_deviation: Option<Degree> => positive,
        /// Of the standard uncertainty of any angle between neighbours.
        max_standard_uncertainty: Option<Degree> => positive,
    }
}

record! {
    /// The limits for the drift of the wavelength.
    pub struct DriftLimits {
        /// Of the mean drift in an hour after the recommended warm-up, either way.
        max_drift_per_hour: Option<Nanometre> => positive,
        /// Of the error of position, at the distance of the analysis, that the change of wavelength
        /// makes in a measurement after the recommended warm-up.
        max_position_error: Option<Millimetre> => positive,
        /// How many mode hops there may be.
        max_hops: Option<u32>,
        /// Of the recommended warm-up.
        max_warm_up: Option<Second> => positive,
    }
}
