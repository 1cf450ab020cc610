//! Does what the machine says, step by step, on one task: it joins, and spawns nothing, so that a
//! virtual clock can drive it.

use std::sync::Arc;
use std::time::Duration;

use beampose_core::clock::{Clock, within};
use beampose_core::{
    EventKind, Gap, InstrumentError, RunSink, SessionHeader, SessionId, SessionOutcome, SinkError,
    Stamp, StepNumber, StepOutcome, StepRecord,
};
use beampose_plan::{Action, Section, Step};
use futures::future::{Either, join_all, select};

use crate::actions::{Acquired, Doing, Fault, Journal, Situation};
use crate::machine::{Command, Input, Lasers, Machine};
use crate::resume::{Earlier, restoration};
use crate::safe_state::{Cause, LaserGuard, secure};
use crate::{AbortHandle, Bench, EngineError, Notice, Observers};

/// How long an instrument may take to say who it is: a camera that wakes up takes seconds.
const IDENTIFY_DEADLINE: Duration = Duration::from_secs(15);
/// How long storing may take before the laser is not left on any longer: the store's own patience
/// with another program that holds the database is well within.
const STORE_DEADLINE: Duration = Duration::from_secs(60);

/// What a run works with.
#[derive(Clone, Copy)]
pub struct Surroundings<'a> {
    /// The instruments.
    pub bench: &'a Bench,
    /// Who keeps what is acquired.
    pub sink: &'a dyn RunSink,
    /// Who looks on.
    pub observers: &'a Observers,
    /// The time.
    pub clock: &'a dyn Clock,
    /// Who may stop it.
    pub abort: &'a AbortHandle,
}

/// How a run ended.
#[derive(Debug, Clone, PartialEq)]
pub struct RunSummary {
    /// The session.
    pub session: SessionId,
    /// How it ended.
    pub outcome: SessionOutcome,
    /// When.
    pub closed: Stamp,
    /// Steps in the plan.
    pub steps: usize,
    /// Steps done and stored.
    pub steps_done: usize,
    /// Captures stored, those of failed steps included.
    pub captures: usize,
    /// What failed, in order.
    pub failures: Vec<StepFailure>,
    /// Why it was stopped, if somebody asked for that.
    pub abort_reason: Option<String>,
    /// What is known of the lasers at the end.
    pub lasers: Lasers,
}

/// Something that failed in a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StepFailure {
    /// Which step; `None` before the first.
    pub step: Option<StepNumber>,
    /// What was being done: the step's label, or `preparation`.
    pub doing: String,
    /// With which instrument and why.
    pub reason: String,
}

/// Runs `steps` as the session that `header` describes.
///
/// A step that fails is no error of this function: it makes the outcome
/// [`SessionOutcome::Error`]. Whatever happens, lasers end switched off, or reported as unknown.
///
/// # Errors
/// [`EngineError::NoInstrument`] and [`EngineError::NotOpened`] before anything is done;
/// [`EngineError::NotStored`] and [`EngineError::NotClosed`] where the store is incomplete.
pub async fn run(
    steps: &[Step],
    header: &SessionHeader,
    around: &Surroundings<'_>,
) -> Result<RunSummary, EngineError> {
    around.bench.check(steps)?;
    let guard = LaserGuard::armed(around.bench);
    let opening = around.sink.open(header);
    kept(around.clock, "the session", opening).await.map_err(EngineError::NotOpened)?;
    follow(steps, header, Earlier::default(), guard, around).await
}

/// Goes on with the session that `header` describes: main steps that `earlier` did are not run
/// again. What later steps rely on is re-established first ([`crate::restoration`]), after lasers
/// were switched off and every instrument said who it is.
///
/// # Errors
/// As [`run`].
pub async fn resume(
    steps: &[Step],
    header: &SessionHeader,
    earlier: Earlier,
    gap: &Gap,
    around: &Surroundings<'_>,
) -> Result<RunSummary, EngineError> {
    around.bench.check(steps)?;
    let guard = LaserGuard::armed(around.bench);
    let reopening = around.sink.reopen(header.id, gap);
    kept(around.clock, "the session", reopening).await.map_err(EngineError::NotOpened)?;
    follow(steps, header, earlier, guard, around).await
}

