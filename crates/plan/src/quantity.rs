//! Quantities as people write them: a number and its unit, `100 mm`, `2 deg`, `658 nm`.
//!
//! The unit is part of the text, never implied. Which units a place takes depends on the kind of
//! quantity that belongs there: `nm` is a unit of wavelengths, not of lengths.
//! To add a unit: one entry in its `Dimension`; to add a kind: a `Dimension` and a `quantity!`.

use std::fmt;

use beampose_core::instrument::AxisUnit;
use beampose_core::units::{Celsius, Degree, Milliampere, Millimetre, Nanometre, Second};
use serde::Serialize;

/// A kind of quantity and its units.
#[derive(Debug, PartialEq)]
pub(crate) struct Dimension {
    /// As in "expected a length".
    pub article_name: &'static str,
    /// What to write.
    pub example: &'static str,
    /// Symbols, and how many of the stored unit one of them is.
    pub units: &'static [(&'static str, f64)],
}

const fn dimension(
    article_name: &'static str,
    example: &'static str,
    units: &'static [(&'static str, f64)],
) -> Dimension {
    Dimension { article_name, example, units }
}

const MINUTE: f64 = 60.0;

pub(crate) static LENGTH: Dimension =
    dimension("a length", "100 mm", &[("mm", 1.0), ("um", 1e-3), ("cm", 10.0), ("m", 1e3)]);
pub(crate) static ANGLE: Dimension = dimension(
    "an angle",
    "2 deg",
    &[("deg", 1.0), ("rad", 180.0 / std::f64::consts::PI), ("mrad", 0.18 / std::f64::consts::PI)],
);
pub(crate) static TIME: Dimension = dimension(
    "a time",
    "0.5 s",
    &[("s", 1.0), ("ms", 1e-3), ("min", MINUTE), ("h", 60.0 * MINUTE)],
);
pub(crate) static WAVELENGTH: Dimension =
    dimension("a wavelength", "658 nm", &[("nm", 1.0), ("pm", 1e-3), ("um", 1e3)]);
pub(crate) static TEMPERATURE: Dimension = dimension("a temperature", "25 degC", &[("degC", 1.0)]);
pub(crate) static TEMPERATURE_DIFFERENCE: Dimension =
    dimension("a temperature difference", "1.4 K", &[("K", 1.0), ("mK", 1e-3), ("degC", 1.0)]);
pub(crate) static CURRENT: Dimension = dimension("a current", "40 mA", &[("mA", 1.0), ("A", 1e3)]);
pub(crate) static SPEED: Dimension =
    dimension("a speed", "50 mm/s", &[("mm/s", 1.0), ("m/s", 1e3)]);
pub(crate) static ANGULAR_SPEED: Dimension =
    dimension("a speed of rotation", "10 deg/s", &[("deg/s", 1.0)]);
pub(crate) static DATA: Dimension =
    dimension("an amount of data", "3 MB", &[("B", 1.0), ("kB", 1e3), ("MB", 1e6), ("GB", 1e9)]);
pub(crate) static PIXELS: Dimension = dimension("a number of pixels", "1.5 px", &[("px", 1.0)]);

/// In this order a unit alone is understood, when nothing says which kind it should be.
static ALL: [&Dimension; 11] = [
    &LENGTH,
    &ANGLE,
    &TIME,
    &WAVELENGTH,
    &TEMPERATURE,
    &TEMPERATURE_DIFFERENCE,
    &CURRENT,
    &SPEED,
    &ANGULAR_SPEED,
    &DATA,
    &PIXELS,
];

macro_rules! unit {
    ($(#[$doc:meta])* $name:ident, $symbol:literal) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default, Serialize)]
        #[serde(transparent)]
        pub struct $name(pub f64);

        impl $name {
            /// The bare number in this unit.
            #[must_use]
            pub const fn get(self) -> f64 {
                self.0
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{} {}", self.0, $symbol)
            }
        }
    };
}

unit!(
    /// A difference of temperatures, in kelvin.
    Kelvin, "K"
);
unit!(
    /// A speed in millimetres per second.
    MillimetrePerSecond, "mm/s"
);
unit!(
    /// A speed of rotation in degrees per second.
    DegreePerSecond, "deg/s"
);
unit!(
    /// An amount of data in bytes.
    Byte, "B"
);
unit!(
    /// A distance in a picture, in pixels.
    Pixel, "px"
);

/// A type of `core` or of this room that is written as a number with a unit.
pub(crate) trait Quantity: Sized {
    const DIMENSION: &'static Dimension;
    /// From the number in the stored unit.
    fn from_number(number: f64) -> Self;
    /// The number in the stored unit.
    fn number(&self) -> f64;
}

macro_rules! quantity {
    ($($name:ident in $dimension:ident),* $(,)?) => {$(
        impl Quantity for $name {
            const DIMENSION: &'static Dimension = &$dimension;

            fn from_number(number: f64) -> Self {
                Self(number)
            }

            fn number(&self) -> f64 {
                self.0
            }
        }
    )*};
}

quantity!(
    Millimetre in LENGTH,
    Degree in ANGLE,
    Second in TIME,
    Nanometre in WAVELENGTH,
    Celsius in TEMPERATURE,
    Milliampere in CURRENT,
    Kelvin in TEMPERATURE_DIFFERENCE,
    MillimetrePerSecond in SPEED,
    DegreePerSecond in ANGULAR_SPEED,
    Byte in DATA,
    Pixel in PIXELS,
);

/// A place along or about an axis: the unit says which.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum AxisPosition {
    /// Along a linear axis.
    Length(Millimetre),
    /// About a rotary axis.
    Angle(Degree),
}

