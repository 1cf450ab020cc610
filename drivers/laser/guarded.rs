//! The one implementation of the rules.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use async_trait::async_trait;
use beampose_core::{Clock, Emission, Identity, Instrument, InstrumentError, Interlock, Laser};
use futures::lock::Mutex;

use super::{LaserDevice, SHORTEST_DELAY};
use crate::registry::{Role, Setting};

/// A diode that draws less emits nothing; above it, off is not believed.
const DARK_MA: f64 = 1.0;
/// How long the current may take to fall after off.
const FALL: Duration = Duration::from_secs(1);
/// How long the current may take to flow once it should, beyond the rig's delay.
const RISE: Duration = Duration::from_secs(1);
/// Between two looks at the current.
const LOOK: Duration = Duration::from_millis(50);
/// Between two looks at the contact while light is to come.
const WATCH: Duration = Duration::from_millis(250);
/// What a limit and a set point may differ when read back, relative: rounding of the display.
const ROUNDING: f64 = 2e-3;

/// A laser under the rules.
pub struct GuardedLaser {
    device: Arc<dyn LaserDevice>,
    clock: Arc<dyn Clock>,
    name: String,
    current_ma: Option<f64>,
    limit_ma: f64,
    delay: Duration,
    /// One at a time sets up or switches.
    turn: Mutex<()>,
    /// The contact was seen open since the last off.
    latched: AtomicBool,
    /// Output was commanded on by us.
    commanded: AtomicBool,
    armed: AtomicBool,
    /// Light came since it was commanded.
    lit: AtomicBool,
    /// How often it was told off: who is about to switch on sees that this is no longer wanted.
    offs: AtomicU64,
}

impl GuardedLaser {
    /// A laser of a device. `limit_ma` is programmed as its hardware limit.
    ///
    /// # Errors
    /// [`InstrumentError::Refused`] where the rig's setting is no laser's or the limit is none.
    pub fn new(
        device: Arc<dyn LaserDevice>,
        setting: &Setting,
        limit_ma: f64,
    ) -> Result<Self, InstrumentError> {
        let Role::Laser { current_ma, emission_delay } = setting.role else {
            return Err(InstrumentError::Refused(format!("{} is no laser", setting.name)));
        };
        if !limit_ma.is_finite() || limit_ma <= 0.0 {
            let why = format!("the current limit must be above zero, found {limit_ma} mA");
            return Err(InstrumentError::Refused(why));
        }
        Ok(Self {
            device,
            clock: Arc::clone(&setting.clock),
            name: setting.name.clone(),
            current_ma,
            limit_ma,
            delay: emission_delay.max(SHORTEST_DELAY),
            turn: Mutex::new(()),
            latched: AtomicBool::new(false),
            commanded: AtomicBool::new(false),
            armed: AtomicBool::new(false),
            lit: AtomicBool::new(false),
            offs: AtomicU64::new(0),
        })
    }

    /// Off and zero on a connection that is new.
    async fn connected(&self) -> Result<(), InstrumentError> {
        if !self.device.is_new().await? {
            return Ok(());
        }
        let _turn = self.turn.lock().await;
        // Another may have done it while this one waited.
        if self.device.is_new().await? {
            self.is_to_be_off();
            // Off before anything else: nobody knows what it did while nobody listened. A device
            // that cannot be switched off stays new, and every call says so.
            self.device.switch(false).await?;
            self.device.set_current(0.0).await?;
            self.dark().await?;
            self.device.set_up().await?;
        }
        Ok(())
    }

    /// No light is wanted from now on.
    fn is_to_be_off(&self) {
        self.offs.fetch_add(1, Ordering::SeqCst);
        self.armed.store(false, Ordering::SeqCst);
        self.commanded.store(false, Ordering::SeqCst);
        self.lit.store(false, Ordering::SeqCst);
    }

    /// Checks and programs all that light needs, and gives none. Holds for one emission.
    ///
    /// # Errors
    /// [`InstrumentError::Refused`] with what is against it.
    pub async fn arm(&self) -> Result<(), InstrumentError> {
        self.connected().await?;
        self.armed.store(false, Ordering::SeqCst);
        let current = self.checked().await?;
        self.program(current).await?;
        self.read_back(current).await?;
        self.armed.store(true, Ordering::SeqCst);
        Ok(())
    }

