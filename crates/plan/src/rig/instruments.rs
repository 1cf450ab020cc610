//! The instruments of a rig.
//!
//! To add a kind: a record here, a line in [`Instrument`], a trait in `core`.

use std::collections::BTreeMap;

use beampose_core::units::{Degree, Milliampere, Millimetre, Nanometre, Second};
use beampose_core::{InstrumentName, Quantity};
use schemars::{Schema, SchemaGenerator, json_schema};
use serde::Serialize;

use crate::fault::At;
use crate::quantity::{
    Byte, CURRENT, DegreePerSecond, Kelvin, MillimetrePerSecond, TEMPERATURE_DIFFERENCE,
    WAVELENGTH, parse,
};
use crate::reader::{Read, Reader, not_negative, positive, quantity_of};
use crate::tree::{Node, Value};

/// The driver of instruments that do not exist.
pub const SIMULATED: &str = "simulated";
/// How the address of an instrument begins whose simulator this program starts.
const SIMULATOR: &str = "simulator:";

choice! {
    /// One instrument: a map with one key that says of which kind.
    pub enum Instrument ("a kind of instrument") {
        /// A stage that moves along a line.
        "linear_axis" => LinearAxis(LinearAxis),
        /// A stage that turns.
        "rotary_axis" => RotaryAxis(RotaryAxis),
        /// A laser source.
        "laser" => Laser(Laser),
        /// Something that is read: a wavelength meter, a thermometer.
        "sensor" => Sensor(Sensor),
        /// A camera that takes single pictures.
        "camera" => Camera(Camera),
    }
}

/// What a driver is told beside what all instruments of its kind are: names that the driver knows.
pub type Options = BTreeMap<String, At<Scalar>>;

/// A number, a text, or yes and no, as it stands in the file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Scalar(pub String);

impl Read for Scalar {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        match &node.value {
            // A terminator may be all white space.
            Value::Text(text) => Some(Self(text.clone())),
            Value::Number(number) => Some(Self(number.to_string())),
            Value::Bool(it) => Some(Self(it.to_string())),
            _ => reader.expected(node, "a number, a text, true or false"),
        }
    }

    fn schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": ["number", "string", "boolean"] })
    }
}

/// How far from its target a linear axis may read after a move, where the rig says nothing.
const TOLERANCE_MM: f64 = 0.1;
/// How far from its target a rotary axis may read after a move, where the rig says nothing.
const TOLERANCE_DEG: f64 = 0.02;

impl Instrument {
    /// How far from its target an axis may read after a move, in its unit.
    #[must_use]
    pub fn tolerance(&self) -> Option<f64> {
        match self {
            Self::LinearAxis(axis) => Some(axis.tolerance.map_or(TOLERANCE_MM, |t| t.0)),
            Self::RotaryAxis(axis) => Some(axis.tolerance.map_or(TOLERANCE_DEG, |t| t.0)),
            _ => None,
        }
    }

    /// How long an axis that is moved by hand must have stood; `None` of one with a motor.
    #[must_use]
    pub fn still_for(&self) -> Option<Second> {
        match self {
            Self::LinearAxis(axis) => axis.by_hand.as_ref().map(|hand| hand.still_for),
            Self::RotaryAxis(axis) => axis.by_hand.as_ref().map(|hand| hand.still_for),
            _ => None,
        }
    }

    /// Which driver speaks to it, and where that is written.
    #[must_use]
    pub const fn driver(&self) -> &At<String> {
        match self {
            Self::LinearAxis(i) => &i.driver,
            Self::RotaryAxis(i) => &i.driver,
            Self::Laser(i) => &i.driver,
            Self::Sensor(i) => &i.driver,
            Self::Camera(i) => &i.driver,
        }
    }

    /// Where the driver finds it.
    #[must_use]
    pub const fn address(&self) -> Option<&At<String>> {
        match self {
            Self::LinearAxis(i) => i.address.as_ref(),
            Self::RotaryAxis(i) => i.address.as_ref(),
            Self::Laser(i) => i.address.as_ref(),
            Self::Sensor(i) => i.address.as_ref(),
            Self::Camera(i) => i.address.as_ref(),
        }
    }

