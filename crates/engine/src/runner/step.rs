//! One step: tried, tried again, passed over or failed, as the plan's policy says.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use beampose_core::{EventKind, Missing, Stamp, StepOutcome, StepRecord};
use beampose_plan::policy::{OnError, RunIf};
use beampose_plan::{Action, Section, Step};
use futures::future::{Either, select};

use super::{Runner, Surroundings};
use crate::actions::{Acquired, Doing, Fault};
use crate::machine::{Input, Lasers};
use crate::safe_state::{Cause, settle};
use crate::{Notice, Wish};

/// A wall clock that departs by more than this from one step to the next was set; network time
/// slews by far less.
const CLOCK_SET: Duration = Duration::from_secs(1);

/// How often light may come back in one step after its interlock put it out, where the plan waits for
/// that: a contact that opens again and again is broken.
const RELIGHTS: u32 = 3;

/// How a step ended.
pub(super) enum Ended {
    Done,
    PassedOver { reason: String },
    Failed { reason: String },
    Skipped,
    Interrupted(Wish),
}

/// What is made of a fault.
pub(super) enum Verdict {
    TryAgain,
    End(Ended),
}

impl Runner<'_> {
    pub(super) async fn step(&mut self, step: &Step) -> Input {
        if let Some(wish) = self.see_wish(step.section) {
            return Input::Wished(wish);
        }
        let clock = self.around.clock;
        let held = if step.section == Section::Main { self.hold().await } else { Some(Ok(())) };
        let Some(held) = held else {
            // Whoever wished it is heard before the step.
            return self.see_wish(step.section).map_or(Input::Wished(Wish::Pause), Input::Wished);
        };
        self.around.bench.under_way.store(step.number.0, Ordering::Relaxed);
        tracing::debug!("{step}");
        self.journal.observers.tell(&Notice::StepStarted(Arc::new(step.clone())));
        let started = clock.now();
        self.watch_clock(started);
        let mut acquired = Acquired::default();
        let mut missing = Vec::new();
        let ended = match held {
            Ok(()) => self.attempts(step, &mut acquired, &mut missing).await,
            Err(fault) => Ended::Failed { reason: fault.to_string() },
        };
        let (outcome, input) = match ended {
            Ended::Done => (StepOutcome::Done, Input::StepDone),
            Ended::Skipped => (StepOutcome::Skipped, Input::StepDone),
            Ended::PassedOver { reason } => (StepOutcome::PassedOver { reason }, Input::StepDone),
            Ended::Failed { reason } => {
                self.fail(Some(step.number), &step.to_string(), reason.clone());
                self.cause = Some(Cause::StepFailed(step.number));
                (StepOutcome::Failed { reason }, Input::StepFailed)
            }
            Ended::Interrupted(wish) => {
                self.see_wish(step.section);
                if wish.is_pause() {
                    return Input::StepInterrupted(wish);
                }
                let reason = format!("interrupted: {}", self.wish_reason());
                (StepOutcome::Failed { reason }, Input::StepInterrupted(wish))
            }
        };
        let Acquired { readings, capture, answer, looks } = acquired;
        let (label, kind) = (step.to_string(), step.action.kind().to_owned());
        let (number, finished, events) = (step.number, clock.now(), Vec::new());
        self.pending = Some(StepRecord {
            number,
            label,
            kind,
            started,
            finished,
            outcome,
            readings,
            capture,
            missing,
            answer,
            looks,
            events,
        });
        input
    }

    /// Notes that somebody set the wall clock. What the run does goes by the monotonic one.
    fn watch_clock(&mut self, now: Stamp) {
        let origin = |stamp: Stamp| {
            let monotonic = jiff::SignedDuration::try_from(stamp.monotonic).unwrap_or_default();
            stamp.utc.checked_sub(monotonic).unwrap_or(stamp.utc)
        };
        let jump = origin(now).duration_since(origin(self.clock_seen)).as_secs_f64();
        if jump.abs() > CLOCK_SET.as_secs_f64() {
            let message = format!("the wall clock was set by {jump:+.0} s");
            self.journal.note(EventKind::ClockJumped, message);
        }
        self.clock_seen = now;
    }

    /// Tries a step until it is done or its policy says what becomes of it.
    async fn attempts(
        &mut self,
        step: &Step,
        acquired: &mut Acquired,
        missing: &mut Vec<Missing>,
    ) -> Ended {
        if let Some(not) = step.policy.run_if.iter().find(|run_if| !self.is_so(run_if)) {
            let message = format!("step {}, {step}: skipped, since not: {not}", step.number);
            self.journal.note(EventKind::Skipped, message);
            return Ended::Skipped;
        }
        let (mut tries, mut dark) = (0, 0);
        loop {
            let fault = match self.perform(step, self.around.clock.now(), acquired).await {
                Some(Ok(())) => return Ended::Done,
                Some(Err(fault)) => fault,
                None => return self.interrupted(),
            };
            if let Fault::Interlock(trip) = &fault {
                dark += 1;
                if dark > RELIGHTS {
                    self.hear_of_lasers();
                    return Ended::Failed { reason: fault.to_string() };
                }
                match self.went_dark(step, trip, &fault).await {
                    Verdict::End(ended) => return ended,
                    // What it had acquired is done anew, as after a pause.
                    Verdict::TryAgain => *acquired = Acquired::default(),
                }
                continue;
            }
            match self.judge(step, &fault, tries, missing).await {
                Verdict::End(ended) => return ended,
                Verdict::TryAgain => tries += 1,
            }
        }
    }

    pub(super) fn interrupted(&self) -> Ended {
        Ended::Interrupted(self.around.control.wish().map_or(Wish::Abort, |(wish, _)| wish))
    }

    fn is_so(&self, run_if: &RunIf) -> bool {
        match run_if {
            RunIf::Answer { name, is } => self.situation.answers.get(name) == Some(is),
            RunIf::Reading(band) => {
                self.situation.last.get(&band.instrument).is_some_and(|value| band.holds(*value))
            }
        }
    }

    /// What becomes of a fault. Whatever that is, nothing is left in doubt: a laser that may be on
    /// is switched off, an axis that may move is stopped.
    async fn judge(
        &mut self,
        step: &Step,
        fault: &Fault,
        tries: u32,
        missing: &mut Vec<Missing>,
    ) -> Verdict {
        let (policy, number, reason) = (&step.policy, step.number, fault.to_string());
        let ends = |ended| Verdict::End(ended);
        let retry = policy.retry.filter(|retry| tries < retry.times && !self.is_over(step));
        if retry.is_none() && policy.on_error == OnError::Abort {
            // The machine makes everything safe.
            return ends(Ended::Failed { reason });
        }
        let cause = Cause::StepFailed(number);
        if !self.is_settled_after(step, &cause).await {
            return ends(Ended::Failed { reason });
        }
        if let Some(retry) = retry {
            let backoff = retry.backoff.0 * f64::from(2u32.saturating_pow(tries));
            let message = format!(
                "step {number}, {step}: {reason}; try {} of {} in {backoff} s",
                tries + 2,
                retry.times + 1
            );
            self.journal.note(EventKind::Retried, message);
            let backoff = Duration::try_from_secs_f64(backoff).unwrap_or(Duration::MAX);
            if !self.rest(backoff).await || !self.recover(step).await {
                return ends(self.interrupted());
            }
            return Verdict::TryAgain;
        }
        match policy.on_error {
            OnError::Skip => {
                let message = format!("step {number}, {step}: {reason}; passed over");
                self.journal.note(EventKind::Skipped, message);
                ends(Ended::PassedOver { reason })
            }
            OnError::RecordMissing if !fault.missing().is_empty() => {
                for it in fault.missing() {
                    let message = format!("step {number}: {}: {}", it.instrument, it.reason);
                    self.journal.note(EventKind::Missing, message);
                    missing.push(it);
                }
                ends(Ended::Done)
            }
            OnError::Pause if step.section == Section::Main => {
                let message = format!("step {number}, {step}: {reason}");
                self.journal.note(EventKind::StepFailed, message.clone());
                self.around.control.request(Wish::PauseNow, &message);
                ends(self.interrupted())
            }
            OnError::Pause | OnError::RecordMissing | OnError::Abort => {
                ends(Ended::Failed { reason })
            }
        }
    }

    /// Leaves nothing in doubt behind a failed try; false where that cannot be had.
    async fn is_settled_after(&mut self, step: &Step, cause: &Cause) -> bool {
        if matches!(step.action, Action::LaserOn { .. } | Action::LaserOff { .. }) {
            return self.secure(cause).await == Lasers::Off;
        }
        let Surroundings { bench, clock, .. } = *self.around;
        let unsettled = self.unsettled();
        let stops = settle(bench, unsettled, clock, cause).await;
        let stopped = stops.iter().all(|event| event.kind != EventKind::StepFailed);
        for event in stops {
            self.journal.note_event(event);
        }
        stopped
    }

    /// Does what is to be done before a retry; what fails of it is noted. False where somebody
    /// wished to stop.
    async fn recover(&mut self, step: &Step) -> bool {
        for remedy in &step.policy.recover {
            let doing = Step {
                action: remedy.action.clone(),
                deadline: remedy.deadline,
                policy: beampose_plan::Policy::default(),
                ..step.clone()
            };
            let mut acquired = Acquired::default();
            match self.perform(&doing, self.around.clock.now(), &mut acquired).await {
                Some(Ok(())) => {}
                Some(Err(fault)) => {
                    let message = format!("before trying again, {}: {fault}", remedy.action);
                    self.journal.note(EventKind::StepFailed, message);
                }
                None => return false,
            }
        }
        true
    }

    /// Waits; false where somebody wished to stop.
    pub(super) async fn rest(&self, time: Duration) -> bool {
        let Surroundings { clock, control, .. } = *self.around;
        let reaches = std::pin::pin!(control.reaches(Wish::PauseNow));
        matches!(select(clock.sleep(time), reaches).await, Either::Left(_))
    }

    /// Whether the time of a block around the step is over.
    fn is_over(&self, step: &Step) -> bool {
        let now = self.around.clock.now().monotonic;
        self.block_end(step).is_some_and(|(end, _)| now >= end)
    }

    /// When the first of the blocks around a step has to be done, and the time that it had.
    fn block_end(&self, step: &Step) -> Option<(Duration, Duration)> {
        let ends = step.policy.within.iter().filter_map(|bound| {
            let began = self.blocks.get(&bound.block)?;
            let timeout = bound.timeout.duration();
            Some((began.saturating_add(timeout), timeout))
        });
        ends.min()
    }

    /// Performs a step; `None` where somebody's wish interrupted it.
    pub(super) async fn perform(
        &mut self,
        step: &Step,
        started: Stamp,
        acquired: &mut Acquired,
    ) -> Option<Result<(), Fault>> {
        let Surroundings { bench, clock, control, operator, rules, .. } = *self.around;
        for bound in &step.policy.within {
            self.blocks.entry(bound.block).or_insert(started.monotonic);
        }
        let own = started.monotonic.saturating_add(step.deadline.duration());
        let block = self.block_end(step);
        if let Some((_, timeout)) = block.filter(|(end, _)| started.monotonic >= *end) {
            return Some(Err(Fault::Block(timeout)));
        }
        let until = block.map_or(own, |(end, _)| end.min(own));
        let max_skew = rules.max_skew.duration();
        let (situation, journal) = (&mut self.situation, &mut self.journal);
        let limit = step.deadline.duration();
        let lit = situation.lit.clone();
        // A laser that is to be off is told so, whatever befell it.
        let needs_light = !matches!(step.action, Action::LaserOff { .. });
        if needs_light && let Some(trip) = lit.trip() {
            return Some(Err(Fault::Interlock(trip)));
        }
        let doing = Doing {
            step,
            bench,
            clock,
            operator,
            max_skew,
            situation,
            journal,
            acquired,
            until,
            limit,
        };
        let wished = std::pin::pin!(async {
            match (can_be_interrupted(step), step.section) {
                (false, _) => std::future::pending().await,
                (true, Section::Main) => control.reaches(Wish::PauseNow).await,
                (true, Section::Finally) => control.reaches(Wish::Halt).await,
            }
        });
        let tripped = std::pin::pin!(async {
            if needs_light { lit.tripped().await } else { std::future::pending().await }
        });
        match select(std::pin::pin!(doing.perform()), select(wished, tripped)).await {
            Either::Left((ended, _)) => Some(ended),
            Either::Right((Either::Left(_), _)) => None,
            Either::Right((Either::Right((trip, _)), _)) => Some(Err(Fault::Interlock(trip))),
        }
    }

    fn wish_reason(&self) -> String {
        self.around.control.wish().map_or_else(|| "abort".to_owned(), |(_, reason)| reason)
    }

    /// A wish that was not seen before, or is more urgent than the one that was; it is noted then.
    pub(super) fn see_wish(&mut self, section: Section) -> Option<Wish> {
        let (wish, reason) = self.around.control.wish()?;
        // `finally` is broken off by nothing but a halt, and holds no pause up.
        if self.seen.is_some_and(|seen| seen >= wish) {
            return None;
        }
        self.seen = Some(wish);
        let message = match wish {
            Wish::Abort => reason.clone(),
            _ => format!("{}: {reason}", wish.as_str()),
        };
        self.journal.note(EventKind::AbortRequested, message);
        if !wish.is_pause() {
            self.summary.abort_reason = Some(reason.clone());
        }
        if section == Section::Main || wish == Wish::Halt {
            self.cause = Some(Cause::Wished(wish, reason));
        }
        Some(wish)
    }
}

/// Waits, moves, prompts and a laser's emission delay end at once when somebody asks to stop; a
/// reading or a capture takes its time, so that what it acquires is whole.
fn can_be_interrupted(step: &Step) -> bool {
    matches!(
        step.action,
        Action::Wait { .. }
            | Action::Move { .. }
            | Action::Align { .. }
            | Action::LaserOn { .. }
            | Action::Prompt { .. }
    )
}
