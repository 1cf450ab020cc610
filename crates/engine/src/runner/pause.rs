//! A run that stands: for an operator, or for a store that does not take what it is given.

use std::sync::Arc;
use std::time::Duration;

use beampose_core::{EventKind, StepOutcome};
use beampose_plan::{Section, Step};

use super::{Runner, Surroundings, kept};
use crate::actions::Acquired;
use crate::machine::Input;
use crate::resume::restoration;
use crate::safe_state::Cause;
use crate::{Notice, Wish};

/// How soon what could not be stored is offered again; each further time waits twice as long.
const OFFER_AGAIN: Duration = Duration::from_secs(1);
/// The longest that it waits.
const OFFER_AT_LEAST_EVERY: Duration = Duration::from_secs(30);

impl Runner<'_> {
    /// Everything is safe; somebody is to say how it goes on.
    pub(super) async fn await_operator(&mut self) -> Input {
        let Surroundings { control, clock, .. } = *self.around;
        let reason = control.wish().map_or_else(String::new, |(_, reason)| reason);
        self.journal.note(EventKind::Paused, format!("paused: {reason}"));
        self.journal.observers.tell(&Notice::Paused { reason });
        {
            let _stands_still = clock.external();
            control.decided().await;
        }
        if let Some(wish) = self.see_wish(Section::Main) {
            return Input::Wished(wish);
        }
        self.seen = None;
        self.journal.note(EventKind::Continued, "the run goes on".to_owned());
        self.journal.observers.tell(&Notice::Continued);
        Input::Continued
    }

    /// Re-establishes what the steps that are left rely on.
    pub(super) async fn restore_all(&mut self) -> Input {
        let restoration = restoration(self.steps, &self.done);
        if self.restore(restoration).await {
            return Input::Prepared;
        }
        self.cause = Some(Cause::NotPrepared);
        Input::PreparationFailed
    }

    /// Repeats steps that later ones rely on; false where that failed. A wish to stop ends it at
    /// once: the machine hears of it before the next step.
    pub(super) async fn restore(&mut self, restoration: Vec<Step>) -> bool {
        // What was read before the run stopped is what the next capture refers to.
        let known = self.situation.clone();
        for step in restoration {
            let message = format!("re-established: {step}");
            let mut acquired = Acquired::default();
            match self.perform(&step, self.around.clock.now(), &mut acquired).await {
                Some(Ok(())) => self.journal.note(EventKind::Resumed, message),
                Some(Err(fault)) => {
                    self.fail(None, &format!("re-establishing {step}"), fault.to_string());
                    return false;
                }
                None => break,
            }
        }
        let now = std::mem::replace(&mut self.situation, known);
        self.situation.moving = now.moving;
        true
    }

    pub(super) async fn store(&mut self) -> Input {
        let Some(mut record) = self.pending.take() else {
            return Input::Stored;
        };
        record.events.append(&mut self.journal.events);
        let number = record.number;
        let Surroundings { sink, clock, .. } = *self.around;
        let storing = sink.step(self.summary.session, &record);
        if let Err(error) = kept(clock, &format!("step {number}"), storing).await {
            let message =
                format!("step {number}, storing it: {error}; it is kept, and offered again");
            self.journal.note(EventKind::StoreFailed, message);
            self.store_error = Some(error);
            self.cause = Some(Cause::NotStored(number));
            self.pending = Some(record);
            return Input::StoreFailed;
        }
        if record.outcome == StepOutcome::Done {
            self.summary.steps_done += 1;
            self.done.insert(number);
        } else if record.outcome.is_settled() {
            self.passed.insert(number);
        }
        let capture = record.capture.take();
        self.journal.observers.tell(&Notice::StepDone(Arc::new(record)));
        if let Some(capture) = capture {
            self.summary.captures += 1;
            self.journal.observers.captured(number, capture);
        }
        Input::Stored
    }

    /// Offers what could not be stored again and again, until it is stored, somebody wishes to end
    /// the run, or patience ends. After patience ended once, it is offered once more and no longer.
    pub(super) async fn offer(&mut self) -> Input {
        let Surroundings { clock, control, store_patience, .. } = *self.around;
        let patience =
            if self.summary.unstored.is_empty() { store_patience } else { Duration::ZERO };
        let until = clock.now().monotonic.saturating_add(patience);
        let reason = self.store_error.as_ref().map(ToString::to_string).unwrap_or_default();
        self.journal.observers.tell(&Notice::Paused { reason });
        let mut pause = OFFER_AGAIN;
        let input = loop {
            let left = until.saturating_sub(clock.now().monotonic);
            let ends = control.wish().is_some_and(|(wish, _)| !wish.is_pause());
            if left.is_zero() || ends {
                break self.give_up();
            }
            // A pause that is wished is one already.
            let stop = std::pin::pin!(control.reaches(Wish::Stop));
            let _either = futures::future::select(clock.sleep(pause.min(left)), stop).await;
            pause = (pause * 2).min(OFFER_AT_LEAST_EVERY);
            if self.store().await == Input::Stored {
                self.cause = None;
                break Input::Stored;
            }
            // Told once: a disk that is full stays so for hours.
            self.journal.events.retain(|event| event.kind != EventKind::StoreFailed);
        };
        self.journal.observers.tell(&Notice::Continued);
        input
    }

    fn give_up(&mut self) -> Input {
        if let Some(mut record) = self.pending.take() {
            let reason = self.store_error.as_ref().map(ToString::to_string).unwrap_or_default();
            // What was noted goes with the next that can be stored, too.
            record.events.append(&mut self.journal.events);
            self.journal.events.clone_from(&record.events);
            self.fail(Some(record.number), "storing it", reason);
            self.summary.unstored.push(record);
        }
        Input::StoreFailed
    }
}
