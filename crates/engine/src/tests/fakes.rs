//! A laboratory of fakes: each writes what it does into one log, so that tests see the order.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use async_trait::async_trait;
use beampose_core::instrument::{AxisUnit, ByHand};
use beampose_core::{
    Axis, Camera, Clock, Emission, Event, EventKind, Frame, Gap, Identity, Instrument,
    InstrumentError, InstrumentName, Interlock, Laser, Quantity, Reading, RunSink, Sensor,
    SessionHeader, SessionId, SessionOutcome, SinkError, Stamp, StepRecord, VirtualClock,
};
use beampose_plan::{Rules, Step};

pub use super::steps::*;

use crate::{
    Bench, Control, EngineError, Nobody, Observers, Operator, RunSummary, Surroundings, Wish, run,
};

#[derive(Clone, Default)]
pub struct Log(Arc<Mutex<Vec<String>>>);

impl Log {
    pub fn write(&self, line: impl Into<String>) {
        self.0.lock().unwrap().push(line.into());
    }

    pub fn lines(&self) -> Vec<String> {
        self.0.lock().unwrap().clone()
    }

    /// The place of the first line that is `line`.
    #[track_caller]
    pub fn place(&self, line: &str) -> usize {
        let lines = self.lines();
        lines
            .iter()
            .position(|it| it == line)
            .unwrap_or_else(|| panic!("no {line:?} in {lines:#?}"))
    }

    pub fn has(&self, line: &str) -> bool {
        self.lines().iter().any(|it| it == line)
    }
}

/// What is wrong with a fake.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Fault {
    #[default]
    None,
    /// It never answers when it is to do its work.
    Hangs,
    /// It refuses its work.
    Fails,
    /// It refuses its work so many times.
    FailsAtFirst(u32),
    /// Its interlock is open from the first second to the second.
    InterlockOpen(u64, u64),
    /// A laser whose interlock opens whenever it emits.
    LooseContact,
    /// A laser whose interlock never answers.
    ContactHangs,
    /// A laser without an interlock.
    NoContact,
    /// A sensor that reads one more from the first second to the second.
    ReadsHigh(u64, u64),
    /// A camera whose trigger goes out 80 ms late so many times.
    TriggersLate(u32),
    /// An axis that somebody moves: there after a minute, on the way before.
    ByHand,
    /// Its work panics.
    Panics,
    /// It does not say who it is.
    Nameless,
    /// A laser that answers "off" with an error.
    OffFails,
    /// A laser that never answers "off".
    OffHangs,
    /// A laser that cannot be read back.
    Unreadable,
    /// A laser that still reads as on.
    StaysOn,
    /// A laser whose last resort panics.
    LastResortPanics,
    /// An instrument that reads what is no number.
    ReadsNan,
}

pub struct Fake {
    name: &'static str,
    log: Log,
    clock: VirtualClock,
    fault: Fault,
    state: Mutex<(Emission, f64)>,
    calls: AtomicU32,
    looks: Arc<AtomicU32>,
}

impl Fake {
    fn new(name: &'static str, lab: &Lab) -> Self {
        let fault = lab.faults.get(name).copied().unwrap_or_default();
        let state = Mutex::new((Emission::Off, 0.0));
        let (log, clock, calls) = (lab.log.clone(), lab.clock.clone(), AtomicU32::new(0));
        let looks = Arc::clone(&lab.looks);
        Self { name, log, clock, fault, state, calls, looks }
    }

    fn is_between(&self, from: u64, to: u64) -> bool {
        (from..to).contains(&self.clock.now().monotonic.as_secs())
    }

    async fn work(&self, what: &str, takes: u64) -> Result<(), InstrumentError> {
        self.log.write(format!("{} {what}", self.name));
        match self.fault {
            Fault::Hangs => std::future::pending().await,
            Fault::Fails => return Err(InstrumentError::Fault("out of order".to_owned())),
            Fault::FailsAtFirst(times) if self.calls.fetch_add(1, Ordering::Relaxed) < times => {
                return Err(InstrumentError::Fault("out of order".to_owned()));
            }
            Fault::Panics => panic!("driver of {}", self.name),
            _ => {}
        }
        self.clock.sleep(Duration::from_secs(takes)).await;
        Ok(())
    }

