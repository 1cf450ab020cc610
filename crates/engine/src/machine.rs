//! What comes next in a run, and how it ends: a pure state machine without instruments, clock or
//! store. The runner does what a [`Command`] says and answers with an [`Input`].
//!
//! The rules, each a row in the tests below:
//! - A failed or interrupted step makes everything safe before it is stored: light goes off first.
//! - What a step acquired is stored before the next begins. What cannot be stored makes everything
//!   safe, and is offered again until it is stored or given up.
//! - A pause makes everything safe, waits, re-establishes what later steps rely on, and goes on with
//!   the step that it came before or broke off.
//! - After a failure, a stop, an abort or a storage failure no main step runs, every `finally` step
//!   does, whatever becomes of the ones before it. After a halt none does.
//! - Everything is made safe once more before the session closes.
//! - An error outranks halt, abort and stop, in this order, and these outrank completion; an unknown
//!   laser is an error.
//!
//! A resumed run is a machine that begins behind the main steps already done ([`Machine::resuming`]).

use beampose_core::SessionOutcome;
use beampose_plan::Section;

use crate::control::Wish;

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
    /// Everything is made safe, because what the step acquired could not be stored.
    SecuringStore {
        /// Which.
        at: usize,
    },
    /// What could not be stored is offered again.
    Offering {
        /// Which.
        at: usize,
    },
    /// Everything is made safe for a pause before the step.
    SecuringPause {
        /// The step to go on with.
        at: usize,
    },
    /// Somebody is to say how it goes on.
    Paused {
        /// The step to go on with.
        at: usize,
    },
    /// What later steps rely on is re-established.
    Restoring {
        /// The step to go on with.
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
    /// Lasers are off, all instruments said who they are, and what steps rely on is established.
    Prepared,
    /// It is not so.
    PreparationFailed,
    /// The step did what it is for.
    StepDone,
    /// It did not.
    StepFailed,
    /// It was broken off because somebody wished so.
    StepInterrupted(Wish),
    /// Everything was made safe, as far as it can be.
    Secured(Lasers),
    /// What the step acquired is durable.
    Stored,
    /// It is not; after [`Command::Offer`]: it is given up.
    StoreFailed,
    /// Somebody wishes to stop; seen before the step that was to run next, or while paused.
    Wished(Wish),
    /// Somebody wishes to go on.
    Continued,
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
    /// Offer it again until it is stored, or given up.
    Offer,
    /// Wait until somebody says how it goes on.
    AwaitOperator,
    /// Re-establish what later steps rely on.
    Restore,
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
    /// True once no step at all is to run.
    halted: bool,
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
        let outcome = SessionOutcome::Completed;
        Self { order, main, state: State::New, outcome, stopping: false, halted: false }
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
            (State::Running { at }, Input::StepInterrupted(wish)) => {
                if wish.is_pause() {
                    return self.go(State::SecuringPause { at }, Command::Secure);
                }
                self.obey(wish);
                self.go(State::SecuringStep { at }, Command::Secure)
            }
            (State::Running { at }, Input::Wished(wish)) => self.wished_before(at, wish),
            (State::SecuringPause { at }, Input::Secured(lasers)) => {
                self.know(lasers);
                self.go(State::Paused { at }, Command::AwaitOperator)
            }
            (State::Paused { at }, Input::Continued) => {
                self.go(State::Restoring { at }, Command::Restore)
            }
            (State::Paused { at }, Input::Wished(wish)) if !wish.is_pause() => {
                self.obey(wish);
                self.go_to_step(at)
            }
            (State::Restoring { at }, Input::Prepared) => self.go_to_step(at),
            (State::Restoring { at }, Input::PreparationFailed) => {
                self.stop(SessionOutcome::Error);
                self.go(State::SecuringRun { next: at }, Command::Secure)
            }
            (State::SecuringStep { at }, Input::Secured(lasers)) => {
                self.know(lasers);
                self.go(State::Storing { at }, Command::Store)
            }
            (State::Storing { at }, Input::Stored) => self.go_to_step(at + 1),
            (State::Storing { at }, Input::StoreFailed) => {
                self.go(State::SecuringStore { at }, Command::Secure)
            }
            (State::SecuringStore { at }, Input::Secured(lasers)) => {
                self.know(lasers);
                self.go(State::Offering { at }, Command::Offer)
            }
            (State::Offering { at }, Input::Stored) => self.restore_before(at + 1),
            (State::Offering { at }, Input::StoreFailed) => {
                self.stop(SessionOutcome::Error);
                self.go_to_step(at + 1)
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

    /// What is wished before a step: in `finally` only a halt changes anything.
    fn wished_before(&mut self, at: usize, wish: Wish) -> Command {
        if at >= self.main && wish != Wish::Halt {
            return self.go_to_step(at);
        }
        if wish.is_pause() {
            return self.go(State::SecuringPause { at }, Command::Secure);
        }
        self.obey(wish);
        match wish {
            // Tidily: the plan's own `finally` makes the end.
            Wish::Stop => self.go_to_step(at),
            _ => self.go(State::SecuringRun { next: at }, Command::Secure),
        }
    }

    fn obey(&mut self, wish: Wish) {
        match wish {
            Wish::Pause | Wish::PauseNow => {}
            Wish::Stop => self.stop(SessionOutcome::Stopped),
            Wish::Abort => self.stop(SessionOutcome::Aborted),
            Wish::Halt => {
                self.halted = true;
                self.stop(SessionOutcome::Halted);
            }
        }
    }

    /// On behind a pause: main steps rely on what was made safe.
    fn restore_before(&mut self, at: usize) -> Command {
        if self.stopping || at >= self.main {
            return self.go_to_step(at);
        }
        self.go(State::Restoring { at }, Command::Restore)
    }

    /// To the step at `at`, or the first behind it that may run, or the end.
    fn go_to_step(&mut self, at: usize) -> Command {
        let at = match (self.halted, self.stopping) {
            (true, _) => self.order.len(),
            (false, true) => at.max(self.main),
            (false, false) => at,
        };
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
        if gravity(outcome) > gravity(self.outcome) {
            self.outcome = outcome;
        }
    }
}

/// Which of several outcomes a session ends with: the gravest.
const fn gravity(outcome: SessionOutcome) -> u8 {
    match outcome {
        SessionOutcome::Completed => 0,
        SessionOutcome::Stopped => 1,
        SessionOutcome::Aborted => 2,
        SessionOutcome::Halted => 3,
        SessionOutcome::Error => 4,
    }
}
