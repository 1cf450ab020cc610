//! The temperature of the diode that an LDC500 holds.

use std::sync::Arc;

use async_trait::async_trait;
use beampose_core::{Identity, Instrument, InstrumentError, Quantity, Reading, Sensor};

use super::driver::Interface;
use super::protocol;
use crate::registry::{Connected, Role, Setting};
use crate::transport::Talk;

/// No diode is colder or hotter: then its sensor is open, shorted or another one, degrees Celsius.
const POSSIBLE: std::ops::RangeInclusive<f64> = -60.0..=150.0;

/// Reads the temperature sensor of an LDC500.
pub struct DiodeTemperature {
    interface: Interface,
    u: Option<f64>,
}

pub(super) fn connect(setting: Setting) -> Result<Connected, InstrumentError> {
    let Role::Sensor { quantity: Quantity::Temperature, u } = setting.role else {
        let why = format!("{} reads a temperature and nothing else", setting.name);
        return Err(InstrumentError::Refused(why));
    };
    Ok(Connected::Sensor(Arc::new(DiodeTemperature { interface: Interface::new(&setting)?, u })))
}

impl DiodeTemperature {
    /// Opens the session where it is new. The laser beside is not touched.
    async fn talk(&self) -> Result<Talk<'_>, InstrumentError> {
        let mut talk = self.interface.talk().await?;
        if talk.is_new() {
            self.interface.open(&mut talk).await?;
            talk.is_set_up();
        }
        Ok(talk)
    }
}

#[async_trait]
impl Instrument for DiodeTemperature {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        drop(self.talk().await?);
        self.interface.identify().await
    }
}

#[async_trait]
impl Sensor for DiodeTemperature {
    async fn read(&self) -> Result<Reading, InstrumentError> {
        let mut talk = self.talk().await?;
        let text = self.interface.asked(&mut talk, "TTRD").await?;
        let at = self.interface.clock.now();
        match protocol::number(&text) {
            Some(value) if POSSIBLE.contains(&value) => {
                let quantity = Quantity::Temperature;
                Ok(Reading { quantity, value, standard_uncertainty: self.u, at })
            }
            _ => {
                talk.is_lost();
                let expected = "a diode's temperature (is its sensor connected?)".to_owned();
                Err(InstrumentError::Garbled { expected, found: text })
            }
        }
    }
}
