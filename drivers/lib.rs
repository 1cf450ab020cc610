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
mod axis;
pub mod bristol;
pub mod conformance;
pub mod folder_camera;
pub mod generic;
pub mod gphoto2;
pub mod heidenhain_nd287;
pub mod lake_shore;
pub mod laser;
pub mod newport_smc;
mod options;
mod registry;
pub mod sim;
pub mod srs_ldc500;
pub mod sylvac;
pub mod thorlabs_apt;
pub mod transport;
pub mod webcam;
pub mod zaber;

pub use options::{OptionSpec, Options, Value};
pub use registry::{Connected, Driver, Make, Moved, Role, Setting, Simulator};

/// Every driver that this program has.
pub const REGISTRY: &[Driver] = &[
    arroyo::LASER,
    arroyo::TEMPERATURE,
    bristol::WAVEMETER,
    folder_camera::CAMERA,
    generic::READER,
    gphoto2::CAMERA,
    heidenhain_nd287::DISPLAY,
    lake_shore::THERMOMETER,
    newport_smc::RAIL,
    newport_smc::ROTATION,
    srs_ldc500::LASER,
    srs_ldc500::TEMPERATURE,
    sylvac::READOUT,
    thorlabs_apt::RAIL,
    thorlabs_apt::ROTATION,
    webcam::CAMERA,
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
