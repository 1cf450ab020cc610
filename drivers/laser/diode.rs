//! What drivers of laser diodes have in common whose controller holds the temperature.

use beampose_core::InstrumentError;

use crate::options::{OptionSpec, Options, Value};

pub(crate) const LIMIT_CURRENT: OptionSpec = OptionSpec {
    name: "limit_current",
    about: "the most that the diode may ever get, in mA: programmed as the hardware limit",
    default: None,
    example: Value::Number(120.0),
};

pub(crate) const TEMPERATURE_CONTROL: OptionSpec = OptionSpec {
    name: "temperature_control",
    about: "whether the controller holds the diode's temperature; without it light is given at any \
            temperature",
    default: Some(Value::Switch(true)),
    example: Value::Switch(true),
};

pub(crate) const TEMPERATURE_TOLERANCE: OptionSpec = OptionSpec {
    name: "temperature_tolerance",
    about: "how far from its set point the diode's temperature may be for light, in K",
    default: Some(Value::Number(0.5)),
    example: Value::Number(0.5),
};

/// Why there is no light while the temperature is left to itself.
pub(crate) const CONTROL_IS_OFF: &str =
    "its temperature control is off; switch it on and let it settle";

/// How far the diode's temperature may be from its set point, K.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tolerance(f64);

impl Tolerance {
    /// As the options say; `None` where the temperature is not controlled.
    ///
    /// # Errors
    /// [`InstrumentError::Refused`] where it is not above zero.
    pub(crate) fn of(options: &Options) -> Result<Option<Self>, InstrumentError> {
        let tolerance = Self(options.positive(TEMPERATURE_TOLERANCE.name)?);
        Ok(options.switch(TEMPERATURE_CONTROL.name)?.then_some(tolerance))
    }

    /// What is against light at this temperature, degrees Celsius both.
    pub(crate) fn objection(self, set: f64, read: f64) -> Option<String> {
        let Self(tolerance) = self;
        // What is no number is not near.
        let is_near = (set - read).abs() <= tolerance;
        (!is_near).then(|| {
            format!(
                "its diode has {read} degC, more than {tolerance} K from its set point of {set} degC"
            )
        })
    }
}