    /// All that must hold before light, read afresh. The current for it, mA.
    async fn checked(&self) -> Result<f64, InstrumentError> {
        let refused = |why: String| Err(InstrumentError::Refused(why));
        let Some(current) = self.current_ma else {
            return refused(format!("the rig file does not say the `current` of {}", self.name));
        };
        let limit = self.limit_ma;
        if !(current > 0.0 && current <= limit) {
            return refused(format!(
                "{current} mA is not above zero and up to {limit} mA, its limit"
            ));
        }
        if !self.contact().await? {
            return refused("its interlock is open".to_owned());
        }
        if self.latched.load(Ordering::SeqCst) {
            return refused("its interlock was open; switch it off first, then on".to_owned());
        }
        if self.device.is_on().await? {
            self.off_without_waiting();
            return Err(InstrumentError::Fault(UNCOMMANDED.to_owned()));
        }
        match self.device.not_ready().await? {
            Some(why) => refused(why),
            None => Ok(current),
        }
    }

    async fn program(&self, current: f64) -> Result<(), InstrumentError> {
        // The limit first: where it is lowered, devices lower the set point with it.
        self.device.set_limit(self.limit_ma).await?;
        self.device.set_current(current).await
    }

    async fn read_back(&self, current: f64) -> Result<(), InstrumentError> {
        same("current limit", self.limit_ma, self.device.limit().await?)?;
        same("current", current, self.device.set_point().await?)
    }

    /// Reads the contact. Where it is not closed, remembers that and sees that there is no light.
    async fn contact(&self) -> Result<bool, InstrumentError> {
        let closed = self.device.interlock_closed().await;
        if !matches!(closed, Ok(true)) {
            self.latched.store(true, Ordering::SeqCst);
            if self.commanded.load(Ordering::SeqCst) {
                tracing::error!("{}: its interlock is open or unknown; switched off", self.name);
                self.off_without_waiting();
            }
        }
        closed
    }

    /// Waits until nothing flows.
    async fn dark(&self) -> Result<(), InstrumentError> {
        let until = self.clock.now().monotonic + FALL;
        loop {
            let (on, current) = (self.device.is_on().await?, self.device.measured().await?);
            if !on && current.abs() < DARK_MA {
                return Ok(());
            }
            if self.clock.now().monotonic >= until {
                return Err(InstrumentError::Fault(format!(
                    "off was sent, but its output is {} and {current} mA flow: unknown, assume \
                     on; take its key out",
                    word(on)
                )));
            }
            self.clock.sleep(LOOK).await;
        }
    }

    /// Whether light is still wanted, on the same connection and with the contact closed.
    async fn still(&self, offs: u64) -> Result<(), InstrumentError> {
        let refused = |why: &str| Err(InstrumentError::Refused(why.to_owned()));
        if self.offs.load(Ordering::SeqCst) != offs {
            return refused("it was switched off meanwhile");
        }
        if self.device.is_new().await? {
            let why = "its line was lost while it was to emit".to_owned();
            return Err(InstrumentError::Disconnected(why));
        }
        if !self.contact().await? {
            return refused("its interlock opened");
        }
        Ok(())
    }

    async fn wait(&self, duration: Duration, offs: u64) -> Result<(), InstrumentError> {
        let until = self.clock.now().monotonic + duration;
        loop {
            self.still(offs).await?;
            let left = until.saturating_sub(self.clock.now().monotonic);
            if left.is_zero() {
                return Ok(());
            }
            self.clock.sleep(left.min(WATCH)).await;
        }
    }

    async fn light(&self, offs: u64) -> Result<(), InstrumentError> {
        let armed = self.armed.swap(false, Ordering::SeqCst);
        let current = self.checked().await?;
        if !armed {
            self.program(current).await?;
        }
        self.read_back(current).await?;
        let own = self.device.own_delay();
        let seconds = self.delay.max(own).as_secs_f64();
        tracing::warn!("{}: laser light in {seconds} s", self.name);
        self.wait(self.delay.saturating_sub(own), offs).await?;
        {
            let _turn = self.turn.lock().await;
            self.still(offs).await?;
            self.commanded.store(true, Ordering::SeqCst);
            self.device.switch(true).await?;
        }
        self.wait(own, offs).await?;
        self.flows(current, offs).await?;
        self.lit.store(true, Ordering::SeqCst);
        Ok(())
    }

    /// Waits until the current flows.
    async fn flows(&self, asked: f64, offs: u64) -> Result<(), InstrumentError> {
        let until = self.clock.now().monotonic + self.delay + RISE;
        loop {
            self.still(offs).await?;
            let (on, current) = (self.device.is_on().await?, self.device.measured().await?);
            if on && current >= asked / 2.0 && current <= self.limit_ma * 1.02 + DARK_MA {
                return Ok(());
            }
            if !on || current > asked || self.clock.now().monotonic >= until {
                return Err(InstrumentError::Fault(format!(
                    "switched on, but its output is {} and {current} of {asked} mA flow",
                    word(on)
                )));
            }
            self.clock.sleep(LOOK).await;
        }
    }

