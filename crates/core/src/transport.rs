//! Bytes to and from an instrument, behind a trait, so that a driver runs alike on a serial line,
//! on TCP and on a recording.

use std::time::Duration;

use crate::instrument::InstrumentError;

/// A line of bytes to one instrument. Deadlines are real time: bytes do not wait for a virtual one.
#[async_trait::async_trait]
pub trait Transport: Send + Sync {
    /// Opens the line where it is not open. Returns how often it was opened so far: a driver that
    /// sees a number it has not seen sets its instrument up again.
    ///
    /// # Errors
    /// [`InstrumentError::Disconnected`] with the reason and its cure, [`InstrumentError::Timeout`].
    async fn open(&self, deadline: Duration) -> Result<u64, InstrumentError>;

    /// Sends all of `bytes`.
    ///
    /// # Errors
    /// [`InstrumentError::Disconnected`] when the line is gone, [`InstrumentError::Timeout`] when
    /// it does not take the bytes within `deadline`.
    async fn send(&self, bytes: &[u8], deadline: Duration) -> Result<(), InstrumentError>;

    /// Receives up to and with `terminator`.
    ///
    /// # Errors
    /// As [`Transport::send`]; [`InstrumentError::Garbled`] when too much comes without one.
    async fn receive_until(
        &self,
        terminator: u8,
        deadline: Duration,
    ) -> Result<Vec<u8>, InstrumentError>;

    /// Receives `count` bytes.
    ///
    /// # Errors
    /// As [`Transport::send`].
    async fn receive_exactly(
        &self,
        count: usize,
        deadline: Duration,
    ) -> Result<Vec<u8>, InstrumentError>;

    /// Throws away what came and nobody received, until nothing comes for `quiet`.
    ///
    /// # Errors
    /// As [`Transport::send`].
    async fn discard(&self, quiet: Duration) -> Result<(), InstrumentError>;

    /// Gives the connection up; the next [`Transport::open`] makes a new one.
    async fn close(&self);

    /// From a drop or a panic: hands `bytes` to the line, past everything that waits, and does not
    /// ask what becomes of them.
    fn send_without_waiting(&self, bytes: &[u8]);
}
