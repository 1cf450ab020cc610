//! Does what the machine says, step by step, on one task: it joins, and spawns nothing, so that a
//! virtual clock can drive it.

mod conditions;
mod pause;
mod step;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use beampose_core::clock::{Clock, within};
use beampose_core::{
    EventKind, Gap, InstrumentError, RunSink, SessionHeader, SessionId, SessionOutcome, SinkError,
    Stamp, StepNumber, StepRecord,
};
use beampose_plan::{Rules, Section, Step};
use futures::future::{Either, join_all, select};
use tracing::Instrument as _;

use crate::actions::{Fault, Journal, Situation};
use crate::machine::{Command, Input, Lasers, Machine};
use crate::operator::Operator;
use crate::resume::{Earlier, restoration};
use crate::safe_state::{Cause, LaserGuard, Unsettled, secure};
use crate::{Bench, Control, EngineError, Notice, Observers, Wish};

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
    pub control: &'a Control,
    /// Who answers questions.
    pub operator: &'a dyn Operator,
    /// What holds for the whole plan.
    pub rules: &'a Rules,
    /// How long what cannot be stored is offered again before it is given up.
    pub store_patience: Duration,
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
    /// What could not be stored, in order: it is nowhere else.
    pub unstored: Vec<StepRecord>,
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
    let following = async {
        let mut runner = Runner::new(steps, header, earlier, around);
        let lit = runner.situation.lit.clone();
        let outcome = {
            let watch = std::pin::pin!(lit.watch(around.bench, around.clock));
            match select(std::pin::pin!(runner.follow_machine()), watch).await {
                Either::Left((outcome, _)) => outcome,
                Either::Right((never, _)) => match never {},
            }
        };
        if runner.summary.lasers == Lasers::Off {
            guard.disarm();
        }
        runner.close(outcome).await
    };
    following.instrument(tracing::info_span!("session", id = %header.id)).await
}

struct Runner<'a> {
    around: &'a Surroundings<'a>,
    steps: &'a [Step],
    /// Main steps that did what they are for: what they left is relied on.
    done: BTreeSet<StepNumber>,
    /// Main steps that were skipped or passed over.
    passed: BTreeSet<StepNumber>,
    /// What is to be re-established before the first step.
    restoration: Vec<Step>,
    situation: Situation,
    journal: Journal<'a>,
    /// The step that waits to be stored.
    pending: Option<StepRecord>,
    /// Why everything is to be made safe next; the session's end where nothing else is.
    cause: Option<Cause>,
    /// The most urgent wish that was obeyed, or noted in `finally`.
    seen: Option<Wish>,
    /// When each condition was last found to hold.
    held: Vec<Option<Duration>>,
    /// When the first step of each block with a time of its own began.
    blocks: BTreeMap<u32, Duration>,
    store_error: Option<SinkError>,
    /// The last stamp that the wall clock was held against.
    clock_seen: Stamp,
    summary: RunSummary,
}

impl<'a> Runner<'a> {
    fn new(
        steps: &'a [Step],
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
        situation.answers.clone_from(&earlier.answers);
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
            unstored: Vec::new(),
            lasers: Lasers::Unknown,
        };
        Self {
            around,
            restoration: restoration(steps, &earlier.done),
            steps,
            done: earlier.done,
            passed: earlier.passed,
            situation,
            journal,
            pending: None,
            cause: None,
            seen: None,
            held: vec![None; around.rules.conditions.len()],
            blocks: BTreeMap::new(),
            store_error: None,
            clock_seen: around.clock.now(),
            summary,
        }
    }

    async fn follow_machine(&mut self) -> SessionOutcome {
        let steps = self.steps;
        let sections: Vec<Section> = steps.iter().map(|step| step.section).collect();
        let is_behind = |number| self.done.contains(number) || self.passed.contains(number);
        let is_done = |i: usize| is_behind(&steps[i].number);
        let mut machine = Machine::resuming(&sections, is_done);
        let mut input = Input::Begin;
        loop {
            input = match machine.next(input) {
                Command::Prepare => self.prepare().await,
                Command::Run { step } => {
                    let span = tracing::info_span!("step", number = steps[step].number.0);
                    self.step(&steps[step]).instrument(span).await
                }
                Command::Secure => {
                    let cause = self.cause.take().unwrap_or(Cause::SessionEnd);
                    Input::Secured(self.secure(&cause).await)
                }
                Command::Store => self.store().await,
                Command::Offer => self.offer().await,
                Command::AwaitOperator => self.await_operator().await,
                Command::Restore => self.restore_all().await,
                Command::Close(outcome) => return outcome,
            };
        }
    }

    async fn prepare(&mut self) -> Input {
        let lasers = self.secure(&Cause::SessionStart).await;
        let identified = self.identify().await;
        let restoration = std::mem::take(&mut self.restoration);
        if lasers == Lasers::Off && identified && self.restore(restoration).await {
            return Input::Prepared;
        }
        self.cause = Some(Cause::NotPrepared);
        Input::PreparationFailed
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
        let unsettled = self.unsettled();
        self.hear_of_lasers();
        let (lasers, events) = secure(bench, unsettled, clock, cause).await;
        for event in events {
            self.journal.note_event(event);
        }
        self.situation.lit.clear();
        self.summary.lasers = lasers;
        lasers
    }

    /// Puts into the journal what befell lasers that were on.
    fn hear_of_lasers(&mut self) {
        for event in self.situation.lit.take_events() {
            self.journal.note_event(event);
        }
    }

    fn unsettled(&mut self) -> Unsettled {
        let situation = &mut self.situation;
        Unsettled {
            moving: std::mem::take(&mut situation.moving),
            armed: std::mem::take(&mut situation.armed),
        }
    }

    async fn close(mut self, outcome: SessionOutcome) -> Result<RunSummary, EngineError> {
        let Surroundings { sink, clock, .. } = *self.around;
        self.hear_of_lasers();
        self.journal.note(EventKind::Closed, format!("session closed: {}", outcome.as_str()));
        let at = clock.now();
        (self.summary.outcome, self.summary.closed) = (outcome, at);
        let closing = sink.close(self.summary.session, outcome, &self.journal.events, at);
        let closed = kept(clock, "the end of the session", closing).await;
        let summary = self.summary;
        self.journal.observers.tell(&Notice::Closed(Arc::new(summary.clone())));
        if let Some(source) = self.store_error.filter(|_| !summary.unstored.is_empty()) {
            let steps = summary.unstored.iter().map(|record| record.number).collect();
            return Err(EngineError::NotStored { steps, source, summary: Box::new(summary) });
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
