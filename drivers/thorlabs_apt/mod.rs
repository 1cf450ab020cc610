//! Thorlabs stages with the APT binary protocol: KDC101 with MTS and PRM1 stages, K10CR1, LTS.
//!
//! Sources: Thorlabs' "APT Controllers Host-Controller Communications Protocol", and two clients
//! (`thorlabs-apt-device`, `pylablib`) that also talk to [`AptUnit`]. What no peer could check: the
//! reset of the USB chip at connect, the scale of an LTS's speed, how real stages report a refusal.
//!
//! Every position counts from the reference, which a controller loses with its power. It then moves
//! all the same, somewhere else; the driver refuses to.

mod driver;
mod protocol;
mod sim;

pub use driver::ThorlabsApt;
pub use sim::AptUnit;

use crate::options::{OptionSpec, Value};
use crate::registry::{Driver, Moved, Simulator};
use crate::transport::{FlowControl, PortSettings};

const COUNTS: OptionSpec = OptionSpec {
    name: "counts_per_unit",
    about: "counts for a millimetre or a degree: 34554.96 for MTS25-Z8 and MTS50-Z8 (some sources \
            say 34304, by their gears' rounded ratio: check it over a known distance), \
            1919.6418578623391 for PRM1-Z8, 136533.33333333333 for K10CR1, 409600 for LTS150 and \
            LTS300 (25600 with the first electronics)",
    default: None,
    example: Value::Number(34_554.96),
};

const CONTROLLER: OptionSpec = OptionSpec {
    name: "controller",
    about: "kdc101 (a DC motor), or k10cr1 or lts300 (stages with their own stepper controller)",
    default: None,
    example: Value::Text("kdc101"),
};

const CHANNEL: OptionSpec = OptionSpec {
    name: "channel",
    about: "number of the channel on the controller, 1 to 6",
    default: Some(Value::Number(1.0)),
    example: Value::Number(1.0),
};

/// A rail.
pub const RAIL: Driver = Driver {
    kind: "linear_axis",
    name: "thorlabs-apt",
    instruments: "Thorlabs KDC101, K10CR1 and LTS stages (APT protocol)",
    verified: "its simulator by thorlabs-apt-device and pylablib, the driver by that simulator and \
               by recorded conversations; never met a device",
    moved: Moved::ByMotor,
    reads: None,
    port: Some(PortSettings {
        flow: FlowControl::Hardware,
        cycle_rts: true,
        ..PortSettings::at(115_200)
    }),
    options: &[COUNTS, CONTROLLER, CHANNEL],
    connect: driver::connect,
    simulator: Simulator::Device(sim::simulate),
};

/// A rotation stage.
pub const ROTATION: Driver = Driver {
    kind: "rotary_axis",
    options: &[
        OptionSpec { example: Value::Number(136_533.333), ..COUNTS },
        OptionSpec { example: Value::Text("k10cr1"), ..CONTROLLER },
        CHANNEL,
    ],
    ..RAIL
};
