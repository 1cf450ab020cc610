//! A store that does not take what it is given.

use std::sync::Arc;

use async_trait::async_trait;
use beampose_core::{
    Event, Gap, RunSink, SessionHeader, SessionId, SessionOutcome, SinkError, Stamp, StepNumber,
    StepRecord,
};

use super::{FaultKind, Faults};

/// Who can do to what is stored what a failing disk does.
#[async_trait]
pub trait Spoil: Send + Sync {
    /// Damages a stored picture of a step.
    ///
    /// # Errors
    /// When even that fails.
    async fn spoil(&self, session: SessionId, step: StepNumber) -> Result<(), SinkError>;
}

/// A store with faults. What it is given while it has one is not stored.
pub struct FaultySink<'a> {
    inner: &'a dyn RunSink,
    disk: Box<dyn Spoil + 'a>,
    faults: Arc<Faults>,
}

impl<'a> FaultySink<'a> {
    /// The store, with the faults of `store`.
    #[must_use]
    pub fn new(inner: &'a dyn RunSink, disk: impl Spoil + 'a, faults: Arc<Faults>) -> Self {
        Self { inner, disk: Box::new(disk), faults }
    }
}

impl FaultySink<'_> {
    /// Stores a step, and has its picture damaged if that is to be.
    async fn stored(&self, session: SessionId, record: &StepRecord) -> Result<(), SinkError> {
        self.inner.step(session, record).await?;
        let pictures = record.capture.iter().flat_map(|capture| &capture.pictures);
        if pictures.count() > 0 && self.faults.strikes("store", &[FaultKind::CorruptBlob]).is_some()
        {
            self.disk.spoil(session, record.number).await?;
        }
        Ok(())
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
            None => return self.stored(session, record).await,
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
