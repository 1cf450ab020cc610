//! A stage on an APT controller.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use async_trait::async_trait;
use beampose_core::instrument::{AxisUnit, Homing};
use beampose_core::{Axis, Clock, Identity, Instrument, InstrumentError, Reading};

use super::protocol::{self as apt, Bits, HEADER};
use crate::axis::{NOT_HOMED, Travel};
use crate::registry::{Connected, Setting};
use crate::transport::{Party, Talk};

/// Between two looks at whether it still moves.
const POLL: Duration = Duration::from_millis(50);
/// So many looks in a row must find it standing where it should not before that is believed: the
/// status says "moving" some time after the command.
const SURE: usize = 4;
/// Further than this from its target it was stopped on the way, in the axis' unit: ten times what
/// any of these stages settles to.
const ARRIVED: f64 = 0.01;
/// More messages than this without ours: the line is full of somebody else's talk.
const MOST_ASIDES: usize = 50;
/// Quiet for so long, nothing of before is under way.
const QUIET: Duration = Duration::from_millis(30);

/// Whose units of speed, and whose status message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Motor {
    Dc,
    Stepper,
}

impl Motor {
    /// The controller's unit of speed in counts per second: for DC motors by its sampling interval
    /// of 2048/6e6 s and 16 binary digits, for steppers as in the protocol's document.
    const fn speed(self) -> f64 {
        match self {
            Self::Dc => 2048.0 / 6e6 * 65_536.0,
            Self::Stepper => 53.68,
        }
    }

    /// Question and answer of its status update.
    const fn status(self) -> (u16, u16) {
        match self {
            Self::Dc => (0x0490, 0x0491),
            Self::Stepper => (0x0480, 0x0481),
        }
    }
}

/// A stage on an APT controller.
pub struct ThorlabsApt {
    line: Party,
    /// The last exchange lost its place.
    lost: AtomicBool,
    clock: Arc<dyn Clock>,
    channel: u16,
    motor: Motor,
    counts_per_unit: f64,
    travel: Travel,
    simulated: bool,
}

pub(super) fn connect(setting: Setting) -> Result<Connected, InstrumentError> {
    let counts_per_unit = setting.options.positive("counts_per_unit")?;
    let motor = match setting.options.text("controller")? {
        "kdc101" => Motor::Dc,
        "k10cr1" | "lts300" => Motor::Stepper,
        other => {
            let why = format!("controller {other:?}: expected kdc101, k10cr1 or lts300");
            return Err(InstrumentError::Refused(why));
        }
    };
    Ok(Connected::Axis(Arc::new(ThorlabsApt {
        line: setting.line()?,
        lost: AtomicBool::new(false),
        channel: setting.options.whole("channel", 1, 6)? as u16,
        motor,
        counts_per_unit,
        travel: Travel::of(&setting)?,
        simulated: setting.simulated,
        clock: setting.clock,
    })))
}

/// A message that came.
struct Came {
    id: u16,
    data: Vec<u8>,
}

impl ThorlabsApt {
    /// Sends, and waits for the answer of that number to this channel.
    async fn ask(&self, request: &[u8], answer: u16) -> Result<Vec<u8>, InstrumentError> {
        let mut talk = self.line.talk().await?;
        if talk.is_new() {
            // Status messages that another program has ordered would be taken for answers.
            talk.send(&apt::short(apt::HW_STOP_UPDATE_MESSAGES, 0, 0)).await?;
            talk.discard(QUIET).await?;
            talk.is_set_up();
        }
        let asked = self.exchange(&mut talk, request, answer).await;
        match &asked {
            Err(InstrumentError::Garbled { .. } | InstrumentError::Timeout(_)) => {
                // The next talk begins when it is quiet. Where that did not help, from anew.
                talk.is_lost();
                if self.lost.swap(true, Ordering::SeqCst) {
                    talk.hang_up().await;
                }
            }
            _ => self.lost.store(false, Ordering::SeqCst),
        }
        asked
    }

    async fn exchange(
        &self,
        talk: &mut Talk<'_>,
        request: &[u8],
        answer: u16,
    ) -> Result<Vec<u8>, InstrumentError> {
        talk.send(request).await?;
        for _ in 0..MOST_ASIDES {
            let came = Self::next(talk).await?;
            match came.id {
                apt::HW_RESPONSE => {
                    let why = "the controller reports a fault and does not say which".to_owned();
                    return Err(InstrumentError::Fault(why));
                }
                apt::HW_RICH_RESPONSE => {
                    return Err(InstrumentError::Refused(apt::complaint(&came.data)));
                }
                id if id == answer && self.is_ours(&came) => return Ok(came.data),
                // Moves that ended, other channels, and what other programs asked for.
                _ => {}
            }
        }
        let expected = format!("message {answer:04x}");
        Err(InstrumentError::Garbled { expected, found: format!("{MOST_ASIDES} others") })
    }

