//! From the plan as written to the plan as understood.
//!
//! What needs the rig (names of instruments, limits of axes) is checked by [`crate::check`].

use std::collections::BTreeMap;

use beampose_core::InstrumentName;
use beampose_core::instrument::AxisUnit;

use super::file::{
    AcceptFile, AlignFile, AnalyseFile, CamerasFile, LaserFile, PlanFile, RepeatFile, StepFile,
    SweepFile,
};
use super::policy::StepEntry;
use super::{
    Accept, Analyse, Experiment, Method, PLAN_VERSION, Plan, PlanPolicy, PlanStep, PlanStepKind,
};
use crate::fault::{At, Mark};
use crate::policy::Asks;
use crate::reader::{Needed, Reader, is_name};
use crate::suggest;

/// How far off a dot may stand where the plan says nothing.
const ALIGN_TOLERANCE_PX: f64 = 0.05;
/// How many moves a closing-in may take where the plan says nothing.
const ALIGN_MOVES: u32 = 12;
/// No grating has more orders to a side.
const MAX_ORDER: f64 = 100.0;

/// The plan, or `None` where a part of it is missing; faults are noted.
pub(super) fn plan(file: PlanFile, reader: &mut Reader) -> Option<Plan> {
    crate::reader::expect_version(&file.version, PLAN_VERSION, reader);
    let mut scope = Scope::default();
    let policy = scope.policy_of_plan(&file, reader);
    let steps = file.steps.0.as_ref().map(|steps| scope.steps(steps, reader));
    let captures = scope.captures;
    let conditions = super::policies::conditions(file.conditions.as_deref(), reader);
    let finally = file.finally.unwrap_or_default();
    let finally = scope.steps(&finally, reader);
    refuse_captures(&finally, reader);
    let experiment = file.experiment.0.as_ref().map(|e| e.value);
    let methods = methods(file.solve.map(|s| s.value.methods), experiment, captures, reader);
    let analyse = analyse(file.analyse.as_ref(), &scope, reader);
    if let Some(kind) = &file.experiment.0 {
        belongs_together(kind, file.analyse.as_ref(), reader);
    }
    let accept = file.accept.map(|accept| {
        super::drift::limits_belong(&accept, file.analyse.as_ref(), reader);
        accept_limits(&accept, &methods, reader)
    });
    Some(Plan {
        source: reader.source.clone(),
        title: file.title.0?,
        purpose: file.purpose,
        rig: file.rig,
        experiment: experiment?,
        steps: steps?,
        finally,
        policy,
        conditions,
        max_skew: file.max_skew.unwrap_or(crate::policy::MAX_SKEW),
        methods,
        analyse,
        accept: accept.unwrap_or_default(),
        warnings: Vec::new(),
    })
}

/// What surrounds a step, and what the steps so far have named.
#[derive(Default)]
pub(super) struct Scope {
    /// Keys of the loops around, outermost first.
    loops: Vec<String>,
    /// All names of repeats.
    passes: Vec<String>,
    /// All axes swept, with the unit where the values are sound.
    swept: Vec<(InstrumentName, Option<AxisUnit>)>,
    /// All instruments that are read.
    pub(super) read: Vec<InstrumentName>,
    captures: usize,
    /// Whether a step closes in on a dot.
    aligns: bool,
    /// All prompts so far, with what would be an answer.
    pub(super) prompts: BTreeMap<String, Asks>,
}

impl Scope {
    fn steps(&mut self, steps: &[At<StepEntry>], reader: &mut Reader) -> Vec<PlanStep> {
        steps.iter().flat_map(|step| self.entry(step, reader)).collect()
    }

    fn entry(&mut self, entry: &At<StepEntry>, reader: &mut Reader) -> Vec<PlanStep> {
        let policy = self.policy(&entry.value.policy, reader);
        let mut steps = self.step(&entry.with(entry.value.step.clone()), reader);
        for step in &mut steps {
            step.policy = policy.clone();
        }
        steps
    }

