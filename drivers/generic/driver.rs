//! An instrument of which the rig file says how it is read.

use std::sync::Arc;
use std::time::Duration;

use async_trait::async_trait;
use beampose_core::{Clock, Identity, Instrument, InstrumentError, Quantity, Reading, Sensor};

use super::protocol::{self, Pattern};
use super::units::Unit;
use crate::registry::{Connected, Role, Setting};
use crate::transport::{Party, Talk};

/// So long nothing comes once it has answered its setup.
const QUIET: Duration = Duration::from_millis(200);

/// A reader.
pub struct Generic {
    line: Party,
    clock: Arc<dyn Clock>,
    command: Vec<u8>,
    identify: Vec<u8>,
    setup: Vec<Vec<u8>>,
    terminator: u8,
    pattern: Pattern,
    /// The pattern as written, for errors.
    expected: String,
    unit: Unit,
    quantity: Quantity,
    quiet: Duration,
    u: Option<f64>,
    simulated: bool,
}

pub(super) fn connect(setting: Setting) -> Result<Connected, InstrumentError> {
    let Role::Sensor { quantity, u } = setting.role else {
        return Err(InstrumentError::Refused(format!("{} is no sensor", setting.name)));
    };
    let options = &setting.options;
    let wrong = |name: &'static str| {
        move |why: String| InstrumentError::Refused(format!("option {name}: {why}"))
    };
    let bytes = |name: &'static str, text: &str| {
        let escape = || format!("{text:?} has an escape that is none of \\r \\n \\t \\\\ \\x1b");
        protocol::bytes(text).ok_or_else(|| wrong(name)(escape()))
    };
    let read = |name: &'static str| bytes(name, options.text(name)?);
    let command = read("command")?;
    if command.is_empty() {
        return Err(wrong("command")("it is empty".to_owned()));
    }
    let terminator = match read("terminator")?[..] {
        [.., last] => last,
        [] => return Err(wrong("terminator")("it is empty".to_owned())),
    };
    let setup = options.text("setup")?.split('|').filter(|text| !text.is_empty());
    let setup = setup.map(|text| bytes("setup", text)).collect::<Result<_, _>>()?;
    let expected = options.text("answer")?.to_owned();
    Ok(Connected::Sensor(Arc::new(Generic {
        line: setting.line()?,
        command,
        identify: read("identify")?,
        setup,
        terminator,
        pattern: Pattern::new(&expected).map_err(wrong("answer"))?,
        unit: Unit::named(options.text("unit")?, quantity).map_err(wrong("unit"))?,
        expected,
        quantity,
        quiet: QUIET.min(setting.deadline),
        u,
        simulated: setting.simulated,
        clock: setting.clock,
    })))
}

impl Generic {
    async fn turn(&self) -> Result<Talk<'_>, InstrumentError> {
        let mut talk = self.line.talk().await?;
        if talk.is_new() {
            for command in &self.setup {
                talk.send(command).await?;
            }
            // Whatever it answers to that, or says to whoever connects.
            talk.discard(self.quiet).await?;
            talk.is_set_up();
        }
        Ok(talk)
    }

    async fn ask(&self, talk: &mut Talk<'_>, command: &[u8]) -> Result<String, InstrumentError> {
        talk.send(command).await?;
        let line = talk.until(self.terminator).await?;
        Ok(String::from_utf8_lossy(&line).trim().to_owned())
    }
}

#[async_trait]
impl Instrument for Generic {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        let mut talk = self.turn().await?;
        let model = if self.identify.is_empty() {
            // Opening its line is all that is tried: a reading here would be nobody's.
            format!("something that answers {:?}", String::from_utf8_lossy(&self.command).trim())
        } else {
            self.ask(&mut talk, &self.identify).await?
        };
        Ok(Identity { model, serial: None, simulated: self.simulated })
    }
}

#[async_trait]
impl Sensor for Generic {
    async fn read(&self) -> Result<Reading, InstrumentError> {
        let mut talk = self.turn().await?;
        let answer = self.ask(&mut talk, &self.command).await?;
        let value = self.pattern.value(&answer).map(|number| self.unit.reading(number));
        let Some(value) = value.filter(|value| value.is_finite()) else {
            // It may have said more than one line.
            talk.is_lost();
            let expected = self.expected.clone();
            return Err(InstrumentError::Garbled { expected, found: answer });
        };
        Ok(Reading {
            quantity: self.quantity,
            value,
            standard_uncertainty: self.u,
            at: self.clock.now(),
        })
    }
}
