//! Any instrument that answers a question with a number in a line of text: what is asked, what is
//! answered, and in which unit stand in the rig file.
//!
//! ```yaml
//! thermometer:
//!   driver: generic
//!   options: { command: 'T\r', terminator: '\r', answer: 't: {value} C *', unit: C }
//! ```
//!
//! In `command`, `setup`, `identify` and `terminator`, `\r`, `\n`, `\t`, `\\` and `\x1b` stand for
//! bytes; nothing is appended, so a line end must be written. In `answer`, `{value}` is the number,
//! `*` is anything, a blank is any number of blanks, everything else is itself; the whole line must
//! fit, without its terminator and the blanks around it. There is no peer for it: it is whatever the
//! rig file says.

mod driver;
mod protocol;
mod sim;
mod units;

pub use driver::Generic;
pub use sim::GenericDevice;

use crate::options::{OptionSpec, Value};
use crate::registry::{Driver, Moved, Simulator};
use crate::transport::PortSettings;

/// A reader of anything.
pub const READER: Driver = Driver {
    kind: "sensor",
    name: "generic",
    instruments: "anything that answers a question with a number in a line of text",
    verified: "as far as the rig file is right: try it with the instrument's display in sight",
    moved: Moved::ByMotor,
    reads: None,
    port: Some(PortSettings::at(9600)),
    options: &[
        OptionSpec {
            name: "command",
            about: "what asks for a reading, with its line end: READ?\\r\\n",
            default: None,
            example: Value::Text("READ?\\r\\n"),
        },
        OptionSpec {
            name: "answer",
            about: "what the answer looks like: {value} is the number, * anything",
            default: Some(Value::Text("{value}")),
            example: Value::Text("T={value} C"),
        },
        OptionSpec {
            name: "unit",
            about: "unit of the number: nm (in vacuum), um, pm, THz; mm, um, cm, m, in; deg, rad, \
                    mrad; C, K, F; mA, A, uA",
            default: None,
            example: Value::Text("C"),
        },
        OptionSpec {
            name: "terminator",
            about: "the last byte of an answer",
            default: Some(Value::Text("\\n")),
            example: Value::Text("\\r"),
        },
        OptionSpec {
            name: "setup",
            about: "sent after connecting, several apart by |, answers thrown away",
            default: Some(Value::Text("")),
            example: Value::Text("SYST:REM\\r\\n"),
        },
        OptionSpec {
            name: "identify",
            about: "asks who it is, one line of answer; nothing where it cannot be asked",
            default: Some(Value::Text("")),
            example: Value::Text("*IDN?\\r\\n"),
        },
        OptionSpec {
            name: "baud",
            about: "bits per second of a serial port",
            default: Some(Value::Number(9600.0)),
            example: Value::Number(2400.0),
        },
        OptionSpec {
            name: "data_bits",
            about: "7 or 8",
            default: Some(Value::Number(8.0)),
            example: Value::Number(7.0),
        },
        OptionSpec {
            name: "parity",
            about: "none, odd or even",
            default: Some(Value::Text("none")),
            example: Value::Text("even"),
        },
        OptionSpec {
            name: "stop_bits",
            about: "1 or 2",
            default: Some(Value::Number(1.0)),
            example: Value::Number(2.0),
        },
        OptionSpec {
            name: "flow",
            about: "none, software (XON and XOFF) or hardware (RTS and CTS)",
            default: Some(Value::Text("none")),
            example: Value::Text("hardware"),
        },
    ],
    connect: driver::connect,
    simulator: Simulator::Device(sim::simulate),
};