    async fn next(talk: &mut Talk<'_>) -> Result<Came, InstrumentError> {
        let bytes = talk.exactly(HEADER).await?;
        let header = apt::header(&bytes).ok_or_else(|| InstrumentError::Garbled {
            expected: "the header of an APT message".to_owned(),
            found: format!("{bytes:02x?}"),
        })?;
        let data = if header.data == 0 { Vec::new() } else { talk.exactly(header.data).await? };
        Ok(Came { id: header.id, data })
    }

    /// Who it is concerns all channels.
    fn is_ours(&self, came: &Came) -> bool {
        came.id == apt::HW_GET_INFO || apt::channel(&came.data) == Some(self.channel)
    }

    /// A question about this channel, read by `read`.
    async fn query<T>(
        &self,
        (question, answer): (u16, u16),
        read: fn(&[u8]) -> Option<T>,
    ) -> Result<T, InstrumentError> {
        let data = self.ask(&apt::short(question, self.channel as u8, 0), answer).await?;
        read(&data).ok_or_else(|| InstrumentError::Garbled {
            expected: format!("the data of message {answer:04x}"),
            found: format!("{data:02x?}"),
        })
    }

    const STATUS: (u16, u16) = (apt::MOT_REQ_STATUS_BITS, apt::MOT_GET_STATUS_BITS);
    const VELOCITY: (u16, u16) = (apt::MOT_REQ_VELOCITY, apt::MOT_GET_VELOCITY);

    async fn bits(&self) -> Result<Bits, InstrumentError> {
        self.query(Self::STATUS, apt::bits).await
    }

    /// A command that nothing answers, and the status after it: a complaint comes before that.
    async fn tell(&self, mut command: Vec<u8>) -> Result<Bits, InstrumentError> {
        command.extend(apt::short(Self::STATUS.0, self.channel as u8, 0));
        let data = self.ask(&command, Self::STATUS.1).await?;
        apt::bits(&data).ok_or_else(|| InstrumentError::Garbled {
            expected: "status bits".to_owned(),
            found: format!("{data:02x?}"),
        })
    }

    /// Power on the motor, where it has none.
    async fn enable(&self, bits: Bits) -> Result<(), InstrumentError> {
        if bits.is_enabled() {
            return Ok(());
        }
        let command = apt::short(apt::MOD_SET_CHANNEL_ENABLE, self.channel as u8, 1);
        if self.tell(command).await?.is_enabled() {
            return Ok(());
        }
        let why = "its motor stays off: enable it at the controller".to_owned();
        Err(InstrumentError::Refused(why))
    }

    /// The rig's speed, where the controller has another.
    async fn set_speed(&self) -> Result<(), InstrumentError> {
        let before = self.query(Self::VELOCITY, apt::velocity).await?;
        let wanted = (self.travel.speed * self.counts_per_unit * self.motor.speed()).round() as i32;
        if before.highest == wanted {
            return Ok(());
        }
        let velocity = apt::Velocity { highest: wanted, ..before };
        let data = apt::velocity_data(self.channel, velocity);
        self.tell(apt::long(apt::MOT_SET_VELOCITY, &data)).await?;
        let taken = self.query(Self::VELOCITY, apt::velocity).await?.highest;
        if taken == wanted {
            return Ok(());
        }
        let (speed, unit) = (self.travel.speed, self.travel.symbol());
        let takes = f64::from(taken) / self.counts_per_unit / self.motor.speed();
        let why = format!("it does not take a speed of {speed} {unit}/s: it has {takes:.3}");
        Err(InstrumentError::Refused(why))
    }

    /// Waits until it stands at `counts`.
    async fn arrives(&self, target: f64, counts: i32) -> Result<(), InstrumentError> {
        let mut standing = 0;
        loop {
            self.clock.sleep(POLL).await;
            let bits = self.bits().await?;
            if let Some(why) = bits.fault() {
                return Err(InstrumentError::Fault(why.to_owned()));
            }
            if bits.is_moving() {
                standing = 0;
                continue;
            }
            if !bits.is_homed() {
                let why = "it lost its reference on the way: home it".to_owned();
                return Err(InstrumentError::Fault(why));
            }
            // Where the controller has settled; a move that was stopped ends as one that arrived.
            let at = self.query(self.motor.status(), apt::position).await?;
            if f64::from(at.abs_diff(counts)) <= ARRIVED * self.counts_per_unit {
                return Ok(());
            }
            standing += 1;
            if standing == SURE {
                let (at, unit) = (f64::from(at) / self.counts_per_unit, self.travel.symbol());
                let limit = if bits.is_at_limit() { " by a limit switch" } else { "" };
                let why = format!("stopped{limit} at {at:.3} {unit} on the way to {target} {unit}");
                return Err(InstrumentError::Refused(why));
            }
        }
    }
}

