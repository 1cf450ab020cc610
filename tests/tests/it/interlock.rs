//! The engine with real drivers of lasers, over their simulators' bytes and in virtual time: a contact
//! that opens in the middle of a step.

use std::collections::BTreeMap;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::Ordering;
use std::time::Duration;

use beampose_core::units::Second;
use beampose_core::{
    Clock, Event, EventKind, Gap, RunSink, SessionHeader, SessionId, SessionOutcome, SinkError,
    Stamp, StepNumber, StepRecord, VirtualClock,
};
use beampose_drivers::sim::{Diode, Host, Part, Simulated, TestDiode};
use beampose_drivers::transport::{Line, Wire};
use beampose_drivers::{Connected, Driver, Options, REGISTRY, Role, Setting, Simulator};
use beampose_engine::{Bench, Control, Nobody, Observers, Surroundings};
use beampose_plan::policy::{Condition, Holds};
use beampose_plan::{Action, Policy, Rules, Section, Step};

/// Keeps what it is given.
#[derive(Default)]
struct Kept {
    steps: Mutex<Vec<StepRecord>>,
    end: Mutex<Option<(SessionOutcome, Vec<Event>)>>,
}

#[async_trait::async_trait]
impl RunSink for Kept {
    async fn open(&self, _: &SessionHeader) -> Result<(), SinkError> {
        Ok(())
    }

    async fn reopen(&self, _: SessionId, _: &Gap) -> Result<(), SinkError> {
        Ok(())
    }

    async fn step(&self, _: SessionId, record: &StepRecord) -> Result<(), SinkError> {
        self.steps.lock().unwrap().push(record.clone());
        Ok(())
    }

    async fn close(
        &self,
        _: SessionId,
        outcome: SessionOutcome,
        events: &[Event],
        _: Stamp,
    ) -> Result<(), SinkError> {
        *self.end.lock().unwrap() = Some((outcome, events.to_vec()));
        Ok(())
    }
}

struct Lab {
    clock: VirtualClock,
    diode: Arc<TestDiode>,
    bench: Bench,
    kept: Kept,
    _host: Host,
}

impl Lab {
    fn new(driver: &'static Driver) -> Self {
        let clock = VirtualClock::starting_at(jiff::Timestamp::UNIX_EPOCH);
        let shared: Arc<dyn Clock> = Arc::new(clock.clone());
        let diode = Arc::new(TestDiode::new(Arc::clone(&shared)));
        let written = BTreeMap::from([("limit_current".to_owned(), "120".to_owned())]);
        let options = Options::read(driver.options, &written).unwrap();
        let role = Role::Laser { current_ma: Some(60.0), emission_delay: Duration::from_secs(3) };
        let Simulator::Device(make) = driver.simulator else { unreachable!("a line of bytes") };
        let device = make(&[Simulated {
            name: "laser".to_owned(),
            options: options.clone(),
            role,
            part: Part::Diode(Arc::clone(&diode) as Arc<dyn Diode>),
            clock: Arc::clone(&shared),
        }]);
        let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let host = Host::tcp(device.unwrap(), any).unwrap();
        let deadline = Duration::from_secs(2);
        let port = driver.port.unwrap();
        let wire = Wire::new("laser", host.address().clone(), port, Arc::clone(&shared), None);
        let connected = (driver.connect)(Setting {
            name: "laser".to_owned(),
            address: host.address().clone(),
            line: Some(Arc::new(Line::new(Arc::new(wire), deadline))),
            clock: shared,
            options,
            role,
            deadline,
            simulated: true,
            scratch: std::env::temp_dir(),
        });
        let Ok(Connected::Laser(laser)) = connected else { unreachable!("a laser") };
        let bench = Bench { lasers: BTreeMap::from([("laser".into(), laser)]), ..Bench::default() };
        Self { clock, diode, bench, kept: Kept::default(), _host: host }
    }

    /// Runs it, with the contact open from one time to another.
    fn run(&self, steps: &[Step], rules: &Rules, open: [u64; 2]) -> SessionOutcome {
        let around = Surroundings {
            bench: &self.bench,
            sink: &self.kept,
            observers: &Observers::none(),
            clock: &self.clock,
            control: &Control::new(),
            operator: &Nobody,
            rules,
            store_patience: Duration::ZERO,
        };
        let header = header();
        let somebody = async {
            for (at, is_open) in open.into_iter().zip([true, false]) {
                let wait = Duration::from_secs(at).saturating_sub(self.clock.now().monotonic);
                self.clock.sleep(wait).await;
                self.diode.interlock_open.store(is_open, Ordering::SeqCst);
            }
        };
        let running = beampose_engine::run(steps, &header, &around);
        let both = async { futures::future::join(running, somebody).await.0 };
        futures::executor::block_on(self.clock.drive(Box::pin(both))).unwrap().outcome
    }

