//! The rules for lasers against a device that does nothing by itself: no trip, no clamp, no delay.
#![expect(clippy::unwrap_used, reason = "tests")]

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use async_trait::async_trait;
use beampose_core::{Clock, Emission, Identity, InstrumentError, Laser, VirtualClock};
use beampose_drivers::laser::{GuardedLaser, LaserDevice};
use beampose_drivers::transport::Address;
use beampose_drivers::{Options, Role, Setting};
use futures::future::{join, select};

/// What a device was told, in order, and what it answers.
struct Bare {
    told: Mutex<Vec<String>>,
    on: AtomicBool,
    new: AtomicBool,
    open: AtomicBool,
    /// Refuses "off" in words, and obeys.
    grumbles: AtomicBool,
    /// The limit it has whatever it was told.
    clamp: Option<f64>,
    values: Mutex<[f64; 2]>,
    own_ms: AtomicU64,
}

impl Bare {
    fn tell(&self, what: String) {
        self.told.lock().unwrap_or_else(PoisonError::into_inner).push(what);
    }

    fn told(&self) -> Vec<String> {
        std::mem::take(&mut self.told.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn value(&self, which: usize) -> f64 {
        self.values.lock().unwrap_or_else(PoisonError::into_inner)[which]
    }

    fn set(&self, which: usize, ma: f64) {
        self.values.lock().unwrap_or_else(PoisonError::into_inner)[which] = ma;
    }
}

#[async_trait]
impl LaserDevice for Bare {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        Ok(Identity { model: "bare".to_owned(), serial: None, simulated: true })
    }

    async fn is_new(&self) -> Result<bool, InstrumentError> {
        Ok(self.new.load(Ordering::SeqCst))
    }

    async fn set_up(&self) -> Result<(), InstrumentError> {
        self.tell("set up".to_owned());
        self.new.store(false, Ordering::SeqCst);
        Ok(())
    }

    async fn switch(&self, on: bool) -> Result<(), InstrumentError> {
        self.tell(if on { "on" } else { "off" }.to_owned());
        self.on.store(on, Ordering::SeqCst);
        if !on && self.grumbles.load(Ordering::SeqCst) {
            return Err(InstrumentError::Refused("an old error of mine".to_owned()));
        }
        Ok(())
    }

    async fn is_on(&self) -> Result<bool, InstrumentError> {
        Ok(self.on.load(Ordering::SeqCst))
    }

    async fn set_current(&self, ma: f64) -> Result<(), InstrumentError> {
        self.tell(format!("current {ma}"));
        self.set(0, ma);
        Ok(())
    }

    async fn set_point(&self) -> Result<f64, InstrumentError> {
        Ok(self.value(0))
    }

    async fn set_limit(&self, ma: f64) -> Result<(), InstrumentError> {
        self.tell(format!("limit {ma}"));
        self.set(1, self.clamp.unwrap_or(ma));
        Ok(())
    }

    async fn limit(&self) -> Result<f64, InstrumentError> {
        Ok(self.value(1))
    }

    async fn measured(&self) -> Result<f64, InstrumentError> {
        Ok(if self.on.load(Ordering::SeqCst) { self.value(0) } else { 0.0 })
    }

    async fn interlock_closed(&self) -> Result<bool, InstrumentError> {
        Ok(!self.open.load(Ordering::SeqCst))
    }

    async fn not_ready(&self) -> Result<Option<String>, InstrumentError> {
        Ok(None)
    }

    fn off_without_waiting(&self) {
        self.tell("cry".to_owned());
        self.on.store(false, Ordering::SeqCst);
    }

    fn own_delay(&self) -> Duration {
        Duration::from_millis(self.own_ms.load(Ordering::SeqCst))
    }
}

struct Rig {
    clock: VirtualClock,
    device: Arc<Bare>,
    laser: GuardedLaser,
}

impl Rig {
    fn new() -> Self {
        Self::with(Some(60.0), None)
    }

