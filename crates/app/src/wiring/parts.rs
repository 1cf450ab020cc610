//! The virtual lab's instruments as what simulators of bytes move, switch and read.

use std::sync::Arc;
use std::time::Duration;

use beampose_core::{Clock, InstrumentName, Quantity, Sensor};
use beampose_drivers::sim::{Diode, Part, Probe, Shutter, Stage};
use beampose_plan::{Instrument, Rig};
use beampose_virtual_lab::{
    SimulatedCamera, SimulatedDiodeThermometer, SimulatedLaser, SimulatedRail, SimulatedRotation,
    SimulatedThermometer, SimulatedWavemeter, World,
};
use futures::FutureExt as _;

/// What an instrument of the rig is in the world.
///
/// # Errors
/// For people, where the world has no such thing.
pub fn part(
    rig: &Rig,
    name: &InstrumentName,
    instrument: &Instrument,
    world: &Arc<World>,
    clock: &Arc<dyn Clock>,
) -> Result<Part, String> {
    let (world, clock) = (world.clone(), clock.clone());
    let in_words = |error: beampose_virtual_lab::WorldError| error.to_string();
    Ok(match instrument {
        Instrument::LinearAxis(_) => {
            Part::Stage(Arc::new(Rail(SimulatedRail::new(world, clock).map_err(in_words)?)))
        }
        Instrument::RotaryAxis(_) => {
            let stage = SimulatedRotation::new(world, clock).map_err(in_words)?;
            Part::Stage(Arc::new(Turntable(stage)))
        }
        Instrument::Laser(_) => {
            Part::Diode(Arc::new(LaserDiode(SimulatedLaser::new(world, clock))))
        }
        Instrument::Sensor(sensor) => {
            let sensor: Arc<dyn Sensor> = match sensor.reads {
                Quantity::Wavelength => Arc::new(SimulatedWavemeter::new(world, clock)),
                Quantity::Temperature if super::is_of_a_laser(rig, name) => {
                    Arc::new(SimulatedDiodeThermometer::new(world, clock))
                }
                Quantity::Temperature => Arc::new(SimulatedThermometer::new(world, clock)),
                other => return Err(format!("the simulated world has no {}", other.name())),
            };
            Part::Probe(Arc::new(Meter(sensor)))
        }
        Instrument::Camera(_) => {
            let camera = SimulatedCamera::new(world, clock, name.as_str()).map_err(in_words)?;
            Part::Shutter(Arc::new(Lens(camera)))
        }
    })
}

macro_rules! stage {
    ($name:ident, $inner:ty) => {
        struct $name($inner);

        impl Stage for $name {
            fn go(&self, target: f64) -> Result<(), String> {
                self.0.set_off(target).map_err(|error| error.to_string())
            }

            fn is_moving(&self) -> bool {
                self.0.is_moving()
            }

            fn encoder(&self) -> f64 {
                self.0.encoder()
            }

            fn stop(&self) {
                self.0.halt();
            }

            fn limits(&self) -> [f64; 2] {
                self.0.limits()
            }
        }
    };
}

stage!(Rail, SimulatedRail);
stage!(Turntable, SimulatedRotation);

struct LaserDiode(SimulatedLaser);

impl Diode for LaserDiode {
    fn switch(&self, on: bool) {
        self.0.switch(on);
    }

    fn strike(&self) {
        self.0.strike();
    }

    fn is_on(&self) -> bool {
        self.0.is_on()
    }

    fn emits(&self) -> bool {
        self.0.emits()
    }

    fn delay(&self) -> Duration {
        self.0.delay()
    }

    fn interlock_closed(&self) -> bool {
        true
    }

    fn temperature_degc(&self) -> f64 {
        self.0.temperature_degc()
    }
}

struct Meter(Arc<dyn Sensor>);

impl Probe for Meter {
    fn read(&self) -> Result<f64, String> {
        // A sensor of the world answers at once.
        let read = self.0.read().now_or_never();
        let read = read.ok_or_else(|| "it takes its time".to_owned())?;
        read.map(|reading| reading.value).map_err(|error| error.to_string())
    }
}

struct Lens(SimulatedCamera);

impl Shutter for Lens {
    fn expose(&self) -> Result<Vec<u8>, String> {
        self.0.photograph().map_err(|error| error.to_string())
    }
}