    async fn off_once(&self) -> Result<(), InstrumentError> {
        self.is_to_be_off();
        if let Err(error) = self.connected().await {
            self.device.off_without_waiting();
            return Err(error);
        }
        self.extinguish().await?;
        if matches!(self.device.interlock_closed().await, Ok(true)) {
            self.latched.store(false, Ordering::SeqCst);
        }
        Ok(())
    }

    /// Off and zero, verified. Leaves the latch.
    async fn extinguish(&self) -> Result<(), InstrumentError> {
        let off = {
            let _turn = self.turn.lock().await;
            self.device.switch(false).await
        };
        if off.is_err() {
            self.device.off_without_waiting();
        }
        let zero = self.device.set_current(0.0).await;
        // Dark is what counts, whatever was answered to "off".
        self.dark().await?;
        zero
    }

    async fn is_lit(&self) -> Result<bool, InstrumentError> {
        Ok(self.lit.load(Ordering::SeqCst)
            && self.contact().await?
            && self.device.is_on().await?
            && self.device.measured().await? >= self.current_ma.unwrap_or(f64::MAX) / 2.0)
    }
}

const UNCOMMANDED: &str = "its output is on, and nobody here switched it on: off was sent; find out \
                           who did before it is used";

const fn word(on: bool) -> &'static str {
    if on { "on" } else { "off" }
}

fn same(what: &str, asked: f64, read: f64) -> Result<(), InstrumentError> {
    if (asked - read).abs() <= (ROUNDING * asked.abs()).max(0.1) {
        return Ok(());
    }
    Err(InstrumentError::Fault(format!("its {what} was set to {asked} mA and reads {read} mA")))
}

impl Drop for GuardedLaser {
    fn drop(&mut self) {
        self.off_without_waiting();
    }
}

/// Who switches on and is given up half-way leaves no light behind.
struct Unlit<'a>(Option<&'a GuardedLaser>);

impl Drop for Unlit<'_> {
    fn drop(&mut self) {
        if let Some(laser) = self.0.take() {
            laser.off_without_waiting();
        }
    }
}

#[async_trait]
impl Instrument for GuardedLaser {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        self.connected().await?;
        self.device.identify().await
    }
}

#[async_trait]
impl Laser for GuardedLaser {
    async fn emit(&self) -> Result<(), InstrumentError> {
        self.connected().await?;
        if self.is_lit().await? {
            return Ok(());
        }
        let offs = self.offs.load(Ordering::SeqCst);
        let mut unlit = Unlit(Some(self));
        let lit = self.light(offs).await;
        if lit.is_err() {
            self.is_to_be_off();
            // Its own failure is found by who asks next.
            if self.extinguish().await.is_err() {
                return lit;
            }
        }
        unlit.0 = None;
        lit
    }

    async fn off(&self) -> Result<(), InstrumentError> {
        // A cable that was pulled may have swallowed the word, and off may be said twice.
        match self.off_once().await {
            Err(_) => self.off_once().await,
            said => said,
        }
    }

    async fn emission(&self) -> Emission {
        if self.connected().await.is_err() {
            return Emission::Unknown;
        }
        // First the contact: if it is open, off is on its way before the output is read.
        let _ = self.contact().await;
        let read = (self.device.is_on().await, self.device.measured().await);
        let (Ok(on), Ok(current)) = read else { return Emission::Unknown };
        if !on && self.lit.load(Ordering::SeqCst) {
            tracing::error!("{}: it switched itself off", self.name);
            self.is_to_be_off();
        }
        match (on, current.abs() < DARK_MA) {
            (true, _) => {
                if !self.commanded.load(Ordering::SeqCst) {
                    tracing::error!("{}: {UNCOMMANDED}", self.name);
                    self.device.off_without_waiting();
                }
                Emission::On
            }
            (false, true) => Emission::Off,
            (false, false) => Emission::Unknown,
        }
    }

    fn off_without_waiting(&self) {
        self.is_to_be_off();
        self.device.off_without_waiting();
    }

    fn interlock(&self) -> Option<&dyn Interlock> {
        Some(self)
    }
}

#[async_trait]
impl Interlock for GuardedLaser {
    async fn is_closed(&self) -> Result<bool, InstrumentError> {
        self.connected().await?;
        self.contact().await
    }
}
