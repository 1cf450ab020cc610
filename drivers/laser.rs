//! The rules for lasers, in one place, for every driver of one.
//!
//! A family implements [`LaserDevice`], single commands and readings; [`GuardedLaser`] makes a
//! [`beampose_core::Laser`] of it and obeys the rules.
//! - Off and zero when connected, when connected again, and when dropped, be it in the middle of
//!   switching on.
//! - Arming is apart from emitting, and holds for one emission. All that must hold is read again
//!   just before light: contact, latch, temperature, limit and set point.
//! - The current's limit is programmed and read back before the output is enabled.
//! - Light is announced and comes no earlier than [`SHORTEST_DELAY`] after that. Until it comes the
//!   contact is looked at all the time.
//! - A contact that is open or cannot be read switches off and is latched: light comes back only
//!   after an off from outside with the contact closed again.
//! - Off is verified by the output's state and the measured current. What cannot be read is unknown,
//!   to be taken as on.
//! - On that nobody commanded is a fault, and is switched off.
//!
//! No software is an interlock: this one reads and reports it. Nothing here runs by itself: who has
//! a laser on must ask for its emission or contact twice a second, as the engine does.

pub(crate) mod diode;
mod guarded;

use std::time::Duration;

use async_trait::async_trait;
use beampose_core::{Identity, InstrumentError};

pub use guarded::GuardedLaser;

/// The law's shortest emission delay in practice: no driver goes below.
pub const SHORTEST_DELAY: Duration = Duration::from_secs(3);

/// What a family's driver does, one command each. Nothing here decides whether light may come.
#[async_trait]
pub trait LaserDevice: Send + Sync {
    /// Asks who it is.
    ///
    /// # Errors
    /// Any [`InstrumentError`], as in all of these.
    async fn identify(&self) -> Result<Identity, InstrumentError>;
    /// Makes sure of the connection. Whether it is new, so that the instrument has to be set up;
    /// what reading and switching off need of the interface is done already then.
    async fn is_new(&self) -> Result<bool, InstrumentError>;
    /// Sets modes, after output and set point are off and zero: no autostart, no modulation, the
    /// delay. Then the connection is no longer new.
    async fn set_up(&self) -> Result<(), InstrumentError>;
    /// Output on or off.
    async fn switch(&self, on: bool) -> Result<(), InstrumentError>;
    /// Whether the output is on.
    async fn is_on(&self) -> Result<bool, InstrumentError>;
    /// Sets the current, mA.
    async fn set_current(&self, ma: f64) -> Result<(), InstrumentError>;
    /// The current that is set, mA.
    async fn set_point(&self) -> Result<f64, InstrumentError>;
    /// Programs the current's limit, mA.
    async fn set_limit(&self, ma: f64) -> Result<(), InstrumentError>;
    /// The limit that is programmed, mA.
    async fn limit(&self) -> Result<f64, InstrumentError>;
    /// The current that flows, mA.
    async fn measured(&self) -> Result<f64, InstrumentError>;
    /// Whether the safety contact is closed.
    async fn interlock_closed(&self) -> Result<bool, InstrumentError>;
    /// Why the diode should not be driven now: its temperature is not in tolerance, say.
    async fn not_ready(&self) -> Result<Option<String>, InstrumentError>;
    /// The bytes of "off", sent without waiting.
    fn off_without_waiting(&self);
    /// From output on to current, where the device waits by itself.
    fn own_delay(&self) -> Duration {
        Duration::ZERO
    }
}
