//! A plan and a rig together: unrolled to numbered steps, with deadlines and expected durations.
//!
//! What cannot be done with this rig (no such instrument, a move beyond the limits) is a fault at
//! its place in the plan.

use std::collections::{BTreeMap, BTreeSet};

use beampose_core::instrument::AxisUnit;
use beampose_core::units::Second;
use beampose_core::{CaptureId, InstrumentName, StepNumber};

use crate::fault::{At, Fault, Faults, Mark};
use crate::plan::{Plan, PlanStep, PlanStepKind, Switch, axis_key};
use crate::policy::{Policy, Remedy, Rules};
use crate::quantity::AxisPosition;
use crate::rig::{FanTurns, Instrument, Rig};
use crate::step::{Action, Section, Step};
use crate::suggest;
use crate::timing::{AxisFacts, Timing};

/// More steps than this are a slip of the finger: the default plan has a few hundred.
const MAX_STEPS: u64 = 100_000;

/// The steps of `plan` with the instruments of `rig`.
///
/// # Errors
/// Every fault in which the plan asks for what the rig does not have.
pub fn expand(plan: &Plan, rig: &Rig) -> Result<Vec<Step>, Faults> {
    expand_with_warnings(plan, rig).map(|expanded| expanded.steps)
}

/// A plan with a rig.
pub(crate) struct Expanded {
    pub steps: Vec<Step>,
    pub rules: Rules,
    /// What is odd about them.
    pub warnings: Vec<Fault>,
}

/// The steps, what holds for all of them, and what is odd.
pub(crate) fn expand_with_warnings(plan: &Plan, rig: &Rig) -> Result<Expanded, Faults> {
    let count = count(&plan.steps).saturating_add(count(&plan.finally));
    if count > MAX_STEPS {
        let message = format!("the plan has {count} steps; at most {MAX_STEPS} are run");
        let longest = plan.steps.iter().max_by_key(|step| steps_of(step));
        let mark = longest.map(|step| step.mark).unwrap_or_default();
        return Err(plan.source.error(mark, message).into());
    }
    let mut expander = Expander::new(plan, rig);
    expander.policy = expander.overlaid(&plan.policy, true);
    let rules = expander.rules();
    expander.steps(&plan.steps);
    expander.check_analysis();
    expander.section = Section::Finally;
    // What holds for the experiment does not hold for what makes an end of it.
    expander.policy = Policy::default();
    expander.steps(&plan.finally);
    for mark in expander.lit.values() {
        let warning = plan.source.warning(*mark, "the laser is still on when the plan ends");
        expander.warnings.push(warning.help("end with `finally: [laser: off]`"));
    }
    if expander.faults.is_empty() {
        let warnings = expander.warnings.sorted().into_iter().cloned().collect();
        Ok(Expanded { steps: expander.out, rules, warnings })
    } else {
        Err(expander.faults)
    }
}

fn count(steps: &[PlanStep]) -> u64 {
    steps.iter().map(steps_of).fold(0, u64::saturating_add)
}

fn steps_of(step: &PlanStep) -> u64 {
    match &step.kind {
        PlanStepKind::Repeat { times, steps, .. } => u64::from(*times).saturating_mul(count(steps)),
        PlanStepKind::Block(steps) => count(steps),
        PlanStepKind::Sweep { values, steps, .. } => {
            (values.len() as u64).saturating_mul(count(steps).saturating_add(1))
        }
        _ => 1,
    }
}

pub(crate) struct Expander<'a> {
    pub(crate) plan: &'a Plan,
    pub(crate) rig: &'a Rig,
    timing: Timing<'a>,
    section: Section,
    context: BTreeMap<String, f64>,
    captures: u32,
    /// Lasers that are on at this point, and where they were switched on.
    lit: BTreeMap<InstrumentName, Mark>,
    /// Places complained of: once is enough for a loop.
    complained: BTreeSet<Mark>,
    out: Vec<Step>,
    faults: Faults,
    warnings: Faults,
    /// What holds for the steps that are next.
    pub(crate) policy: Policy,
    /// Blocks entered so far that have a time of their own.
    pub(crate) blocks: u32,
}

impl<'a> Expander<'a> {
    fn new(plan: &'a Plan, rig: &'a Rig) -> Self {
        Self {
            plan,
            rig,
            timing: Timing::new(rig),
            section: Section::Main,
            context: BTreeMap::new(),
            captures: 0,
            lit: BTreeMap::new(),
            complained: BTreeSet::new(),
            out: Vec::new(),
            faults: Faults::default(),
            warnings: Faults::default(),
            policy: Policy::default(),
            blocks: 0,
        }
    }

    fn steps(&mut self, steps: &[PlanStep]) {
        steps.iter().for_each(|step| self.step(step));
    }

