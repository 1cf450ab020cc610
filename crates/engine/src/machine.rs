//! What comes next in a run, and how it ends: a pure state machine without instruments, clock or
//! store. The runner does what a [`Command`] says and answers with an [`Input`].
//!
//! The rules, each a row in the tests below:
//! - A failed or interrupted step makes everything safe before it is stored: light goes off first.
//! - What a step acquired is stored before the next begins.
//! - After a failure, an abort or a storage failure no main step runs, every `finally` step does,
//!   whatever becomes of the ones before it.
//! - Everything is made safe once more before the session closes.
//! - An error outranks an abort, an abort outranks completion; an unknown laser is an error.
//!
//! A resumed run is a machine that begins behind the main steps already done ([`Machine::resuming`]).
//! Pause will be a state between steps: `Input::Pause` where [`Machine::next`] would give
//! [`Command::Run`] in the main section.

use beampose_core::SessionOutcome;
use beampose_plan::Section;

/// Where a run stands. `at` counts the steps in the order in which they run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// Nothing has begun.
    New,
    /// Lasers are switched off and instruments identified.
    Preparing,
    /// A step runs.
    Running {
        /// Which.
        at: usize,
    },
    /// Everything is made safe, because the step failed or was interrupted; it is stored then.
    SecuringStep {
        /// Which.
        at: usize,
    },
    /// What a step acquired is being stored.
    Storing {
        /// Which.
        at: usize,
    },
    /// Everything is made safe between steps; then the run goes on with `finally`.
    SecuringRun {
        /// The step behind, whether or not it is to run.
        next: usize,
    },
    /// Everything is made safe for the last time.
    Finishing,
    /// The session is being closed.
    Closing,
}

/// How what a [`Command`] asked for went.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Input {
    /// To begin.
    Begin,
    /// Lasers are off, and all instruments said who they are.
    Prepared,
    /// An instrument did not.
    PreparationFailed,
    /// The step did what it is for.
    StepDone,
    /// It did not.
    StepFailed,
    /// It was stopped because somebody asked to abort.
    StepInterrupted,
    /// Everything was made safe, as far as it can be.
    Secured(Lasers),
    /// What the step acquired is durable.
    Stored,
    /// It is not.
    StoreFailed,
    /// Somebody asked to stop; seen before the step that was to run next.
    AbortRequested,
}

/// What is known of the lasers after they were told to be off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lasers {
    /// Each read back as off.
    Off,
    /// At least one did not: assume that it is on.
    Unknown,
}

/// What the runner is to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// Switch the lasers off and identify the instruments.
    Prepare,
    /// Run the step with this index in the plan's list.
    Run {
        /// Its index.
        step: usize,
    },
    /// Switch the lasers off, then stop what moves.
    Secure,
    /// Store what the step acquired.
    Store,
    /// Close the session with this outcome. Nothing comes after it.
    Close(SessionOutcome),
}

/// The state machine of one run.
#[derive(Debug, Clone)]
pub struct Machine {
    /// Indices into the plan's steps: the main ones, then the `finally` ones.
    order: Vec<usize>,
    /// How many of `order` are main steps.
    main: usize,
    state: State,
    outcome: SessionOutcome,
    /// True once no further main step is to run.
    stopping: bool,
}

impl Machine {
    /// A machine for steps of these sections.
    #[must_use]
    pub fn new(sections: &[Section]) -> Self {
        Self::resuming(sections, |_| false)
    }

    /// A machine that goes on with a run: main steps that `is_done` (by their index) are behind it.
    /// Every `finally` step is before it, whether or not it ran before.
    #[must_use]
    pub fn resuming(sections: &[Section], is_done: impl Fn(usize) -> bool) -> Self {
        let of = |section| (0..sections.len()).filter(move |&i| sections[i] == section);
        let mut order: Vec<usize> = of(Section::Main).filter(|&i| !is_done(i)).collect();
        let main = order.len();
        order.extend(of(Section::Finally));
        Self { order, main, state: State::New, outcome: SessionOutcome::Completed, stopping: false }
    }

    /// Where the run stands.
    #[must_use]
    pub const fn state(&self) -> State {
        self.state
    }

