//! What must hold before a main step: looked at every so often, waited for, given up.

use std::time::Duration;

use beampose_core::clock::within;
use beampose_core::{EventKind, Quantity};
use beampose_plan::policy::{Band, Condition, Holds, OnError};
use beampose_plan::{Section, Step};

use super::step::{Ended, Verdict};
use super::{Runner, Surroundings};
use crate::Wish;
use crate::actions::Fault;
use crate::bench::Readable;
use crate::interlock::{Trip, is_closed};
use crate::machine::Lasers;
use crate::resume::restoration;
use crate::safe_state::Cause;

/// How long an instrument may take to answer when a condition is looked at.
const LOOK: Duration = Duration::from_secs(10);
/// While a condition does not hold it is looked at as often as this.
const SOON: Duration = Duration::from_secs(1);

impl Runner<'_> {
    /// Waits until all conditions hold. `None` where somebody wished to stop meanwhile; an error
    /// where one was given up.
    pub(super) async fn hold(&mut self) -> Option<Result<(), Fault>> {
        let conditions = &self.around.rules.conditions;
        for (i, condition) in conditions.iter().enumerate() {
            let now = self.around.clock.now().monotonic;
            let due = self.held[i].is_none_or(|at| now >= at + condition.every.duration());
            if !due {
                continue;
            }
            if let Err(why) = self.look(&condition.what).await
                && let Err(fault) = self.suspend(condition, &why).await?
            {
                return Some(Err(fault));
            }
            self.held[i] = Some(self.around.clock.now().monotonic);
        }
        Some(Ok(()))
    }

    /// Waits for a condition; `None` where somebody wished to stop.
    pub(super) async fn suspend(
        &mut self,
        condition: &Condition,
        why: &str,
    ) -> Option<Result<(), Fault>> {
        let clock = self.around.clock;
        let (began, give_up) = (clock.now().monotonic, condition.give_up.duration());
        self.journal.note(EventKind::Suspended, format!("waiting for {}: {why}", condition.what));
        let dark = matches!(condition.what, Holds::Interlock { .. });
        if dark && let Err(fault) = self.darken(why).await {
            return Some(Err(fault));
        }
        let (mut why, mut holds_since) = (why.to_owned(), None);
        loop {
            let now = clock.now().monotonic;
            if holds_since.is_some_and(|since| now - since >= condition.hold_for.duration()) {
                break;
            }
            if holds_since.is_none() && now - began >= give_up {
                return Some(Err(Fault::Condition { why, within: give_up }));
            }
            let rested = self.rest(SOON.min(condition.every.duration())).await;
            let wish = self.around.control.wish().map(|(wish, _)| wish);
            // Between steps a pause need not wait for the next one.
            if !rested || wish > self.seen {
                return None;
            }
            match self.look(&condition.what).await {
                Ok(()) => holds_since = holds_since.or(Some(clock.now().monotonic)),
                Err(not) => (why, holds_since) = (not, None),
            }
        }
        // A laser that has latched its open contact lets go when it is told off with it closed.
        if dark && let Err(fault) = self.darken(&why).await {
            return Some(Err(fault));
        }
        if dark && !self.restore(restoration(self.steps, &self.done)).await {
            let why = "what the steps rely on could not be re-established".to_owned();
            return Some(Err(Fault::Condition { why, within: give_up }));
        }
        if !self.rest(condition.settle.duration()).await {
            return None;
        }
        let waited = (clock.now().monotonic - began).as_secs_f64();
        let message = format!("{} again, after {waited:.1} s", condition.what);
        self.journal.note(EventKind::Released, message);
        Some(Ok(()))
    }

    /// What becomes of a step whose light was put out by its interlock: the run waits where the plan
    /// has a condition for that, pauses where the step's policy says so, and ends otherwise. Neither
    /// a retry nor passing the step over is a reason for light to come back.
    pub(super) async fn went_dark(&mut self, step: &Step, trip: &Trip, fault: &Fault) -> Verdict {
        self.hear_of_lasers();
        let reason = fault.to_string();
        let is_main = step.section == Section::Main;
        let of_it = |it: &&Condition| matches!(&it.what, Holds::Interlock { laser } if *laser == trip.laser);
        let condition = self.around.rules.conditions.iter().find(of_it).filter(|_| is_main);
        if let Some(condition) = condition {
            return match self.suspend(condition, &reason).await {
                Some(Ok(())) => Verdict::TryAgain,
                Some(Err(given_up)) => Verdict::End(Ended::Failed { reason: given_up.to_string() }),
                None => Verdict::End(self.interrupted()),
            };
        }
        if is_main && step.policy.on_error == OnError::Pause {
            let message = format!("step {}, {step}: {reason}", step.number);
            self.journal.note(EventKind::StepFailed, message.clone());
            self.around.control.request(Wish::PauseNow, &message);
            return Verdict::End(self.interrupted());
        }
        Verdict::End(Ended::Failed { reason })
    }

    async fn darken(&mut self, why: &str) -> Result<(), Fault> {
        if self.secure(&Cause::Suspended(why.to_owned())).await == Lasers::Off {
            return Ok(());
        }
        let why = format!("{why}, and a laser may be on");
        Err(Fault::Condition { why, within: Duration::ZERO })
    }

    /// Whether something holds; why not, for people.
    async fn look(&mut self, what: &Holds) -> Result<(), String> {
        let Surroundings { sink, bench, clock, .. } = *self.around;
        match what {
            Holds::Reading(band) => self.look_at(band).await,
            Holds::DiskFree { bytes } => match sink.free_bytes() {
                Some(free) if (free as f64) < *bytes => {
                    Err(format!("{:.0} MB are free", free as f64 / 1e6))
                }
                _ => Ok(()),
            },
            Holds::Interlock { laser } => {
                let found = bench.laser(laser).map_err(|error| error.to_string())?;
                let closed = is_closed(found, clock).await;
                closed.map_err(|why| format!("the interlock of {laser} {why}"))
            }
        }
    }

    async fn look_at(&mut self, band: &Band) -> Result<(), String> {
        let Surroundings { bench, clock, .. } = *self.around;
        // Without light there is no wavelength, and none that a step could rely on.
        if band.quantity == Quantity::Wavelength && self.situation.lit.is_empty() {
            return Ok(());
        }
        let name = &band.instrument;
        let reading = match bench.readable(name).map_err(|error| error.to_string())? {
            Readable::Axis(axis) => within(clock, LOOK, axis.position()).await,
            Readable::Sensor(sensor) => within(clock, LOOK, sensor.read()).await,
        };
        match reading {
            Ok(Ok(reading)) if band.holds(reading.value) => Ok(()),
            Ok(Ok(reading)) => {
                Err(format!("{name} reads {} {}", reading.value, band.quantity.suffix()))
            }
            Ok(Err(error)) => Err(format!("{name}: {error}")),
            Err(limit) => Err(format!("{name}: no answer within {limit:?}")),
        }
    }
}
