//! One input of a Lake Shore monitor.

use std::sync::Arc;
use std::time::Duration;

use async_trait::async_trait;
use beampose_core::{Clock, Identity, Instrument, InstrumentError, Quantity, Reading, Sensor};

use super::protocol::{self, Scale};
use crate::registry::{Connected, Role, Setting};
use crate::transport::{Party, Talk};

/// Before each command: it takes 20 in a second, of all inputs together.
const PACE: Duration = Duration::from_millis(50);

/// One input.
pub struct LakeShore {
    line: Party,
    clock: Arc<dyn Clock>,
    channel: String,
    scale: Scale,
    asks_status: bool,
    u: Option<f64>,
    simulated: bool,
}

pub(super) fn connect(setting: Setting) -> Result<Connected, InstrumentError> {
    let refused = |why: String| Err(InstrumentError::Refused(why));
    let Role::Sensor { quantity: Quantity::Temperature, u } = setting.role else {
        return refused(format!("{} is to read no temperature; a Lake Shore does", setting.name));
    };
    let channel = setting.options.text("channel")?.to_ascii_uppercase();
    if !protocol::is_channel(&channel) {
        return refused(format!("option channel must be as 1, A or C3, found {channel:?}"));
    }
    let scale = match setting.options.text("scale")? {
        "celsius" => Scale::Celsius,
        "kelvin" => Scale::Kelvin,
        other => {
            return refused(format!("option scale must be celsius or kelvin, found {other:?}"));
        }
    };
    Ok(Connected::Sensor(Arc::new(LakeShore {
        line: setting.line()?,
        channel,
        scale,
        asks_status: setting.options.switch("status")?,
        u,
        simulated: setting.simulated,
        clock: setting.clock,
    })))
}

fn garbled(expected: &str, found: &str) -> InstrumentError {
    InstrumentError::Garbled { expected: expected.to_owned(), found: found.to_owned() }
}

impl LakeShore {
    async fn turn(&self) -> Result<Talk<'_>, InstrumentError> {
        let mut talk = self.line.talk().await?;
        if talk.is_new() {
            // Half a command of whoever spoke before, and what the register remembers of it.
            self.clock.sleep(PACE).await;
            talk.send(b"\r\n").await?;
            self.clock.sleep(PACE).await;
            talk.send(b"*CLS\r\n").await?;
            talk.is_set_up();
        }
        Ok(talk)
    }

    async fn exchange(&self, talk: &mut Talk<'_>, words: &str) -> Result<String, InstrumentError> {
        self.clock.sleep(PACE).await;
        talk.send(format!("{words}\r\n").as_bytes()).await?;
        let line = talk.until(b'\n').await?;
        Ok(String::from_utf8_lossy(&line).trim().to_owned())
    }

    /// The reading, and what is wrong with it.
    async fn measure(&self) -> Result<(String, Option<String>), InstrumentError> {
        let mut talk = self.turn().await?;
        let words = format!("{} {}", self.scale.command(), self.channel);
        let answer = self.exchange(&mut talk, &words).await?;
        if !self.asks_status {
            return Ok((answer, None));
        }
        let status = self.exchange(&mut talk, &format!("RDGST? {}", self.channel)).await?;
        let Ok(bits) = status.parse::<u16>() else {
            talk.is_lost();
            return Err(garbled("the status of a reading, a number", &status));
        };
        Ok((answer, protocol::complaint(bits)))
    }

    /// A query that it refuses it leaves unanswered: its register says why.
    async fn why(&self, error: InstrumentError) -> InstrumentError {
        if !matches!(error, InstrumentError::Timeout(_)) {
            return error;
        }
        let asked = async {
            let mut talk = self.turn().await?;
            self.exchange(&mut talk, "*ESR?").await
        };
        let register = asked.await.ok().and_then(|answer| answer.parse::<u8>().ok());
        match register.and_then(protocol::refusal) {
            Some(why) => {
                InstrumentError::Refused(format!("input {} was not read: {why}", self.channel))
            }
            None => error,
        }
    }
}

#[async_trait]
impl Instrument for LakeShore {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        let mut talk = self.turn().await?;
        let answer = self.exchange(&mut talk, "*IDN?").await?;
        let Some((model, serial, firmware)) = protocol::identity(&answer) else {
            talk.is_lost();
            return Err(garbled("LSCI,model,serial,firmware", &answer));
        };
        Ok(Identity {
            model: format!("Lake Shore {model}, firmware {firmware}"),
            serial,
            simulated: self.simulated,
        })
    }
}

#[async_trait]
impl Sensor for LakeShore {
    async fn read(&self) -> Result<Reading, InstrumentError> {
        let (answer, complaint) = match self.measure().await {
            Ok(both) => both,
            Err(error) => return Err(self.why(error).await),
        };
        if let Some(complaint) = complaint {
            let why = format!("input {} has no valid temperature: {complaint}", self.channel);
            return Err(InstrumentError::Refused(why));
        }
        let expected = "a temperature as +025.250, above absolute zero";
        let value = self.scale.celsius(&answer).ok_or_else(|| garbled(expected, &answer))?;
        Ok(Reading {
            quantity: Quantity::Temperature,
            value,
            standard_uncertainty: self.u,
            at: self.clock.now(),
        })
    }
}