impl AxisPosition {
    /// The position as a number in [`AxisPosition::unit`].
    #[must_use]
    pub const fn number(self) -> f64 {
        match self {
            Self::Length(length) => length.0,
            Self::Angle(angle) => angle.0,
        }
    }

    /// The unit of that number.
    #[must_use]
    pub const fn unit(self) -> AxisUnit {
        match self {
            Self::Length(_) => AxisUnit::Millimetre,
            Self::Angle(_) => AxisUnit::Degree,
        }
    }

    /// A position of the same kind at another number.
    #[must_use]
    pub const fn at(self, number: f64) -> Self {
        match self {
            Self::Length(_) => Self::Length(Millimetre(number)),
            Self::Angle(_) => Self::Angle(Degree(number)),
        }
    }
}

impl fmt::Display for AxisPosition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Length(length) => length.fmt(f),
            Self::Angle(angle) => angle.fmt(f),
        }
    }
}

/// Why a text is not the quantity that belongs there.
#[derive(Debug, PartialEq)]
pub(crate) enum NotThat {
    /// It begins with no number.
    NoNumber,
    /// The number has no unit.
    NoUnit(f64),
    /// Nobody knows that unit.
    UnknownUnit(String),
    /// The unit belongs to another kind of quantity.
    Other(&'static Dimension),
}

/// The number in the stored unit of `dimension`.
pub(crate) fn parse(text: &str, dimension: &Dimension) -> Result<f64, NotThat> {
    let (number, symbol) = split(text)?;
    if let Some(factor) = factor(dimension, &symbol) {
        return Ok(scaled(number, factor));
    }
    let other = ALL.iter().find(|other| factor(other, &symbol).is_some());
    Err(other.map_or(NotThat::UnknownUnit(symbol), |other| NotThat::Other(other)))
}

/// Whether a text is a quantity of any kind.
pub(crate) fn is_quantity(text: &str) -> bool {
    split(text).is_ok_and(|(_, symbol)| ALL.iter().any(|d| factor(d, &symbol).is_some()))
}

/// `1.6 um` is 0.0016 mm, not 0.0016000000000000001: small units divide.
fn scaled(number: f64, factor: f64) -> f64 {
    if factor < 1.0 { number / (1.0 / factor).round() } else { number * factor }
}

fn factor(dimension: &Dimension, symbol: &str) -> Option<f64> {
    dimension.units.iter().find(|(known, _)| *known == symbol).map(|(_, factor)| *factor)
}

fn split(text: &str) -> Result<(f64, String), NotThat> {
    let text = text.trim();
    let end = text.rfind(|c: char| c.is_ascii_digit() || c == '.').map_or(0, |i| i + 1);
    let (number, symbol) = text.split_at(end);
    let number: f64 = number.parse().map_err(|_| NotThat::NoNumber)?;
    if !number.is_finite() {
        return Err(NotThat::NoNumber);
    }
    // Both micro signs, and the degree sign, as keyboards offer them.
    let symbol = symbol.trim().replace(['\u{b5}', '\u{3bc}'], "u").replace("°C", "degC");
    let symbol = symbol.replace('°', "deg");
    if symbol.is_empty() { Err(NotThat::NoUnit(number)) } else { Ok((number, symbol)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_and_a_unit_are_a_quantity() {
        assert_eq!(parse("100 mm", &LENGTH), Ok(100.0));
        assert_eq!(parse("0.9m", &LENGTH), Ok(900.0));
        assert_eq!(parse("1.6 um", &LENGTH), Ok(0.0016));
        assert_eq!(parse("-1e-3 µm", &LENGTH), Ok(-1e-6));
        assert_eq!(parse("1.2 min", &TIME), Ok(72.0));
        assert_eq!(parse("24 °C", &TEMPERATURE), Ok(24.0));
        assert_eq!(parse("50 mm/s", &SPEED), Ok(50.0));
    }

    #[test]
    fn what_is_not_the_quantity_says_why() {
        assert_eq!(parse("100", &LENGTH), Err(NotThat::NoUnit(100.0)));
        assert_eq!(parse("2 s", &LENGTH), Err(NotThat::Other(&TIME)));
        assert_eq!(parse("2 furlong", &LENGTH), Err(NotThat::UnknownUnit("furlong".into())));
        assert_eq!(parse("mm", &LENGTH), Err(NotThat::NoNumber));
        assert_eq!(parse("1e999 mm", &LENGTH), Err(NotThat::NoNumber));
        assert_eq!(parse("nan mm", &LENGTH), Err(NotThat::NoNumber));
    }
}
