//! Zaber stages with the ASCII protocol, over serial port or TCP: X-LSM, X-LRQ and LC40 rails, X-RST
//! and X-RSW rotation stages, alone or several in a chain.
//!
//! Sources: Zaber's ASCII Protocol Manual, and the behaviour of two clients (`zaber-motion`,
//! `zproto`) that talk to [`ZaberChain`]. What no peer could check: stall and limit physics, replies in
//! several packets of firmware 7.26 and later.

mod driver;
mod protocol;
mod sim;

pub use driver::Zaber;
pub use sim::ZaberChain;

use crate::options::{OptionSpec, Value};
use crate::registry::{Driver, Moved, Simulator};
use crate::transport::PortSettings;

const INSTRUMENTS: &str = "Zaber X- and A-series stages (ASCII protocol)";
const VERIFIED: &str = "its simulator by zaber-motion and zproto, the driver by that simulator and \
                        by recorded conversations; never met a device";
const PORT: PortSettings = PortSettings::at(115_200);

const OPTIONS: &[OptionSpec] = &[
    OptionSpec {
        name: "device",
        about: "number of the device in its chain, 1 to 99",
        default: Some(Value::Number(1.0)),
        example: Value::Number(1.0),
    },
    OptionSpec {
        name: "axis",
        about: "number of the axis on the device, 1 to 9",
        default: Some(Value::Number(1.0)),
        example: Value::Number(1.0),
    },
    OptionSpec {
        name: "steps_per_unit",
        about: "microsteps for a millimetre or a degree, from the data sheet: 2015.748 for a \
                microstep of 0.49609375 um",
        default: None,
        example: Value::Number(10_000.0),
    },
];

/// A rail.
pub const RAIL: Driver = Driver {
    kind: "linear_axis",
    name: "zaber",
    instruments: INSTRUMENTS,
    verified: VERIFIED,
    moved: Moved::ByMotor,
    reads: None,
    port: Some(PORT),
    options: OPTIONS,
    connect: driver::connect,
    simulator: Simulator::Device(sim::simulate),
};

/// A rotation stage.
pub const ROTATION: Driver = Driver { kind: "rotary_axis", ..RAIL };