    /// How long an answer over its line may take, where the rig says it.
    #[must_use]
    pub const fn deadline(&self) -> Option<Second> {
        match self {
            Self::LinearAxis(i) => i.deadline,
            Self::RotaryAxis(i) => i.deadline,
            Self::Laser(i) => i.deadline,
            Self::Sensor(i) => i.deadline,
            Self::Camera(i) => i.deadline,
        }
    }

    /// What only its driver understands; the driver checks it.
    #[must_use]
    pub const fn options(&self) -> Option<&Options> {
        match self {
            Self::LinearAxis(i) => i.options.as_ref(),
            Self::RotaryAxis(i) => i.options.as_ref(),
            Self::Laser(i) => i.options.as_ref(),
            Self::Sensor(i) => i.options.as_ref(),
            Self::Camera(i) => i.options.as_ref(),
        }
    }

    /// Whether nothing but a simulation answers.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        self.driver().value == SIMULATED
    }

    /// Whether it is part of the simulated world: simulated itself, or a real driver before its own
    /// simulator, which moves that world.
    #[must_use]
    pub fn is_of_simulated_world(&self) -> bool {
        let simulator = |at: &At<String>| at.value.starts_with(SIMULATOR);
        self.is_simulated() || self.address().is_some_and(simulator)
    }

    /// The kind, as in the rig file.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::LinearAxis(_) => "linear_axis",
            Self::RotaryAxis(_) => "rotary_axis",
            Self::Laser(_) => "laser",
            Self::Sensor(_) => "sensor",
            Self::Camera(_) => "camera",
        }
    }
}

record! {
    /// A stage that moves along a line.
    pub struct LinearAxis {
        /// Which driver speaks to it; `simulated` where none does.
        driver: At<String>,
        /// Where the driver finds it: `/dev/ttyUSB0`, `tcp:host:port`, `simulator:tcp`.
        address: Option<At<String>>,
        /// How long an answer over its line may take; without it 1 s.
        deadline: Option<Second> => positive,
        /// What this driver alone needs to know.
        options: Option<Options>,
        /// Between which places it may move.
        travel: At<LinearTravel>,
        /// How fast it moves.
        speed: MillimetrePerSecond => positive,
        /// How long it needs to stand still after a move.
        settle: Second => not_negative,
        /// Standard uncertainty of its encoder.
        u: Option<Millimetre> => positive,
        /// How far from its target it may read after a move; without it 0.1 mm.
        tolerance: Option<Millimetre> => positive,
        /// Where somebody moves it and the program only reads it.
        by_hand: Option<ByHand>,
    }
}

record! {
    /// When an axis that is moved by hand stands where it should: within its tolerance.
    pub struct ByHand {
        /// For so long.
        still_for: Second => positive,
    }
}

record! {
    /// The soft limits of a linear axis.
    pub struct LinearTravel {
        /// The lower one.
        from: Millimetre,
        /// The upper one.
        to: Millimetre,
    }
}

record! {
    /// A stage that turns.
    pub struct RotaryAxis {
        /// Which driver speaks to it; `simulated` where none does.
        driver: At<String>,
        /// Where the driver finds it: `/dev/ttyUSB0`, `tcp:host:port`, `simulator:tcp`.
        address: Option<At<String>>,
        /// How long an answer over its line may take; without it 1 s.
        deadline: Option<Second> => positive,
        /// What this driver alone needs to know.
        options: Option<Options>,
        /// Between which angles it may turn.
        travel: At<RotaryTravel>,
        /// How fast it turns.
        speed: DegreePerSecond => positive,
        /// How long it needs to stand still after a move.
        settle: Second => not_negative,
        /// Standard uncertainty of its encoder.
        u: Option<Degree> => positive,
        /// How far from its target it may read after a move; without it 0.02 deg.
        tolerance: Option<Degree> => positive,
        /// Where somebody moves it and the program only reads it.
        by_hand: Option<ByHand>,
    }
}

record! {
    /// The soft limits of a rotary axis.
    pub struct RotaryTravel {
        /// The lower one.
        from: Degree,
        /// The upper one.
        to: Degree,
    }
}

