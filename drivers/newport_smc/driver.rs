//! A stage on an SMC100 or CONEX controller.

use std::sync::Arc;
use std::time::Duration;

use async_trait::async_trait;
use beampose_core::instrument::{AxisUnit, Homing};
use beampose_core::{Axis, Clock, Identity, Instrument, InstrumentError, Reading};

use super::protocol::{self, State, Status};
use crate::axis::{NOT_HOMED, Travel};
use crate::registry::{Connected, Setting};
use crate::transport::{Party, Talk};

/// Between two looks at whether it still moves.
const POLL: Duration = Duration::from_millis(50);
/// How long a controller is dead after a reset: about 5 s, and a reserve.
const RESET: Duration = Duration::from_secs(6);
/// Quiet for so long, it has heard that it is to reset.
const GOES_DOWN: Duration = Duration::from_millis(50);
/// How often it is asked after that, one second apart, before it is given up.
const TRIES_AFTER_RESET: usize = 10;
/// Further than this from its target it was stopped on the way. Stages of these controllers count in
/// steps below a tenth of it.
const ARRIVED: f64 = 1e-3;

/// A stage on an SMC100 or CONEX controller.
pub struct NewportSmc {
    line: Party,
    clock: Arc<dyn Clock>,
    address: u32,
    travel: Travel,
    simulated: bool,
}

pub(super) fn connect(setting: Setting) -> Result<Connected, InstrumentError> {
    Ok(Connected::Axis(Arc::new(NewportSmc {
        line: setting.line()?,
        address: setting.options.whole("address", 1, 31)?,
        travel: Travel::of(&setting)?,
        simulated: setting.simulated,
        clock: setting.clock,
    })))
}

impl NewportSmc {
    /// A question of two letters, and what is answered to it.
    async fn ask(&self, question: &str) -> Result<String, InstrumentError> {
        let mut talk = self.line.talk().await?;
        self.query(&mut talk, question, "").await
    }

    async fn query(
        &self,
        talk: &mut Talk<'_>,
        question: &str,
        mark: &str,
    ) -> Result<String, InstrumentError> {
        talk.send(&protocol::command(self.address, &format!("{question}{mark}"))).await?;
        let line = talk.until(b'\n').await?;
        protocol::answer(self.address, question, &line).ok_or_else(|| {
            talk.is_lost();
            InstrumentError::Garbled {
                expected: format!("the answer to {}{question}{mark}", self.address),
                found: String::from_utf8_lossy(&line).trim_end().to_owned(),
            }
        })
    }

    /// A command that nothing answers, and whether it was taken.
    async fn tell(&self, words: &str) -> Result<(), InstrumentError> {
        let mut talk = self.line.talk().await?;
        // An error of before, of whomever, is not ours: reading it clears it.
        self.query(&mut talk, "TE", "").await?;
        talk.send(&protocol::command(self.address, words)).await?;
        let letter = self.query(&mut talk, "TE", "").await?;
        match protocol::error(&letter) {
            None => Ok(()),
            Some(why) => {
                Err(InstrumentError::Refused(format!("{words:?}: {why} (error {letter})")))
            }
        }
    }

    async fn status(&self) -> Result<Status, InstrumentError> {
        let text = self.ask("TS").await?;
        protocol::status(&text).ok_or_else(|| InstrumentError::Garbled {
            expected: "a status, as 000033".to_owned(),
            found: text,
        })
    }

    async fn number(&self, question: &str) -> Result<f64, InstrumentError> {
        let text = self.ask(question).await?;
        let number = text.parse().ok().filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| InstrumentError::Garbled {
            expected: "a position".to_owned(),
            found: text,
        })
    }

    /// Waits until it stands. What it then is.
    async fn stands(&self) -> Result<Status, InstrumentError> {
        loop {
            let status = self.status().await?;
            if !matches!(status.state, State::Moving | State::Homing | State::Jogging) {
                return Ok(status);
            }
            self.clock.sleep(POLL).await;
        }
    }

    /// Whether it is ready for a move, and in words why not.
    async fn is_ready(&self) -> Result<(), InstrumentError> {
        let why = match self.status().await?.state {
            State::Ready => return Ok(()),
            State::NotReferenced => NOT_HOMED,
            State::Disabled => "its motor is off: switch it on at the controller, or home it",
            State::Configuration => "it is being configured: switch it off and on",
            State::Homing => "it searches its reference",
            State::Moving | State::Jogging => "it is moving",
        };
        Err(InstrumentError::Refused(why.to_owned()))
    }

    /// Forgets its reference: a controller that has one refuses to search it again.
    async fn reset(&self) -> Result<(), InstrumentError> {
        let mut talk = self.line.talk().await?;
        talk.send(&protocol::command(self.address, "RS")).await?;
        // What it may say as it goes down is nobody's answer.
        talk.discard(GOES_DOWN).await?;
        drop(talk);
        self.clock.sleep(RESET).await;
        let mut last = self.status().await;
        for _ in 0..TRIES_AFTER_RESET {
            if last.is_ok() {
                break;
            }
            // A CONEX leaves the USB meanwhile: no error counts before the last.
            self.clock.sleep(Duration::from_secs(1)).await;
            last = self.status().await;
        }
        match last?.state {
            State::NotReferenced => Ok(()),
            other => {
                let why = format!("after a reset it is {}", other.words());
                Err(InstrumentError::Fault(why))
            }
        }
    }
}

