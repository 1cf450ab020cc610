//! The one `match` over actions: what each does with the instruments.
//!
//! Every instrument is asked with the step's deadline. What was acquired before a failure is kept.

use std::collections::{BTreeMap, BTreeSet};
use std::future::Future;
use std::time::Duration;

use beampose_core::clock::{Clock, within};
use beampose_core::instrument::AxisUnit;
use beampose_core::{
    Camera, CaptureId, CaptureRecord, Emission, Event, EventKind, Frame, InstrumentError,
    InstrumentName, Picture, Quantity, Reading,
};
use beampose_plan::{Action, Step};
use futures::future::join_all;

use crate::bench::Readable;
use crate::observe::{Notice, Observers};
use crate::safe_state::{Cause, switch_off};
use crate::{Bench, EngineError};

/// Why a step failed, in the words of its record.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Fault {
    #[error("{name}: {source}")]
    Instrument { name: InstrumentName, source: InstrumentError },
    #[error("{name}: it read {value}, which is no number")]
    NotANumber { name: InstrumentName, value: f64 },
    #[error("{name}: the plan counts in {planned:?}, the axis in {found:?}")]
    WrongUnit { name: InstrumentName, planned: AxisUnit, found: AxisUnit },
    #[error("{0}")]
    Laser(String),
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    Cameras(Vec<Fault>),
    #[error("not done within {0:?}")]
    Deadline(Duration),
    #[error(transparent)]
    Bench(#[from] EngineError),
}

/// What is known of the laboratory from one step to the next.
#[derive(Debug, Clone, Default)]
pub(crate) struct Situation {
    /// Where axes were last told to be, keyed as `rail_mm`.
    setpoints: BTreeMap<String, f64>,
    /// What encoders read since their axis last moved, keyed alike.
    encoders: BTreeMap<String, f64>,
    /// What sensors read since any axis last moved, keyed as `temperature_degc`.
    sensed: BTreeMap<String, f64>,
    /// Axes told to move that have not confirmed to stand.
    pub(crate) moving: BTreeSet<InstrumentName>,
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
    }

    /// An axis was told to move: what was read before holds no more.
    fn moved(&mut self, axis: &InstrumentName, target: f64, unit: AxisUnit) {
        let key = format!("{axis}_{}", suffix(unit));
        self.sensed.clear();
        self.encoders.remove(&key);
        self.setpoints.insert(key, target);
    }

    fn have_read(&mut self, name: &InstrumentName, reading: &Reading) {
        match reading.quantity {
            Quantity::Position | Quantity::Angle => {
                let key = format!("{name}_{}", reading.quantity.suffix());
                self.encoders.insert(key, reading.value);
            }
            _ => {
                self.sensed.insert(reading.quantity.to_string(), reading.value);
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
        self.observers.tell(&Notice::Event(event.clone()));
        self.events.push(event);
    }
}

/// What a step acquires.
#[derive(Debug, Default)]
pub(crate) struct Acquired {
    pub(crate) readings: Vec<(InstrumentName, Reading)>,
    pub(crate) capture: Option<CaptureRecord>,
}

/// One step under way.
pub(crate) struct Doing<'a, 'j> {
    pub(crate) step: &'a Step,
    pub(crate) bench: &'a Bench,
    pub(crate) clock: &'a dyn Clock,
    pub(crate) situation: &'a mut Situation,
    pub(crate) journal: &'a mut Journal<'j>,
    pub(crate) acquired: &'a mut Acquired,
    /// The monotonic time at which the step has failed.
    pub(crate) until: Duration,
}

impl Doing<'_, '_> {
    /// Does what the step says.
    pub(crate) async fn perform(mut self) -> Result<(), Fault> {
        match &self.step.action {
            Action::LaserOn { laser } => self.laser_on(laser).await,
            Action::LaserOff { laser } => self.laser_off(laser).await,
            Action::Wait { duration } => self.wait(duration.duration()).await,
            Action::Move { axis, target, unit } => self.move_axis(axis, *target, *unit).await,
            Action::Read { instruments } => {
                for name in instruments {
                    self.read(name).await?;
                }
                Ok(())
            }
            Action::Capture { id, cameras } => self.capture(id, cameras).await,
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
        let answer =
            answer.unwrap_or_else(|_| Err(InstrumentError::Timeout(self.step.deadline.duration())));
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
        self.situation.moving.remove(name);
        let message = format!("{name} moved to {target} {suffix} (step {})", self.step.number);
        self.journal.note(EventKind::Moved, message);
        self.read(name).await
    }

    async fn read(&mut self, name: &InstrumentName) -> Result<(), Fault> {
        let readable = self.bench.readable(name)?;
        let reading = match readable {
            Readable::Axis(axis) => self.ask(name, axis.position()).await?,
            Readable::Sensor(sensor) => self.ask(name, sensor.read()).await?,
        };
        let value = reading.value;
        if !value.is_finite() {
            return Err(Fault::NotANumber { name: name.clone(), value });
        }
        self.situation.have_read(name, &reading);
        self.acquired.readings.push((name.clone(), reading));
        Ok(())
    }

    /// All cameras are armed, then all are triggered together. Where one fails, what the others
    /// delivered is kept.
    async fn capture(&mut self, id: &CaptureId, names: &[InstrumentName]) -> Result<(), Fault> {
        let mut cameras: BTreeMap<&InstrumentName, &dyn Camera> = BTreeMap::new();
        for name in names {
            cameras.insert(name, self.bench.camera(name)?);
        }
        let arming = cameras.iter().map(|(name, camera)| self.ask(name, camera.arm()));
        let faults: Vec<Fault> =
            join_all(arming).await.into_iter().filter_map(Result::err).collect();
        if !faults.is_empty() {
            return Err(Fault::Cameras(faults));
        }
        let triggers = cameras.iter().map(|(name, camera)| self.ask(name, camera.trigger()));
        let frames = join_all(triggers).await;
        let (mut pictures, mut faults) = (Vec::new(), Vec::new());
        for (camera, frame) in cameras.keys().zip(frames) {
            match frame {
                Ok(frame) => pictures.push(picture(camera, frame)),
                Err(fault) => faults.push(fault),
            }
        }
        if !pictures.is_empty() {
            self.acquired.capture = Some(self.capture_record(id, pictures));
        }
        if faults.is_empty() { Ok(()) } else { Err(Fault::Cameras(faults)) }
    }

    fn capture_record(&self, id: &CaptureId, pictures: Vec<Picture>) -> CaptureRecord {
        let mut setpoints = self.step.context.clone();
        setpoints.extend(self.situation.setpoints.clone());
        let mut readings = self.situation.sensed.clone();
        readings.extend(self.situation.encoders.clone());
        CaptureRecord { id: id.clone(), setpoints, readings, pictures }
    }
}

fn picture(camera: &InstrumentName, frame: Frame) -> Picture {
    Picture {
        camera: camera.clone(),
        bytes: frame.bytes,
        requested: frame.requested,
        delivered: frame.delivered,
    }
}
