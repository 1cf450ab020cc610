//! The wish that a run stops, from whoever may have it: Ctrl-C, a web page, a supervisor.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

/// The ways to stop, each more urgent than the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Wish {
    /// Pause before the next step: a step that is stored is a checkpoint.
    Pause,
    /// Pause now: a wait, a move or a prompt is broken off, and done anew when the run goes on.
    PauseNow,
    /// End early and tidily: the step under way is finished if it acquires something, and
    /// `finally` runs.
    Stop,
    /// Break off: everything is made safe, then `finally` runs.
    Abort,
    /// Break off at once: everything is made safe, and nothing else is done.
    Halt,
}

impl Wish {
    /// Whether the run can go on after it.
    #[must_use]
    pub const fn is_pause(self) -> bool {
        matches!(self, Self::Pause | Self::PauseNow)
    }

    /// The word for it, as people give it.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Pause => "pause",
            Self::PauseNow => "pause-now",
            Self::Stop => "stop",
            Self::Abort => "abort",
            Self::Halt => "halt",
        }
    }
}

/// Asks a run to pause or to stop, and to go on. Cheap to clone: all clones are one handle.
///
/// A reading or a capture under way is always finished and kept; waits, moves, prompts and a
/// laser's emission delay are broken off by everything above [`Wish::Pause`]. While a run pauses,
/// everything is safe: lasers off, nothing moves. A more urgent wish replaces a less urgent one,
/// never the other way round.
#[derive(Debug, Clone, Default)]
pub struct Control(Arc<Inner>);

#[derive(Debug, Default)]
struct Inner {
    wish: Mutex<Option<(Wish, String)>>,
    notify: Notify,
}

impl Control {
    /// A handle that nobody has used yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Asks the run to stop in that way. `reason` goes into the journal: `Ctrl-C`.
    pub fn request(&self, wish: Wish, reason: &str) {
        {
            let mut current = self.lock();
            if current.as_ref().is_some_and(|(earlier, _)| *earlier >= wish) {
                return;
            }
            *current = Some((wish, reason.to_owned()));
        }
        self.0.notify.notify_waiters();
    }

    /// Lets a run that pauses, or is about to, go on.
    pub fn go_on(&self) {
        {
            let mut current = self.lock();
            if current.as_ref().is_none_or(|(wish, _)| !wish.is_pause()) {
                return;
            }
            *current = None;
        }
        self.0.notify.notify_waiters();
    }

    /// What is wished, and why.
    #[must_use]
    pub fn wish(&self) -> Option<(Wish, String)> {
        self.lock().clone()
    }

    /// Ready when something at least as urgent is wished.
    pub async fn reaches(&self, urgency: Wish) {
        self.until(|wish| wish.is_some_and(|wish| wish >= urgency)).await;
    }

    /// Ready when no pause is wished: the run is to go on, or to stop.
    pub async fn decided(&self) {
        self.until(|wish| wish.is_none_or(|wish| !wish.is_pause())).await;
    }

    async fn until(&self, is_so: impl Fn(Option<Wish>) -> bool) {
        loop {
            let notified = self.0.notify.notified();
            let mut notified = std::pin::pin!(notified);
            // Registered before looking: a request in between is not missed.
            notified.as_mut().enable();
            if is_so(self.lock().as_ref().map(|(wish, _)| *wish)) {
                return;
            }
            notified.await;
        }
    }

    fn lock(&self) -> MutexGuard<'_, Option<(Wish, String)>> {
        self.0.wish.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_more_urgent_wish_replaces_a_less_urgent_one_only() {
        let control = Control::new();
        control.request(Wish::PauseNow, "operator");
        control.request(Wish::Pause, "later");
        assert_eq!(control.wish(), Some((Wish::PauseNow, "operator".to_owned())));
        control.request(Wish::Abort, "SIGTERM");
        control.go_on();
        assert_eq!(control.wish(), Some((Wish::Abort, "SIGTERM".to_owned())));
    }

    #[test]
    fn who_waits_hears_of_a_pause_that_is_over() {
        let control = Control::new();
        control.request(Wish::Pause, "operator");
        let elsewhere = control.clone();
        let thread = std::thread::spawn(move || {
            std::thread::sleep(std::time::Duration::from_millis(20));
            elsewhere.go_on();
        });
        futures::executor::block_on(control.decided());
        assert!(thread.join().is_ok());
        assert_eq!(control.wish(), None);
    }
}
