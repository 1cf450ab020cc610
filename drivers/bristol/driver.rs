//! A Bristol wavelength meter.

use std::sync::Arc;
use std::time::Duration;

use async_trait::async_trait;
use beampose_core::{Clock, Identity, Instrument, InstrumentError, Quantity, Reading, Sensor};

use super::protocol::{self, Frequency};
use crate::registry::{Connected, Role, Setting};
use crate::transport::{Party, Talk};

/// So long nothing comes once the banner is over.
const BANNER_QUIET: Duration = Duration::from_millis(200);
/// More lines than this without an answer: somebody else speaks there.
const MOST_ASIDES: usize = 20;

/// A wavelength meter.
pub struct Bristol {
    line: Party,
    clock: Arc<dyn Clock>,
    quiet: Duration,
    u: Option<f64>,
    simulated: bool,
}

pub(super) fn connect(setting: Setting) -> Result<Connected, InstrumentError> {
    let Role::Sensor { quantity: Quantity::Wavelength, u } = setting.role else {
        let why =
            format!("{} is to read something else; a Bristol reads wavelengths", setting.name);
        return Err(InstrumentError::Refused(why));
    };
    Ok(Connected::Sensor(Arc::new(Bristol {
        line: setting.line()?,
        // Whoever wants answers sooner than that also has a line that is quiet sooner.
        quiet: BANNER_QUIET.min(setting.deadline),
        u,
        simulated: setting.simulated,
        clock: setting.clock,
    })))
}

fn garbled(expected: &str, found: &str) -> InstrumentError {
    InstrumentError::Garbled { expected: expected.to_owned(), found: found.to_owned() }
}

impl Bristol {
    async fn turn(&self) -> Result<Talk<'_>, InstrumentError> {
        let mut talk = self.line.talk().await?;
        if talk.is_new() {
            // The telnet server greets, in how many lines depends on the firmware.
            talk.discard(self.quiet).await?;
            let answer = exchange(&mut talk, "*IDN?").await?;
            if protocol::identity(&answer).is_none() {
                talk.is_lost();
                return Err(garbled("BRISTOL WAVELENGTH METER, model, serial, firmware", &answer));
            }
            // Errors of whoever spoke before are not ours.
            talk.send(b"*CLS\r\n").await?;
            talk.is_set_up();
        }
        Ok(talk)
    }

    /// Frequency and what is questionable about it.
    async fn measure(&self) -> Result<(String, String), InstrumentError> {
        let mut talk = self.turn().await?;
        let frequency = exchange(&mut talk, protocol::FREQUENCY).await?;
        let register = exchange(&mut talk, protocol::CONDITION).await?;
        Ok((frequency, register))
    }

    /// A query that it refuses it leaves unanswered: its queue says why.
    async fn why(&self, error: InstrumentError) -> InstrumentError {
        if !matches!(error, InstrumentError::Timeout(_)) {
            return error;
        }
        let asked = async {
            let mut talk = self.turn().await?;
            exchange(&mut talk, protocol::ERROR).await
        };
        match asked.await.ok().as_deref().and_then(protocol::error) {
            Some((number, words)) if number != 0 => {
                InstrumentError::Refused(format!("error {number}: {words}"))
            }
            _ => error,
        }
    }
}

async fn exchange(talk: &mut Talk<'_>, words: &str) -> Result<String, InstrumentError> {
    talk.send(format!("{words}\r\n").as_bytes()).await?;
    for _ in 0..MOST_ASIDES {
        let line = protocol::text(&talk.until(b'\n').await?);
        // Some telnet servers echo.
        if !line.is_empty() && line != words {
            return Ok(line);
        }
    }
    talk.is_lost();
    Err(garbled(&format!("the answer to {words}"), "empty lines"))
}

#[async_trait]
impl Instrument for Bristol {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        let mut talk = self.turn().await?;
        let answer = exchange(&mut talk, "*IDN?").await?;
        let Some((model, serial, firmware)) = protocol::identity(&answer) else {
            talk.is_lost();
            return Err(garbled("BRISTOL WAVELENGTH METER, model, serial, firmware", &answer));
        };
        Ok(Identity {
            model: format!("Bristol {model}, firmware {firmware}"),
            serial: Some(serial),
            simulated: self.simulated,
        })
    }
}

#[async_trait]
impl Sensor for Bristol {
    async fn read(&self) -> Result<Reading, InstrumentError> {
        let (answer, register) = match self.measure().await {
            Ok(both) => both,
            Err(error) => return Err(self.why(error).await),
        };
        let wrong = |found: &str| garbled("the questionable register, a number", found);
        let condition = register.parse::<u32>().map_err(|_| wrong(&register))?;
        if let Some(complaint) = protocol::complaint(condition) {
            return Err(InstrumentError::Refused(format!("no valid wavelength: {complaint}")));
        }
        let value = match protocol::frequency(&answer) {
            // Seven digits of a frequency are 0.1 pm: what stands behind is not the meter's.
            Some(Frequency::Vacuum(nm)) => (nm * 1e6).round() / 1e6,
            Some(Frequency::None) => {
                let why = "no valid wavelength: it measured none; is there light in its fibre?";
                return Err(InstrumentError::Refused(why.to_owned()));
            }
            None => {
                let expected = "a frequency in THz with seven digits or more, as 455.6054321";
                return Err(garbled(expected, &answer));
            }
        };
        Ok(Reading {
            quantity: Quantity::Wavelength,
            value,
            standard_uncertainty: self.u,
            at: self.clock.now(),
        })
    }
}
