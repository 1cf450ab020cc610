//! A hand-moved rail with an OptoRS readout.

use std::sync::Arc;

use async_trait::async_trait;
use beampose_core::instrument::AxisUnit;
use beampose_core::{Axis, Clock, Identity, Instrument, InstrumentError, Reading};

use super::protocol::{self, Message, Unit};
use crate::axis::Travel;
use crate::registry::{Connected, Setting};
use crate::transport::{Party, Talk};

/// More lines than this before the answer: somebody leans on PRINT, or it sends by itself.
const MOST_ASIDES: usize = 20;

/// A readout.
pub struct Sylvac {
    line: Party,
    clock: Arc<dyn Clock>,
    travel: Travel,
    simulated: bool,
}

pub(super) fn connect(setting: Setting) -> Result<Connected, InstrumentError> {
    Ok(Connected::Axis(Arc::new(Sylvac {
        line: setting.line()?,
        travel: Travel::of_rail(&setting)?,
        simulated: setting.simulated,
        clock: setting.clock,
    })))
}

fn garbled(expected: &str, found: &str) -> InstrumentError {
    InstrumentError::Garbled { expected: expected.to_owned(), found: found.to_owned() }
}

impl Sylvac {
    async fn ask(&self, talk: &mut Talk<'_>, words: &str) -> Result<String, InstrumentError> {
        talk.send(format!("{words}\r").as_bytes()).await?;
        self.next(talk).await
    }

    async fn next(&self, talk: &mut Talk<'_>) -> Result<String, InstrumentError> {
        let line = talk.until(b'\r').await?;
        Ok(String::from_utf8_lossy(&line).trim_matches(['\r', '\n', '\0']).to_owned())
    }

    /// A value, then its unit. Answers come in the order of the questions: whatever values came
    /// unasked, the last one before the unit is as late as the answer or later.
    async fn measure(&self, talk: &mut Talk<'_>) -> Result<f64, InstrumentError> {
        let mut line = self.ask(talk, "?").await?;
        let mut value: Option<(f64, Option<Unit>)> = None;
        let mut asked_unit = false;
        for _ in 0..MOST_ASIDES {
            match protocol::message(&line) {
                Some(Message::Value(number, its_unit)) => value = Some((number, its_unit)),
                Some(Message::Unit(unit)) if asked_unit => {
                    let none = || garbled("a position before its unit", &line);
                    let (number, its_unit) = value.ok_or_else(none)?;
                    return Ok(its_unit.unwrap_or(unit).millimetres(number));
                }
                // Of a question whose time was over.
                Some(Message::Unit(_)) => {}
                Some(Message::Error(number)) => return Err(refusal(number)),
                Some(Message::Overflow) => {
                    let why = "the position has more digits than it can show".to_owned();
                    return Err(InstrumentError::Refused(why));
                }
                None => return Err(garbled("a position as `   123.456`", &line)),
            }
            line = if asked_unit || value.is_none() {
                self.next(talk).await?
            } else {
                asked_unit = true;
                self.ask(talk, "UNI?").await?
            };
        }
        Err(garbled("the answer to UNI?", &format!("{MOST_ASIDES} other lines")))
    }
}

fn refusal(number: u8) -> InstrumentError {
    let why = format!("ERR{number}: {}", protocol::error(number));
    if number == 0 { InstrumentError::Fault(why) } else { InstrumentError::Refused(why) }
}

#[async_trait]
impl Instrument for Sylvac {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        let mut talk = self.line.talk().await?;
        let mut line = self.ask(&mut talk, "ID?").await?;
        // What PRINT sent before is passed over.
        for _ in 0..MOST_ASIDES {
            match protocol::message(&line) {
                None if line.contains(|c: char| c.is_ascii_alphabetic()) => {
                    let model = line.trim().to_owned();
                    return Ok(Identity { model, serial: None, simulated: self.simulated });
                }
                Some(Message::Error(number)) => return Err(refusal(number)),
                _ => line = self.next(&mut talk).await?,
            }
        }
        talk.is_lost();
        Err(garbled("a name as `SYLVAC - TRIMOS V600`", &line))
    }
}

#[async_trait]
impl Axis for Sylvac {
    async fn move_to(&self, target: f64) -> Result<(), InstrumentError> {
        self.travel.reaches(target)
    }

    async fn position(&self) -> Result<Reading, InstrumentError> {
        let mut talk = self.line.talk().await?;
        let measured = self.measure(&mut talk).await;
        if measured.is_err() {
            talk.is_lost();
        }
        talk.is_set_up();
        Ok(self.travel.reading(measured?, &*self.clock))
    }

    async fn stop(&self) -> Result<(), InstrumentError> {
        // No motor: there is nothing to stop.
        Ok(())
    }

    fn unit(&self) -> AxisUnit {
        self.travel.unit
    }
}
