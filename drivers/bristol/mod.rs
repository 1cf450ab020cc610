//! Wavelength meters Bristol 671 and 871 over their network interface (TCP port 23, SCPI behind a
//! telnet server).
//!
//! Sources: the manuals of 671 and 871 (chapter on SCPI, pages 33 to 40 and 44 to 58), and the bits
//! of the questionable register as open laboratory scripts have them. What no peer could check:
//! banner and telnet options of a real one, and how many digits its frequency has. The binary
//! protocol of the 871's serial port is another one and is not spoken here.
//!
//! It asks for the frequency, which is the same in every medium, and reports the vacuum wavelength
//! of it: whether the meter is set to show wavelengths in air does not matter.

mod driver;
mod protocol;
mod sim;

pub use driver::Bristol;
pub use sim::BristolMeter;

use beampose_core::Quantity;

use crate::registry::{Driver, Moved, Simulator};
use crate::transport::PortSettings;

/// A wavelength meter.
pub const WAVEMETER: Driver = Driver {
    kind: "sensor",
    name: "bristol",
    instruments: "Bristol 671 and 871 wavelength meters (SCPI, TCP port 23)",
    verified: "written from the manual, never met a device",
    moved: Moved::ByMotor,
    reads: Some(Quantity::Wavelength),
    port: Some(PortSettings::at(115_200)),
    options: &[],
    connect: driver::connect,
    simulator: Simulator::Device(sim::simulate),
};
