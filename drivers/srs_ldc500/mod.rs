//! Laser diode controllers SRS LDC500, LDC501 and LDC502, over Ethernet (TCP port 8888) or RS-232
//! (9600 baud): the diode's current as a laser, its temperature as a sensor. Both may stand at the
//! same address in the rig file and then share the line.
//!
//! Sources: operation and service manual, chapter "Remote Operation" (syntax, buffers, token and
//! termination modes, limits, the table of `LCME?`), and the behaviour of pymeasure's `LDC500Series`
//! that talks to `sim`. What nobody could check: the table of `LEXE?` (a code is reported as a
//! number), what the Ethernet port refuses before `ULOC 1`, what `TTRD?` answers without a sensor,
//! and every trip of the real hardware. The range (`RNGE`), the voltage limit (`SVLM`) and the
//! temperature control are set at the front panel, for the diode in use; this driver changes neither
//! and refuses light while the temperature control is off or not at its set point.

mod driver;
mod protocol;
mod sensor;
mod sim;

pub use driver::SrsLdc500;
pub use sensor::DiodeTemperature;
pub use sim::Ldc500;

use beampose_core::Quantity;

use crate::laser::diode::{LIMIT_CURRENT, TEMPERATURE_CONTROL, TEMPERATURE_TOLERANCE};
use crate::registry::{Driver, Moved, Simulator};
use crate::transport::PortSettings;

const INSTRUMENTS: &str = "Stanford Research Systems LDC500, LDC501, LDC502";
const VERIFIED: &str = "its simulator by pymeasure's LDC500Series over TCP and by a recorded \
                        conversation, the driver by that simulator; never met a device";
const PORT: PortSettings = PortSettings::at(9_600);

/// The current source.
pub const LASER: Driver = Driver {
    kind: "laser",
    name: "srs-ldc500",
    instruments: INSTRUMENTS,
    verified: VERIFIED,
    moved: Moved::ByMotor,
    reads: None,
    port: Some(PORT),
    options: &[LIMIT_CURRENT, TEMPERATURE_CONTROL, TEMPERATURE_TOLERANCE],
    connect: driver::connect,
    simulator: Simulator::Device(sim::simulate),
};

/// The temperature of the diode.
pub const TEMPERATURE: Driver = Driver {
    kind: "sensor",
    name: "srs-ldc500",
    instruments: INSTRUMENTS,
    verified: VERIFIED,
    moved: Moved::ByMotor,
    reads: Some(Quantity::Temperature),
    port: Some(PORT),
    options: &[],
    connect: sensor::connect,
    simulator: Simulator::Device(sim::simulate),
};
