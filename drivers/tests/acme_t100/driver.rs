//! A channel of an Acme T100.

use std::sync::Arc;

use async_trait::async_trait;
use beampose_core::{Clock, Identity, Instrument, InstrumentError, Quantity, Reading, Sensor};

use super::protocol::{self, Answer};
use crate::transport::{Party, Talk};
use crate::{Connected, Role, Setting};

struct Thermometer {
    line: Party,
    clock: Arc<dyn Clock>,
    channel: u32,
    u: Option<f64>,
    simulated: bool,
}

/// Checks what the rig file says. Nothing is sent yet: the first call opens the line.
pub(super) fn connect(setting: Setting) -> Result<Connected, InstrumentError> {
    let Role::Sensor { quantity: Quantity::Temperature, u } = setting.role else {
        let why = format!("{} reads a temperature and nothing else", setting.name);
        return Err(InstrumentError::Refused(why));
    };
    Ok(Connected::Sensor(Arc::new(Thermometer {
        line: setting.line()?,
        channel: setting.options.whole("channel", 1, 4)?,
        u,
        simulated: setting.simulated,
        clock: setting.clock,
    })))
}

impl Thermometer {
    /// One question and its answer, on an instrument that is set up.
    async fn ask(&self, words: &str) -> Result<Answer, InstrumentError> {
        let mut talk = self.line.talk().await?;
        if talk.is_new() {
            // The first time, and again after the cable was out: it may be another instrument, or
            // one that was switched off meanwhile.
            exchange(&mut talk, "UNIT C").await?;
            talk.is_set_up();
        }
        exchange(&mut talk, words).await
    }
}

async fn exchange(talk: &mut Talk<'_>, words: &str) -> Result<Answer, InstrumentError> {
    talk.send(&protocol::command(words)).await?;
    let line = talk.until(b'\n').await?;
    match protocol::answer(&line) {
        Some(Answer::Refused(code)) => {
            let why = format!("{words}: {} (ERR {code})", protocol::meaning(code));
            Err(InstrumentError::Refused(why))
        }
        Some(answer) => Ok(answer),
        None => {
            // Whose answer this was is not known: the next question waits until the line is quiet.
            talk.is_lost();
            let found = String::from_utf8_lossy(&line).trim_end().to_owned();
            Err(InstrumentError::Garbled { expected: format!("an answer to {words:?}"), found })
        }
    }
}

fn unexpected(words: &str, answer: &Answer) -> InstrumentError {
    let (expected, found) = (format!("an answer to {words:?}"), format!("{answer:?}"));
    InstrumentError::Garbled { expected, found }
}

#[async_trait]
impl Instrument for Thermometer {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        match self.ask("ID?").await? {
            Answer::Name(model, serial) => Ok(Identity {
                model: format!("Acme {model}"),
                serial: Some(serial),
                simulated: self.simulated,
            }),
            other => Err(unexpected("ID?", &other)),
        }
    }
}

#[async_trait]
impl Sensor for Thermometer {
    async fn read(&self) -> Result<Reading, InstrumentError> {
        let words = format!("T? {}", self.channel);
        match self.ask(&words).await? {
            Answer::Celsius(value) => Ok(Reading {
                quantity: Quantity::Temperature,
                value,
                standard_uncertainty: self.u,
                at: self.clock.now(),
            }),
            Answer::Open => {
                let why = format!("there is no sensor on channel {}", self.channel);
                Err(InstrumentError::Fault(why))
            }
            other => Err(unexpected(&words, &other)),
        }
    }
}