    fn reading(&self, quantity: Quantity, value: f64) -> Reading {
        let value = match self.fault {
            Fault::ReadsNan => f64::NAN,
            Fault::ReadsHigh(from, to) if self.is_between(from, to) => value + 1.0,
            _ => value,
        };
        Reading { quantity, value, standard_uncertainty: None, at: self.clock.now() }
    }
}

#[async_trait]
impl Instrument for Fake {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        if self.fault == Fault::Nameless {
            return Err(InstrumentError::Disconnected("no cable".to_owned()));
        }
        Ok(Identity { model: format!("fake {}", self.name), serial: None, simulated: true })
    }
}

#[async_trait]
impl Axis for Fake {
    async fn move_to(&self, target: f64) -> Result<(), InstrumentError> {
        if self.fault == Fault::ByHand {
            return Ok(());
        }
        self.work(&format!("to {target}"), 3).await?;
        self.state.lock().unwrap().1 = target + 0.25;
        Ok(())
    }

    async fn position(&self) -> Result<Reading, InstrumentError> {
        if self.fault == Fault::ByHand {
            let on_the_way = self.clock.now().monotonic.as_secs_f64() / 60.0;
            return Ok(self.reading(Quantity::Position, 10.0 * on_the_way.min(1.0)));
        }
        let (value, quantity) = (
            self.state.lock().unwrap().1,
            match self.unit() {
                AxisUnit::Millimetre => Quantity::Position,
                AxisUnit::Degree => Quantity::Angle,
            },
        );
        Ok(self.reading(quantity, value))
    }

    async fn stop(&self) -> Result<(), InstrumentError> {
        self.log.write(format!("{} stop", self.name));
        Ok(())
    }

    fn by_hand(&self) -> Option<ByHand> {
        let by_hand = ByHand { tolerance: 0.05, still_for: Duration::from_secs(2) };
        (self.fault == Fault::ByHand).then_some(by_hand)
    }

    fn unit(&self) -> AxisUnit {
        if self.name == "stage" { AxisUnit::Degree } else { AxisUnit::Millimetre }
    }
}

#[async_trait]
impl Laser for Fake {
    async fn emit(&self) -> Result<(), InstrumentError> {
        self.state.lock().unwrap().0 = Emission::On;
        self.work("emit", 5).await
    }

    async fn off(&self) -> Result<(), InstrumentError> {
        self.log.write(format!("{} off", self.name));
        match self.fault {
            Fault::OffFails => return Err(InstrumentError::Disconnected("no cable".to_owned())),
            Fault::OffHangs => std::future::pending().await,
            Fault::StaysOn => {}
            _ => self.state.lock().unwrap().0 = Emission::Off,
        }
        Ok(())
    }

    async fn emission(&self) -> Emission {
        match self.fault {
            Fault::Unreadable => Emission::Unknown,
            Fault::StaysOn => Emission::On,
            _ => self.state.lock().unwrap().0,
        }
    }

    fn interlock(&self) -> Option<&dyn Interlock> {
        (self.fault != Fault::NoContact).then_some(self as &dyn Interlock)
    }

    fn off_without_waiting(&self) {
        self.log.write(format!("{} off without waiting", self.name));
        assert!(self.fault != Fault::LastResortPanics, "driver of {}", self.name);
        self.state.lock().unwrap().0 = Emission::Off;
    }
}

#[async_trait]
impl Interlock for Fake {
    async fn is_closed(&self) -> Result<bool, InstrumentError> {
        self.looks.fetch_add(1, Ordering::Relaxed);
        if self.fault == Fault::ContactHangs {
            std::future::pending::<()>().await;
        }
        let emits = self.state.lock().unwrap().0 == Emission::On;
        let is_open = match self.fault {
            Fault::InterlockOpen(from, to) => self.is_between(from, to),
            Fault::LooseContact => emits,
            _ => false,
        };
        Ok(!is_open)
    }
}

