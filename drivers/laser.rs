//! The rules for lasers, in one place, for every driver of one.
//!
//! A family implements [`LaserDevice`], single commands and readings; [`GuardedLaser`] makes a
//! [`Laser`] of it and obeys the rules. Off and zero when connected, also when connected again.
//! Current limit programmed and read back before the output is enabled; arming is apart from
//! emitting, and the delay until light is announced. An open interlock is latched: light comes back
//! only after an off with the contact closed again. Off is verified by the output's state and the
//! measured current. What cannot be read is unknown, to be taken as on. No software is an interlock:
//! this one reads and reports it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use async_trait::async_trait;
use beampose_core::{Clock, Emission, Identity, Instrument, InstrumentError, Interlock, Laser};

use crate::registry::{Role, Setting};

/// The law's shortest emission delay in practice: no driver goes below.
pub const SHORTEST_DELAY: Duration = Duration::from_secs(3);
/// A diode that draws less emits nothing; above it, off is not believed.
const DARK_MA: f64 = 1.0;
/// How long the current may take to fall after off.
const FALL: Duration = Duration::from_secs(1);
/// Between two looks at the current.
const LOOK: Duration = Duration::from_millis(50);
/// What a limit and a set point may differ when read back, relative: rounding of the display.
const ROUNDING: f64 = 2e-3;

/// What a family's driver does, one command each. Nothing here decides whether light may come.
#[async_trait]
pub trait LaserDevice: Send + Sync {
    /// Asks who it is.
    ///
    /// # Errors
    /// Any [`InstrumentError`], as in all of these.
    async fn identify(&self) -> Result<Identity, InstrumentError>;
    /// Makes sure of the connection. Whether it is new, so that the instrument has to be set up.
    async fn is_new(&self) -> Result<bool, InstrumentError>;
    /// Sets interface and modes, after output and set point are off and zero; then the connection
    /// is no longer new.
    async fn set_up(&self) -> Result<(), InstrumentError>;
    /// Output on or off.
    async fn switch(&self, on: bool) -> Result<(), InstrumentError>;
    /// Whether the output is on.
    async fn is_on(&self) -> Result<bool, InstrumentError>;
    /// Sets the current, mA.
    async fn set_current(&self, ma: f64) -> Result<(), InstrumentError>;
    /// The current that is set, mA.
    async fn set_point(&self) -> Result<f64, InstrumentError>;
    /// Programs the current's limit, mA.
    async fn set_limit(&self, ma: f64) -> Result<(), InstrumentError>;
    /// The limit that is programmed, mA.
    async fn limit(&self) -> Result<f64, InstrumentError>;
    /// The current that flows, mA.
    async fn measured(&self) -> Result<f64, InstrumentError>;
    /// Whether the safety contact is closed.
    async fn interlock_closed(&self) -> Result<bool, InstrumentError>;
    /// Why the diode should not be driven now: its temperature is not in tolerance, say.
    async fn not_ready(&self) -> Result<Option<String>, InstrumentError>;
    /// The bytes of "off", sent without waiting.
    fn off_without_waiting(&self);
}

/// A laser under the rules.
pub struct GuardedLaser {
    device: Arc<dyn LaserDevice>,
    clock: Arc<dyn Clock>,
    name: String,
    current_ma: Option<f64>,
    limit_ma: f64,
    delay: Duration,
    /// The contact was seen open since the last off.
    latched: AtomicBool,
    /// Output was commanded on by us.
    commanded: AtomicBool,
    armed: AtomicBool,
}

impl GuardedLaser {
    /// A laser of a device. `limit_ma` is programmed as its hardware limit.
    ///
    /// # Errors
    /// [`InstrumentError::Refused`] where the rig's setting is no laser's.
    pub fn new(
        device: Arc<dyn LaserDevice>,
        setting: &Setting,
        limit_ma: f64,
    ) -> Result<Self, InstrumentError> {
        let Role::Laser { current_ma, emission_delay } = setting.role else {
            return Err(InstrumentError::Refused(format!("{} is no laser", setting.name)));
        };
        Ok(Self {
            device,
            clock: Arc::clone(&setting.clock),
            name: setting.name.clone(),
            current_ma,
            limit_ma,
            delay: emission_delay.max(SHORTEST_DELAY),
            latched: AtomicBool::new(false),
            commanded: AtomicBool::new(false),
            armed: AtomicBool::new(false),
        })
    }

    /// Off and zero on a connection that is new.
    async fn connected(&self) -> Result<(), InstrumentError> {
        if self.device.is_new().await? {
            self.armed.store(false, Ordering::SeqCst);
            self.commanded.store(false, Ordering::SeqCst);
            // Off before anything else: nobody knows what it did while nobody listened.
            self.device.switch(false).await?;
            self.device.set_current(0.0).await?;
            self.device.set_up().await?;
            self.dark().await?;
        }
        Ok(())
    }

