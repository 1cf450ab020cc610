//! Onlookers of a run. None of them can delay or end it.
//!
//! A display ([`Observer`]) gets its notices on a thread of its own, through a bounded queue: one
//! that is slow misses notices, one that panics gets no more. The solving pipeline gets each
//! stored capture through one hook, which must only hand it over (a channel's `send`).
//!
//! To add an onlooker: implement [`Observer`], and [`Observers::display`] it.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use beampose_core::instrument::AxisUnit;
use beampose_core::{
    CaptureId, CaptureRecord, Event, InstrumentName, SessionHeader, StepNumber, StepRecord,
};
use beampose_plan::Step;

use crate::RunSummary;

/// How many notices a display may lag behind before it misses some. Notices hold no pictures.
const QUEUE: usize = 1024;

/// What happens in a run, as displays hear of it. Closed: whoever handles notices handles them all.
#[derive(Debug, Clone)]
pub enum Notice {
    /// The session is open in the store.
    Opened(Arc<SessionHeader>),
    /// A step begins.
    StepStarted(Arc<Step>),
    /// Something happened: a laser switched, an axis moved. Heard at once, stored with its step.
    Event(Event),
    /// The run stands, everything safe: for an operator, or until the store takes what it has.
    Paused {
        /// Why.
        reason: String,
    },
    /// It goes on.
    Continued,
    /// Where a stage is that somebody moves by hand, several times a second.
    ByHand {
        /// Which.
        axis: InstrumentName,
        /// The unit of both numbers.
        unit: AxisUnit,
        /// Where it is to stand.
        target: f64,
        /// Where it is.
        reading: f64,
    },
    /// A step ended and is stored. Its `capture` is empty: [`Notice::Captured`] tells of it.
    StepDone(Arc<StepRecord>),
    /// A capture is stored.
    Captured(Arc<CaptureSummary>),
    /// The run is over. Of a run whose session could not be closed in the store too.
    Closed(Arc<RunSummary>),
}

/// A stored capture, without its pictures.
#[derive(Debug, Clone, PartialEq)]
pub struct CaptureSummary {
    /// The step that took it.
    pub step: StepNumber,
    /// Its name within the session.
    pub id: CaptureId,
    /// The cameras that delivered.
    pub cameras: Vec<InstrumentName>,
    /// Where every axis was told to be.
    pub setpoints: std::collections::BTreeMap<String, f64>,
    /// What was read nearest to the trigger.
    pub readings: std::collections::BTreeMap<String, f64>,
}

/// Somebody who looks on: a progress bar, a web page.
pub trait Observer: Send {
    /// Something happened. Called on the observer's own thread, in order.
    fn notice(&mut self, notice: &Notice);
}

/// Gets each stored capture with its pictures.
type CaptureHook = Box<dyn Fn(CaptureRecord) + Send + Sync>;

/// Everybody who looks on a run.
#[derive(Default)]
pub struct Observers {
    displays: Vec<Display>,
    capture_hook: Option<CaptureHook>,
}

struct Display {
    queue: SyncSender<Notice>,
    missed: AtomicU64,
    /// Disconnected when the display's thread has ended.
    ended: Mutex<Receiver<()>>,
}

impl std::fmt::Debug for Observers {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Observers").field("displays", &self.displays.len()).finish_non_exhaustive()
    }
}

impl Observers {
    /// Nobody.
    #[must_use]
    pub fn none() -> Self {
        Self::default()
    }

    /// Adds a display, which gets its own thread and queue.
    #[must_use]
    pub fn display(mut self, observer: impl Observer + 'static) -> Self {
        let (queue, notices) = sync_channel::<Notice>(QUEUE);
        let (running, ended) = sync_channel::<()>(0);
        std::thread::spawn(move || {
            let _running = running;
            show(observer, &notices);
        });
        self.displays.push(Display { queue, missed: AtomicU64::new(0), ended: Mutex::new(ended) });
        self
    }

    /// Sets the hook that gets each capture once it is stored, to be solved while the run goes on.
    /// It is called on the run's own task: it must hand over and return.
    #[must_use]
    pub fn on_capture(mut self, hook: impl Fn(CaptureRecord) + Send + Sync + 'static) -> Self {
        self.capture_hook = Some(Box::new(hook));
        self
    }

    /// Lets the displays show what is still queued, for at most `patience`; returns how many
    /// notices displays missed. To be called after the run; dropping instead waits for nobody.
    pub fn finish(self, patience: Duration) -> u64 {
        let until = Instant::now() + patience;
        let mut missed = 0;
        for Display { queue, missed: count, ended } in self.displays {
            drop(queue);
            let ended = ended.into_inner().unwrap_or_else(PoisonError::into_inner);
            let left = until.saturating_duration_since(Instant::now());
            if ended.recv_timeout(left) == Err(RecvTimeoutError::Timeout) {
                tracing::debug!("a display did not finish in time");
            }
            missed += count.load(Ordering::Relaxed);
        }
        missed
    }

    pub(crate) fn tell(&self, notice: &Notice) {
        for display in &self.displays {
            if display.queue.try_send(notice.clone()).is_err() {
                display.missed.fetch_add(1, Ordering::Relaxed);
            }
        }
    }

    /// Hands a stored capture on: its summary to the displays, itself to the hook.
    pub(crate) fn captured(&self, step: StepNumber, capture: CaptureRecord) {
        self.tell(&Notice::Captured(Arc::new(CaptureSummary {
            step,
            id: capture.id.clone(),
            cameras: capture.pictures.iter().map(|picture| picture.camera.clone()).collect(),
            setpoints: capture.setpoints.clone(),
            readings: capture.readings.clone(),
        })));
        if let Some(hook) = &self.capture_hook
            && catch_unwind(AssertUnwindSafe(|| hook(capture))).is_err()
        {
            // The capture is stored: it can be solved again at any time.
            tracing::error!("the capture of step {step} could not be handed on to be solved");
        }
    }
}

fn show(mut observer: impl Observer, notices: &Receiver<Notice>) {
    for notice in notices {
        if catch_unwind(AssertUnwindSafe(|| observer.notice(&notice))).is_err() {
            tracing::warn!("a display failed and gets no more notices");
            return;
        }
    }
}
