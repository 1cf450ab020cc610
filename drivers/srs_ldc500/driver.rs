//! The current source of an LDC500.

use std::sync::Arc;
use std::time::Duration;

use async_trait::async_trait;
use beampose_core::{Clock, Identity, InstrumentError};

use super::protocol;
use crate::laser::diode::{CONTROL_IS_OFF, LIMIT_CURRENT, Tolerance};
use crate::laser::{GuardedLaser, LaserDevice};
use crate::registry::{Connected, Setting};
use crate::transport::{Party, Talk};

/// From a setting to its error in the registers: 15 ms in the experience of others, and some more.
const ERROR_COMES: Duration = Duration::from_millis(25);

/// An LDC500's line as laser and sensor use it.
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
        self.errors(talk).await.map(drop)
    }

    /// What the commands before have left in the registers for execution and command errors.
    async fn errors(&self, talk: &mut Talk<'_>) -> Result<[u32; 2], InstrumentError> {
        // Answered when all before is executed: only from then on time counts, not from when the
        // bytes were handed to a slow line.
        self.asked(talk, "*OPC").await?;
        self.clock.sleep(ERROR_COMES).await;
        let mut codes = [0; 2];
        for (code, register) in codes.iter_mut().zip(["LEXE", "LCME"]) {
            let text = self.asked(talk, register).await?;
            *code = text.parse().map_err(|_| garbled(talk, register, &text))?;
        }
        Ok(codes)
    }

    /// One question in a talk.
    pub(super) async fn asked(
        &self,
        talk: &mut Talk<'_>,
        word: &str,
    ) -> Result<String, InstrumentError> {
        talk.send(&protocol::question(word)).await?;
        let line = talk.until(b'\n').await?;
        match protocol::answer(&line) {
            Some(text) => Ok(text.to_owned()),
            None => Err(garbled(talk, word, &String::from_utf8_lossy(&line))),
        }
    }

    /// One question whose answer is read by `read`.
    pub(super) async fn ask<T>(
        &self,
        word: &str,
        read: impl Fn(&str) -> Option<T> + Send,
    ) -> Result<T, InstrumentError> {
        let mut talk = self.talk().await?;
        let text = self.asked(&mut talk, word).await?;
        read(&text).ok_or_else(|| garbled(&talk, word, &text))
    }

    /// One setting. The device says nothing to it; its error registers do.
    async fn set(&self, word: &str, value: &str) -> Result<(), InstrumentError> {
        let mut talk = self.talk().await?;
        talk.send(&protocol::setting(word, value)).await?;
        let refused = |why: String| Err(InstrumentError::Refused(format!("{word} {value}: {why}")));
        match self.errors(&mut talk).await? {
            [0, 0] => Ok(()),
            [0, code] => refused(format!("{} (LCME {code})", protocol::command_error(code))),
            [code, _] => refused(format!("execution error {code} (LEXE in its manual)")),
        }
    }

    /// Who it is.
    pub(super) async fn identify(&self) -> Result<Identity, InstrumentError> {
        let (model, serial) = self.ask("*IDN", protocol::identity).await?;
        Ok(Identity { model, serial, simulated: self.simulated })
    }
}

fn garbled(talk: &Talk<'_>, word: &str, found: &str) -> InstrumentError {
    talk.is_lost();
    let expected = format!("an answer to {word}?");
    InstrumentError::Garbled { expected, found: found.trim_end().to_owned() }
}

/// A laser diode on an LDC500.
pub struct SrsLdc500 {
    interface: Interface,
    /// `None` without temperature control.
    tolerance: Option<Tolerance>,
}

pub(super) fn connect(setting: Setting) -> Result<Connected, InstrumentError> {
    let limit = setting.options.positive(LIMIT_CURRENT.name)?;
    let device = SrsLdc500 {
        interface: Interface::new(&setting)?,
        tolerance: Tolerance::of(&setting.options)?,
    };
    Ok(Connected::Laser(Arc::new(GuardedLaser::new(Arc::new(device), &setting, limit)?)))
}

#[async_trait]
impl LaserDevice for SrsLdc500 {
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
        self.interface.set("SMOD", "CC").await?;
        // Modulation adds to the set point.
        self.interface.set("MODU", "OFF").await?;
        self.interface.talk().await?.is_set_up();
        Ok(())
    }

    async fn switch(&self, on: bool) -> Result<(), InstrumentError> {
        self.interface.set("LDON", if on { "ON" } else { "OFF" }).await
    }

    async fn is_on(&self) -> Result<bool, InstrumentError> {
        self.interface.ask("LDON", protocol::switch).await
    }

    async fn set_current(&self, ma: f64) -> Result<(), InstrumentError> {
        self.interface.set("SILD", &protocol::milliampere(ma)).await
    }

    async fn set_point(&self) -> Result<f64, InstrumentError> {
        self.interface.ask("SILD", protocol::number).await
    }

    async fn set_limit(&self, ma: f64) -> Result<(), InstrumentError> {
        self.interface.set("SILM", &protocol::milliampere(ma)).await
    }

    async fn limit(&self) -> Result<f64, InstrumentError> {
        self.interface.ask("SILM", protocol::number).await
    }

    async fn measured(&self) -> Result<f64, InstrumentError> {
        self.interface.ask("RILD", protocol::number).await
    }

    async fn interlock_closed(&self) -> Result<bool, InstrumentError> {
        self.interface.ask("ILOC", protocol::contact).await
    }

    async fn not_ready(&self) -> Result<Option<String>, InstrumentError> {
        let Some(tolerance) = self.tolerance else { return Ok(None) };
        if !self.interface.ask("TEON", protocol::switch).await? {
            return Ok(Some(CONTROL_IS_OFF.to_owned()));
        }
        let mode = self.interface.ask("TMOD", |text| Some(text.to_owned())).await?;
        if mode != "CT" {
            return Ok(Some(format!("its temperature control is in mode {mode}, not CT")));
        }
        let set = self.interface.ask("TEMP", protocol::number).await?;
        let read = self.interface.ask("TTRD", protocol::number).await?;
        Ok(tolerance.objection(set, read))
    }

    fn off_without_waiting(&self) {
        self.interface.line_off();
    }
}

impl Interface {
    fn line_off(&self) {
        self.line.send_without_waiting(protocol::OFF);
    }
}