    /// Checks and programs all that light needs, and gives none.
    ///
    /// # Errors
    /// [`InstrumentError::Refused`] with what is against it.
    pub async fn arm(&self) -> Result<(), InstrumentError> {
        self.connected().await?;
        let refused = |why: String| Err(InstrumentError::Refused(why));
        let Some(current) = self.current_ma else {
            return refused(format!("the rig file does not say the `current` of {}", self.name));
        };
        if current > self.limit_ma {
            let limit = self.limit_ma;
            return refused(format!("{current} mA is above the limit of {limit} mA"));
        }
        if !self.contact().await? {
            return refused("its interlock is open".to_owned());
        }
        if self.latched.load(Ordering::SeqCst) {
            return refused("its interlock was open; switch it off first, then on".to_owned());
        }
        if let Some(why) = self.device.not_ready().await? {
            return refused(why);
        }
        self.device.set_limit(self.limit_ma).await?;
        same("current limit", self.limit_ma, self.device.limit().await?)?;
        self.device.set_current(current).await?;
        same("current", current, self.device.set_point().await?)?;
        self.armed.store(true, Ordering::SeqCst);
        Ok(())
    }

    /// Reads the contact, and remembers that it was open.
    async fn contact(&self) -> Result<bool, InstrumentError> {
        let closed = self.device.interlock_closed().await;
        if !matches!(closed, Ok(true)) {
            self.latched.store(true, Ordering::SeqCst);
        }
        closed
    }

    /// Waits until nothing flows.
    async fn dark(&self) -> Result<(), InstrumentError> {
        let until = self.clock.now().monotonic + FALL;
        loop {
            let (on, current) = (self.device.is_on().await?, self.device.measured().await?);
            if !on && current < DARK_MA {
                return Ok(());
            }
            if self.clock.now().monotonic >= until {
                let output = if on { "on" } else { "off" };
                return Err(InstrumentError::Fault(format!(
                    "off was sent, but its output is {output} and {current} mA flow: unknown, \
                     assume on; take its key out"
                )));
            }
            self.clock.sleep(LOOK).await;
        }
    }

    async fn light(&self) -> Result<(), InstrumentError> {
        self.device.switch(true).await?;
        self.commanded.store(true, Ordering::SeqCst);
        self.clock.sleep(self.delay).await;
        let (on, current) = (self.device.is_on().await?, self.device.measured().await?);
        let asked = self.current_ma.unwrap_or_default();
        if !self.contact().await? {
            return Err(InstrumentError::Refused("its interlock opened".to_owned()));
        }
        if !on || current < asked / 2.0 {
            return Err(InstrumentError::Fault(format!(
                "switched on, but its output is {} and {current} of {asked} mA flow",
                if on { "on" } else { "off" }
            )));
        }
        Ok(())
    }
}

fn same(what: &str, asked: f64, read: f64) -> Result<(), InstrumentError> {
    if (asked - read).abs() <= (ROUNDING * asked.abs()).max(0.1) {
        return Ok(());
    }
    Err(InstrumentError::Fault(format!("its {what} was set to {asked} mA and reads {read} mA")))
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
        if !self.armed.load(Ordering::SeqCst) {
            self.arm().await?;
        }
        let seconds = self.delay.as_secs_f64();
        tracing::warn!("{}: laser light in {seconds} s", self.name);
        let lit = self.light().await;
        if lit.is_err() {
            // Whatever went wrong: not with the light on. Its own failure is found by who asks next.
            let _ = self.off().await;
        }
        lit
    }

    async fn off(&self) -> Result<(), InstrumentError> {
        self.armed.store(false, Ordering::SeqCst);
        self.connected().await?;
        self.device.switch(false).await?;
        self.commanded.store(false, Ordering::SeqCst);
        self.device.set_current(0.0).await?;
        self.dark().await?;
        if matches!(self.device.interlock_closed().await, Ok(true)) {
            self.latched.store(false, Ordering::SeqCst);
        }
        Ok(())
    }

    async fn emission(&self) -> Emission {
        if self.connected().await.is_err() {
            return Emission::Unknown;
        }
        let read = (self.device.is_on().await, self.device.measured().await);
        let (Ok(on), Ok(current)) = read else { return Emission::Unknown };
        if !matches!(self.contact().await, Ok(true)) && on {
            self.device.off_without_waiting();
        }
        match (on, current < DARK_MA) {
            (true, _) => {
                if !self.commanded.load(Ordering::SeqCst) {
                    tracing::error!(
                        "{}: its output is on, and nobody here switched it on",
                        self.name
                    );
                }
                Emission::On
            }
            (false, true) => Emission::Off,
            (false, false) => Emission::Unknown,
        }
    }

    fn off_without_waiting(&self) {
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
