//! A line as drivers use it: one conversation at a time.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use beampose_core::InstrumentError;
use beampose_core::transport::Transport;
use futures::lock::{Mutex, MutexGuard};

/// A line that several drivers may share. Question and answer are not interrupted by another's.
pub struct Line {
    transport: Arc<dyn Transport>,
    turn: Mutex<()>,
    deadline: Duration,
    /// An answer did not come in time: it may still come, whole or in part.
    owed: AtomicBool,
}

impl Line {
    /// A line on which each step may take `deadline`, of real time.
    #[must_use]
    pub fn new(transport: Arc<dyn Transport>, deadline: Duration) -> Self {
        Self { transport, turn: Mutex::new(()), deadline, owed: AtomicBool::new(false) }
    }

    fn noted<T>(&self, received: Result<T, InstrumentError>) -> Result<T, InstrumentError> {
        if matches!(received, Err(InstrumentError::Timeout(_) | InstrumentError::Garbled { .. })) {
            self.owed.store(true, Ordering::SeqCst);
        }
        received
    }
}

/// One instrument's place on a line, which others may share.
pub struct Party {
    line: Arc<Line>,
    /// How often the line was opened when the instrument was last set up.
    seen: AtomicU64,
}

impl Party {
    /// A place of its own on a line.
    #[must_use]
    pub const fn new(line: Arc<Line>) -> Self {
        Self { line, seen: AtomicU64::new(0) }
    }

    /// Waits for its turn, and sees that the line is open and that no answer of before comes in
    /// between: after one that did not come in time it waits until the line is quiet. Where the line
    /// was opened since, [`Talk::is_new`] says so, until [`Talk::is_set_up`].
    ///
    /// # Errors
    /// As [`Transport::open`].
    pub async fn talk(&self) -> Result<Talk<'_>, InstrumentError> {
        let line = &*self.line;
        let turn = line.turn.lock().await;
        let opened = line.transport.open(line.deadline.max(CONNECT)).await?;
        if line.owed.load(Ordering::SeqCst) {
            line.transport.discard(line.deadline * 2).await?;
            // Not before: whoever waits here may be given up as well.
            line.owed.store(false, Ordering::SeqCst);
        }
        Ok(Talk { line, opened, seen: &self.seen, midway: false, _turn: turn })
    }

    /// From a drop or a panic: see [`Transport::send_without_waiting`].
    pub fn send_without_waiting(&self, bytes: &[u8]) {
        self.line.transport.send_without_waiting(bytes);
    }
}

/// A connection may take longer than an answer.
const CONNECT: Duration = Duration::from_millis(500);

/// One's turn on a line.
pub struct Talk<'a> {
    line: &'a Line,
    opened: u64,
    seen: &'a AtomicU64,
    /// Something was begun that has not ended.
    midway: bool,
    _turn: MutexGuard<'a, ()>,
}

impl Drop for Talk<'_> {
    /// A call that is given up midway, as a move is where somebody stops it, leaves an answer behind
    /// that nobody waits for, or half of one.
    fn drop(&mut self) {
        if self.midway {
            self.is_lost();
        }
    }
}

impl Talk<'_> {
    /// Whether the line was opened since this driver last set its instrument up.
    #[must_use]
    pub fn is_new(&self) -> bool {
        self.seen.load(Ordering::SeqCst) != self.opened
    }

    /// Says that the instrument is set up on this connection.
    pub fn is_set_up(&self) {
        self.seen.store(self.opened, Ordering::SeqCst);
    }

    /// Sends.
    ///
    /// # Errors
    /// As [`Transport::send`].
    pub async fn send(&mut self, bytes: &[u8]) -> Result<(), InstrumentError> {
        self.midway = true;
        let sent = self.line.transport.send(bytes, self.line.deadline).await;
        self.midway = false;
        sent
    }

    /// Receives up to a terminator.
    ///
    /// # Errors
    /// As [`Transport::receive_until`].
    pub async fn until(&mut self, terminator: u8) -> Result<Vec<u8>, InstrumentError> {
        self.midway = true;
        let received = self.line.transport.receive_until(terminator, self.line.deadline).await;
        self.midway = false;
        self.line.noted(received)
    }

    /// Receives `count` bytes.
    ///
    /// # Errors
    /// As [`Transport::receive_exactly`].
    pub async fn exactly(&mut self, count: usize) -> Result<Vec<u8>, InstrumentError> {
        self.midway = true;
        let received = self.line.transport.receive_exactly(count, self.line.deadline).await;
        self.midway = false;
        self.line.noted(received)
    }

    /// Says that what came was no answer: the next talk begins when the line is quiet.
    pub fn is_lost(&self) {
        self.line.owed.store(true, Ordering::SeqCst);
    }

    /// Throws away what comes until it is quiet.
    ///
    /// # Errors
    /// As [`Transport::discard`].
    pub async fn discard(&mut self, quiet: Duration) -> Result<(), InstrumentError> {
        self.line.transport.discard(quiet).await
    }

    /// Gives the connection up: the cure where a protocol cannot find its place again.
    pub async fn hang_up(self) {
        self.line.transport.close().await;
    }
}