    /// All events of a kind, in seconds.
    fn times(&self, kind: EventKind) -> Vec<f64> {
        let steps = self.kept.steps.lock().unwrap();
        let end = self.kept.end.lock().unwrap();
        let events = steps.iter().flat_map(|step| &step.events);
        let events = events.chain(end.iter().flat_map(|(_, events)| events));
        events.filter(|it| it.kind == kind).map(|it| it.at.monotonic.as_secs_f64()).collect()
    }
}

fn header() -> SessionHeader {
    SessionHeader {
        id: SessionId::fresh(),
        title: "interlock".to_owned(),
        experiment: "acquisition".to_owned(),
        plan_text: String::new(),
        rig_text: String::new(),
        measurement_json: "{}".to_owned(),
        files: Vec::new(),
        plan_hash: String::new(),
        origin_json: None,
        software: "test".to_owned(),
        seed: Some(1),
        steps: 3,
        opened: Stamp { monotonic: Duration::ZERO, utc: jiff::Timestamp::UNIX_EPOCH },
    }
}

/// On, a minute of waiting, off.
fn steps() -> Vec<Step> {
    let laser = || "laser".into();
    let actions = [
        Action::LaserOn { laser: laser() },
        Action::Wait { duration: Second(60.0) },
        Action::LaserOff { laser: laser() },
    ];
    (1..)
        .zip(actions)
        .map(|(number, action)| Step {
            number: StepNumber(number),
            section: Section::Main,
            context: BTreeMap::new(),
            action,
            deadline: Second(120.0),
            expected: Second(1.0),
            policy: Policy::default(),
        })
        .collect()
}

fn lasers() -> impl Iterator<Item = &'static Driver> {
    REGISTRY.iter().filter(|driver| driver.kind == "laser")
}

#[test]
fn light_goes_out_within_half_a_second_and_stays_out() {
    assert_eq!(lasers().count(), 2);
    for driver in lasers() {
        let lab = Lab::new(driver);
        // Closed again long before the run ends.
        let outcome = lab.run(&steps(), &Rules::default(), [20, 21]);
        assert_eq!(outcome, SessionOutcome::Error, "{}", driver.name);
        let tripped = lab.times(EventKind::InterlockTripped);
        assert!(matches!(tripped[..], [at] if (20.0..20.5).contains(&at)), "{tripped:?}");
        assert_eq!(lab.times(EventKind::LaserOn).len(), 1);
        assert!(!lab.diode.is_on());
        assert!(lab.times(EventKind::LaserUnknown).is_empty());
    }
}

#[test]
fn where_the_plan_waits_for_it_light_comes_back_after_it_closed() {
    for driver in lasers() {
        let lab = Lab::new(driver);
        let closed = Condition {
            what: Holds::Interlock { laser: "laser".into() },
            hold_for: Second(5.0),
            settle: Second(0.0),
            every: Second(10.0),
            give_up: Second(600.0),
        };
        let rules = Rules { conditions: vec![closed], ..Rules::default() };
        let outcome = lab.run(&steps(), &rules, [20, 90]);
        assert_eq!(outcome, SessionOutcome::Completed, "{}", driver.name);
        let lit = lab.times(EventKind::LaserOn);
        assert!(lit.len() == 2 && lit[1] >= 98.0, "{}: {lit:?}", driver.name);
        assert!(!lab.diode.is_on());
    }
}

#[test]
fn a_contact_that_stays_closed_is_noticed_by_nobody() {
    for driver in lasers() {
        let lab = Lab::new(driver);
        let outcome = lab.run(&steps(), &Rules::default(), [1000, 1001]);
        assert_eq!(outcome, SessionOutcome::Completed, "{}", driver.name);
        assert!(lab.times(EventKind::InterlockTripped).is_empty());
        let steps = lab.kept.steps.lock().unwrap();
        let took =
            |i: usize| (steps[i].finished.monotonic - steps[i].started.monotonic).as_secs_f64();
        // Looking takes no virtual time.
        assert_eq!(took(1), 60.0, "{}", driver.name);
    }
}