    /// One step as written can be several as understood, or none after a fault.
    pub(super) fn step(&mut self, step: &At<StepFile>, reader: &mut Reader) -> Vec<PlanStep> {
        let one = |kind| vec![PlanStep { mark: step.mark, kind, policy: PlanPolicy::default() }];
        match &step.value {
            StepFile::Laser(laser) => lasers(laser).into_iter().flat_map(one).collect(),
            StepFile::Wait(time) => {
                if time.value.0 <= 0.0 {
                    let message = format!("a wait must be above zero, found `{}`", time.value);
                    reader.fault(time.mark, message);
                }
                one(PlanStepKind::Wait(time.value))
            }
            StepFile::Move(targets) => targets
                .iter()
                .map(|(axis, target)| PlanStepKind::Move {
                    axis: target.with(InstrumentName(axis.clone())),
                    target: target.value.clone(),
                })
                .flat_map(one)
                .collect(),
            StepFile::Read(names) => {
                self.read.extend(names.iter().map(|name| name.value.clone()));
                one(PlanStepKind::Read(distinct(names, reader)))
            }
            StepFile::Capture(capture) => {
                self.captures += 1;
                one(PlanStepKind::Capture(match &capture.cameras {
                    CamerasFile::All => None,
                    CamerasFile::Named(names) => Some(distinct(names, reader)),
                }))
            }
            StepFile::Align(align) => {
                self.align(align, step.mark, reader).into_iter().flat_map(one).collect()
            }
            StepFile::Prompt(prompt) => {
                self.prompt(prompt, reader).into_iter().flat_map(one).collect()
            }
            StepFile::Block(steps) => one(PlanStepKind::Block(self.steps(steps, reader))),
            StepFile::Repeat(repeat) => {
                self.repeat(repeat, reader).into_iter().flat_map(one).collect()
            }
            StepFile::Sweep(sweep) => {
                self.sweep(sweep, step.mark, reader).into_iter().flat_map(one).collect()
            }
        }
    }

    /// One step for each dot.
    fn align(&mut self, align: &AlignFile, mark: Mark, reader: &mut Reader) -> Vec<PlanStepKind> {
        let tolerance = align.tolerance.as_ref();
        if let Some(tolerance) = tolerance.filter(|it| it.value.0 <= 0.0) {
            reader.fault(tolerance.mark, "`tolerance` must be above zero");
        }
        // The first approaches, the second comes near: with fewer nothing can be closed in on.
        if let Some(moves) = align.moves.as_ref().filter(|moves| moves.value < 2) {
            let message = format!("`moves` must be at least 2, found `{}`", moves.value);
            reader.fault(moves.mark, message);
        }
        let tolerance_px = tolerance.map_or(ALIGN_TOLERANCE_PX, |it| it.value.0);
        let moves = align.moves.as_ref().map_or(ALIGN_MOVES, |moves| moves.value);
        let dots = align.dots.0.as_ref().map(|dots| dots.value.as_slice()).unwrap_or_default();
        let dots: Vec<[i32; 2]> = dots.iter().filter_map(|dot| beam(dot, reader)).collect();
        if dots.iter().any(|dot| dot[0] != 0) && dots.iter().any(|dot| dot[1] != 0) {
            let help = "roll the module between two `align` steps".to_owned();
            let message = "an axis brings the dots of a row, or those of a column".to_owned();
            reader.fault_help(mark, message, Some(help));
        }
        self.captures += dots.len();
        self.aligns |= !dots.is_empty();
        dots.into_iter().map(|dot| PlanStepKind::Align { dot, tolerance_px, moves }).collect()
    }

    fn repeat(&mut self, repeat: &RepeatFile, reader: &mut Reader) -> Option<PlanStepKind> {
        if let Some(times) = repeat.times.0.as_ref().filter(|times| times.value == 0) {
            reader.fault(times.mark, "`times` must be at least 1, found `0`");
        }
        let name = repeat.name.as_ref();
        if let Some(name) = name.filter(|name| !is_name(&name.value)) {
            reader.fault(name.mark, "a loop's name has letters, digits and `_` only");
        }
        self.passes.extend(name.map(|name| name.value.clone()));
        let steps = self.inside(name.cloned(), &repeat.steps, reader);
        let times = repeat.times.0.as_ref()?.value;
        Some(PlanStepKind::Repeat { times, name: name.map(|n| n.value.clone()), steps })
    }

    fn sweep(
        &mut self,
        sweep: &SweepFile,
        mark: Mark,
        reader: &mut Reader,
    ) -> Option<PlanStepKind> {
        let values = super::sweep::values(sweep, mark, reader);
        let axis = sweep.axis.0.as_ref();
        let unit = values.as_ref().and_then(|v| v.first()).map(|v| v.value.unit());
        self.swept.extend(axis.map(|axis| (axis.value.clone(), unit)));
        let key = axis.zip(unit).map(|(axis, unit)| axis.with(axis_key(&axis.value, unit)));
        let steps = self.inside(key, &sweep.steps, reader);
        Some(PlanStepKind::Sweep { axis: axis?.clone(), values: values?, steps })
    }

