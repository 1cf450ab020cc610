//! The current source of an Arroyo controller.

use std::sync::Arc;
use std::time::Duration;

use async_trait::async_trait;
use beampose_core::{Clock, Identity, InstrumentError};

use super::protocol;
use crate::laser::diode::{CONTROL_IS_OFF, LIMIT_CURRENT, Tolerance};
use crate::laser::{GuardedLaser, LaserDevice, SHORTEST_DELAY};
use crate::registry::{Connected, Role, Setting};
use crate::transport::{Party, Talk};

/// How long nothing must come before echoes of the opening are over. Real time.
const QUIET: Duration = Duration::from_millis(40);

/// A controller's line as laser and sensor use it.
pub(super) struct Interface {
    line: Party,
    pub(super) clock: Arc<dyn Clock>,
    simulated: bool,
}

impl Interface {
    pub(super) fn new(setting: &Setting) -> Result<Self, InstrumentError> {
        Ok(Self {
            line: setting.line()?,
            clock: Arc::clone(&setting.clock),
            simulated: setting.simulated,
        })
    }

    pub(super) async fn talk(&self) -> Result<Talk<'_>, InstrumentError> {
        self.line.talk().await
    }

    /// What every session begins with. Errors that were there before are nobody's here.
    pub(super) async fn open(&self, talk: &mut Talk<'_>) -> Result<(), InstrumentError> {
        talk.send(protocol::OPENING).await?;
        talk.discard(QUIET).await?;
        self.asked(talk, "ERR?").await.map(drop)
    }

    /// One question in a talk.
    pub(super) async fn asked(
        &self,
        talk: &mut Talk<'_>,
        words: &str,
    ) -> Result<String, InstrumentError> {
        talk.send(&protocol::line(words)).await?;
        let line = talk.until(b'\n').await?;
        match protocol::answer(&line) {
            Some(text) => Ok(text.to_owned()),
            None => Err(garbled(talk, words, &String::from_utf8_lossy(&line))),
        }
    }

    /// One question in a talk whose answer is read by `read`.
    pub(super) async fn read<T>(
        &self,
        talk: &mut Talk<'_>,
        words: &str,
        read: fn(&str) -> Option<T>,
    ) -> Result<T, InstrumentError> {
        let text = self.asked(talk, words).await?;
        read(&text).ok_or_else(|| garbled(talk, words, &text))
    }

    /// One question.
    async fn ask<T>(&self, words: &str, read: fn(&str) -> Option<T>) -> Result<T, InstrumentError> {
        let mut talk = self.talk().await?;
        self.read(&mut talk, words, read).await
    }

    /// One setting. The device says nothing to it; its list of errors does.
    async fn set(&self, words: &str) -> Result<(), InstrumentError> {
        let mut talk = self.talk().await?;
        talk.send(&protocol::line(words)).await?;
        let codes = self.read(&mut talk, "ERR?", protocol::errors).await?;
        if codes.is_empty() {
            return Ok(());
        }
        let why = |code: &u32| format!("{} (E-{code:03})", protocol::meaning(*code));
        let why: Vec<String> = codes.iter().map(why).collect();
        Err(InstrumentError::Refused(format!("{words}: {}", why.join(", "))))
    }

    /// Who it is.
    pub(super) async fn identify(&self) -> Result<Identity, InstrumentError> {
        let (model, serial) = self.ask("*IDN?", protocol::identity).await?;
        Ok(Identity { model, serial, simulated: self.simulated })
    }
}

fn garbled(talk: &Talk<'_>, words: &str, found: &str) -> InstrumentError {
    talk.is_lost();
    let expected = format!("an answer to {words}");
    InstrumentError::Garbled { expected, found: found.trim_end().to_owned() }
}

/// A laser diode on an Arroyo controller.
pub struct Arroyo {
    interface: Interface,
    /// `None` without temperature control.
    tolerance: Option<Tolerance>,
    delay_ms: u32,
}

pub(super) fn connect(setting: Setting) -> Result<Connected, InstrumentError> {
    let Role::Laser { emission_delay, .. } = setting.role else {
        return Err(InstrumentError::Refused(format!("{} is no laser", setting.name)));
    };
    let limit = setting.options.positive(LIMIT_CURRENT.name)?;
    let delay = emission_delay.max(SHORTEST_DELAY).as_millis();
    let device = Arroyo {
        interface: Interface::new(&setting)?,
        tolerance: Tolerance::of(&setting.options)?,
        // What is longer than the device can wait, the rules wait before it.
        delay_ms: delay.min(u128::from(protocol::LONGEST_DELAY_MS)) as u32,
    };
    Ok(Connected::Laser(Arc::new(GuardedLaser::new(Arc::new(device), &setting, limit)?)))
}

