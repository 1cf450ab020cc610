//! Drivers of real instruments, behind the traits of `beampose_core`.
//!
//! To add a driver: a folder here with `mod.rs` (docs and exports), `protocol.rs`, `driver.rs` and
//! `sim.rs`, and one line in [`REGISTRY`]. Simulated instruments of the virtual lab are not here:
//! the app wires them itself, under the name `simulated`.

/// A driver: which kind of instrument it is for, and its name in a rig file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Driver {
    /// The kind, as in the rig file: `linear_axis`, `camera`.
    pub kind: &'static str,
    /// The name, as in the rig file.
    pub name: &'static str,
}

/// Every driver that this program has.
pub const REGISTRY: &[Driver] = &[];

/// The names of the drivers for a kind of instrument.
#[must_use]
pub fn known(kind: &str) -> Vec<&'static str> {
    REGISTRY.iter().filter(|d| d.kind == kind).map(|d| d.name).collect()
}
