//! A wall clock that jumps, as when somebody sets it; what is measured does not depend on it.

use std::sync::Arc;
use std::time::Duration;

use beampose_core::clock::{BoxFuture, Clock, ExternalGuard, Stamp};
use jiff::SignedDuration;

use super::{FaultKind, Faults};

/// How far the clock jumps.
const JUMP: SignedDuration = SignedDuration::from_hours(1);

/// A clock with faults.
pub struct FaultyClock {
    inner: Arc<dyn Clock>,
    faults: Arc<Faults>,
}

impl FaultyClock {
    /// The clock, with the faults of `clock`.
    #[must_use]
    pub fn new(inner: Arc<dyn Clock>, faults: Arc<Faults>) -> Self {
        Self { inner, faults }
    }
}

impl Clock for FaultyClock {
    fn now(&self) -> Stamp {
        let now = self.inner.now();
        if self.faults.strikes("clock", &[FaultKind::ClockJump]).is_none() {
            return now;
        }
        Stamp { utc: now.utc.checked_add(JUMP).unwrap_or(now.utc), ..now }
    }

    fn sleep(&self, duration: Duration) -> BoxFuture<'_, ()> {
        self.inner.sleep(duration)
    }

    fn external(&self) -> ExternalGuard {
        self.inner.external()
    }
}
