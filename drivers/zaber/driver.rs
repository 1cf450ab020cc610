//! A Zaber stage.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU32, Ordering};
use std::time::Duration;

use async_trait::async_trait;
use beampose_core::instrument::{AxisUnit, Homing};
use beampose_core::{Axis, Clock, Identity, Instrument, InstrumentError, Reading};

use super::protocol::{self, Message, Reply};
use crate::axis::{NOT_HOMED, Travel};
use crate::registry::{Connected, Setting};
use crate::transport::{Party, Talk};

/// Between two looks at whether it still moves.
const POLL: Duration = Duration::from_millis(50);
/// Further than this from its target it was stopped on the way, in the axis' unit: ten times what
/// any of these stages settles to.
const ARRIVED: f64 = 0.01;
/// More lines than this without ours: the line is full of somebody else's talk.
const MOST_ASIDES: usize = 50;
/// Zaber's unit of speed: microsteps per second times this.
const SPEED: f64 = 1.6384;

/// A stage on a Zaber chain.
pub struct Zaber {
    line: Party,
    next_id: AtomicU8,
    /// How often it was told to stop.
    stops: AtomicU32,
    clock: Arc<dyn Clock>,
    device: u32,
    axis: u32,
    steps_per_unit: f64,
    travel: Travel,
    simulated: bool,
}

pub(super) fn connect(setting: Setting) -> Result<Connected, InstrumentError> {
    Ok(Connected::Axis(Arc::new(Zaber {
        line: setting.line()?,
        next_id: AtomicU8::new(0),
        stops: AtomicU32::new(0),
        device: setting.options.whole("device", 1, 99)?,
        axis: setting.options.whole("axis", 1, 9)?,
        steps_per_unit: setting.options.positive("steps_per_unit")?,
        travel: Travel::of(&setting)?,
        simulated: setting.simulated,
        clock: setting.clock,
    })))
}

impl Zaber {
    /// The next command's number.
    fn id(&self) -> u8 {
        let next = |id: u8| Some((id + 1) % 100);
        self.next_id.fetch_update(Ordering::SeqCst, Ordering::SeqCst, next).unwrap_or_default()
    }

    /// One command and its reply.
    async fn ask(&self, words: &str) -> Result<Reply, InstrumentError> {
        let mut talk = self.line.talk().await?;
        if talk.is_new() {
            let speed = (self.travel.speed * self.steps_per_unit * SPEED).round();
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
        let id = self.id();
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
                    if reply.id == Some(id)
                        && [reply.device, reply.axis].map(u32::from) == [self.device, axis] =>
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

    async fn steps(&self) -> Result<f64, InstrumentError> {
        let reply = self.ask("get pos").await?;
        reply.data.parse().map_err(|_| InstrumentError::Garbled {
            expected: "a position in microsteps".to_owned(),
            found: reply.data,
        })
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
        self.travel.reaches(target)?;
        let stops = self.stops.load(Ordering::SeqCst);
        let before = self.ask("").await?;
        if protocol::has_no_reference(&before.warning) {
            return Err(InstrumentError::Refused(NOT_HOMED.to_owned()));
        }
        let steps = (target * self.steps_per_unit).round();
        self.ask(&format!("move abs {steps}")).await?;
        let flag = self.stands().await?;
        match protocol::failure(&flag) {
            None if protocol::has_no_reference(&flag) => {
                let why = "it lost its reference on the way".to_owned();
                return Err(InstrumentError::Fault(why));
            }
            Some(why) if flag != protocol::INTERRUPTED => {
                return Err(InstrumentError::Fault(format!("{why} (flag {flag})")));
            }
            _ => {}
        }
        // A stop is said twice, and the second takes the flag of the first back.
        let is_flagged = flag == protocol::INTERRUPTED;
        if is_flagged || self.stops.load(Ordering::SeqCst) != stops {
            let at = self.steps().await? / self.steps_per_unit;
            if is_flagged || (at - target).abs() > ARRIVED {
                let unit = self.travel.symbol();
                let why = format!("stopped at {at:.3} {unit} on the way to {target} {unit}");
                return Err(InstrumentError::Refused(why));
            }
        }
        Ok(())
    }

    async fn position(&self) -> Result<Reading, InstrumentError> {
        let position = self.steps().await? / self.steps_per_unit;
        Ok(self.travel.reading(position, &*self.clock))
    }

    async fn stop(&self) -> Result<(), InstrumentError> {
        self.stops.fetch_add(1, Ordering::SeqCst);
        // At once, whoever waits for an answer now: its own answer has a number that nobody waits for.
        let stop = protocol::command(self.device, self.axis, self.id(), "stop");
        self.line.send_without_waiting(&stop);
        // A stop is itself a move: it lasts until the stage stands.
        self.ask("stop").await?;
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
