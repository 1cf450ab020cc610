//! Lake Shore thermometers: 218 (inputs 1 to 8), 224, 331 to 340 (inputs A, B, C1 ...), over serial
//! port or, 224 and 336, over TCP port 7777. Several inputs of one instrument share one line.
//!
//! Sources: the manuals of 218 and 336, and two foreign peers: the device emulator `Lksh218` of the
//! ISIS facility (on lewis), which this driver reads, and the client of pymeasure, which reads
//! its simulator. What no peer could check: what a real one answers for an input without a sensor, and how
//! it takes more than 20 commands a second.

mod driver;
mod protocol;
mod sim;

pub use driver::LakeShore;
pub use sim::LakeShoreMonitor;

use beampose_core::Quantity;

use crate::options::{OptionSpec, Value};
use crate::registry::{Driver, Moved, Simulator};
use crate::transport::{Parity, PortSettings};

/// One input of a monitor.
pub const THERMOMETER: Driver = Driver {
    kind: "sensor",
    name: "lake-shore",
    instruments: "Lake Shore 218, 224, 331, 335, 336, 340 temperature monitors and controllers",
    verified: "the driver by lewis with the emulator Lksh218 of ISIS (readings in kelvin), its \
               simulator by pymeasure; never met a device",
    moved: Moved::ByMotor,
    reads: Some(Quantity::Temperature),
    port: Some(PortSettings { data_bits: 7, parity: Parity::Odd, ..PortSettings::at(9600) }),
    options: &[
        OptionSpec {
            name: "channel",
            about: "input: 1 to 8 of a 218, A to D of a 336, C1 to C5 of a 224",
            default: None,
            example: Value::Text("1"),
        },
        OptionSpec {
            name: "scale",
            about: "which reading is asked for: celsius (CRDG?) or kelvin (KRDG?); degrees Celsius \
                    are reported either way",
            default: Some(Value::Text("celsius")),
            example: Value::Text("celsius"),
        },
        OptionSpec {
            name: "status",
            about: "whether the reading's status is asked for (RDGST?); without it an input that \
                    reads nothing may look like a temperature",
            default: Some(Value::Switch(true)),
            example: Value::Switch(true),
        },
    ],
    connect: driver::connect,
    simulator: Simulator::Device(sim::simulate),
};