    fn with(current_ma: Option<f64>, clamp: Option<f64>) -> Self {
        let clock = VirtualClock::starting_at(jiff::Timestamp::UNIX_EPOCH);
        let device = Arc::new(Bare {
            told: Mutex::default(),
            on: AtomicBool::new(false),
            new: AtomicBool::new(true),
            open: AtomicBool::new(false),
            grumbles: AtomicBool::new(false),
            clamp,
            values: Mutex::new([5.0, 5.0]),
            own_ms: AtomicU64::new(0),
        });
        let setting = Setting {
            name: "laser".to_owned(),
            address: Address::Device("none".to_owned()),
            line: None,
            clock: Arc::new(clock.clone()),
            options: Options::default(),
            role: Role::Laser { current_ma, emission_delay: Duration::from_secs(3) },
            deadline: Duration::from_secs(1),
            simulated: true,
            scratch: std::env::temp_dir(),
        };
        let laser = GuardedLaser::new(device.clone(), &setting, 120.0).unwrap();
        Self { clock, device, laser }
    }

    fn run<'a, T: Send + 'a>(&self, future: impl Future<Output = T> + Send + 'a) -> T {
        futures::executor::block_on(self.clock.drive(Box::pin(future)))
    }

    async fn after(&self, ms: u64) {
        self.clock.sleep(Duration::from_millis(ms)).await;
    }