    fn step(&mut self, step: &PlanStep) {
        let (around, first) = (self.policy.clone(), self.out.len());
        let is_block = matches!(
            step.kind,
            PlanStepKind::Repeat { .. } | PlanStepKind::Sweep { .. } | PlanStepKind::Block(_)
        );
        self.policy = self.overlaid(&step.policy, is_block);
        self.unroll(step);
        self.policy = around;
        if !is_block {
            self.check_policy(step, first);
        }
    }

    fn unroll(&mut self, step: &PlanStep) {
        match &step.kind {
            PlanStepKind::Laser { name, switch } => self.laser(step.mark, name.as_ref(), *switch),
            PlanStepKind::Wait(duration) => self.emit(Action::Wait { duration: *duration }),
            PlanStepKind::Move { axis, target } => self.move_axis(axis, target),
            PlanStepKind::Read(names) => self.read(names),
            PlanStepKind::Capture(names) => self.capture(step.mark, names.as_deref()),
            PlanStepKind::Align { dot, tolerance_px, moves } => {
                self.align(step.mark, *dot, *tolerance_px, *moves);
            }
            PlanStepKind::Prompt { name, text, asks, default, deadline } => {
                let (name, text) = (name.clone(), text.clone());
                let (asks, default) = (asks.clone(), default.clone());
                let action = Action::Prompt { name, text, asks, default };
                let (expected, usual) = self.timing.of(&action);
                self.push(action, expected, deadline.unwrap_or(usual));
            }
            PlanStepKind::Block(steps) => self.steps(steps),
            PlanStepKind::Repeat { times, name, steps } => {
                for turn in 1..=*times {
                    self.within(name.clone(), f64::from(turn), steps, None);
                }
            }
            PlanStepKind::Sweep { axis, values, steps } => {
                for value in values {
                    let key = axis_key(&axis.value, value.value.unit());
                    self.within(Some(key), value.value.number(), steps, Some((axis, value)));
                }
            }
        }
    }

    /// One turn of a loop; a sweep first moves its axis.
    fn within(
        &mut self,
        key: Option<String>,
        value: f64,
        steps: &[PlanStep],
        sweep: Option<(&At<InstrumentName>, &At<AxisPosition>)>,
    ) {
        if let Some(key) = &key {
            self.context.insert(key.clone(), value);
        }
        if let Some((axis, target)) = sweep {
            self.move_axis(axis, target);
        }
        self.steps(steps);
        if let Some(key) = key {
            self.context.remove(&key);
        }
    }

    fn laser(&mut self, mark: Mark, name: Option<&At<InstrumentName>>, switch: Switch) {
        let Some(laser) = self.which_laser(mark, name) else { return };
        match switch {
            Switch::On => {
                self.lit.insert(laser.clone(), mark);
                self.emit(Action::LaserOn { laser });
            }
            Switch::Off => {
                self.lit.remove(&laser);
                self.emit(Action::LaserOff { laser });
            }
        }
    }

    fn which_laser(
        &mut self,
        mark: Mark,
        name: Option<&At<InstrumentName>>,
    ) -> Option<InstrumentName> {
        if let Some(name) = name {
            self.expect_kind(name, &["laser"])?;
            return Some(name.value.clone());
        }
        let lasers: Vec<&str> = self.rig.lasers().map(|(name, _)| name.as_str()).collect();
        if let [laser] = lasers[..] {
            return Some(laser.into());
        }
        let (message, help) = if lasers.is_empty() {
            (format!("the rig {} has no laser", self.rig.source.name()), None)
        } else {
            let help = format!("as in `laser: {{{}: on}}`", lasers[0]);
            (format!("which laser? The rig has {}", suggest::quoted(&lasers)), Some(help))
        };
        self.complain(mark, message, help);
        None
    }

    pub(crate) fn complain(
        &mut self,
        mark: Mark,
        message: impl Into<String>,
        help: Option<String>,
    ) {
        if self.complained.insert(mark) && !self.faults.is_full() {
            self.faults.push(self.plan.source.error(mark, message).maybe_help(help));
        }
    }

    fn move_axis(&mut self, axis: &At<InstrumentName>, target: &At<AxisPosition>) {
        if self.expect_kind(axis, &["linear_axis", "rotary_axis"]).is_none() {
            return;
        }
        let Some(facts) = self.timing.axis(&axis.value) else { return };
        let position = target.value;
        if position.unit() != facts.unit() {
            let message =
                format!("`{}` counts in {}, found `{position}`", axis.value, facts.unit_name());
            self.complain(target.mark, message, None);
            return;
        }
        if !facts.reaches(position.number()) {
            self.beyond_limits(axis, target, &facts);
            return;
        }
        let (expected, deadline) = self.timing.travel(&axis.value, &facts, position.number());
        let target = position.number();
        let action = Action::Move { axis: axis.value.clone(), target, unit: facts.unit() };
        self.push(action, expected, deadline);
    }

