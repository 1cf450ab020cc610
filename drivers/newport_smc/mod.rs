//! Newport stages on SMC100CC, SMC100PP and CONEX controllers, alone or up to 31 on one line.
//!
//! Sources: the open drivers of EPICS (`motorNewport`, SMC100) and of the yaq project
//! (`yaqd-newport`), whose daemon also talks to [`SmcChain`] here. A CONEX on USB wants `?baud=921600`
//! behind its address. What no peer could check: flow control, how long a real search or reset
//! takes, which setters a controller refuses in which state (here: the strict reading).
//!
//! `PW1` and `PW0`, which write the controller's flash memory, are never sent: it bears only some
//! hundred of them.

mod driver;
mod protocol;
mod sim;

pub use driver::NewportSmc;
pub use sim::SmcChain;

use crate::options::{OptionSpec, Value};
use crate::registry::{Driver, Moved, Simulator};
use crate::transport::{FlowControl, PortSettings};

const OPTIONS: &[OptionSpec] = &[OptionSpec {
    name: "address",
    about: "number of the controller on its line, 1 to 31",
    default: Some(Value::Number(1.0)),
    example: Value::Number(1.0),
}];

/// A rail.
pub const RAIL: Driver = Driver {
    kind: "linear_axis",
    name: "newport-smc",
    instruments: "Newport SMC100CC, SMC100PP and CONEX-CC stages",
    verified: "its simulator by yaqd-newport (home, limits, move, position, status), the driver by \
               that simulator; never met a device",
    moved: Moved::ByMotor,
    reads: None,
    port: Some(PortSettings { flow: FlowControl::Software, ..PortSettings::at(57_600) }),
    options: OPTIONS,
    connect: driver::connect,
    simulator: Simulator::Device(sim::simulate),
};

/// A rotation stage.
pub const ROTATION: Driver = Driver { kind: "rotary_axis", ..RAIL };
