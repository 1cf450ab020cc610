//! A store that does not take what it is given.

use std::sync::Arc;

use async_trait::async_trait;
use beampose_core::{
    Event, Gap, RunSink, SessionHeader, SessionId, SessionOutcome, SinkError, Stamp, StepRecord,
};

use super::{FaultKind, Faults};

/// A store with faults. What it is given while it has one is not stored.
pub struct FaultySink<'a> {
    inner: &'a dyn RunSink,
    faults: Arc<Faults>,
}

impl<'a> FaultySink<'a> {
    /// The store, with the faults of `store`.
    #[must_use]
    pub fn new(inner: &'a dyn RunSink, faults: Arc<Faults>) -> Self {
        Self { inner, faults }
    }
}

#[async_trait]
impl RunSink for FaultySink<'_> {
    async fn open(&self, header: &SessionHeader) -> Result<(), SinkError> {
        self.inner.open(header).await
    }

    async fn reopen(&self, session: SessionId, gap: &Gap) -> Result<(), SinkError> {
        self.inner.reopen(session, gap).await
    }

    async fn step(&self, session: SessionId, record: &StepRecord) -> Result<(), SinkError> {
        let kinds = [FaultKind::DiskFull, FaultKind::DatabaseBusy];
        let reason = match self.faults.strikes("store", &kinds) {
            Some(FaultKind::DiskFull) => "database or disk is full (simulated)",
            Some(_) => "the database is locked by another program (simulated)",
            None => return self.inner.step(session, record).await,
        };
        Err(SinkError { what: format!("step {}", record.number), reason: reason.to_owned() })
    }

    async fn close(
        &self,
        session: SessionId,
        outcome: SessionOutcome,
        events: &[Event],
        at: Stamp,
    ) -> Result<(), SinkError> {
        self.inner.close(session, outcome, events, at).await
    }

    fn free_bytes(&self) -> Option<u64> {
        self.inner.free_bytes()
    }
}