impl Arroyo {
    async fn condition(&self) -> Result<u32, InstrumentError> {
        self.interface.ask("LAS:COND?", protocol::whole).await
    }

    /// Sets a whole number and reads it back.
    async fn programmed(&self, words: &str, value: u32) -> Result<(), InstrumentError> {
        self.interface.set(&format!("{words} {value}")).await?;
        let read = self.interface.ask(&format!("{words}?"), protocol::whole).await?;
        if read == value {
            return Ok(());
        }
        Err(InstrumentError::Fault(format!("{words} was set to {value} and reads {read}")))
    }
}

#[async_trait]
impl LaserDevice for Arroyo {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        self.interface.identify().await
    }

    async fn is_new(&self) -> Result<bool, InstrumentError> {
        let mut talk = self.interface.talk().await?;
        if talk.is_new() {
            // Off before anything that could fail.
            talk.send(protocol::OFF).await?;
            self.interface.open(&mut talk).await?;
        }
        Ok(talk.is_new())
    }

    async fn set_up(&self) -> Result<(), InstrumentError> {
        self.interface.set("LAS:MODE:ILBW").await?;
        // The box waits by itself, its light that says so lit.
        self.programmed("ONDELAY", self.delay_ms).await?;
        let before = self.interface.ask("LAS:ENAB:OUTOFF?", protocol::whole).await?;
        let after = match self.tolerance {
            Some(_) => before | protocol::OFF_WITHOUT_TEC,
            None => before & !protocol::OFF_WITHOUT_TEC,
        };
        self.programmed("LAS:ENAB:OUTOFF", after).await?;
        self.interface.talk().await?.is_set_up();
        Ok(())
    }

    async fn switch(&self, on: bool) -> Result<(), InstrumentError> {
        self.interface.set(&format!("LAS:OUT {}", u8::from(on))).await
    }

    async fn is_on(&self) -> Result<bool, InstrumentError> {
        // During the on-delay the output is on and no current flows; either sign is "on".
        let output = self.interface.ask("LAS:OUT?", protocol::switch).await?;
        Ok(output || self.condition().await? & protocol::OUTPUT_ON != 0)
    }

    async fn set_current(&self, ma: f64) -> Result<(), InstrumentError> {
        self.interface.set(&format!("LAS:LDI {ma:.3}")).await
    }

    async fn set_point(&self) -> Result<f64, InstrumentError> {
        // LAS:LDI? is what flows.
        self.interface.ask("LAS:SET:LDI?", protocol::number).await
    }

    async fn set_limit(&self, ma: f64) -> Result<(), InstrumentError> {
        self.interface.set(&format!("LAS:LIM:LDI {ma:.3}")).await
    }

    async fn limit(&self) -> Result<f64, InstrumentError> {
        self.interface.ask("LAS:LIM:LDI?", protocol::number).await
    }

    async fn measured(&self) -> Result<f64, InstrumentError> {
        self.interface.ask("LAS:LDI?", protocol::number).await
    }

    async fn interlock_closed(&self) -> Result<bool, InstrumentError> {
        Ok(self.condition().await? & protocol::INTERLOCK_OPEN == 0)
    }

    async fn not_ready(&self) -> Result<Option<String>, InstrumentError> {
        let Some(tolerance) = self.tolerance else { return Ok(None) };
        if !self.interface.ask("TEC:OUT?", protocol::switch).await? {
            return Ok(Some(CONTROL_IS_OFF.to_owned()));
        }
        let set = self.interface.ask("TEC:SET:T?", protocol::number).await?;
        let read = self.interface.ask("TEC:T?", protocol::number).await?;
        if self.interface.ask("TEC:COND?", protocol::whole).await? & protocol::NO_SENSOR != 0 {
            return Ok(Some("its temperature sensor is open or shorted".to_owned()));
        }
        Ok(tolerance.objection(set, read))
    }

    fn off_without_waiting(&self) {
        self.interface.line.send_without_waiting(protocol::OFF);
    }

    fn own_delay(&self) -> Duration {
        Duration::from_millis(u64::from(self.delay_ms))
    }
}