#[async_trait]
impl Instrument for ThorlabsApt {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        let data = self.ask(&apt::short(apt::HW_REQ_INFO, 0, 0), apt::HW_GET_INFO).await?;
        let info = apt::info(&data).ok_or_else(|| InstrumentError::Garbled {
            expected: "who the controller is".to_owned(),
            found: format!("{data:02x?}"),
        })?;
        Ok(Identity {
            model: format!("Thorlabs {}, firmware {}", info.model, info.firmware),
            serial: Some(info.serial.to_string()),
            simulated: self.simulated,
        })
    }
}

#[async_trait]
impl Axis for ThorlabsApt {
    async fn move_to(&self, target: f64) -> Result<(), InstrumentError> {
        self.travel.reaches(target)?;
        let refused = |why: String| Err(InstrumentError::Refused(why));
        let counts = (target * self.counts_per_unit).round();
        if counts.abs() > f64::from(i32::MAX) {
            let unit = self.travel.symbol();
            return refused(format!("{target} {unit} is more than the controller can count"));
        }
        let bits = self.bits().await?;
        if bits.is_moving() || bits.is_homing() {
            return refused("it is moving".to_owned());
        }
        // The controller itself would move: somewhere.
        if !bits.is_homed() {
            return refused(NOT_HOMED.to_owned());
        }
        self.enable(bits).await?;
        self.set_speed().await?;
        let counts = counts as i32;
        let data = apt::target_data(self.channel, counts);
        self.tell(apt::long(apt::MOT_MOVE_ABSOLUTE, &data)).await?;
        self.arrives(target, counts).await
    }

    async fn position(&self) -> Result<Reading, InstrumentError> {
        let question = (apt::MOT_REQ_POSITION_COUNTER, apt::MOT_GET_POSITION_COUNTER);
        let counts = self.query(question, apt::position).await?;
        let value = f64::from(counts) / self.counts_per_unit;
        Ok(self.travel.reading(value, &*self.clock))
    }

    async fn stop(&self) -> Result<(), InstrumentError> {
        // 2: with its own deceleration, so that it does not lose its place.
        let stop = apt::short(apt::MOT_MOVE_STOP, self.channel as u8, 2);
        // At once, whoever waits for an answer now; nothing answers it but a message of its own.
        self.line.send_without_waiting(&stop);
        let mut bits = self.tell(stop).await?;
        while bits.is_moving() || bits.is_homing() {
            self.clock.sleep(POLL).await;
            bits = self.bits().await?;
        }
        Ok(())
    }

    fn unit(&self) -> AxisUnit {
        self.travel.unit
    }

    fn homing(&self) -> Option<&dyn Homing> {
        Some(self)
    }
}

#[async_trait]
impl Homing for ThorlabsApt {
    async fn home(&self) -> Result<(), InstrumentError> {
        let bits = self.bits().await?;
        self.enable(bits).await?;
        self.tell(apt::short(apt::MOT_MOVE_HOME, self.channel as u8, 0)).await?;
        let mut standing = 0;
        loop {
            self.clock.sleep(POLL).await;
            let bits = self.bits().await?;
            if let Some(why) = bits.fault() {
                return Err(InstrumentError::Fault(format!("homing: {why}")));
            }
            standing = if bits.is_homing() || bits.is_moving() { 0 } else { standing + 1 };
            if standing == SURE {
                return if bits.is_homed() {
                    Ok(())
                } else {
                    let why = "homing was stopped before it found its reference".to_owned();
                    Err(InstrumentError::Refused(why))
                };
            }
        }
    }

    async fn is_homed(&self) -> Result<bool, InstrumentError> {
        let bits = self.bits().await?;
        Ok(bits.is_homed() && !bits.is_homing())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speeds_are_those_of_the_protocols_document() {
        // Its section 8, as several open programs cite it: counts per unit, and the controller's
        // number for one unit per second. MTS50-Z8, PRM1-Z8, K10CR1, LTS300.
        for (motor, counts_per_unit, number) in [
            (Motor::Dc, 34_554.96, 772_981.369_2),
            (Motor::Dc, 1_919.641_857_862_339, 42_941.66),
            (Motor::Stepper, 136_533.33, 7_329_109.0),
            (Motor::Stepper, 409_600.0, 21_987_328.0),
        ] {
            let ours = counts_per_unit * motor.speed();
            assert!((ours / number - 1.0).abs() < 1e-6, "{ours} {number}");
        }
    }
}
