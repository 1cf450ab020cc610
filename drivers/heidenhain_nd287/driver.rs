//! A hand-moved rail with an ND 287 display.

use std::sync::Arc;

use async_trait::async_trait;
use beampose_core::instrument::AxisUnit;
use beampose_core::{Axis, Clock, Identity, Instrument, InstrumentError, Reading};

use super::protocol;
use crate::axis::Travel;
use crate::registry::{Connected, Setting};
use crate::transport::{Party, Talk};

/// A display.
pub struct Nd287 {
    line: Party,
    clock: Arc<dyn Clock>,
    travel: Travel,
    simulated: bool,
}

pub(super) fn connect(setting: Setting) -> Result<Connected, InstrumentError> {
    Ok(Connected::Axis(Arc::new(Nd287 {
        line: setting.line()?,
        travel: Travel::of_rail(&setting)?,
        simulated: setting.simulated,
        clock: setting.clock,
    })))
}

fn garbled(expected: &str, found: &str) -> InstrumentError {
    InstrumentError::Garbled { expected: expected.to_owned(), found: found.to_owned() }
}

/// One question and the first line of its answer; `None` where it says that it is invalid.
async fn ask(talk: &mut Talk<'_>, command: &[u8]) -> Result<Option<String>, InstrumentError> {
    talk.send(command).await?;
    match talk.exactly(1).await?[..] {
        [protocol::STX] => line(talk).await.map(Some),
        [protocol::NAK] => Ok(None),
        ref other => {
            talk.is_lost();
            Err(garbled("STX, then the contents of the screen", &format!("{other:02x?}")))
        }
    }
}

async fn line(talk: &mut Talk<'_>) -> Result<String, InstrumentError> {
    let line = talk.until(b'\n').await?;
    Ok(String::from_utf8_lossy(&line).trim().to_owned())
}

/// As [`ask`], where a refusal is an error: the one that it displays, if it displays one.
async fn text(talk: &mut Talk<'_>, command: &[u8]) -> Result<String, InstrumentError> {
    if let Some(text) = ask(talk, command).await? {
        return Ok(text);
    }
    match ask(talk, protocol::ERROR).await {
        Ok(Some(words)) => Err(InstrumentError::Fault(format!("it displays: {words}"))),
        _ => Err(InstrumentError::Refused("it says that the command is invalid".to_owned())),
    }
}

/// How many millimetres the unit that it shows has.
async fn unit(talk: &mut Talk<'_>) -> Result<f64, InstrumentError> {
    let status = text(talk, protocol::STATUS).await?;
    protocol::millimetres(&status).map_err(|why| match why {
        Some(why) => InstrumentError::Refused(why.to_owned()),
        None => {
            talk.is_lost();
            garbled("a status bar of eight digits", &status)
        }
    })
}

#[async_trait]
impl Instrument for Nd287 {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        let mut talk = self.line.talk().await?;
        let name = text(&mut talk, protocol::IDENTITY).await?;
        let (software, version) = (line(&mut talk).await?, line(&mut talk).await?);
        if !name.starts_with("ND") {
            talk.is_lost();
            return Err(garbled("a name as ND-287", &name));
        }
        let model = format!("Heidenhain {name}, software {software} {version}");
        Ok(Identity { model, serial: None, simulated: self.simulated })
    }
}

#[async_trait]
impl Axis for Nd287 {
    async fn move_to(&self, target: f64) -> Result<(), InstrumentError> {
        self.travel.reaches(target)
    }

    async fn position(&self) -> Result<Reading, InstrumentError> {
        let mut talk = self.line.talk().await?;
        let before = unit(&mut talk).await?;
        let shown = text(&mut talk, protocol::POSITION).await?;
        let after = unit(&mut talk).await?;
        if before.to_bits() != after.to_bits() {
            let why = "its unit was changed while it was read; read again";
            return Err(InstrumentError::Refused(why.to_owned()));
        }
        let Some(value) = protocol::position(&shown) else {
            talk.is_lost();
            return Err(garbled("a position as -12345.6789", &shown));
        };
        Ok(self.travel.reading(value * before, &*self.clock))
    }

    async fn stop(&self) -> Result<(), InstrumentError> {
        // No motor: there is nothing to stop.
        Ok(())
    }

    fn unit(&self) -> AxisUnit {
        self.travel.unit
    }
}
