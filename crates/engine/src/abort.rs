//! The wish to stop, from whoever may have it: Ctrl-C, a web page, a supervisor.

use std::sync::{Arc, OnceLock};

use tokio::sync::Notify;

/// Asks a run to stop. Cheap to clone: all clones are one handle.
///
/// Waits, moves and a laser's emission delay are interrupted; a reading or a capture under way is
/// finished and kept. Then, lasers first, everything is made safe, `finally` runs, and the session
/// closes as aborted. Asking again changes nothing.
#[derive(Debug, Clone, Default)]
pub struct AbortHandle(Arc<Inner>);

#[derive(Debug, Default)]
struct Inner {
    reason: OnceLock<String>,
    notify: Notify,
}

impl AbortHandle {
    /// A handle that nobody has used yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Asks the run to stop. `reason` goes into the journal: `Ctrl-C`. The first reason stays.
    pub fn request(&self, reason: &str) {
        let _the_first_stays = self.0.reason.set(reason.to_owned());
        self.0.notify.notify_waiters();
    }

    /// Why the run is to stop, once somebody asked.
    #[must_use]
    pub fn reason(&self) -> Option<&str> {
        self.0.reason.get().map(String::as_str)
    }

    /// Ready when somebody asked.
    pub async fn requested(&self) {
        let notified = self.0.notify.notified();
        let mut notified = std::pin::pin!(notified);
        // Registered before looking: a request in between is not missed.
        notified.as_mut().enable();
        if self.reason().is_none() {
            notified.await;
        }
    }
}
