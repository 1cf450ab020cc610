//! The simplest world: for tests of drivers, without the virtual lab.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use beampose_core::Clock;

use super::world::{Diode, Probe, Shutter, Stage};

/// A stage at constant speed, without error.
pub struct TestStage {
    clock: Arc<dyn Clock>,
    limits: [f64; 2],
    speed: f64,
    motion: Mutex<Motion>,
}

#[derive(Clone, Copy)]
struct Motion {
    from: f64,
    to: f64,
    start: Duration,
}

impl TestStage {
    /// Stands at the lower limit or at zero; `speed` in units per second.
    #[must_use]
    pub fn new(clock: Arc<dyn Clock>, limits: [f64; 2], speed: f64) -> Self {
        let at = limits[0].max(0.0);
        let motion = Mutex::new(Motion { from: at, to: at, start: Duration::ZERO });
        Self { clock, limits, speed, motion }
    }

    fn motion(&self) -> MutexGuard<'_, Motion> {
        self.motion.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn at(&self, motion: Motion) -> f64 {
        let passed = self.clock.now().monotonic.saturating_sub(motion.start).as_secs_f64();
        let way = motion.to - motion.from;
        motion.from + way.signum() * (passed * self.speed).min(way.abs())
    }
}

impl Stage for TestStage {
    fn go(&self, target: f64) -> Result<(), String> {
        let [low, high] = self.limits;
        if !(low..=high).contains(&target) {
            return Err(format!("{target} is outside {low} to {high}"));
        }
        let mut motion = self.motion();
        let from = self.at(*motion);
        *motion = Motion { from, to: target, start: self.clock.now().monotonic };
        Ok(())
    }

    fn is_moving(&self) -> bool {
        let motion = *self.motion();
        (self.at(motion) - motion.to).abs() > 1e-9
    }

    fn encoder(&self) -> f64 {
        self.at(*self.motion())
    }

    fn stop(&self) {
        let mut motion = self.motion();
        let at = self.at(*motion);
        *motion = Motion { from: at, to: at, start: self.clock.now().monotonic };
    }

    fn limits(&self) -> [f64; 2] {
        self.limits
    }
}

/// A diode that lights three seconds after the current, or at once where it is struck.
pub struct TestDiode {
    clock: Arc<dyn Clock>,
    /// When light comes, while it is on.
    light: Mutex<Option<Duration>>,
    temperature_degc: Mutex<f64>,
    /// Whether the safety contact is open.
    pub interlock_open: AtomicBool,
    /// Whether it goes on burning whatever is commanded: a fault to be found.
    pub stuck: AtomicBool,
    /// Whether current flows past the switch: off, and it burns.
    pub leaks: AtomicBool,
}

impl TestDiode {
    /// A diode in the dark at 25 degrees Celsius, its contact closed.
    #[must_use]
    pub fn new(clock: Arc<dyn Clock>) -> Self {
        Self {
            clock,
            light: Mutex::new(None),
            temperature_degc: Mutex::new(25.0),
            interlock_open: AtomicBool::new(false),
            stuck: AtomicBool::new(false),
            leaks: AtomicBool::new(false),
        }
    }

    /// Has this temperature from now on, in degrees Celsius.
    pub fn warm_to(&self, degc: f64) {
        *self.temperature_degc.lock().unwrap_or_else(PoisonError::into_inner) = degc;
    }

    fn light(&self) -> MutexGuard<'_, Option<Duration>> {
        self.light.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn on_after(&self, delay: Duration) {
        let light = self.clock.now().monotonic + delay;
        self.light().get_or_insert(light);
    }
}

impl Diode for TestDiode {
    fn switch(&self, on: bool) {
        if on {
            self.on_after(self.delay());
        } else if !self.stuck.load(Ordering::SeqCst) {
            *self.light() = None;
        }
    }

    fn strike(&self) {
        self.on_after(Duration::ZERO);
    }

    fn is_on(&self) -> bool {
        self.light().is_some()
    }

    fn emits(&self) -> bool {
        let light = *self.light();
        light.is_some_and(|light| self.clock.now().monotonic >= light)
            || self.leaks.load(Ordering::SeqCst)
    }

    fn delay(&self) -> Duration {
        Duration::from_secs(3)
    }

    fn interlock_closed(&self) -> bool {
        !self.interlock_open.load(Ordering::SeqCst)
    }

    fn temperature_degc(&self) -> f64 {
        *self.temperature_degc.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Reads a number that goes up by a step with each reading, so that an old answer is told from a
/// new one.
pub struct TestProbe {
    start: f64,
    step: f64,
    reads: AtomicU64,
    lost: AtomicBool,
}

impl TestProbe {
    /// Begins at `start`.
    #[must_use]
    pub const fn new(start: f64, step: f64) -> Self {
        Self { start, step, reads: AtomicU64::new(0), lost: AtomicBool::new(false) }
    }

    /// There is nothing to read, or there is again.
    pub fn lose_signal(&self, lost: bool) {
        self.lost.store(lost, Ordering::SeqCst);
    }

    /// The value of reading number `read`, from 0.
    #[must_use]
    pub fn value(&self, read: u64) -> f64 {
        self.start + self.step * read as f64
    }

    /// How often it was read.
    #[must_use]
    pub fn reads(&self) -> u64 {
        self.reads.load(Ordering::SeqCst)
    }
}

impl Probe for TestProbe {
    fn read(&self) -> Result<f64, String> {
        if self.lost.load(Ordering::SeqCst) {
            return Err("no signal".to_owned());
        }
        Ok(self.value(self.reads.fetch_add(1, Ordering::SeqCst)))
    }
}

/// Takes pictures that are not pictures, each another.
#[derive(Default)]
pub struct TestShutter {
    shots: AtomicU64,
}

impl TestShutter {
    /// The bytes of picture number `shot`, from 0: begins and ends as a JPEG file does.
    #[must_use]
    pub fn picture(shot: u64) -> Vec<u8> {
        let mut bytes = vec![0xff, 0xd8, 0xff, 0xe0];
        bytes.extend((0..5000_u64).map(|i| (i.wrapping_mul(31 + shot) % 251) as u8));
        bytes.extend([0xff, 0xd9]);
        bytes
    }

    /// How many it took.
    #[must_use]
    pub fn shots(&self) -> u64 {
        self.shots.load(Ordering::SeqCst)
    }
}

impl Shutter for TestShutter {
    fn expose(&self) -> Result<Vec<u8>, String> {
        Ok(Self::picture(self.shots.fetch_add(1, Ordering::SeqCst)))
    }
}