async fn follow(
    steps: &[Step],
    header: &SessionHeader,
    earlier: Earlier,
    guard: LaserGuard<'_>,
    around: &Surroundings<'_>,
) -> Result<RunSummary, EngineError> {
    around.observers.tell(&Notice::Opened(Arc::new(header.clone())));
    let mut runner = Runner::new(steps, header, earlier, around);
    let outcome = runner.follow_machine(steps).await;
    if runner.summary.lasers == Lasers::Off {
        guard.disarm();
    }
    runner.close(outcome).await
}

struct Runner<'a> {
    around: &'a Surroundings<'a>,
    /// What an earlier run did.
    earlier: Earlier,
    /// What is to be re-established before the first step.
    restoration: Vec<Step>,
    situation: Situation,
    journal: Journal<'a>,
    /// The step that waits to be stored.
    pending: Option<StepRecord>,
    /// Why everything is to be made safe next; the session's end where nothing else is.
    cause: Option<Cause>,
    abort_seen: bool,
    unstored: Vec<StepNumber>,
    store_error: Option<SinkError>,
    summary: RunSummary,
}

impl<'a> Runner<'a> {
    fn new(
        steps: &[Step],
        header: &SessionHeader,
        earlier: Earlier,
        around: &'a Surroundings<'a>,
    ) -> Self {
        let Surroundings { observers, clock, .. } = *around;
        let mut journal = Journal { observers, clock, events: Vec::new() };
        if earlier.done.is_empty() {
            let message = format!("session {} opened: {}", header.id, header.title);
            journal.note(EventKind::Opened, message);
        } else {
            let message = format!("session {} resumed: {}", header.id, header.title);
            journal.note(EventKind::Resumed, message);
        }
        let mut situation = Situation::default();
        for step in steps.iter().filter(|step| earlier.done.contains(&step.number)) {
            let readings = earlier.readings.get(&step.number);
            situation.replay(step, readings.map_or(&[], Vec::as_slice));
        }
        let done = steps.iter().filter(|step| earlier.done.contains(&step.number));
        let summary = RunSummary {
            session: header.id,
            outcome: SessionOutcome::Error,
            closed: header.opened,
            steps: steps.len(),
            steps_done: earlier.done.len(),
            captures: done.filter(|step| step.action.kind() == "capture").count(),
            failures: Vec::new(),
            abort_reason: None,
            lasers: Lasers::Unknown,
        };
        Self {
            around,
            restoration: restoration(steps, &earlier.done),
            earlier,
            situation,
            journal,
            pending: None,
            cause: None,
            abort_seen: false,
            unstored: Vec::new(),
            store_error: None,
            summary,
        }
    }

    async fn follow_machine(&mut self, steps: &[Step]) -> SessionOutcome {
        let sections: Vec<Section> = steps.iter().map(|step| step.section).collect();
        let is_done = |i: usize| self.earlier.done.contains(&steps[i].number);
        let mut machine = Machine::resuming(&sections, is_done);
        let mut input = Input::Begin;
        loop {
            input = match machine.next(input) {
                Command::Prepare => self.prepare().await,
                Command::Run { step } => self.step(&steps[step]).await,
                Command::Secure => {
                    let cause = self.cause.take().unwrap_or(Cause::SessionEnd);
                    Input::Secured(self.secure(&cause).await)
                }
                Command::Store => self.store().await,
                Command::Close(outcome) => return outcome,
            };
        }
    }

    async fn prepare(&mut self) -> Input {
        let lasers = self.secure(&Cause::SessionStart).await;
        let identified = self.identify().await;
        if lasers == Lasers::Off && identified && self.restore().await {
            return Input::Prepared;
        }
        self.cause = Some(Cause::NotPrepared);
        Input::PreparationFailed
    }

