//! The simulated world: where the module is, what the wavelength does, what each camera would see.
//!
//! One [`World`] is shared by all simulated instruments. It is made from a [`WorldConfig`] (what
//! the rig declares) and a seed; what is really so differs from what is declared by errors drawn
//! once from the declared uncertainties ([`TrueParameters`]). Every random number comes from a
//! ChaCha stream of its own (purpose, camera, capture, dot), so the same seed gives the same bytes
//! for any number of threads and in any order of rendering.
//!
//! Inside this crate plain `f64` is in millimetres, radians and pixels unless a name ends in
//! another unit; the conventions of axes and pixels are those of `photogrammetry`. Grey levels run
//! from 0 to 255.
//!
//! Not simulated: occlusion (of a wall by the module, a stage or another wall's shadow), defocus
//! over the depth of field, motion during the exposure, light reflected from wall to wall.

pub mod config;
mod diode;
mod error;
pub mod faults;
mod geometry;
pub mod instruments;
mod motion;
mod render;
mod room;
mod stage;
mod streams;
mod truth;
mod world;

#[cfg(test)]
mod tests;

pub use config::{ErrorDraw, WorldConfig};
pub use error::WorldError;
pub use instruments::{
    HandMoved, SimulatedCamera, SimulatedDiodeThermometer, SimulatedLaser, SimulatedRail,
    SimulatedRotation, SimulatedThermometer, SimulatedWavemeter,
};
pub use truth::{DotTruth, TargetTruth, TrueCamera, TrueParameters, Truth};
pub use world::{History, ImagedDot, ImagedTarget, ModuleState, StageHistory, World};
