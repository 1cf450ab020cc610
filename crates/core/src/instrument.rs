//! Instruments as capability traits of a few methods each.
//!
//! To add a kind of instrument: a trait here, an accessor in the engine's `Bench`, an action in
//! `plan` that uses it. An optional ability is an accessor that returns `Option`, never a method
//! that answers "not supported".

use async_trait::async_trait;
use serde::{Deserialize, Serialize};

use crate::clock::Stamp;
use crate::record::Reading;

/// What an instrument says of itself.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// Maker and model, as in `Zaber X-LRQ1000`.
    pub model: String,
    /// Serial number, if it tells one.
    pub serial: Option<String>,
    /// True where nothing but a simulation answers; stored with the session.
    pub simulated: bool,
}

/// Why an instrument did not do as asked. The engine adds which instrument and which step.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum InstrumentError {
    /// No answer in time.
    #[error("no answer within {0:?}")]
    Timeout(std::time::Duration),
    /// The line to it is gone.
    #[error("the connection is lost: {0}")]
    Disconnected(String),
    /// It understood and refused.
    #[error("refused: {0}")]
    Refused(String),
    /// It answered what cannot be understood.
    #[error("expected {expected}, got {found:?}")]
    Garbled {
        /// What the protocol asks for here.
        expected: String,
        /// What came.
        found: String,
    },
    /// Its own hardware reports a fault.
    #[error("hardware fault: {0}")]
    Fault(String),
}

/// What every instrument can do.
#[async_trait]
pub trait Instrument: Send + Sync {
    /// Asks the instrument who it is.
    ///
    /// # Errors
    /// Any [`InstrumentError`]: it may not answer.
    async fn identify(&self) -> Result<Identity, InstrumentError>;
}

/// A stage with one axis. Positions are in the axis' own unit: millimetres for a rail, degrees for
/// a rotation stage; which one, [`Axis::unit`] says.
#[async_trait]
pub trait Axis: Instrument {
    /// Moves to `target` and returns when the stage stands there.
    ///
    /// # Errors
    /// Refused beyond its limits; any other [`InstrumentError`].
    async fn move_to(&self, target: f64) -> Result<(), InstrumentError>;
    /// Reads the encoder.
    ///
    /// # Errors
    /// Any [`InstrumentError`].
    async fn position(&self) -> Result<Reading, InstrumentError>;
    /// Stops at once.
    ///
    /// # Errors
    /// Any [`InstrumentError`]: then the stage may still move.
    async fn stop(&self) -> Result<(), InstrumentError>;
    /// The unit of positions.
    fn unit(&self) -> AxisUnit;
    /// Where a person moves it and the program only reads it: when it counts as standing. Its
    /// [`Axis::move_to`] then returns at once.
    fn by_hand(&self) -> Option<ByHand> {
        None
    }
    /// The search for its reference, where it needs one after power on.
    fn homing(&self) -> Option<&dyn Homing> {
        None
    }
}

/// A stage that finds its reference by moving to it.
#[async_trait]
pub trait Homing: Send + Sync {
    /// Searches it: the stage moves, perhaps over all of its travel. Returns when it stands.
    ///
    /// # Errors
    /// Any [`InstrumentError`].
    async fn home(&self) -> Result<(), InstrumentError>;
    /// Whether it knows its reference.
    ///
    /// # Errors
    /// Any [`InstrumentError`].
    async fn is_homed(&self) -> Result<bool, InstrumentError>;
}

/// When a stage that is moved by hand stands where it should.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ByHand {
    /// How far from the target it may stand, in the axis' unit.
    pub tolerance: f64,
    /// How long it must have stood.
    pub still_for: std::time::Duration,
}

/// The unit in which an axis counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum AxisUnit {
    /// Millimetres: a rail.
    Millimetre,
    /// Degrees: a rotation stage.
    Degree,
}

/// Whether a laser emits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Emission {
    /// It does not: read back, not assumed.
    Off,
    /// It does.
    On,
    /// Nobody knows: to be treated as on.
    Unknown,
}

/// A laser source. Off at connect; off whenever the program does not know better.
#[async_trait]
pub trait Laser: Instrument {
    /// Starts emission; returns when light comes out, its emission delay included.
    ///
    /// # Errors
    /// Any [`InstrumentError`]; emission is then unknown.
    async fn emit(&self) -> Result<(), InstrumentError>;
    /// Ends emission and reads back that it ended.
    ///
    /// # Errors
    /// Any [`InstrumentError`]; emission is then unknown: assume on.
    async fn off(&self) -> Result<(), InstrumentError>;
    /// Reads back whether it emits.
    async fn emission(&self) -> Emission;
    /// Last resort from a drop or a panic: sends "off" without waiting for an answer.
    fn off_without_waiting(&self);
    /// The contact that lets it emit, where it has one that can be read.
    fn interlock(&self) -> Option<&dyn Interlock> {
        None
    }
}

/// A safety contact (door, lid, key) without which a laser does not emit.
#[async_trait]
pub trait Interlock: Send + Sync {
    /// Reads whether it is closed.
    ///
    /// # Errors
    /// Any [`InstrumentError`]: then it counts as open.
    async fn is_closed(&self) -> Result<bool, InstrumentError>;
}

/// An instrument that is read: wavelength meter, thermometer.
#[async_trait]
pub trait Sensor: Instrument {
    /// Takes one reading.
    ///
    /// # Errors
    /// Any [`InstrumentError`].
    async fn read(&self) -> Result<Reading, InstrumentError>;
}

/// One picture as the camera delivered it.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// The camera's own bytes: a JPEG or PNG file.
    pub bytes: Vec<u8>,
    /// When the trigger was sent.
    pub requested: Stamp,
    /// When the picture was here.
    pub delivered: Stamp,
}

/// A camera that takes single pictures.
#[async_trait]
pub trait Camera: Instrument {
    /// Prepares for a trigger.
    ///
    /// # Errors
    /// Any [`InstrumentError`].
    async fn arm(&self) -> Result<(), InstrumentError>;
    /// Takes a picture and waits for it.
    ///
    /// # Errors
    /// Any [`InstrumentError`].
    async fn trigger(&self) -> Result<Frame, InstrumentError>;
    /// Gives up an [`Camera::arm`] that no trigger followed.
    ///
    /// # Errors
    /// Any [`InstrumentError`].
    async fn disarm(&self) -> Result<(), InstrumentError> {
        Ok(())
    }
}
