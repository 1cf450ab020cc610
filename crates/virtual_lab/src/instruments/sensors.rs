//! Wavelength meter and thermometers.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use async_trait::async_trait;
use beampose_core::{
    Clock, Emission, Identity, Instrument, InstrumentError, Quantity, Reading, Sensor,
};

use super::identity;
use crate::diode;
use crate::streams::{Purpose, normal};
use crate::world::World;

/// The wavelength meter: true wavelength, its own bias, and noise.
pub struct SimulatedWavemeter {
    world: Arc<World>,
    clock: Arc<dyn Clock>,
    reads: AtomicU64,
}

/// The thermometer in the room.
pub struct SimulatedThermometer {
    world: Arc<World>,
    clock: Arc<dyn Clock>,
    reads: AtomicU64,
}

/// The thermometer on the laser's diode.
pub struct SimulatedDiodeThermometer {
    world: Arc<World>,
    clock: Arc<dyn Clock>,
    reads: AtomicU64,
}

impl SimulatedWavemeter {
    /// The world's wavelength meter.
    #[must_use]
    pub fn new(world: Arc<World>, clock: Arc<dyn Clock>) -> Self {
        let reads = AtomicU64::new(world.history().wavelength_reads);
        Self { world, clock, reads }
    }
}

impl SimulatedThermometer {
    /// The world's thermometer.
    #[must_use]
    pub fn new(world: Arc<World>, clock: Arc<dyn Clock>) -> Self {
        let reads = AtomicU64::new(world.history().temperature_reads);
        Self { world, clock, reads }
    }
}

impl SimulatedDiodeThermometer {
    /// The world's thermometer on the diode.
    #[must_use]
    pub fn new(world: Arc<World>, clock: Arc<dyn Clock>) -> Self {
        let reads = AtomicU64::new(world.history().diode_temperature_reads);
        Self { world, clock, reads }
    }
}

/// A meter shows so many steps a unit and no more: 0.01 pm, 0.001 degrees.
fn shown(value: f64, steps: f64) -> f64 {
    (value * steps).round() / steps
}

/// The noise of one more reading, of N(0, 1).
fn next_noise(world: &World, purpose: Purpose, reads: &AtomicU64) -> f64 {
    let read = reads.fetch_add(1, Ordering::SeqCst);
    normal(&mut world.streams.item(purpose, read))
}

#[async_trait]
impl Instrument for SimulatedWavemeter {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        Ok(identity("wavelength meter"))
    }
}

#[async_trait]
impl Sensor for SimulatedWavemeter {
    async fn read(&self) -> Result<Reading, InstrumentError> {
        let at = self.clock.now();
        let module = self.world.module_at(at.monotonic);
        if module.emission != Emission::On {
            return Err(InstrumentError::Refused("no light to measure".to_owned()));
        }
        let meter = &self.world.config.wavemeter;
        let noise = meter.noise_nm * next_noise(&self.world, Purpose::Wavelength, &self.reads);
        let value = shown(module.wavelength_nm + self.world.truth.wavemeter_bias_nm + noise, 1e5);
        // What a single reading is worth: bias and noise together.
        let standard_uncertainty = Some(f64::hypot(meter.noise_nm, meter.bias_u_nm));
        Ok(Reading { quantity: Quantity::Wavelength, value, standard_uncertainty, at })
    }
}

#[async_trait]
impl Instrument for SimulatedThermometer {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        Ok(identity("thermometer"))
    }
}

#[async_trait]
impl Sensor for SimulatedThermometer {
    async fn read(&self) -> Result<Reading, InstrumentError> {
        let at = self.clock.now();
        let sigma = self.world.config.thermometer.noise_degc;
        let noise = sigma * next_noise(&self.world, Purpose::Temperature, &self.reads);
        let value = shown(diode::room_degc(&self.world.config.room, at.monotonic) + noise, 1e3);
        let standard_uncertainty = Some(sigma);
        Ok(Reading { quantity: Quantity::Temperature, value, standard_uncertainty, at })
    }
}

#[async_trait]
impl Instrument for SimulatedDiodeThermometer {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        Ok(identity("thermometer on the diode"))
    }
}

#[async_trait]
impl Sensor for SimulatedDiodeThermometer {
    /// The diode has a temperature in the dark too: that of the room in the end.
    async fn read(&self) -> Result<Reading, InstrumentError> {
        let at = self.clock.now();
        let sigma = self.world.config.diode_thermometer.noise_degc;
        let noise = sigma * next_noise(&self.world, Purpose::DiodeTemperature, &self.reads);
        let value = shown(self.world.diode_degc_at(at.monotonic) + noise, 1e3);
        let standard_uncertainty = Some(sigma);
        Ok(Reading { quantity: Quantity::Temperature, value, standard_uncertainty, at })
    }
}
