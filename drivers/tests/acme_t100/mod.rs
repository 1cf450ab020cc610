//! Thermometers Acme T100 with up to four sensors, over RS-232 (9600 baud) or a terminal server.
//!
//! Sources: the manual of an instrument that does not exist. What nobody could check: all of it.

mod driver;
mod protocol;
mod sim;

use beampose_core::Quantity;

use crate::transport::PortSettings;
use crate::{Driver, Moved, OptionSpec, Simulator, Value};

/// A sensor.
pub const SENSOR: Driver = Driver {
    kind: "sensor",
    name: "acme-t100",
    instruments: "Acme T100",
    verified: "written from the manual, never met a device",
    // Of no account for what is no axis.
    moved: Moved::ByMotor,
    reads: Some(Quantity::Temperature),
    port: Some(PortSettings::at(9_600)),
    options: &[OptionSpec {
        name: "channel",
        about: "the sensor's channel, 1 to 4",
        default: Some(Value::Number(1.0)),
        example: Value::Number(1.0),
    }],
    connect: driver::connect,
    simulator: Simulator::Device(sim::simulate),
};