#[async_trait]
impl Sensor for Fake {
    async fn read(&self) -> Result<Reading, InstrumentError> {
        self.work("read", 1).await?;
        Ok(match self.name {
            "wavemeter" => self.reading(Quantity::Wavelength, 658.02),
            _ => self.reading(Quantity::Temperature, 21.5),
        })
    }
}

#[async_trait]
impl Camera for Fake {
    async fn arm(&self) -> Result<(), InstrumentError> {
        self.log.write(format!("{} arm", self.name));
        Ok(())
    }

    async fn disarm(&self) -> Result<(), InstrumentError> {
        self.log.write(format!("{} disarm", self.name));
        Ok(())
    }

    async fn trigger(&self) -> Result<Frame, InstrumentError> {
        if matches!(self.fault, Fault::TriggersLate(times) if self.calls.fetch_add(1, Ordering::Relaxed) < times)
        {
            self.clock.sleep(Duration::from_millis(80)).await;
        }
        let requested = self.clock.now();
        self.work("trigger", 2).await?;
        let bytes = self.name.as_bytes().to_vec();
        Ok(Frame { bytes, requested, delivered: self.clock.now() })
    }
}

/// Keeps what it is given, unless told to fail at a step (0 is opening).
#[derive(Default)]
pub struct Memory {
    pub log: Log,
    pub fails_at: Option<u32>,
    /// After so many failures it works again.
    pub recovers_after: Option<u32>,
    failures: AtomicU32,
    pub records: Mutex<Vec<StepRecord>>,
    pub closed: Mutex<Option<(SessionOutcome, Vec<Event>)>>,
}

impl Memory {
    fn fails(&self, step: u32) -> Result<(), SinkError> {
        let failed = self.failures.load(Ordering::Relaxed);
        if self.fails_at != Some(step) || self.recovers_after.is_some_and(|n| failed >= n) {
            return Ok(());
        }
        self.failures.fetch_add(1, Ordering::Relaxed);
        Err(SinkError { what: format!("step {step}"), reason: "disk full".to_owned() })
    }
}

#[async_trait]
impl RunSink for Memory {
    async fn open(&self, _: &SessionHeader) -> Result<(), SinkError> {
        self.fails(0)
    }

    async fn reopen(&self, _: SessionId, _: &Gap) -> Result<(), SinkError> {
        self.log.write("reopened");
        self.fails(0)
    }

    async fn step(&self, _: SessionId, record: &StepRecord) -> Result<(), SinkError> {
        self.log.write(format!("stored {}", record.number));
        self.fails(record.number.0)?;
        self.records.lock().unwrap().push(record.clone());
        Ok(())
    }

    async fn close(
        &self,
        _: SessionId,
        outcome: SessionOutcome,
        events: &[Event],
        _: Stamp,
    ) -> Result<(), SinkError> {
        self.log.write("closed");
        self.fails(u32::MAX)?;
        *self.closed.lock().unwrap() = Some((outcome, events.to_vec()));
        Ok(())
    }
}

/// The laboratory of one test: set it up, run it, look at what is left.
pub struct Lab {
    pub clock: VirtualClock,
    pub log: Log,
    /// How often interlocks were asked.
    pub looks: Arc<AtomicU32>,
    pub faults: BTreeMap<&'static str, Fault>,
    pub sink: Memory,
    pub observers: Observers,
    pub control: Control,
    pub operator: Box<dyn Operator>,
    pub rules: Rules,
    pub store_patience: Duration,
    /// Wishes, each so many seconds after the start.
    pub wishes: Vec<(u64, Wish)>,
    pub dropped_after: Option<u64>,
}

pub type Ran = Result<RunSummary, EngineError>;

impl Lab {
    pub fn new() -> Self {
        let log = Log::default();
        Self {
            clock: VirtualClock::starting_at(jiff::Timestamp::UNIX_EPOCH),
            sink: Memory { log: log.clone(), ..Memory::default() },
            log,
            looks: Arc::default(),
            faults: BTreeMap::new(),
            observers: Observers::none(),
            control: Control::new(),
            operator: Box::new(Nobody),
            rules: Rules::default(),
            store_patience: Duration::ZERO,
            wishes: Vec::new(),
            dropped_after: None,
        }
    }