    /// What to do next. An input that does not fit the state is a fault of the runner: everything
    /// is made safe and the session closes with an error.
    pub fn next(&mut self, input: Input) -> Command {
        match (self.state, input) {
            (State::New, Input::Begin) => self.go(State::Preparing, Command::Prepare),
            (State::Preparing, Input::Prepared) => self.go_to_step(0),
            (State::Preparing, Input::PreparationFailed) => {
                self.stop(SessionOutcome::Error);
                self.go(State::SecuringRun { next: 0 }, Command::Secure)
            }
            (State::Running { at }, Input::StepDone) => {
                self.go(State::Storing { at }, Command::Store)
            }
            (State::Running { at }, Input::StepFailed) => {
                self.stop(SessionOutcome::Error);
                self.go(State::SecuringStep { at }, Command::Secure)
            }
            (State::Running { at }, Input::StepInterrupted) => {
                self.stop(SessionOutcome::Aborted);
                self.go(State::SecuringStep { at }, Command::Secure)
            }
            (State::Running { at }, Input::AbortRequested) => self.abort_before(at),
            (State::SecuringStep { at }, Input::Secured(lasers)) => {
                self.know(lasers);
                self.go(State::Storing { at }, Command::Store)
            }
            (State::Storing { at }, Input::Stored) => self.go_to_step(at + 1),
            (State::Storing { at }, Input::StoreFailed) => {
                self.stop(SessionOutcome::Error);
                self.go(State::SecuringRun { next: at + 1 }, Command::Secure)
            }
            (State::SecuringRun { next }, Input::Secured(lasers)) => {
                self.know(lasers);
                self.go_to_step(next)
            }
            (State::Finishing, Input::Secured(lasers)) => {
                self.know(lasers);
                self.go(State::Closing, Command::Close(self.outcome))
            }
            (_, _) => {
                self.stop(SessionOutcome::Error);
                self.go(State::Finishing, Command::Secure)
            }
        }
    }

    /// Main steps are abandoned; `finally` has begun already or is what the abort leads to.
    fn abort_before(&mut self, at: usize) -> Command {
        if at >= self.main {
            return self.go_to_step(at);
        }
        self.stop(SessionOutcome::Aborted);
        self.go(State::SecuringRun { next: at }, Command::Secure)
    }

    /// To the step at `at`, or the first behind it that may run, or the end.
    fn go_to_step(&mut self, at: usize) -> Command {
        let at = if self.stopping { at.max(self.main) } else { at };
        match self.order.get(at) {
            Some(&step) => self.go(State::Running { at }, Command::Run { step }),
            None => self.go(State::Finishing, Command::Secure),
        }
    }

    fn go(&mut self, state: State, command: Command) -> Command {
        self.state = state;
        command
    }

    fn stop(&mut self, outcome: SessionOutcome) {
        self.stopping = true;
        self.worsen(outcome);
    }

    fn know(&mut self, lasers: Lasers) {
        if lasers == Lasers::Unknown {
            self.worsen(SessionOutcome::Error);
        }
    }

