//! What drivers of axes have in common: what the rig file says of the travel, and what they say of it.

use beampose_core::instrument::AxisUnit;
use beampose_core::{Clock, InstrumentError, Quantity, Reading};

use crate::registry::{Role, Setting};

/// Why a stage that lost its reference is not moved.
pub(crate) const NOT_HOMED: &str =
    "it has not been homed since it was switched on: `beampose rig jog` with --home";

/// The travel of an axis.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Travel {
    pub(crate) unit: AxisUnit,
    /// Soft limits, in the unit.
    limits: [f64; 2],
    /// Units per second.
    pub(crate) speed: f64,
}

impl Travel {
    /// As the rig file says it.
    ///
    /// # Errors
    /// [`InstrumentError::Refused`] where the instrument is no axis.
    pub(crate) fn of(setting: &Setting) -> Result<Self, InstrumentError> {
        match setting.role {
            Role::Axis { unit, limits, speed } => Ok(Self { unit, limits, speed }),
            _ => Err(InstrumentError::Refused(format!("{} is no axis", setting.name))),
        }
    }

    /// The same, of something that only measures lengths.
    ///
    /// # Errors
    /// [`InstrumentError::Refused`] where the instrument is no rail.
    pub(crate) fn of_rail(setting: &Setting) -> Result<Self, InstrumentError> {
        let travel = Self::of(setting)?;
        if travel.unit == AxisUnit::Millimetre {
            return Ok(travel);
        }
        Err(InstrumentError::Refused(format!("{} is no rail", setting.name)))
    }

    /// The unit as people write it.
    pub(crate) const fn symbol(&self) -> &'static str {
        match self.unit {
            AxisUnit::Millimetre => "mm",
            AxisUnit::Degree => "deg",
        }
    }

    /// Whether a target is within its limits. All that `move_to` of an axis does that a person
    /// moves: nothing is sent, and the engine asks the person.
    ///
    /// # Errors
    /// [`InstrumentError::Refused`] with both limits.
    pub(crate) fn reaches(&self, target: f64) -> Result<(), InstrumentError> {
        let ([low, high], unit) = (self.limits, self.symbol());
        if (low..=high).contains(&target) {
            return Ok(());
        }
        Err(InstrumentError::Refused(format!("{target} {unit} is outside {low} to {high} {unit}")))
    }

    /// Where it stands now, in the unit.
    pub(crate) fn reading(&self, value: f64, clock: &dyn Clock) -> Reading {
        let quantity = match self.unit {
            AxisUnit::Millimetre => Quantity::Position,
            AxisUnit::Degree => Quantity::Angle,
        };
        Reading { quantity, value, standard_uncertainty: None, at: clock.now() }
    }
}
