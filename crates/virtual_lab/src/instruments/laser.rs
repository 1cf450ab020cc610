//! The laser: off at start, light after its emission delay.

use std::sync::Arc;

use async_trait::async_trait;
use beampose_core::units::Second;
use beampose_core::{Clock, Emission, Identity, Instrument, InstrumentError, Laser};

use super::identity;
use crate::world::World;

/// The laser diode's driver.
pub struct SimulatedLaser {
    world: Arc<World>,
    clock: Arc<dyn Clock>,
}

impl SimulatedLaser {
    /// The world's laser.
    #[must_use]
    pub fn new(world: Arc<World>, clock: Arc<dyn Clock>) -> Self {
        Self { world, clock }
    }
}

/// The diode alone, without a driver's waiting: what a simulator of its bytes switches.
impl SimulatedLaser {
    /// Current on, with light after the delay, or off.
    pub fn switch(&self, on: bool) {
        if !on {
            return self.off_without_waiting();
        }
        let light = self.clock.now().monotonic.saturating_add(self.delay());
        let mut live = self.world.live();
        if !live.switches.commanded() {
            live.switches.light(light);
        }
    }

    /// Current on and light at once: a controller without a delay of its own.
    pub fn strike(&self) {
        let now = self.clock.now().monotonic;
        let mut live = self.world.live();
        if !live.switches.commanded() {
            live.switches.light(now);
        }
    }

    /// Whether its current is switched on.
    #[must_use]
    pub fn is_on(&self) -> bool {
        self.world.live().switches.commanded()
    }

    /// Whether light comes out.
    #[must_use]
    pub fn emits(&self) -> bool {
        self.world.module_at(self.clock.now().monotonic).emission == Emission::On
    }

    /// From the current to light.
    #[must_use]
    pub fn delay(&self) -> std::time::Duration {
        Second(self.world.config.diode.emission_delay_s).duration()
    }

    /// True temperature of the diode, degrees Celsius.
    #[must_use]
    pub fn temperature_degc(&self) -> f64 {
        self.world.diode_degc_at(self.clock.now().monotonic)
    }
}

#[async_trait]
impl Instrument for SimulatedLaser {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        Ok(identity("laser"))
    }
}

#[async_trait]
impl Laser for SimulatedLaser {
    async fn emit(&self) -> Result<(), InstrumentError> {
        if self.emission().await == Emission::On {
            return Ok(());
        }
        self.switch(true);
        self.clock.sleep(self.delay()).await;
        if self.emission().await == Emission::On {
            Ok(())
        } else {
            Err(InstrumentError::Refused("switched off before light came out".to_owned()))
        }
    }

    async fn off(&self) -> Result<(), InstrumentError> {
        self.off_without_waiting();
        Ok(())
    }

    /// On from the command on: nobody should look into it during the delay.
    async fn emission(&self) -> Emission {
        if self.world.live().switches.commanded() { Emission::On } else { Emission::Off }
    }

    fn off_without_waiting(&self) {
        let now = self.clock.now().monotonic;
        let mut live = self.world.live();
        if live.switches.commanded() {
            live.switches.dark(now);
        }
    }
}
