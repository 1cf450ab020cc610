//! What goes wrong on a line, on demand.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
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
}

/// The trouble of one host: faults to come, a cable that may be pulled.
#[derive(Debug, Default)]
pub struct Trouble {
    next: Mutex<VecDeque<Fault>>,
    cuts: AtomicU64,
    unplugged: AtomicBool,
}

impl Trouble {
    /// The next answers have these faults, one each.
    pub fn next(&self, faults: impl IntoIterator<Item = Fault>) {
        self.next.lock().unwrap_or_else(PoisonError::into_inner).extend(faults);
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

    /// The fault of an answer.
    pub(super) fn take(&self) -> Option<Fault> {
        self.next.lock().unwrap_or_else(PoisonError::into_inner).pop_front()
    }
}
