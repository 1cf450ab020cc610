//! Bytes to and from an instrument, behind a trait, so that a driver runs alike on a serial line,
//! on TCP and on a recording.

use std::time::Duration;

use crate::instrument::InstrumentError;

/// A line of bytes to one instrument.
#[async_trait::async_trait]
pub trait Transport: Send + Sync {
    /// Sends all of `bytes`.
    ///
    /// # Errors
    /// [`InstrumentError::Disconnected`] when the line is gone, [`InstrumentError::Timeout`] when
    /// it does not take the bytes within `deadline`.
    async fn send(&self, bytes: &[u8], deadline: Duration) -> Result<(), InstrumentError>;

    /// Receives up to and with `terminator`.
    ///
    /// # Errors
    /// As [`Transport::send`].
    async fn receive_until(
        &self,
        terminator: u8,
        deadline: Duration,
    ) -> Result<Vec<u8>, InstrumentError>;
}
