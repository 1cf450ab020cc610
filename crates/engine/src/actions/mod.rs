//! The one `match` over actions: what each does with the instruments.
//!
//! Every instrument is asked with the step's deadline. What was acquired before a failure is kept.

use std::collections::{BTreeMap, BTreeSet};
use std::future::Future;
use std::time::Duration;

mod align;
mod capture;
mod fault;
mod person;

use beampose_core::clock::{Clock, within};
use beampose_core::instrument::AxisUnit;
use beampose_core::{
    Answer, CaptureRecord, Emission, Event, EventKind, InstrumentError, InstrumentName, Look,
    Quantity, Reading,
};
use beampose_plan::{Action, Step};

pub(crate) use self::fault::Fault;
use crate::Bench;
use crate::bench::Readable;
use crate::interlock::Lit;
use crate::observe::{Notice, Observers};
use crate::operator::Operator;
use crate::safe_state::{Cause, switch_off};

/// What is known of the laboratory from one step to the next.
#[derive(Debug, Clone, Default)]
pub(crate) struct Situation {
    /// Where axes were last told to be, keyed as `rail_mm`.
    setpoints: BTreeMap<String, f64>,
    /// What encoders read since their axis last moved, keyed alike.
    encoders: BTreeMap<String, f64>,
    /// What sensors read since any axis last moved.
    sensed: BTreeMap<InstrumentName, (Quantity, f64)>,
    /// Axes told to move that have not confirmed to stand.
    pub(crate) moving: BTreeSet<InstrumentName>,
    /// Cameras armed and not yet triggered.
    pub(crate) armed: BTreeSet<InstrumentName>,
    /// Lasers that are on.
    pub(crate) lit: Lit,
    /// What each instrument read last.
    pub(crate) last: BTreeMap<InstrumentName, f64>,
    /// What the operator answered.
    pub(crate) answers: BTreeMap<String, String>,
    /// Which dot each axis brought to its pixel last, and what its encoder read there.
    pub(crate) aligned: BTreeMap<InstrumentName, ([i32; 2], f64)>,
}

impl Situation {
    /// What a step that was done left behind, from its readings.
    pub(crate) fn replay(&mut self, step: &Step, readings: &[(InstrumentName, Reading)]) {
        if let Action::Move { axis, target, unit } = &step.action {
            self.moved(axis, *target, *unit);
        }
        for (name, reading) in readings {
            self.have_read(name, reading);
        }
        if let (Action::Align { axis, dot, .. }, [(_, reading)]) = (&step.action, readings) {
            self.aligned.insert(axis.clone(), (*dot, reading.value));
        }
    }

    /// An axis was told to move: what was read before holds no more.
    fn moved(&mut self, axis: &InstrumentName, target: f64, unit: AxisUnit) {
        let key = format!("{axis}_{}", suffix(unit));
        self.sensed.clear();
        self.encoders.remove(&key);
        self.setpoints.insert(key, target);
    }

    fn have_read(&mut self, name: &InstrumentName, reading: &Reading) {
        self.last.insert(name.clone(), reading.value);
        match reading.quantity {
            Quantity::Position | Quantity::Angle => {
                let key = format!("{name}_{}", reading.quantity.suffix());
                self.encoders.insert(key, reading.value);
            }
            _ => {
                self.sensed.insert(name.clone(), (reading.quantity, reading.value));
            }
        }
    }
}

fn suffix(unit: AxisUnit) -> &'static str {
    match unit {
        AxisUnit::Millimetre => "mm",
        AxisUnit::Degree => "deg",
    }
}

/// Events that wait for the next transaction; displays hear of them at once.
pub(crate) struct Journal<'a> {
    pub(crate) observers: &'a Observers,
    pub(crate) clock: &'a dyn Clock,
    pub(crate) events: Vec<Event>,
}

