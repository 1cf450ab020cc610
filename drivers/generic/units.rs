//! Units of the numbers that instruments answer with, as units of the quantities.

use beampose_core::Quantity;

/// Speed of light, nm times THz.
const LIGHT_NM_THZ: f64 = 299_792.458;

/// How a number becomes a reading.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Scale {
    /// `factor * x + offset`.
    Linear(f64, f64),
    /// `numerator / x`: a frequency.
    Inverse(f64),
}

/// Unit, what it measures, and how it becomes that quantity's own unit.
const UNITS: &[(&str, Quantity, Scale)] = &[
    ("nm", Quantity::Wavelength, Scale::Linear(1.0, 0.0)),
    ("um", Quantity::Wavelength, Scale::Linear(1e3, 0.0)),
    ("pm", Quantity::Wavelength, Scale::Linear(1e-3, 0.0)),
    ("THz", Quantity::Wavelength, Scale::Inverse(LIGHT_NM_THZ)),
    ("mm", Quantity::Position, Scale::Linear(1.0, 0.0)),
    ("um", Quantity::Position, Scale::Linear(1e-3, 0.0)),
    ("cm", Quantity::Position, Scale::Linear(10.0, 0.0)),
    ("m", Quantity::Position, Scale::Linear(1e3, 0.0)),
    ("in", Quantity::Position, Scale::Linear(25.4, 0.0)),
    ("deg", Quantity::Angle, Scale::Linear(1.0, 0.0)),
    ("rad", Quantity::Angle, Scale::Linear(180.0 / std::f64::consts::PI, 0.0)),
    ("mrad", Quantity::Angle, Scale::Linear(0.18 / std::f64::consts::PI, 0.0)),
    ("C", Quantity::Temperature, Scale::Linear(1.0, 0.0)),
    ("K", Quantity::Temperature, Scale::Linear(1.0, -273.15)),
    ("F", Quantity::Temperature, Scale::Linear(5.0 / 9.0, -160.0 / 9.0)),
    ("mA", Quantity::Current, Scale::Linear(1.0, 0.0)),
    ("A", Quantity::Current, Scale::Linear(1e3, 0.0)),
    ("uA", Quantity::Current, Scale::Linear(1e-3, 0.0)),
];

/// A unit of a quantity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Unit(Scale);

impl Unit {
    /// The unit of that name.
    ///
    /// # Errors
    /// Which units the quantity has.
    pub(super) fn named(name: &str, quantity: Quantity) -> Result<Self, String> {
        let of_it = || UNITS.iter().filter(|(_, of, _)| *of == quantity);
        let found = of_it().find(|(unit, ..)| *unit == name).map(|(.., scale)| Self(*scale));
        found.ok_or_else(|| {
            let known: Vec<&str> = of_it().map(|(unit, ..)| *unit).collect();
            let what = quantity.name();
            format!("{name:?} is no unit of a {what}; known are {}", known.join(", "))
        })
    }

    /// A number in this unit, in the quantity's own.
    pub(super) fn reading(self, number: f64) -> f64 {
        match self.0 {
            Scale::Linear(factor, offset) => factor * number + offset,
            Scale::Inverse(numerator) => numerator / number,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_become_the_quantitys_own_unit() {
        for (unit, quantity, number, reading) in [
            ("F", Quantity::Temperature, 212.0, 100.0),
            ("K", Quantity::Temperature, 273.15, 0.0),
            ("um", Quantity::Wavelength, 0.658, 658.0),
            ("um", Quantity::Position, 658.0, 0.658),
            ("in", Quantity::Position, 1.0, 25.4),
            ("mrad", Quantity::Angle, 1000.0 * std::f64::consts::PI, 180.0),
            ("A", Quantity::Current, 0.06, 60.0),
            // The helium-neon line in vacuum (BIPM).
            ("THz", Quantity::Wavelength, 473.612_353_604, 632.991_212_58),
        ] {
            let found = Unit::named(unit, quantity).unwrap().reading(number);
            assert!((found - reading).abs() < 1e-8 * reading.abs().max(1.0), "{unit}: {found}");
        }
        let error = Unit::named("C", Quantity::Current).unwrap_err();
        assert!(error.contains("mA, A, uA"), "{error}");
    }
}
