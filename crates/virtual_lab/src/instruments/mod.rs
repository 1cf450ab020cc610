//! Simulated instruments: the core's traits on one shared world and clock.
//!
//! They take their time on the clock, as hardware does, and know of the world only what the
//! hardware would tell. What goes wrong with them on demand is in [`crate::faults`].

mod camera;
mod laser;
mod sensors;
mod stages;

pub use camera::SimulatedCamera;
pub use laser::SimulatedLaser;
pub use sensors::{SimulatedDiodeThermometer, SimulatedThermometer, SimulatedWavemeter};
pub use stages::{HandMoved, SimulatedRail, SimulatedRotation};

use beampose_core::Identity;

fn identity(model: &str) -> Identity {
    Identity { model: format!("simulated {model}"), serial: None, simulated: true }
}