    /// The steps of a loop, whose key must not be that of a loop around it.
    fn inside(
        &mut self,
        key: Option<At<String>>,
        steps: &Needed<Vec<At<StepEntry>>>,
        reader: &mut Reader,
    ) -> Vec<PlanStep> {
        if let Some(key) = key.as_ref().filter(|key| self.loops.contains(&key.value)) {
            let message = format!("a loop around this one is already called `{}`", key.value);
            reader.fault(key.mark, message);
        }
        let depth = self.loops.len();
        self.loops.extend(key.map(|key| key.value));
        let steps = self.steps(steps.0.as_deref().unwrap_or_default(), reader);
        self.loops.truncate(depth);
        steps
    }
}

/// A beam of the zero order's row or column.
fn beam(dot: &At<[f64; 2]>, reader: &mut Reader) -> Option<[i32; 2]> {
    let is_order = |order: &f64| order.fract() == 0.0 && order.abs() <= MAX_ORDER;
    let [column, row] = dot.value;
    if !dot.value.iter().all(is_order) || (column != 0.0 && row != 0.0) {
        let help = "as in `[3, 0]`: 3 columns to the right of the zero order".to_owned();
        let message =
            format!("expected a beam of the zero order's row or column, found {column}, {row}");
        reader.fault_help(dot.mark, message, Some(help));
        return None;
    }
    Some(dot.value.map(|order| order as i32))
}

/// The key of an axis in setpoints, as `rail_mm`.
pub(crate) fn axis_key(axis: &InstrumentName, unit: AxisUnit) -> String {
    let suffix = match unit {
        AxisUnit::Millimetre => "mm",
        AxisUnit::Degree => "deg",
    };
    format!("{axis}_{suffix}")
}

fn lasers(laser: &LaserFile) -> Vec<PlanStepKind> {
    match laser {
        LaserFile::Only(switch) => vec![PlanStepKind::Laser { name: None, switch: *switch }],
        LaserFile::Named(lasers) => lasers
            .iter()
            .map(|(name, switch)| PlanStepKind::Laser {
                name: Some(switch.with(InstrumentName(name.clone()))),
                switch: switch.value,
            })
            .collect(),
    }
}

/// A list of instruments, none twice.
fn distinct(names: &[At<InstrumentName>], reader: &mut Reader) -> Vec<At<InstrumentName>> {
    for (i, name) in names.iter().enumerate() {
        if names.iter().take(i).any(|earlier| earlier.value == name.value) {
            reader.fault(name.mark, format!("`{}` is named twice", name.value));
        }
    }
    names.to_vec()
}

fn refuse_captures(finally: &[PlanStep], reader: &mut Reader) {
    for step in finally {
        match &step.kind {
            PlanStepKind::Capture(_) | PlanStepKind::Align { .. } => {
                let help = "`finally` also runs after a failure, when nothing can be said of what \
                            the pictures show"
                    .to_owned();
                reader.fault_help(step.mark, "no captures in `finally`".to_owned(), Some(help));
            }
            PlanStepKind::Repeat { steps, .. }
            | PlanStepKind::Sweep { steps, .. }
            | PlanStepKind::Block(steps) => {
                refuse_captures(steps, reader);
            }
            _ => {}
        }
    }
}

fn methods(
    methods: Option<At<Vec<At<Method>>>>,
    experiment: Option<Experiment>,
    captures: usize,
    reader: &mut Reader,
) -> Vec<Method> {
    let Some(methods) = methods else {
        let analysed = experiment == Some(Experiment::Translation);
        return if analysed { vec![Method::VirtualCamera] } else { Vec::new() };
    };
    if captures == 0 && reader.faults.is_empty() {
        reader.fault(methods.mark, "nothing to solve: no step captures");
    }
    for (i, method) in methods.value.iter().enumerate() {
        if methods.value.iter().take(i).any(|earlier| earlier.value == method.value) {
            reader.fault(method.mark, format!("`{}` is named twice", method.value.as_str()));
        }
    }
    methods.value.into_iter().map(|method| method.value).collect()
}

