//! Laser controllers of Arroyo Instruments: LaserSource 4300 (current only) and ComboSource 6300
//! (current and temperature), over USB's serial port (38400 baud) or RS-232 (factory setting 9600
//! baud: write `?baud=9600` behind the port). The diode's current as a laser, its temperature as a
//! sensor; both may stand at the same address and then share the line.
//!
//! Source: Arroyo's Computer Interfacing Manual. What nobody could check, since no foreign client or
//! simulator could be had: everything beyond that manual; whether bit 10 of the condition register
//! is set already during the on-delay (the driver takes either sign for "on"); the exact digits of
//! answers. The laser's mode becomes constant current with low bandwidth; the voltage limit and the
//! temperature control are set at the front panel for the diode in use.

mod driver;
mod protocol;
mod sensor;
mod sim;
mod words;

pub use driver::Arroyo;
pub use sensor::ArroyoTemperature;
pub use sim::ComboSource;

use beampose_core::Quantity;

use crate::laser::diode::{LIMIT_CURRENT, TEMPERATURE_CONTROL, TEMPERATURE_TOLERANCE};
use crate::options::OptionSpec;
use crate::registry::{Driver, Moved, Simulator};
use crate::transport::PortSettings;

const INSTRUMENTS: &str = "Arroyo Instruments 4300 and 6300 series";
const VERIFIED: &str = "written from the manual, never met a device";
/// No flow control: with it the box never answers (manual, "Interface Settings").
const PORT: PortSettings = PortSettings::at(38_400);

const HELD: OptionSpec = OptionSpec {
    about: "whether the controller holds the diode's temperature (a 4300 cannot); without it light \
            is given at any temperature",
    ..TEMPERATURE_CONTROL
};

/// The current source.
pub const LASER: Driver = Driver {
    kind: "laser",
    name: "arroyo",
    instruments: INSTRUMENTS,
    verified: VERIFIED,
    moved: Moved::ByMotor,
    reads: None,
    port: Some(PORT),
    options: &[LIMIT_CURRENT, HELD, TEMPERATURE_TOLERANCE],
    connect: driver::connect,
    simulator: Simulator::Device(sim::simulate),
};

/// The temperature of the diode, of a 6300.
pub const TEMPERATURE: Driver = Driver {
    kind: "sensor",
    name: "arroyo",
    instruments: INSTRUMENTS,
    verified: VERIFIED,
    moved: Moved::ByMotor,
    reads: Some(Quantity::Temperature),
    port: Some(PORT),
    options: &[],
    connect: sensor::connect,
    simulator: Simulator::Device(sim::simulate),
};