#[async_trait]
impl Instrument for NewportSmc {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        let mut talk = self.line.talk().await?;
        let controller = self.query(&mut talk, "VE", "").await?;
        let stage = self.query(&mut talk, "ID", "?").await?;
        Ok(Identity {
            model: format!("Newport {controller}, stage {stage}"),
            serial: None,
            simulated: self.simulated,
        })
    }
}

#[async_trait]
impl Axis for NewportSmc {
    async fn move_to(&self, target: f64) -> Result<(), InstrumentError> {
        self.travel.reaches(target)?;
        self.is_ready().await?;
        // A reset, which no line notices, takes the speed back: it is said each time.
        self.tell(&format!("VA{}", self.travel.speed)).await?;
        self.tell(&format!("PA{target:.6}")).await?;
        let Status { faults, state } = self.stands().await?;
        if faults != 0 {
            return Err(InstrumentError::Fault(protocol::faults(faults)));
        }
        if state != State::Ready {
            let why = format!("after the move it is {}", state.words());
            return Err(InstrumentError::Fault(why));
        }
        // A move that was stopped ends as one that arrived. `TH`, where it should be, reads no
        // encoder.
        let stands = self.number("TH").await?;
        if (stands - target).abs() > ARRIVED {
            let unit = self.travel.symbol();
            let why = format!("stopped at {stands} {unit} on the way to {target} {unit}");
            return Err(InstrumentError::Refused(why));
        }
        Ok(())
    }

    async fn position(&self) -> Result<Reading, InstrumentError> {
        let value = self.number("TP").await?;
        Ok(self.travel.reading(value, &*self.clock))
    }

    async fn stop(&self) -> Result<(), InstrumentError> {
        let stop = protocol::command(self.address, "ST");
        // At once, whoever waits for an answer now; nothing answers it.
        self.line.send_without_waiting(&stop);
        let mut talk = self.line.talk().await?;
        talk.send(&stop).await?;
        // Refused where nothing moves, or an error of before: what counts is that it stands.
        self.query(&mut talk, "TE", "").await?;
        drop(talk);
        self.stands().await.map(drop)
    }

    fn unit(&self) -> AxisUnit {
        self.travel.unit
    }

    fn homing(&self) -> Option<&dyn Homing> {
        Some(self)
    }
}

#[async_trait]
impl Homing for NewportSmc {
    /// A controller that is homed is reset first: it takes some six seconds more, in which nothing
    /// holds the stage.
    async fn home(&self) -> Result<(), InstrumentError> {
        match self.status().await?.state {
            State::NotReferenced => {}
            State::Ready | State::Disabled => self.reset().await?,
            State::Configuration => return self.is_ready().await,
            State::Homing | State::Moving | State::Jogging => {
                return Err(InstrumentError::Refused("it is moving: stop it first".to_owned()));
            }
        }
        self.tell("OR").await?;
        let Status { faults, state } = self.stands().await?;
        match state {
            State::Ready => Ok(()),
            _ if faults != 0 => {
                Err(InstrumentError::Fault(format!("homing: {}", protocol::faults(faults))))
            }
            _ => {
                let why = format!("homing was stopped: it is {}", state.words());
                Err(InstrumentError::Refused(why))
            }
        }
    }

    async fn is_homed(&self) -> Result<bool, InstrumentError> {
        let state = self.status().await?.state;
        Ok(!matches!(state, State::NotReferenced | State::Configuration | State::Homing))
    }
}