record! {
    /// A laser source.
    pub struct Laser {
        /// Which driver speaks to it; `simulated` where none does.
        driver: At<String>,
        /// Where the driver finds it: `/dev/ttyUSB0`, `tcp:host:port`, `simulator:tcp`.
        address: Option<At<String>>,
        /// How long an answer over its line may take; without it 1 s.
        deadline: Option<Second> => positive,
        /// What this driver alone needs to know.
        options: Option<Options>,
        /// How long after switching on no light comes out: the law asks for it in class 3B.
        emission_delay: Second => not_negative,
        /// The current it is driven with.
        current: Option<Milliampere> => positive,
    }
}

record! {
    /// Something that is read.
    pub struct Sensor {
        /// Which driver speaks to it; `simulated` where none does.
        driver: At<String>,
        /// Where the driver finds it: `/dev/ttyUSB0`, `tcp:host:port`, `simulator:tcp`.
        address: Option<At<String>>,
        /// How long an answer over its line may take; without it 1 s.
        deadline: Option<Second> => positive,
        /// What this driver alone needs to know.
        options: Option<Options>,
        /// What it reads.
        reads: Quantity,
        /// Of which laser: a thermometer on its diode. Without it a thermometer reads that of the room.
        of: Option<At<InstrumentName>>,
        /// Standard uncertainty of a reading.
        u: Option<At<SensorUncertainty>>,
        /// How long a reading takes.
        response: Option<Second> => not_negative,
    }
}

/// The standard uncertainty of a sensor's reading: the unit says of what.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SensorUncertainty {
    /// Of a wavelength.
    Wavelength(Nanometre),
    /// Of a temperature.
    Temperature(Kelvin),
    /// Of a current.
    Current(Milliampere),
}

impl SensorUncertainty {
    /// What the sensor reads.
    #[must_use]
    pub const fn quantity(self) -> Quantity {
        match self {
            Self::Wavelength(_) => Quantity::Wavelength,
            Self::Temperature(_) => Quantity::Temperature,
            Self::Current(_) => Quantity::Current,
        }
    }

    /// The number, in the unit of [`SensorUncertainty::quantity`].
    #[must_use]
    pub const fn number(self) -> f64 {
        match self {
            Self::Wavelength(u) => u.0,
            Self::Temperature(u) => u.0,
            Self::Current(u) => u.0,
        }
    }
}

impl Read for SensorUncertainty {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        let is = |dimension| matches!(&node.value, Value::Text(t) if parse(t, dimension).is_ok());
        let u = if is(&TEMPERATURE_DIFFERENCE) {
            quantity_of(node, &TEMPERATURE_DIFFERENCE, reader).map(|n| Self::Temperature(Kelvin(n)))
        } else if is(&CURRENT) {
            quantity_of(node, &CURRENT, reader).map(|n| Self::Current(Milliampere(n)))
        } else {
            quantity_of(node, &WAVELENGTH, reader).map(|n| Self::Wavelength(Nanometre(n)))
        }?;
        if u.number() <= 0.0 {
            reader.fault(node.mark, format!("`u` must be above zero, found {}", node.describe()));
        }
        Some(u)
    }

    fn schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "string", "examples": ["0.02 nm", "0.1 K", "0.5 mA"] })
    }
}

record! {
    /// A camera that takes single pictures.
    pub struct Camera {
        /// Which driver speaks to it; `simulated` where none does.
        driver: At<String>,
        /// Where the driver finds it: `folder:pictures/left`, `device:usb:001,002`, `simulator:tcp`.
        address: Option<At<String>>,
        /// How long an answer over its line may take; without it 1 s.
        deadline: Option<Second> => positive,
        /// What this driver alone needs to know.
        options: Option<Options>,
        /// Its interior orientation: a ROS `camera_info` file, relative to the rig's.
        calibration: At<String>,
        /// Standard uncertainty of the interior orientation.
        interior_u: Option<InteriorU>,
        /// The distance of the sensor's pixels.
        pixel_pitch: Millimetre => positive,
        /// How long it exposes.
        exposure: Option<Second> => positive,
        /// How long until a picture is here.
        delivery: Option<Second> => not_negative,
        /// How big a picture is, about.
        picture_size: Option<Byte> => positive,
    }
}

record! {
    /// Standard uncertainty of an interior orientation, on the sensor.
    pub struct InteriorU {
        /// Of the focal length.
        focal: Millimetre => not_negative,
        /// Of the principal point, in x and y.
        principal_point: [Millimetre; 2] => not_negative,
    }
}
