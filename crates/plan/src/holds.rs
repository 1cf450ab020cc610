//! Policies and conditions with the instruments of a rig.

use beampose_core::instrument::AxisUnit;
use beampose_core::units::Second;
use beampose_core::{InstrumentName, Quantity};

use crate::expand::Expander;
use crate::fault::At;
use crate::plan::{PlanBand, PlanCondition, PlanHolds, PlanPolicy, PlanRunIf, PlanStep};
use crate::policy::{Band, Bound, Condition, Holds, OnError, Policy, Rules, RunIf};
use crate::rig::Instrument;
use crate::step::Action;

/// How often a condition is looked at, where the plan says nothing.
const EVERY: Second = Second(10.0);

impl Expander<'_> {
    /// What holds within a step or block: what held around it, and what it says itself.
    pub(crate) fn overlaid(&mut self, own: &PlanPolicy, is_block: bool) -> Policy {
        let mut policy = self.policy.clone();
        if let Some(on_error) = &own.on_error {
            (policy.retry, policy.on_error) = on_error.value;
        }
        if let Some(recover) = &own.recover {
            policy.recover = self.remedies(recover);
        }
        if let Some(run_if) = &own.run_if {
            policy.run_if.extend(self.run_if(run_if));
        }
        for limits in &own.accept {
            if is_block {
                let message = "`accept` belongs to a step that reads";
                self.complain(limits.mark, message, None);
            }
            policy.accept.extend(self.band(&limits.value));
        }
        if let Some(timeout) = own.timeout.filter(|_| is_block) {
            self.blocks += 1;
            policy.within.push(Bound { block: self.blocks, timeout });
        }
        policy
    }

    /// What holds for an action: not all of it makes sense for each.
    pub(crate) fn policy_for(&self, action: &Action) -> Policy {
        let mut policy = self.policy.clone();
        let acquires = matches!(action, Action::Read { .. } | Action::Capture { .. });
        if policy.on_error == OnError::RecordMissing && !acquires {
            policy.on_error = OnError::Abort;
        }
        if policy.retry.is_none() {
            policy.recover.clear();
        }
        policy
    }

    /// What a single step says of itself, held against what it does.
    pub(crate) fn check_policy(&mut self, step: &PlanStep, first: usize) {
        let own = &step.policy;
        let Some(action) = self.steps_since(first).first().map(|step| step.action.clone()) else {
            return;
        };
        if let Some(timeout) = own.timeout {
            self.steps_since(first).iter_mut().for_each(|step| step.deadline = timeout);
        }
        let acquires = matches!(action, Action::Read { .. } | Action::Capture { .. });
        if let Some(on_error) = &own.on_error
            && on_error.value.1 == OnError::RecordMissing
            && !acquires
        {
            let message = format!("`record_missing` is for what is acquired, not for `{action}`");
            let help = "`read` and `capture` can miss something".to_owned();
            self.complain(on_error.mark, message, Some(help));
        }
        for limits in &own.accept {
            let reads = match &action {
                Action::Read { instruments } => {
                    instruments.contains(&limits.value.instrument.value)
                }
                Action::Move { axis, .. } => *axis == limits.value.instrument.value,
                _ => false,
            };
            if !reads {
                let name = &limits.value.instrument.value;
                self.complain(limits.mark, format!("this step does not read `{name}`"), None);
            }
        }
    }

    /// What holds for all main steps.
    pub(crate) fn rules(&mut self) -> Rules {
        let plan = self.plan;
        let conditions = plan.conditions.iter().filter_map(|condition| self.condition(condition));
        Rules { conditions: conditions.collect(), max_skew: plan.max_skew }
    }

    fn condition(&mut self, condition: &PlanCondition) -> Option<Condition> {
        let what = match &condition.what {
            PlanHolds::Reading(limits) => Holds::Reading(self.band(limits)?),
            PlanHolds::Interlock(laser) => {
                self.expect_kind(laser, &["laser"])?;
                Holds::Interlock { laser: laser.value.clone() }
            }
            PlanHolds::DiskFree(bytes) => Holds::DiskFree { bytes: *bytes },
        };
        let patience = &condition.patience;
        Some(Condition {
            what,
            hold_for: patience.hold_for.unwrap_or_default(),
            settle: patience.settle.unwrap_or_default(),
            every: patience.every.unwrap_or(EVERY),
            give_up: patience.give_up,
        })
    }

    fn run_if(&mut self, run_if: &PlanRunIf) -> Option<RunIf> {
        match run_if {
            PlanRunIf::Answer { name, is } => {
                Some(RunIf::Answer { name: name.clone(), is: is.clone() })
            }
            PlanRunIf::Reading(limits) => self.band(limits).map(RunIf::Reading),
        }
    }

    fn band(&mut self, limits: &PlanBand) -> Option<Band> {
        let name = &limits.instrument;
        self.expect_kind(name, &["sensor", "linear_axis", "rotary_axis"])?;
        let reads = self.quantity(name)?;
        if reads != limits.quantity {
            let message = format!("`{name}` reads {}", reads.name(), name = name.value);
            let help = format!("these are limits of {}", limits.quantity.name());
            self.complain(name.mark, message, Some(help));
            return None;
        }
        let (above, below) = (limits.above, limits.below);
        Some(Band { instrument: name.value.clone(), quantity: reads, above, below })
    }

    fn quantity(&self, name: &At<InstrumentName>) -> Option<Quantity> {
        match self.rig.instruments.get(&name.value)? {
            Instrument::Sensor(sensor) => Some(sensor.reads),
            Instrument::LinearAxis(_) => Some(quantity_of(AxisUnit::Millimetre)),
            Instrument::RotaryAxis(_) => Some(quantity_of(AxisUnit::Degree)),
            Instrument::Laser(_) | Instrument::Camera(_) => None,
        }
    }
}

const fn quantity_of(unit: AxisUnit) -> Quantity {
    match unit {
        AxisUnit::Millimetre => Quantity::Position,
        AxisUnit::Degree => Quantity::Angle,
    }
}