impl Journal<'_> {
    pub(crate) fn note(&mut self, kind: EventKind, message: String) {
        self.note_event(Event { at: self.clock.now(), kind, message });
    }

    pub(crate) fn note_event(&mut self, event: Event) {
        let kind = event.kind;
        match kind {
            EventKind::LaserUnknown
            | EventKind::InterlockTripped
            | EventKind::StepFailed
            | EventKind::StoreFailed => {
                tracing::warn!(?kind, "{}", event.message);
            }
            _ => tracing::info!(?kind, "{}", event.message),
        }
        self.observers.tell(&Notice::Event(event.clone()));
        self.events.push(event);
    }
}

/// What a step acquires.
#[derive(Debug, Default)]
pub(crate) struct Acquired {
    pub(crate) readings: Vec<(InstrumentName, Reading)>,
    pub(crate) capture: Option<CaptureRecord>,
    pub(crate) answer: Option<Answer>,
    pub(crate) looks: Vec<Look>,
}

/// One step under way.
pub(crate) struct Doing<'a, 'j> {
    pub(crate) step: &'a Step,
    pub(crate) bench: &'a Bench,
    pub(crate) clock: &'a dyn Clock,
    pub(crate) operator: &'a dyn Operator,
    /// How far apart the triggers of a capture may be.
    pub(crate) max_skew: Duration,
    pub(crate) situation: &'a mut Situation,
    pub(crate) journal: &'a mut Journal<'j>,
    pub(crate) acquired: &'a mut Acquired,
    /// The monotonic time at which the step has failed.
    pub(crate) until: Duration,
    /// How long what is under way may take, for people.
    pub(crate) limit: Duration,
}

impl Doing<'_, '_> {
    /// Does what the step says.
    pub(crate) async fn perform(mut self) -> Result<(), Fault> {
        match &self.step.action {
            Action::LaserOn { laser } => self.laser_on(laser).await,
            Action::LaserOff { laser } => self.laser_off(laser).await,
            Action::Wait { duration } => self.wait(duration.duration()).await,
            Action::Move { axis, target, unit } => self.move_axis(axis, *target, *unit).await,
            Action::Read { instruments } => self.read_all(instruments).await,
            Action::Prompt { name, text, asks, default } => {
                self.prompt(name, text, asks, default.as_deref()).await
            }
            Action::Capture { id, cameras } => self.capture(id, cameras).await,
            Action::Align { .. } => self.align().await,
        }
    }

    /// What is left until the step's deadline.
    fn left(&self) -> Duration {
        self.until.saturating_sub(self.clock.now().monotonic)
    }

    /// Waits for an instrument's answer, the step's deadline at most.
    async fn ask<T>(
        &self,
        name: &InstrumentName,
        work: impl Future<Output = Result<T, InstrumentError>>,
    ) -> Result<T, Fault> {
        let answer = within(self.clock, self.left(), work).await;
        let answer = answer.unwrap_or_else(|_| Err(InstrumentError::Timeout(self.limit)));
        answer.map_err(|source| Fault::Instrument { name: name.clone(), source })
    }

    async fn wait(&self, duration: Duration) -> Result<(), Fault> {
        let waited = within(self.clock, self.left(), self.clock.sleep(duration)).await;
        waited.map_err(|_| Fault::Deadline(self.step.deadline.duration()))
    }

    async fn laser_on(&mut self, name: &InstrumentName) -> Result<(), Fault> {
        let laser = self.bench.laser(name)?;
        let step = self.step.number;
        let lit = match self.ask(name, laser.emit()).await {
            Ok(()) => self.ask(name, async { Ok(laser.emission().await) }).await,
            Err(fault) => Err(fault),
        };
        let doubt = match lit {
            Ok(Emission::On) => {
                self.situation.lit.insert(name.clone());
                self.journal.note(EventKind::LaserOn, format!("{name} on (step {step})"));
                return Ok(());
            }
            Ok(Emission::Off) => {
                Fault::Laser(format!("{name}: told to emit, it reads back as off"))
            }
            Ok(Emission::Unknown) => {
                Fault::Laser(format!("{name}: told to emit, it cannot be read back"))
            }
            Err(fault) => fault,
        };
        let message = format!("{name} unknown, assume on: {doubt} (step {step})");
        self.journal.note(EventKind::LaserUnknown, message);
        Err(doubt)
    }

