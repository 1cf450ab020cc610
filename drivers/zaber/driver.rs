//! A Zaber stage.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::Duration;

use async_trait::async_trait;
use beampose_core::instrument::{AxisUnit, Homing};
use beampose_core::{Axis, Clock, Identity, Instrument, InstrumentError, Quantity, Reading};

use super::protocol::{self, Message, Reply};
use crate::registry::{Connected, Role, Setting};
use crate::transport::{Party, Talk};

/// Between two looks at whether it still moves.
const POLL: Duration = Duration::from_millis(50);
/// More lines than this without ours: the line is full of somebody else's talk.
const MOST_ASIDES: usize = 50;
/// Zaber's unit of speed: microsteps per second times this.
const SPEED: f64 = 1.6384;

/// A stage on a Zaber chain.
pub struct Zaber {
    line: Party,
    next_id: AtomicU8,
    clock: Arc<dyn Clock>,
    device: u32,
    axis: u32,
    steps_per_unit: f64,
    unit: AxisUnit,
    limits: [f64; 2],
    speed: f64,
    simulated: bool,
}

pub(super) fn connect(setting: Setting) -> Result<Connected, InstrumentError> {
    let Role::Axis { unit, limits, speed } = setting.role else {
        return Err(InstrumentError::Refused(format!("{} is no axis", setting.name)));
    };
    let steps_per_unit = setting.options.number("steps_per_unit")?;
    if steps_per_unit <= 0.0 {
        return Err(InstrumentError::Refused("steps_per_unit must be above zero".to_owned()));
    }
    Ok(Connected::Axis(Arc::new(Zaber {
        line: setting.line()?,
        next_id: AtomicU8::new(0),
        device: setting.options.whole("device", 1, 99)?,
        axis: setting.options.whole("axis", 1, 9)?,
        steps_per_unit,
        unit,
        limits,
        speed,
        simulated: setting.simulated,
        clock: setting.clock,
    })))
}

impl Zaber {
    /// One command and its reply.
    async fn ask(&self, words: &str) -> Result<Reply, InstrumentError> {
        let mut talk = self.line.talk().await?;
        if talk.is_new() {
            let speed = (self.speed * self.steps_per_unit * SPEED).round();
            self.exchange(&mut talk, self.axis, &format!("set maxspeed {speed}")).await?;
            talk.is_set_up();
        }
        self.exchange(&mut talk, self.axis, words).await
    }

    async fn exchange(
        &self,
        talk: &mut Talk<'_>,
        axis: u32,
        words: &str,
    ) -> Result<Reply, InstrumentError> {
        let next = |id: u8| Some((id + 1) % 100);
        let id = self.next_id.fetch_update(Ordering::SeqCst, Ordering::SeqCst, next);
        let id = id.unwrap_or_default();
        talk.send(&protocol::command(self.device, axis, id, words)).await?;
        let mut damaged = None;
        for _ in 0..MOST_ASIDES {
            let line = match talk.until(b'\n').await {
                Ok(line) => line,
                Err(timeout) => return Err(damaged.unwrap_or(timeout)),
            };
            match protocol::message(&line) {
                // A reply to an earlier command may come after its time was over.
                Some(Message::Reply(reply))
                    if reply.id == Some(id) && u32::from(reply.device) == self.device =>
                {
                    return if reply.accepted {
                        Ok(reply)
                    } else {
                        let why = protocol::rejection(&reply.data);
                        Err(InstrumentError::Refused(format!("{words:?}: {why}")))
                    };
                }
                Some(_) => {}
                None => {
                    let found = String::from_utf8_lossy(&line).trim_end().to_owned();
                    let expected = "a Zaber reply, as @01 0 OK IDLE -- 0".to_owned();
                    damaged = Some(InstrumentError::Garbled { expected, found });
                }
            }
        }
        let found = format!("{MOST_ASIDES} other lines");
        Err(InstrumentError::Garbled { expected: format!("the reply to {words:?}"), found })
    }

    /// Waits until it stands. The warning flag it then shows.
    async fn stands(&self) -> Result<String, InstrumentError> {
        loop {
            let reply = self.ask("").await?;
            if !reply.busy {
                return Ok(reply.warning);
            }
            self.clock.sleep(POLL).await;
        }
    }

    fn symbol(&self) -> &'static str {
        match self.unit {
            AxisUnit::Millimetre => "mm",
            AxisUnit::Degree => "deg",
        }
    }
}

#[async_trait]
impl Instrument for Zaber {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        let get = async |words: &str| {
            let mut talk = self.line.talk().await?;
            self.exchange(&mut talk, 0, words).await.map(|reply| reply.data)
        };
        let model = get("get deviceid").await?;
        let version = get("get version").await?;
        let serial = get("get system.serial").await?;
        Ok(Identity {
            model: format!("Zaber device {model}, firmware {version}"),
            serial: Some(serial),
            simulated: self.simulated,
        })
    }
}

#[async_trait]
impl Axis for Zaber {
    async fn move_to(&self, target: f64) -> Result<(), InstrumentError> {
        let ([low, high], unit) = (self.limits, self.symbol());
        if !(low..=high).contains(&target) {
            let why = format!("{target} {unit} is outside {low} to {high} {unit}");
            return Err(InstrumentError::Refused(why));
        }
        let before = self.ask("").await?;
        if protocol::has_no_reference(&before.warning) {
            let why =
                "it has not been homed since it was switched on: `beampose rig jog` with --home";
            return Err(InstrumentError::Refused(why.to_owned()));
        }
        let steps = (target * self.steps_per_unit).round();
        self.ask(&format!("move abs {steps}")).await?;
        let flag = self.stands().await?;
        match protocol::failure(&flag) {
            None if protocol::has_no_reference(&flag) => {
                Err(InstrumentError::Fault("it lost its reference on the way".to_owned()))
            }
            None => Ok(()),
            Some(why) if flag == "NI" => {
                Err(InstrumentError::Refused(format!("{why} to {target} {unit}")))
            }
            Some(why) => Err(InstrumentError::Fault(format!("{why} (flag {flag})"))),
        }
    }

    async fn position(&self) -> Result<Reading, InstrumentError> {
        let reply = self.ask("get pos").await?;
        let steps: f64 = reply.data.parse().map_err(|_| InstrumentError::Garbled {
            expected: "a position in microsteps".to_owned(),
            found: reply.data.clone(),
        })?;
        let quantity = match self.unit {
            AxisUnit::Millimetre => Quantity::Position,
            AxisUnit::Degree => Quantity::Angle,
        };
        let at = self.clock.now();
        let value = steps / self.steps_per_unit;
        Ok(Reading { quantity, value, standard_uncertainty: None, at })
    }

    async fn stop(&self) -> Result<(), InstrumentError> {
        // A stop is itself a move: it lasts until the stage stands.
        self.ask("stop").await?;
        self.stands().await.map(drop)
    }

    fn unit(&self) -> AxisUnit {
        self.unit
    }

    fn homing(&self) -> Option<&dyn Homing> {
        Some(self)
    }
}

#[async_trait]
impl Homing for Zaber {
    async fn home(&self) -> Result<(), InstrumentError> {
        self.ask("home").await?;
        let flag = self.stands().await?;
        match protocol::failure(&flag) {
            Some(why) => Err(InstrumentError::Fault(format!("homing: {why} (flag {flag})"))),
            None => Ok(()),
        }
    }

    async fn is_homed(&self) -> Result<bool, InstrumentError> {
        Ok(!protocol::has_no_reference(&self.ask("").await?.warning))
    }
}