    fn worsen(&mut self, outcome: SessionOutcome) {
        if self.outcome != SessionOutcome::Error {
            self.outcome = outcome;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Command::{Close, Prepare, Run, Secure, Store};
    use Input::{
        AbortRequested, Begin, PreparationFailed, Prepared, Secured, StepDone, StepFailed,
        StepInterrupted, StoreFailed, Stored,
    };
    use SessionOutcome::{Aborted, Completed, Error};

    const OFF: Input = Secured(Lasers::Off);
    const UNKNOWN: Input = Secured(Lasers::Unknown);

    /// Two main steps (0, 1) and two `finally` steps (2, 3).
    #[track_caller]
    fn check(conversation: &[(Input, Command)]) {
        let [main, finally] = [Section::Main, Section::Finally];
        let mut machine = Machine::new(&[main, main, finally, finally]);
        for (i, (input, command)) in conversation.iter().enumerate() {
            assert_eq!(machine.next(*input), *command, "line {i}: {input:?}");
        }
    }

    #[test]
    fn steps_run_in_order_and_are_stored_one_by_one() {
        check(&[
            (Begin, Prepare),
            (Prepared, Run { step: 0 }),
            (StepDone, Store),
            (Stored, Run { step: 1 }),
            (StepDone, Store),
            (Stored, Run { step: 2 }),
            (StepDone, Store),
            (Stored, Run { step: 3 }),
            (StepDone, Store),
            (Stored, Secure),
            (OFF, Close(Completed)),
        ]);
    }

    #[test]
    fn a_failed_step_is_made_safe_then_stored_then_finally_runs() {
        check(&[
            (Begin, Prepare),
            (Prepared, Run { step: 0 }),
            (StepFailed, Secure),
            (OFF, Store),
            (Stored, Run { step: 2 }),
            (StepDone, Store),
            (Stored, Run { step: 3 }),
            (StepDone, Store),
            (Stored, Secure),
            (OFF, Close(Error)),
        ]);
    }

    #[test]
    fn every_finally_step_runs_although_one_fails() {
        check(&[
            (Begin, Prepare),
            (Prepared, Run { step: 0 }),
            (StepFailed, Secure),
            (OFF, Store),
            (Stored, Run { step: 2 }),
            (StepFailed, Secure),
            (OFF, Store),
            (Stored, Run { step: 3 }),
            (StepFailed, Secure),
            (OFF, Store),
            (Stored, Secure),
            (OFF, Close(Error)),
        ]);
    }

    #[test]
    fn an_abort_between_steps_goes_to_finally() {
        check(&[
            (Begin, Prepare),
            (Prepared, Run { step: 0 }),
            (StepDone, Store),
            (Stored, Run { step: 1 }),
            (AbortRequested, Secure),
            (OFF, Run { step: 2 }),
            (StepDone, Store),
            (Stored, Run { step: 3 }),
            (StepDone, Store),
            (Stored, Secure),
            (OFF, Close(Aborted)),
        ]);
    }

    #[test]
    fn an_abort_within_a_step_keeps_what_it_acquired() {
        check(&[
            (Begin, Prepare),
            (Prepared, Run { step: 0 }),
            (StepInterrupted, Secure),
            (OFF, Store),
            (Stored, Run { step: 2 }),
        ]);
    }

    #[test]
    fn an_abort_in_finally_skips_nothing_and_changes_no_outcome() {
        check(&[
            (Begin, Prepare),
            (Prepared, Run { step: 0 }),
            (StepDone, Store),
            (Stored, Run { step: 1 }),
            (StepDone, Store),
            (Stored, Run { step: 2 }),
            (AbortRequested, Run { step: 2 }),
            (StepDone, Store),
            (Stored, Run { step: 3 }),
            (StepDone, Store),
            (Stored, Secure),
            (OFF, Close(Completed)),
        ]);
    }

    #[test]
    fn a_storage_failure_ends_the_run_with_an_error() {
        check(&[
            (Begin, Prepare),
            (Prepared, Run { step: 0 }),
            (StepDone, Store),
            (StoreFailed, Secure),
            (OFF, Run { step: 2 }),
            (StepDone, Store),
            (StoreFailed, Secure),
            (OFF, Run { step: 3 }),
            (StepDone, Store),
            (StoreFailed, Secure),
            (OFF, Secure),
            (OFF, Close(Error)),
        ]);
    }

    #[test]
    fn a_failed_preparation_runs_finally_alone() {
        check(&[(Begin, Prepare), (PreparationFailed, Secure), (OFF, Run { step: 2 })]);
    }

    #[test]
    fn an_error_outranks_an_abort_and_an_unknown_laser_is_an_error() {
        check(&[
            (Begin, Prepare),
            (Prepared, Run { step: 0 }),
            (AbortRequested, Secure),
            (UNKNOWN, Run { step: 2 }),
            (StepDone, Store),
            (Stored, Run { step: 3 }),
            (StepDone, Store),
            (Stored, Secure),
            (OFF, Close(Error)),
        ]);
    }

    #[test]
    fn an_input_out_of_turn_makes_everything_safe_and_closes() {
        check(&[(Begin, Prepare), (Stored, Secure), (OFF, Close(Error))]);
    }

    #[test]
    fn a_resumed_run_skips_what_is_done_and_runs_all_of_finally() {
        let [main, finally] = [Section::Main, Section::Finally];
        let mut machine = Machine::resuming(&[main, main, finally], |i| i != 1);
        assert_eq!(machine.next(Begin), Prepare);
        assert_eq!(machine.next(Prepared), Run { step: 1 });
        assert_eq!(machine.next(StepDone), Store);
        assert_eq!(machine.next(Stored), Run { step: 2 });
    }

    #[test]
    fn a_run_without_steps_is_still_made_safe() {
        let mut machine = Machine::new(&[]);
        assert_eq!(machine.next(Begin), Prepare);
        assert_eq!(machine.next(Prepared), Secure);
        assert_eq!(machine.next(OFF), Close(Completed));
    }
}