fn analyse(
    analyse: Option<&At<AnalyseFile>>,
    scope: &Scope,
    reader: &mut Reader,
) -> Option<Analyse> {
    let translation = match &analyse?.value {
        AnalyseFile::Translation(translation) => translation,
        AnalyseFile::WavelengthDrift(drift) => {
            return Some(Analyse::WavelengthDrift(super::drift::analysis(drift, scope, reader)));
        }
        AnalyseFile::BeamAngles(angles) => {
            if let Some(sensor) = &angles.wavelength {
                super::drift::is_read(sensor, scope, reader);
            }
            if !scope.aligns && reader.faults.is_empty() {
                reader.fault(analyse?.mark, "nothing to calibrate: no step aligns");
            }
            return Some(Analyse::BeamAngles { wavelength: angles.wavelength.clone() });
        }
    };
    let (axis, pass) = (&translation.axis, &translation.pass);
    if !pass.value.is_empty() && !scope.passes.contains(&pass.value) {
        let help = suggest::help(&pass.value, scope.passes.iter().map(String::as_str));
        reader.fault_help(pass.mark, format!("no `repeat` is called `{}`", pass.value), help);
    }
    let swept = scope.swept.iter().find(|(name, _)| *name == axis.value);
    if swept.is_none() && !axis.value.as_str().is_empty() {
        let names = scope.swept.iter().map(|(name, _)| name.as_str());
        let help = suggest::help(axis.value.as_str(), names);
        reader.fault_help(axis.mark, format!("no step sweeps `{}`", axis.value), help);
    }
    let unit = swept?.1?;
    if unit != AxisUnit::Millimetre {
        reader.fault(axis.mark, "a translation needs an axis that counts in millimetres");
    }
    let axis_key = axis_key(&axis.value, unit);
    Some(Analyse::Translation { axis: axis.clone(), pass: pass.value.clone(), axis_key })
}

/// The kind of experiment and its analysis are named apart: they must agree.
fn belongs_together(
    experiment: &At<Experiment>,
    analyse: Option<&At<AnalyseFile>>,
    reader: &mut Reader,
) {
    let needed = match experiment.value {
        Experiment::Translation => Some((
            "a translation needs `analyse`",
            "as in `analyse: {translation: {axis: rail, pass: pass}}`",
        )),
        Experiment::WavelengthDrift => Some(super::drift::NEEDED),
        Experiment::BeamAngles => Some((
            "a beam-angle calibration needs `analyse`",
            "as in `analyse: {beam-angle-calibration: {wavelength: wavemeter}}`",
        )),
        Experiment::Acquisition => None,
    };
    match (needed, analyse) {
        (Some((message, help)), None) => {
            reader.fault_help(experiment.mark, message.to_owned(), Some(help.to_owned()));
        }
        (None, Some(analyse)) => reader.fault(analyse.mark, "an acquisition is not analysed"),
        (Some(_), Some(analyse)) if kind(&analyse.value) != experiment.value => {
            let message = format!(
                "the experiment is a `{}`, its analysis that of a `{}`",
                experiment.value.as_str(),
                kind(&analyse.value).as_str()
            );
            reader.fault(analyse.mark, message);
        }
        _ => {}
    }
}

/// The experiment that an analysis belongs to.
const fn kind(analyse: &AnalyseFile) -> Experiment {
    match analyse {
        AnalyseFile::Translation(_) => Experiment::Translation,
        AnalyseFile::WavelengthDrift(_) => Experiment::WavelengthDrift,
        AnalyseFile::BeamAngles(_) => Experiment::BeamAngles,
    }
}

fn accept_limits(file: &AcceptFile, methods: &[Method], reader: &mut Reader) -> Accept {
    let by_method = [
        (Method::VirtualCamera, &file.virtual_camera),
        (Method::InterBeamAngles, &file.inter_beam_angles),
        (Method::InterBeamAnglesGls, &file.inter_beam_angles_gls),
        (Method::RayFit, &file.ray_fit),
        (Method::SessionAdjustment, &file.session_adjustment),
    ];
    let mut accept = Accept { min_solved_fraction: file.min_solved_fraction, ..Accept::default() };
    for (method, limits) in by_method {
        let Some(limits) = limits else { continue };
        if !methods.contains(&method) {
            let message = format!("limits for `{}`, which is not solved", method.as_str());
            let help = Some("add it to `solve: {methods: [...]}`".to_owned());
            reader.fault_help(limits.mark, message, help);
        }
        accept.limits.insert(method, limits.value.clone());
    }
    accept.beam_angles = file.beam_angles.as_ref().map(|limits| limits.value.clone());
    accept.drift = file.wavelength_drift.as_ref().map(|limits| limits.value.clone());
    accept
}
