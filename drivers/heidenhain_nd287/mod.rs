//! Heidenhain ND 287 position displays, on a rail that is moved by hand (RS-232 or USB serial port).
//!
//! Sources: the ND 287 manual (page 108: commands that ask for the contents of the screen; its
//! status bar) and pymeasure's client, which reads its simulator. What no peer could check: the default of
//! the line (9600 baud, 7E2 here, as open scripts have it; `?baud=` in the address for another), and
//! displays of several axes.
//!
//! It asks for the position as it is displayed: the decimal point is in it, which the plain count
//! (`A0200`) leaves out. The status bar before and after tells its unit, and that what is shown is a
//! position and no distance to go.

mod driver;
mod protocol;
mod sim;

pub use driver::Nd287;
pub use sim::Nd287Display;

use crate::registry::{Driver, Moved, Simulator};
use crate::transport::{Parity, PortSettings};

/// A display.
pub const DISPLAY: Driver = Driver {
    kind: "linear_axis",
    name: "heidenhain-nd287",
    instruments: "Heidenhain ND 287 position displays, moved by hand",
    verified: "its simulator by pymeasure (identity, count, status bar, error text), the driver by \
               that simulator; never met a device",
    moved: Moved::ByHand,
    reads: None,
    port: Some(PortSettings {
        data_bits: 7,
        parity: Parity::Even,
        stop_bits: 2,
        ..PortSettings::at(9600)
    }),
    options: &[],
    connect: driver::connect,
    simulator: Simulator::Device(sim::simulate),
};