    /// Re-establishes what later steps rely on; false where that failed. An abort ends it at once:
    /// the machine hears of it before the next step.
    async fn restore(&mut self) -> bool {
        // What was read before the run stopped is what the next capture refers to.
        let known = self.situation.clone();
        for step in std::mem::take(&mut self.restoration) {
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
        let moving = std::mem::take(&mut self.situation.moving);
        self.situation = known;
        self.situation.moving = moving;
        true
    }

    /// Asks every instrument who it is; true when all answered.
    async fn identify(&mut self) -> bool {
        let Surroundings { bench, clock, .. } = *self.around;
        let instruments = bench.instruments();
        let asking = instruments.values().map(|it| within(clock, IDENTIFY_DEADLINE, it.identify()));
        let answers = join_all(asking).await;
        let mut all = true;
        for (name, answer) in instruments.keys().zip(answers) {
            let answer = answer.unwrap_or_else(|limit| Err(InstrumentError::Timeout(limit)));
            match answer {
                Ok(identity) => {
                    let serial = identity.serial.map(|serial| format!(", serial {serial}"));
                    let simulated = if identity.simulated { ", simulated" } else { "" };
                    let of = format!("{}{}{simulated}", identity.model, serial.unwrap_or_default());
                    self.journal.note(EventKind::Identified, format!("{name}: {of}"));
                }
                Err(source) => {
                    all = false;
                    let fault = Fault::Instrument { name: (*name).clone(), source };
                    self.fail(None, "preparation", fault.to_string());
                }
            }
        }
        all
    }

    fn fail(&mut self, step: Option<StepNumber>, doing: &str, reason: String) {
        let place = step.map_or_else(String::new, |step| format!("step {step}, "));
        self.journal.note(EventKind::StepFailed, format!("{place}{doing}: {reason}"));
        self.summary.failures.push(StepFailure { step, doing: doing.to_owned(), reason });
    }

    async fn secure(&mut self, cause: &Cause) -> Lasers {
        let Surroundings { bench, clock, .. } = *self.around;
        let (lasers, events) = secure(bench, &mut self.situation.moving, clock, cause).await;
        for event in events {
            self.journal.note_event(event);
        }
        self.summary.lasers = lasers;
        lasers
    }

    async fn step(&mut self, step: &Step) -> Input {
        if self.see_abort(step) {
            return Input::AbortRequested;
        }
        self.journal.observers.tell(&Notice::StepStarted(Arc::new(step.clone())));
        let clock = self.around.clock;
        let started = clock.now();
        let mut acquired = Acquired::default();
        let ended = self.perform(step, started, &mut acquired).await;
        let finished = clock.now();
        let (outcome, input) = match ended {
            Some(Ok(())) => (StepOutcome::Done, Input::StepDone),
            Some(Err(fault)) => {
                let reason = fault.to_string();
                self.fail(Some(step.number), &step.to_string(), reason.clone());
                self.cause = Some(Cause::StepFailed(step.number));
                (StepOutcome::Failed { reason }, Input::StepFailed)
            }
            None => {
                self.see_abort(step);
                let reason = format!("interrupted: {}", self.abort_reason());
                (StepOutcome::Failed { reason }, Input::StepInterrupted)
            }
        };
        self.pending = Some(StepRecord {
            number: step.number,
            label: step.to_string(),
            kind: step.action.kind().to_owned(),
            started,
            finished,
            outcome,
            readings: acquired.readings,
            capture: acquired.capture,
            events: Vec::new(),
        });
        input
    }

    /// Performs a step; `None` where an abort interrupted it.
    async fn perform(
        &mut self,
        step: &Step,
        started: Stamp,
        acquired: &mut Acquired,
    ) -> Option<Result<(), Fault>> {
        let Surroundings { bench, clock, abort, .. } = *self.around;
        let until = started.monotonic.saturating_add(step.deadline.duration());
        let (situation, journal) = (&mut self.situation, &mut self.journal);
        let doing = Doing { step, bench, clock, situation, journal, acquired, until };
        if !can_be_interrupted(step) {
            return Some(doing.perform().await);
        }
        let performing = std::pin::pin!(doing.perform());
        match select(performing, std::pin::pin!(abort.requested())).await {
            Either::Left((ended, _)) => Some(ended),
            Either::Right(((), _)) => None,
        }
    }

    fn abort_reason(&self) -> &str {
        self.around.abort.reason().unwrap_or("abort")
    }

    /// True the first time that an abort is seen; it is noted then.
    fn see_abort(&mut self, before: &Step) -> bool {
        let Some(reason) = self.around.abort.reason().filter(|_| !self.abort_seen) else {
            return false;
        };
        self.abort_seen = true;
        self.journal.note(EventKind::AbortRequested, reason.to_owned());
        self.summary.abort_reason = Some(reason.to_owned());
        if before.section == Section::Main {
            self.cause = Some(Cause::Abort(reason.to_owned()));
        }
        true
    }

    async fn store(&mut self) -> Input {
        let Some(mut record) = self.pending.take() else {
            return Input::Stored;
        };
        record.events = std::mem::take(&mut self.journal.events);
        let number = record.number;
        let Surroundings { sink, clock, .. } = *self.around;
        let storing = sink.step(self.summary.session, &record);
        if let Err(error) = kept(clock, &format!("step {number}"), storing).await {
            // What was noted goes with the next that can be stored.
            self.journal.events = record.events;
            self.fail(Some(number), "storing it", error.to_string());
            self.unstored.push(number);
            self.store_error.get_or_insert(error);
            self.cause = Some(Cause::NotStored(number));
            return Input::StoreFailed;
        }
        if record.outcome == StepOutcome::Done {
            self.summary.steps_done += 1;
        }
        let capture = record.capture.take();
        self.journal.observers.tell(&Notice::StepDone(Arc::new(record)));
        if let Some(capture) = capture {
            self.summary.captures += 1;
            self.journal.observers.captured(number, capture);
        }
        Input::Stored
    }

    async fn close(mut self, outcome: SessionOutcome) -> Result<RunSummary, EngineError> {
        let Surroundings { sink, clock, .. } = *self.around;
        self.journal.note(EventKind::Closed, format!("session closed: {}", outcome.as_str()));
        let at = clock.now();
        (self.summary.outcome, self.summary.closed) = (outcome, at);
        let closing = sink.close(self.summary.session, outcome, &self.journal.events, at);
        let closed = kept(clock, "the end of the session", closing).await;
        let summary = self.summary;
        self.journal.observers.tell(&Notice::Closed(Arc::new(summary.clone())));
        if let Some(source) = self.store_error {
            let summary = Box::new(summary);
            return Err(EngineError::NotStored { steps: self.unstored, source, summary });
        }
        match closed {
            Ok(()) => Ok(summary),
            Err(source) => Err(EngineError::NotClosed { source, summary: Box::new(summary) }),
        }
    }
}

/// Waits for the store, while a virtual clock stands still.
async fn kept(
    clock: &dyn Clock,
    what: &str,
    storing: impl Future<Output = Result<(), SinkError>>,
) -> Result<(), SinkError> {
    let _stands_still = clock.external();
    within(clock, STORE_DEADLINE, storing).await.unwrap_or_else(|limit| {
        Err(SinkError { what: what.to_owned(), reason: format!("not durable within {limit:?}") })
    })
}

/// Waits, moves and a laser's emission delay end at once when somebody asks to stop; a reading or
/// a capture takes its time, so that what it acquires is whole. `finally` is never interrupted.
fn can_be_interrupted(step: &Step) -> bool {
    step.section == Section::Main
        && matches!(step.action, Action::Wait { .. } | Action::Move { .. } | Action::LaserOn { .. })
}
