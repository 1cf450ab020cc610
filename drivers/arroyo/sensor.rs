//! The temperature of the diode that a ComboSource holds.

use std::sync::Arc;

use async_trait::async_trait;
use beampose_core::{Identity, Instrument, InstrumentError, Quantity, Reading, Sensor};

use super::driver::Interface;
use super::protocol;
use crate::registry::{Connected, Role, Setting};
use crate::transport::Talk;

/// Reads the temperature sensor of a 6300.
pub struct ArroyoTemperature {
    interface: Interface,
    u: Option<f64>,
}

pub(super) fn connect(setting: Setting) -> Result<Connected, InstrumentError> {
    let Role::Sensor { quantity: Quantity::Temperature, u } = setting.role else {
        let why = format!("{} reads a temperature and nothing else", setting.name);
        return Err(InstrumentError::Refused(why));
    };
    Ok(Connected::Sensor(Arc::new(ArroyoTemperature { interface: Interface::new(&setting)?, u })))
}

impl ArroyoTemperature {
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
impl Instrument for ArroyoTemperature {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        drop(self.talk().await?);
        self.interface.identify().await
    }
}

#[async_trait]
impl Sensor for ArroyoTemperature {
    async fn read(&self) -> Result<Reading, InstrumentError> {
        let mut talk = self.talk().await?;
        // TEC:T? is what is measured; the set point is TEC:SET:T?.
        let value = self.interface.read(&mut talk, "TEC:T?", protocol::number).await?;
        let at = self.interface.clock.now();
        let condition = self.interface.read(&mut talk, "TEC:COND?", protocol::whole).await?;
        if condition & protocol::NO_SENSOR != 0 {
            let why = "no temperature: the sensor is open, shorted or out of its range".to_owned();
            return Err(InstrumentError::Fault(why));
        }
        let quantity = Quantity::Temperature;
        Ok(Reading { quantity, value, standard_uncertainty: self.u, at })
    }
}