    fn beyond_limits(
        &mut self,
        axis: &At<InstrumentName>,
        target: &At<AxisPosition>,
        facts: &AxisFacts,
    ) {
        let message = format!("{} is beyond the limits of `{}`", target.value, axis.value);
        let rig = self.rig.source.name();
        let (from, to) = (target.value.at(facts.from), target.value.at(facts.to));
        self.complain(
            target.mark,
            message,
            Some(format!("it travels from {from} to {to}, says {rig}")),
        );
    }

    fn read(&mut self, names: &[At<InstrumentName>]) {
        let kinds = ["sensor", "linear_axis", "rotary_axis"];
        let instruments = self.named(names, &kinds);
        self.emit(Action::Read { instruments });
    }

    fn capture(&mut self, mark: Mark, names: Option<&[At<InstrumentName>]>) {
        let cameras = match names {
            Some(names) => self.named(names, &["camera"]),
            None => self.rig.cameras().map(|(name, _)| name.clone()).collect(),
        };
        if cameras.is_empty() && names.is_none() {
            let message = format!("the rig {} has no camera", self.rig.source.name());
            self.complain(mark, message, None);
        }
        self.warn_if_dark(mark, "a capture while the laser is off");
        let id = self.next_capture();
        self.emit(Action::Capture { id, cameras });
    }

    fn align(&mut self, mark: Mark, dot: [i32; 2], tolerance_px: f64, moves: u32) {
        let Some(goniometer) = &self.rig.measurement.goniometer else {
            let message = format!("the rig {} has no goniometer", self.rig.source.name());
            let help = "it is written in `measurement: {goniometer: ...}`".to_owned();
            self.complain(mark, message, Some(help));
            return;
        };
        self.warn_if_dark(mark, "a closing-in while the laser is off");
        let id = self.next_capture();
        self.emit(Action::Align {
            id,
            axis: goniometer.axis.value.clone(),
            unit: AxisUnit::Degree,
            camera: goniometer.camera.value.clone(),
            dot,
            target_px: goniometer.target.map(|x| x.0),
            tolerance_px,
            moves,
            px_per_unit: goniometer.px_per_degree.map(|x| x.0),
            zero: goniometer.zero.0,
            within: goniometer.within.0,
            sense: match goniometer.turns {
                FanTurns::Left => 1.0,
                FanTurns::Right => -1.0,
            },
        });
    }

    fn warn_if_dark(&mut self, mark: Mark, message: &str) {
        if self.lit.is_empty() && self.complained.insert(mark) {
            self.warnings.push(self.plan.source.warning(mark, message));
        }
    }

    fn next_capture(&mut self) -> CaptureId {
        let id = CaptureId(format!("p{:03}", self.captures));
        self.captures += 1;
        id
    }

    fn named(&mut self, names: &[At<InstrumentName>], kinds: &[&str]) -> Vec<InstrumentName> {
        names
            .iter()
            .filter(|name| self.expect_kind(name, kinds).is_some())
            .map(|name| name.value.clone())
            .collect()
    }

    /// Notes a fault unless the rig has an instrument of that name and one of those kinds.
    pub(crate) fn expect_kind(&mut self, name: &At<InstrumentName>, kinds: &[&str]) -> Option<()> {
        let (wanted, rig) = (kinds.join(" or "), self.rig.source.name());
        let found = match self.rig.instruments.get(&name.value) {
            Some(found) if kinds.contains(&found.kind()) => return Some(()),
            found => found.map(Instrument::kind),
        };
        let (message, help) = if let Some(kind) = found {
            (format!("expected a {wanted}, found `{}`, which is a {kind}", name.value), None)
        } else {
            let fitting = self.rig.instruments.iter();
            let fitting = fitting.filter(|(_, instrument)| kinds.contains(&instrument.kind()));
            let help = suggest::help(name.value.as_str(), fitting.map(|(n, _)| n.as_str()));
            (format!("the rig {rig} has no {wanted} `{}`", name.value), help)
        };
        self.complain(name.mark, message, help);
        None
    }

    fn emit(&mut self, action: Action) {
        let (expected, deadline) = self.timing.of(&action);
        self.push(action, expected, deadline);
    }

    fn push(&mut self, action: Action, expected: Second, deadline: Second) {
        let number = StepNumber(u32::try_from(self.out.len() + 1).unwrap_or(u32::MAX));
        let (section, context) = (self.section, self.context.clone());
        let policy = self.policy_for(&action);
        self.out.push(Step { number, section, context, action, deadline, expected, policy });
    }

    /// The steps from the given one on: those of the step under way.
    pub(crate) fn steps_since(&mut self, first: usize) -> &mut [Step] {
        &mut self.out[first..]
    }

    /// What steps would be done, without doing them: those of a recovery.
    pub(crate) fn remedies(&mut self, steps: &[PlanStep]) -> Vec<Remedy> {
        let first = self.out.len();
        let (lit, around) = (self.lit.clone(), std::mem::take(&mut self.policy));
        self.steps(steps);
        (self.lit, self.policy) = (lit, around);
        let done = self.out.drain(first..);
        done.map(|step| Remedy { action: step.action, deadline: step.deadline }).collect()
    }
}
