//! Drivers of real instruments, behind the traits of `beampose_core`, each with a simulator that
//! answers the same bytes.
//!
//! To add a driver: a folder here with `mod.rs` (docs, and the [`Driver`] itself), `protocol.rs`,
//! `driver.rs` and `sim.rs`, and one line in [`REGISTRY`]; `docs/add-a-driver.md` walks through it.
//! Driver and simulator share no parser, or a shared misreading would pass.
//! Simulated instruments of the virtual lab are not here: the app wires them itself, under the name
//! `simulated`, and hands them to the simulators here as the [`sim::Part`] that these move.

pub mod arroyo;
mod aside;
pub mod conformance;
pub mod folder_camera;
pub mod gphoto2;
pub mod laser;
pub mod newport_smc;
mod options;
mod registry;
pub mod sim;
pub mod srs_ldc500;
pub mod thorlabs_apt;
pub mod transport;
pub mod webcam;
pub mod zaber;

pub use options::{OptionSpec, Options, Value};
pub use registry::{Connected, Driver, Role, Setting, Simulator};

/// Every driver that this program has.
pub const REGISTRY: &[Driver] = &[
    folder_camera::CAMERA,
    gphoto2::CAMERA,
    webcam::CAMERA,
    newport_smc::RAIL,
    newport_smc::ROTATION,
    thorlabs_apt::RAIL,
    thorlabs_apt::ROTATION,
    arroyo::LASER,
    arroyo::TEMPERATURE,
    srs_ldc500::LASER,
    srs_ldc500::TEMPERATURE,
    zaber::RAIL,
    zaber::ROTATION,
];

/// The names of the drivers for a kind of instrument.
#[must_use]
pub fn known(kind: &str) -> Vec<&'static str> {
    REGISTRY.iter().filter(|d| d.kind == kind).map(|d| d.name).collect()
}

/// The driver of that name for a kind of instrument.
#[must_use]
pub fn find(kind: &str, name: &str) -> Option<&'static Driver> {
    REGISTRY.iter().find(|d| d.kind == kind && d.name == name)
}
