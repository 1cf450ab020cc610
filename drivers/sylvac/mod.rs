//! Readouts of hand-moved rails: Trimos and Sylvac columns and scales with the OptoRS interface
//! (RS-232 at 4800 baud, 7E2).
//!
//! Sources: manuals of Trimos V (pages 21 and 22) and of interfaces that read OptoRS. There is no
//! foreign peer for it, and a pty knows no parity: that the line is set to 7E2 is checked as far as
//! a pty tells (baud, two stop bits).
//!
//! The unit is not in a value, and a key on the instrument changes it: it is asked for after every
//! value. That also finds the place again after lines that nobody asked for (the PRINT key).

mod driver;
mod protocol;
mod sim;

pub use driver::Sylvac;
pub use sim::SylvacReadout;

use crate::registry::{Driver, Moved, Simulator};
use crate::transport::{Parity, PortSettings};

/// A readout.
pub const READOUT: Driver = Driver {
    kind: "linear_axis",
    name: "sylvac",
    instruments: "Trimos and Sylvac readouts with OptoRS, moved by hand",
    verified: "written from the manual, never met a device",
    moved: Moved::ByHand,
    reads: None,
    port: Some(PortSettings {
        data_bits: 7,
        parity: Parity::Even,
        stop_bits: 2,
        ..PortSettings::at(4800)
    }),
    options: &[],
    connect: driver::connect,
    simulator: Simulator::Device(sim::simulate),
};
