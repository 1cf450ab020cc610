//! What goes wrong on a line, on demand.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::Duration;

/// What happens to one answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// It does not come.
    Silent,
    /// It comes so much later (real time).
    Late(Duration),
    /// Its bytes are wrong.
    Garbled,
    /// Only its first half comes.
    Half,
    /// Something that nobody asked for comes before it.
    Chatter,
    /// The device refuses what it was asked, in its own words.
    Refused,
    /// The cable is pulled before the device hears it.
    Cut,
    /// The device goes off and on again before it hears it.
    Reboot,
}

/// Who says what goes wrong with the question that just came.
type Source = Box<dyn Fn() -> Option<Fault> + Send + Sync>;

/// The trouble of one host: faults to come, a cable that may be pulled.
#[derive(Default)]
pub struct Trouble {
    next: Mutex<VecDeque<Fault>>,
    cuts: AtomicU64,
    unplugged: AtomicBool,
    source: OnceLock<Source>,
}

impl Trouble {
    /// The next answers have these faults, one each.
    pub fn next(&self, faults: impl IntoIterator<Item = Fault>) {
        self.next.lock().unwrap_or_else(PoisonError::into_inner).extend(faults);
    }

    /// From now on `source` is asked at each question; what [`Trouble::next`] was told comes first.
    /// Only the first source counts.
    pub fn from(&self, source: impl Fn() -> Option<Fault> + Send + Sync + 'static) {
        let _the_first_stays = self.source.set(Box::new(source));
    }

    /// Forgets the faults that have not happened yet.
    pub fn forget(&self) {
        self.next.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }

    /// All connections are cut, and can be made again.
    pub fn cut(&self) {
        self.cuts.fetch_add(1, Ordering::SeqCst);
    }

    /// The cable is pulled, or plugged in again.
    pub fn unplug(&self, unplugged: bool) {
        self.unplugged.store(unplugged, Ordering::SeqCst);
        if unplugged {
            self.cut();
        }
    }

    pub(super) fn cuts(&self) -> u64 {
        self.cuts.load(Ordering::SeqCst)
    }

    pub(super) fn is_unplugged(&self) -> bool {
        self.unplugged.load(Ordering::SeqCst)
    }

    /// The fault of the question that came and its answer.
    pub(super) fn take(&self) -> Option<Fault> {
        let next = self.next.lock().unwrap_or_else(PoisonError::into_inner).pop_front();
        next.or_else(|| self.source.get().and_then(|source| source()))
    }

    /// Puts a fault back that its question had no answer for.
    pub(super) fn keep(&self, fault: Fault) {
        self.next.lock().unwrap_or_else(PoisonError::into_inner).push_front(fault);
    }
}
