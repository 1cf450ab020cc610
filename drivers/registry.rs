//! What a driver is to the rest of the program.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use beampose_core::instrument::AxisUnit;
use beampose_core::{Axis, Camera, Clock, InstrumentError, Laser, Quantity, Sensor};

use crate::options::{OptionSpec, Options};
use crate::sim::{Device, Hosted, Simulated};
use crate::transport::{Address, FlowControl, Line, Parity, Party, PortSettings};

/// A driver: which kind of instrument it is for, and how one is made.
#[derive(Debug, Clone, Copy)]
pub struct Driver {
    /// The kind, as in the rig file: `linear_axis`, `camera`.
    pub kind: &'static str,
    /// The name, as in the rig file.
    pub name: &'static str,
    /// Maker and models, for people.
    pub instruments: &'static str,
    /// Who has verified it and how far: a peer, or "written from the manual, never met a device".
    pub verified: &'static str,
    /// Whether an axis moves by itself. Of no account for other kinds.
    pub moved: Moved,
    /// What it reads, where it is the driver of a sensor that reads one thing only.
    pub reads: Option<Quantity>,
    /// How its line is set where neither address nor options say anything; `None` where there is no
    /// line of bytes. [`Driver::port_settings`] is how it is set then.
    pub port: Option<PortSettings>,
    /// What may stand under `options` in the rig file.
    pub options: &'static [OptionSpec],
    /// Makes the instrument. Nothing is sent yet: the line is opened by the first call.
    pub connect: fn(Setting) -> Result<Connected, InstrumentError>,
    /// Makes the simulator that answers as the instrument does.
    pub simulator: Simulator,
}

impl Driver {
    /// How an instrument's line is set: [`Driver::port`], and where the driver has options of those
    /// names, what they say of `baud`, `data_bits`, `parity`, `stop_bits` and `flow`.
    ///
    /// # Errors
    /// [`InstrumentError::Refused`] with the option that says what no port has.
    pub fn port_settings(
        &self,
        options: &Options,
    ) -> Result<Option<PortSettings>, InstrumentError> {
        let Some(mut port) = self.port else { return Ok(None) };
        let has = |name: &str| self.options.iter().any(|spec| spec.name == name);
        if has("baud") {
            port.baud = options.whole("baud", 50, 4_000_000)?;
        }
        if has("data_bits") {
            port.data_bits = if options.whole("data_bits", 7, 8)? == 7 { 7 } else { 8 };
        }
        if has("stop_bits") {
            port.stop_bits = if options.whole("stop_bits", 1, 2)? == 2 { 2 } else { 1 };
        }
        let wrong = |name: &str, words: &str, found: &str| {
            let why = format!("option {name} must be {words}, found {found:?}");
            Err(InstrumentError::Refused(why))
        };
        if has("parity") {
            port.parity = match options.text("parity")? {
                "none" => Parity::None,
                "odd" => Parity::Odd,
                "even" => Parity::Even,
                other => return wrong("parity", "none, odd or even", other),
            };
        }
        if has("flow") {
            port.flow = match options.text("flow")? {
                "none" => FlowControl::None,
                "software" => FlowControl::Software,
                "hardware" => FlowControl::Hardware,
                other => return wrong("flow", "none, software or hardware", other),
            };
        }
        Ok(Some(port))
    }
}

/// How an axis moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Moved {
    /// By its motor, as told.
    ByMotor,
    /// By a person: the driver only reads where it stands.
    ByHand,
}

/// Makes a simulator of the instruments at one address, or says why it cannot.
pub type Make<T> = fn(&[Simulated]) -> Result<Box<T>, String>;

/// How a driver's simulator is made: of all the rig's instruments at one address.
#[derive(Debug, Clone, Copy)]
pub enum Simulator {
    /// A device on one line of bytes; [`crate::sim::Host`] gives it a pty or a TCP port.
    Device(Make<dyn Device>),
    /// Something that brings its own sockets or files.
    Hosted(Make<dyn Hosted>),
}

/// What a driver is told of its instrument.
pub struct Setting {
    /// Its name in the rig.
    pub name: String,
    /// Where it is.
    pub address: Address,
    /// Its line of bytes, which other instruments may share; `None` where the driver's
    /// [`Driver::port`] is.
    pub line: Option<Arc<Line>>,
    /// The time.
    pub clock: Arc<dyn Clock>,
    /// What the rig file says under `options`, complete and of the right kinds.
    pub options: Options,
    /// What the rig file says besides.
    pub role: Role,
    /// How long an answer may take. Real time.
    pub deadline: Duration,
    /// Whether a simulator answers: stored with the session.
    pub simulated: bool,
    /// Where the driver may leave files while it runs (pictures on their way, say).
    pub scratch: PathBuf,
}

impl Setting {
    /// Its place on the line, for a driver that has one.
    ///
    /// # Errors
    /// [`InstrumentError::Disconnected`] where nobody opened one: the address is of another kind.
    pub fn line(&self) -> Result<Party, InstrumentError> {
        let none = || {
            let name = &self.name;
            InstrumentError::Disconnected(format!("{name} needs a serial port or a TCP address"))
        };
        self.line.clone().map(Party::new).ok_or_else(none)
    }
}

/// What the rig file says of an instrument, by its kind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Role {
    /// A rail or a rotation stage.
    Axis {
        /// Millimetres or degrees.
        unit: AxisUnit,
        /// Soft limits, in the unit.
        limits: [f64; 2],
        /// Speed, units per second.
        speed: f64,
    },
    /// A laser diode.
    Laser {
        /// Its working current, mA.
        current_ma: Option<f64>,
        /// From the command to light.
        emission_delay: Duration,
    },
    /// A wavelength meter, a thermometer.
    Sensor {
        /// What it reads.
        quantity: Quantity,
        /// Declared standard uncertainty, in the quantity's unit.
        u: Option<f64>,
    },
    /// A camera.
    Camera {
        /// How long it exposes.
        exposure: Option<Duration>,
        /// How long until a picture is here; four times as long is waited.
        delivery: Option<Duration>,
    },
}

/// An instrument, made.
#[derive(Clone)]
pub enum Connected {
    /// A rail or a rotation stage.
    Axis(Arc<dyn Axis>),
    /// A laser.
    Laser(Arc<dyn Laser>),
    /// A sensor.
    Sensor(Arc<dyn Sensor>),
    /// A camera.
    Camera(Arc<dyn Camera>),
}
