//! A laboratory of fakes: each writes what it does into one log, so that tests see the order.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use async_trait::async_trait;
use beampose_core::instrument::AxisUnit;
use beampose_core::units::Second;
use beampose_core::{
    Axis, Camera, Clock, Emission, Event, EventKind, Frame, Gap, Identity, Instrument,
    InstrumentError, InstrumentName, Laser, Quantity, Reading, RunSink, Sensor, SessionHeader,
    SessionId, SessionOutcome, SinkError, Stamp, StepNumber, StepRecord, VirtualClock,
};
use beampose_plan::{Action, Section, Step};

use crate::{AbortHandle, Bench, EngineError, Observers, RunSummary, Surroundings, run};

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
}

impl Fake {
    fn new(name: &'static str, lab: &Lab) -> Self {
        let fault = lab.faults.get(name).copied().unwrap_or_default();
        let state = Mutex::new((Emission::Off, 0.0));
        Self { name, log: lab.log.clone(), clock: lab.clock.clone(), fault, state }
    }

    async fn work(&self, what: &str, takes: u64) -> Result<(), InstrumentError> {
        self.log.write(format!("{} {what}", self.name));
        match self.fault {
            Fault::Hangs => std::future::pending().await,
            Fault::Fails => return Err(InstrumentError::Fault("out of order".to_owned())),
            Fault::Panics => panic!("driver of {}", self.name),
            _ => {}
        }
        self.clock.sleep(Duration::from_secs(takes)).await;
        Ok(())
    }

    fn reading(&self, quantity: Quantity, value: f64) -> Reading {
        let value = if self.fault == Fault::ReadsNan { f64::NAN } else { value };
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
        self.work(&format!("to {target}"), 3).await?;
        self.state.lock().unwrap().1 = target + 0.25;
        Ok(())
    }

    async fn position(&self) -> Result<Reading, InstrumentError> {
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

    fn off_without_waiting(&self) {
        self.log.write(format!("{} off without waiting", self.name));
        assert!(self.fault != Fault::LastResortPanics, "driver of {}", self.name);
        self.state.lock().unwrap().0 = Emission::Off;
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

    async fn trigger(&self) -> Result<Frame, InstrumentError> {
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
    pub records: Mutex<Vec<StepRecord>>,
    pub closed: Mutex<Option<(SessionOutcome, Vec<Event>)>>,
}

impl Memory {
    fn fails(&self, step: u32) -> Result<(), SinkError> {
        if self.fails_at != Some(step) {
            return Ok(());
        }
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
    pub faults: BTreeMap<&'static str, Fault>,
    pub sink: Memory,
    pub observers: Observers,
    pub abort: AbortHandle,
    pub abort_after: Option<u64>,
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
            faults: BTreeMap::new(),
            observers: Observers::none(),
            abort: AbortHandle::new(),
            abort_after: None,
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
            abort: &self.abort,
        };
        let header = header(steps);
        let running = async {
            let limit = Duration::from_secs(self.dropped_after.unwrap_or(1_000_000));
            beampose_core::clock::within(clock, limit, run(steps, &header, &around)).await.ok()
        };
        let operator = async {
            if let Some(seconds) = self.abort_after {
                clock.sleep(Duration::from_secs(seconds)).await;
                self.abort.request("Ctrl-C");
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

    pub fn seconds(&self) -> f64 {
        self.clock.now().monotonic.as_secs_f64()
    }
}

pub fn header(steps: &[Step]) -> SessionHeader {
    SessionHeader {
        id: SessionId::fresh(),
        title: "test".to_owned(),
        experiment: "translation".to_owned(),
        plan_text: String::new(),
        rig_text: String::new(),
        measurement_json: "{}".to_owned(),
        plan_hash: String::new(),
        origin_json: None,
        software: "test".to_owned(),
        seed: Some(1),
        steps: u32::try_from(steps.len()).unwrap(),
        opened: Stamp { monotonic: Duration::ZERO, utc: jiff::Timestamp::UNIX_EPOCH },
    }
}

/// Main steps, then `finally` steps, numbered from 1, each with a deadline of a minute.
pub fn plan(
    main: impl IntoIterator<Item = Action>,
    finally: impl IntoIterator<Item = Action>,
) -> Vec<Step> {
    let main = main.into_iter().map(|action| (Section::Main, action));
    let finally = finally.into_iter().map(|action| (Section::Finally, action));
    (1..)
        .zip(main.chain(finally))
        .map(|(number, (section, action))| Step {
            number: StepNumber(number),
            section,
            context: BTreeMap::from([("pass".to_owned(), 2.0)]),
            action,
            deadline: Second(60.0),
            expected: Second(1.0),
        })
        .collect()
}

pub fn laser_on() -> Action {
    Action::LaserOn { laser: "laser".into() }
}

pub fn laser_off() -> Action {
    Action::LaserOff { laser: "laser".into() }
}

pub fn wait(seconds: f64) -> Action {
    Action::Wait { duration: Second(seconds) }
}

pub fn rail(target: f64) -> Action {
    Action::Move { axis: "rail".into(), target, unit: AxisUnit::Millimetre }
}

pub fn stage(target: f64) -> Action {
    Action::Move { axis: "stage".into(), target, unit: AxisUnit::Degree }
}

pub fn read(name: &str) -> Action {
    Action::Read { instruments: vec![name.into()] }
}

pub fn capture(id: &str) -> Action {
    Action::Capture { id: id.into(), cameras: vec!["cam_b".into(), "cam_a".into()] }
}