    pub fn with_fault(name: &'static str, fault: Fault) -> Self {
        let mut lab = Self::new();
        lab.faults.insert(name, fault);
        lab
    }

    pub fn bench(&self) -> Bench {
        let fake =
            |name: &'static str| (InstrumentName::from(name), Arc::new(Fake::new(name, self)));
        let mut bench = Bench::default();
        bench
            .axes
            .extend(["rail", "stage"].map(fake).map(|(name, it)| (name, it as Arc<dyn Axis>)));
        bench.lasers.extend(["laser"].map(fake).map(|(name, it)| (name, it as Arc<dyn Laser>)));
        let sensors = ["wavemeter", "thermometer"].map(fake);
        bench.sensors.extend(sensors.map(|(name, it)| (name, it as Arc<dyn Sensor>)));
        let cameras = ["cam_a", "cam_b"].map(fake);
        bench.cameras.extend(cameras.map(|(name, it)| (name, it as Arc<dyn Camera>)));
        bench
    }

    /// A bench with nothing but lasers of these names.
    pub fn lasers(&self, names: [&'static str; 2]) -> Bench {
        let fake = |name: &'static str| -> (InstrumentName, Arc<dyn Laser>) {
            (name.into(), Arc::new(Fake::new(name, self)))
        };
        Bench { lasers: names.map(fake).into(), ..Bench::default() }
    }

    /// Runs these steps in virtual time; `None` where the run was dropped midway.
    pub fn try_run(&self, steps: &[Step]) -> Option<Ran> {
        let (bench, clock) = (self.bench(), &self.clock);
        let around = Surroundings {
            bench: &bench,
            sink: &self.sink,
            observers: &self.observers,
            clock,
            control: &self.control,
            operator: &*self.operator,
            rules: &self.rules,
            store_patience: self.store_patience,
        };
        let header = header(steps);
        let running = async {
            let limit = Duration::from_secs(self.dropped_after.unwrap_or(1_000_000));
            beampose_core::clock::within(clock, limit, run(steps, &header, &around)).await.ok()
        };
        let operator = async {
            for (at, wish) in &self.wishes {
                let at = Duration::from_secs(*at);
                clock.sleep(at.saturating_sub(clock.now().monotonic)).await;
                self.control.request(*wish, "Ctrl-C");
            }
        };
        let both = async { futures::future::join(running, operator).await.0 };
        futures::executor::block_on(clock.drive(Box::pin(both)))
    }

    pub fn run(&self, steps: &[Step]) -> Ran {
        self.try_run(steps).unwrap()
    }

    pub fn outcome(&self, steps: &[Step]) -> SessionOutcome {
        let outcome = self.run(steps).unwrap().outcome;
        assert_eq!(self.sink.closed.lock().unwrap().as_ref().unwrap().0, outcome);
        outcome
    }

    pub fn stored(&self) -> Vec<u32> {
        self.sink.records.lock().unwrap().iter().map(|record| record.number.0).collect()
    }

    pub fn record(&self, number: u32) -> StepRecord {
        let records = self.sink.records.lock().unwrap();
        records.iter().find(|record| record.number.0 == number).unwrap().clone()
    }

    /// All stored events, those of the end included.
    pub fn events(&self) -> Vec<Event> {
        let records = self.sink.records.lock().unwrap();
        let mut events: Vec<_> = records.iter().flat_map(|record| record.events.clone()).collect();
        events.extend(self.sink.closed.lock().unwrap().iter().flat_map(|(_, end)| end.clone()));
        events
    }

    pub fn kinds(&self) -> Vec<EventKind> {
        self.events().iter().map(|event| event.kind).collect()
    }

    /// Whether the last thing that a laser was told is "off"; `None` if it was never told anything.
    pub fn run_ended_dark(&self) -> Option<bool> {
        let lines = self.log.lines();
        let last = lines.iter().rfind(|line| line.starts_with("laser "))?;
        Some(last == "laser off")
    }

    pub fn seconds(&self) -> f64 {
        self.clock.now().monotonic.as_secs_f64()
    }
}