    async fn laser_off(&mut self, name: &InstrumentName) -> Result<(), Fault> {
        let laser = self.bench.laser(name)?;
        let cause = Cause::Planned(self.step.number);
        // Its own deadline, however long the plan would wait: this is the safe state.
        let event = switch_off(name, laser, self.clock, &cause).await;
        self.situation.lit.remove(name);
        let unknown = (event.kind == EventKind::LaserUnknown).then(|| event.message.clone());
        self.journal.note_event(event);
        unknown.map_or(Ok(()), |message| Err(Fault::Laser(message)))
    }

    async fn move_axis(
        &mut self,
        name: &InstrumentName,
        target: f64,
        planned: AxisUnit,
    ) -> Result<(), Fault> {
        let axis = self.bench.axis(name)?;
        let found = axis.unit();
        if found != planned {
            return Err(Fault::WrongUnit { name: name.clone(), planned, found });
        }
        let suffix = suffix(planned);
        self.situation.moved(name, target, planned);
        self.situation.moving.insert(name.clone());
        self.ask(name, axis.move_to(target)).await?;
        if let Some(by_hand) = axis.by_hand() {
            self.stand_by_hand(name, axis, target, by_hand).await?;
        }
        self.situation.moving.remove(name);
        let message = format!("{name} moved to {target} {suffix} (step {})", self.step.number);
        self.journal.note(EventKind::Moved, message);
        self.read(name).await?;
        // What a motor says of itself is not where the stage stands.
        let read = self.situation.last.get(name).copied().unwrap_or(f64::NAN);
        match self.bench.tolerances.get(name) {
            Some(tolerance) if (read - target).abs() > *tolerance => {
                let (name, tolerance) = (name.clone(), *tolerance);
                Err(Fault::NotThere { name, target, read, suffix, tolerance })
            }
            _ => Ok(()),
        }
    }

    /// One after another; one that does not answer leaves the others their time.
    async fn read_all(&mut self, instruments: &[InstrumentName]) -> Result<(), Fault> {
        let whole = self.until;
        let mut faults = Vec::new();
        for (i, name) in instruments.iter().enumerate() {
            let left = u32::try_from(instruments.len() - i).unwrap_or(u32::MAX);
            let now = self.clock.now().monotonic;
            if left > 1 {
                self.limit = whole.saturating_sub(now) / left;
            }
            self.until = now.saturating_add(whole.saturating_sub(now) / left);
            if let Err(fault) = self.read(name).await {
                faults.push(fault);
            }
        }
        Fault::of_several(faults)
    }

    async fn read(&mut self, name: &InstrumentName) -> Result<(), Fault> {
        let reading = self.look(name).await?;
        self.situation.have_read(name, &reading);
        for band in self.step.policy.accept.iter().filter(|band| band.instrument == *name) {
            if !band.holds(reading.value) {
                let (value, unit) = (reading.value, band.quantity.suffix());
                let message = format!(
                    "{name} read {value} {unit}; accepted is {band} (step {})",
                    self.step.number
                );
                self.journal.note(EventKind::OutOfLimits, message);
            }
        }
        self.acquired.readings.push((name.clone(), reading));
        Ok(())
    }

    /// A reading that is a number.
    pub(crate) async fn look(&self, name: &InstrumentName) -> Result<Reading, Fault> {
        let reading = match self.bench.readable(name)? {
            Readable::Axis(axis) => self.ask(name, axis.position()).await?,
            Readable::Sensor(sensor) => self.ask(name, sensor.read()).await?,
        };
        let value = reading.value;
        if value.is_finite() {
            Ok(reading)
        } else {
            Err(Fault::NotANumber { name: name.clone(), value })
        }
    }
}