    fn is_on(&self) -> bool {
        self.device.on.load(Ordering::SeqCst)
    }
}

#[test]
fn the_order_is_off_zero_limit_current_on_off_zero() {
    let rig = Rig::new();
    rig.run(rig.laser.emit()).unwrap();
    rig.run(rig.laser.off()).unwrap();
    let told = rig.device.told().join(", ");
    assert_eq!(told, "off, current 0, set up, limit 120, current 60, on, off, current 0");
    let Rig { device, laser, .. } = rig;
    drop(laser);
    assert_eq!(device.told(), ["cry"]);
}

#[test]
fn arming_gives_no_light_and_holds_for_one_emission() {
    let rig = Rig::new();
    rig.run(rig.laser.arm()).unwrap();
    assert!(!rig.is_on());
    rig.device.told();
    rig.run(rig.laser.emit()).unwrap();
    assert_eq!(rig.device.told(), ["on"]);
    rig.run(rig.laser.off()).unwrap();
    rig.device.told();
    rig.run(rig.laser.emit()).unwrap();
    assert_eq!(rig.device.told(), ["limit 120", "current 60", "on"]);
    // It emits already: nothing is to be done.
    rig.run(rig.laser.emit()).unwrap();
    assert!(rig.device.told().is_empty());
}

#[test]
fn what_was_changed_after_arming_is_found() {
    let rig = Rig::new();
    rig.run(rig.laser.arm()).unwrap();
    rig.device.set(0, 110.0);
    let error = rig.run(rig.laser.emit()).unwrap_err();
    assert!(error.to_string().contains("set to 60 mA and reads 110 mA"), "{error}");
    rig.run(rig.laser.arm()).unwrap();
    rig.device.open.store(true, Ordering::SeqCst);
    assert!(matches!(rig.run(rig.laser.emit()), Err(InstrumentError::Refused(_))));
    assert!(!rig.device.told().contains(&"on".to_owned()));
}

#[test]
fn a_limit_that_the_device_does_not_take_is_no_limit() {
    let rig = Rig::with(Some(60.0), Some(200.0));
    assert!(matches!(rig.run(rig.laser.emit()), Err(InstrumentError::Fault(_))));
    assert!(!rig.device.told().contains(&"on".to_owned()));
    assert_eq!(rig.device.value(0), 0.0);
}

#[test]
fn currents_that_are_none_are_refused() {
    for current in [None, Some(f64::NAN), Some(-1.0), Some(0.0), Some(120.1), Some(f64::INFINITY)] {
        let rig = Rig::with(current, None);
        let lit = rig.run(rig.laser.emit());
        assert!(matches!(lit, Err(InstrumentError::Refused(_))), "{current:?}: {lit:?}");
        assert!(!rig.device.told().contains(&"on".to_owned()));
    }
}

/// The device has no trip of its own: the poll ends the light, and closing it again gives none.
#[test]
fn a_contact_that_opens_ends_the_light_and_stays_in_mind() {
    let rig = Rig::new();
    rig.run(rig.laser.emit()).unwrap();
    rig.device.open.store(true, Ordering::SeqCst);
    let contact = rig.laser.interlock().unwrap();
    assert_eq!(rig.run(contact.is_closed()), Ok(false));
    assert!(!rig.is_on());
    rig.device.open.store(false, Ordering::SeqCst);
    assert_eq!(rig.run(rig.laser.emission()), Emission::Off);
    assert!(matches!(rig.run(rig.laser.emit()), Err(InstrumentError::Refused(_))));
    // Off with the contact open changes nothing of that.
    rig.device.open.store(true, Ordering::SeqCst);
    rig.run(rig.laser.off()).unwrap();
    rig.device.open.store(false, Ordering::SeqCst);
    assert!(matches!(rig.run(rig.laser.emit()), Err(InstrumentError::Refused(_))));
    rig.run(rig.laser.off()).unwrap();
    rig.run(rig.laser.emit()).unwrap();
    // Told to emit what emits: the contact counts all the same.
    rig.device.open.store(true, Ordering::SeqCst);
    assert!(matches!(rig.run(rig.laser.emit()), Err(InstrumentError::Refused(_))));
    assert!(!rig.is_on());
}

#[test]
fn off_while_it_is_to_emit_wins_at_any_time() {
    for ms in [0, 1, 1_000, 2_999, 3_000] {
        let rig = Rig::new();
        let off = async {
            rig.after(ms).await;
            rig.laser.off().await
        };
        let (_, off) = rig.run(join(rig.laser.emit(), off));
        off.unwrap();
        assert!(!rig.is_on(), "off after {ms} ms");
        let told = rig.device.told();
        assert!(ms >= 3_000 || !told.contains(&"on".to_owned()), "off after {ms} ms: {told:?}");
        assert_eq!(rig.run(rig.laser.emission()), Emission::Off);
    }
}

#[test]
fn a_line_that_is_made_again_while_it_is_to_emit_is_an_error_and_off() {
    let rig = Rig::new();
    let again = async {
        rig.after(1_500).await;
        rig.device.new.store(true, Ordering::SeqCst);
    };
    let (lit, ()) = rig.run(join(rig.laser.emit(), again));
    assert!(matches!(lit, Err(InstrumentError::Disconnected(_))), "{lit:?}");
    assert!(!rig.device.told().contains(&"on".to_owned()));
}

#[test]
fn an_emission_that_is_given_up_leaves_no_light() {
    for (own_ms, ms) in [(0, 1_000), (1_000, 2_500), (3_000, 100), (3_000, 2_900)] {
        let rig = Rig::new();
        rig.device.own_ms.store(own_ms, Ordering::SeqCst);
        let given_up = rig.clock.sleep(Duration::from_millis(ms));
        let on_before = async {
            rig.after(ms.saturating_sub(1)).await;
            rig.is_on()
        };
        let emit = select(rig.laser.emit(), given_up);
        let (_, on_before) = rig.run(join(emit, on_before));
        assert_eq!(on_before, own_ms + ms > 3_000, "before {ms} ms");
        rig.run(rig.after(10_000));
        assert!(!rig.is_on(), "given up after {ms} ms");
        assert_eq!(rig.device.told().last().map(String::as_str), Some("cry"));
    }
}

/// A device that waits by itself is switched on as much earlier.
#[test]
fn light_comes_after_the_rigs_delay_whoever_waits() {
    for own_ms in [0, 1_000, 3_000, 5_000] {
        let rig = Rig::new();
        rig.device.own_ms.store(own_ms, Ordering::SeqCst);
        rig.run(rig.laser.emit()).unwrap();
        let expected = Duration::from_millis(own_ms.max(3_000));
        assert_eq!(rig.clock.now().monotonic, expected, "{own_ms} ms of its own");
    }
}

#[test]
fn dark_counts_whatever_is_answered_to_off() {
    let rig = Rig::new();
    rig.run(rig.laser.emit()).unwrap();
    rig.device.grumbles.store(true, Ordering::SeqCst);
    rig.run(rig.laser.off()).unwrap();
    assert_eq!(rig.device.value(0), 0.0);
    assert_eq!(rig.run(rig.laser.emission()), Emission::Off);
}

#[test]
fn light_that_goes_out_by_itself_is_no_light_of_ours_when_it_comes_back() {
    let rig = Rig::new();
    rig.run(rig.laser.emit()).unwrap();
    rig.device.on.store(false, Ordering::SeqCst);
    assert_eq!(rig.run(rig.laser.emission()), Emission::Off);
    rig.device.on.store(true, Ordering::SeqCst);
    assert_eq!(rig.run(rig.laser.emission()), Emission::On);
    assert!(!rig.is_on(), "on that nobody commanded is ended");
}
