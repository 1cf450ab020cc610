//! The clock of the laboratory.

use std::time::{Duration, Instant};

use beampose_core::clock::{BoxFuture, Clock, ExternalGuard, Stamp};

/// Real time, on tokio's timers.
#[derive(Debug, Clone)]
pub struct RealClock {
    start: Instant,
    offset: Duration,
}

impl RealClock {
    /// A clock whose monotonic offset begins now.
    #[must_use]
    pub fn start() -> Self {
        Self::resumed(Duration::ZERO)
    }

    /// A clock whose monotonic offset goes on from `offset`: that of a session that goes on.
    #[must_use]
    pub fn resumed(offset: Duration) -> Self {
        Self { start: Instant::now(), offset }
    }
}

impl Clock for RealClock {
    fn now(&self) -> Stamp {
        Stamp { monotonic: self.offset + self.start.elapsed(), utc: jiff::Timestamp::now() }
    }

    fn sleep(&self, duration: Duration) -> BoxFuture<'_, ()> {
        Box::pin(tokio::time::sleep(duration))
    }

    /// Real time goes on whatever is waited for.
    fn external(&self) -> ExternalGuard {
        ExternalGuard::default()
    }
}
