//! Whether the rig's sensors read what the plan's analysis takes them for.

use beampose_core::{InstrumentName, Quantity};

use crate::expand::Expander;
use crate::fault::At;
use crate::plan::Analyse;
use crate::rig::instruments::{Instrument, Sensor};
use crate::suggest;

/// What an analysis takes a sensor for.
#[derive(Clone, Copy)]
enum Role {
    Wavelength,
    DiodeTemperature,
    RoomTemperature,
}

impl Role {
    const fn quantity(self) -> Quantity {
        match self {
            Self::Wavelength => Quantity::Wavelength,
            Self::DiodeTemperature | Self::RoomTemperature => Quantity::Temperature,
        }
    }

    /// Whether a sensor can be in this role.
    fn fits(self, sensor: &Sensor) -> bool {
        let of = match self {
            Self::Wavelength => true,
            Self::DiodeTemperature => sensor.of.is_some(),
            Self::RoomTemperature => sensor.of.is_none(),
        };
        sensor.reads == self.quantity() && of
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Wavelength => "a wavelength",
            Self::DiodeTemperature => "the temperature of a laser",
            Self::RoomTemperature => "the temperature of the room",
        }
    }
}

/// What a sensor reads, in words.
fn reads(sensor: &Sensor) -> String {
    let name = sensor.reads.name();
    match (&sensor.of, sensor.reads) {
        (Some(of), _) => format!("the {name} of `{}`", of.value),
        (None, Quantity::Temperature) => "the temperature of the room".to_owned(),
        (None, _) => format!("a {name}"),
    }
}

impl Expander<'_> {
    /// Notes each sensor of the analysis that the rig does not have, or that reads something else.
    pub(crate) fn check_analysis(&mut self) {
        let plan = self.plan;
        let drift = match &plan.analyse {
            Some(Analyse::WavelengthDrift(drift)) => drift,
            Some(Analyse::BeamAngles { wavelength: Some(sensor) }) => {
                self.check_role(sensor, Role::Wavelength);
                return;
            }
            _ => return,
        };
        self.check_role(&drift.wavelength, Role::Wavelength);
        if let Some(sensor) = &drift.diode_temperature {
            self.check_role(sensor, Role::DiodeTemperature);
        }
        if let Some(sensor) = &drift.room_temperature {
            self.check_role(sensor, Role::RoomTemperature);
        }
    }

    fn check_role(&mut self, name: &At<InstrumentName>, role: Role) {
        if self.expect_kind(name, &["sensor"]).is_none() {
            return;
        }
        let Some(Instrument::Sensor(sensor)) = self.rig.instruments.get(&name.value) else {
            return;
        };
        if role.fits(sensor) {
            return;
        }
        let found = format!("found `{}`, which reads {}", name.value, reads(sensor));
        let message = format!("expected a sensor of {}, {found}", role.name());
        let fitting = self.rig.sensors().filter(|(_, sensor)| role.fits(sensor));
        let fitting: Vec<&str> = fitting.map(|(name, _)| name.as_str()).collect();
        let help = if fitting.is_empty() && matches!(role, Role::DiodeTemperature) {
            Some("in the rig, such a sensor says `of: laser`".to_owned())
        } else {
            suggest::help(name.value.as_str(), fitting)
        };
        self.complain(name.mark, message, help);
    }
}
