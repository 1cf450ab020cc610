//! Faults on demand: what goes wrong with simulated instruments, store and clock, and when.
//!
//! Each instrument is wrapped in one that fails as told and else passes on what it is asked. The
//! program meets such a fault as it would meet the real one: through the instrument's trait.
//!
//! To add a fault: a [`FaultKind`], its effect in the wrapper of what can have it, its word in the
//! rig, its rows in the app's fault matrix.

mod clock;
mod instruments;
mod sink;

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use beampose_core::{Clock, InstrumentError};
use rand::RngExt as _;

pub use self::clock::FaultyClock;
pub use self::instruments::{FaultyAxis, FaultyCamera, FaultyLaser, FaultySensor};
pub use self::sink::{FaultySink, Spoil};
use crate::streams::{Purpose, Streams};

/// How late a late answer is.
pub const LATE: Duration = Duration::from_secs(3);

/// What goes wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultKind {
    /// Whatever it is asked, it does not answer.
    NoAnswer,
    /// It answers, or does what it should, [`LATE`].
    LateAnswer,
    /// It answers what cannot be understood.
    Garbled,
    /// The line to it is gone.
    Disconnect,
    /// It understands, and refuses.
    Refused,
    /// It goes off and on again, and has forgotten what it was told.
    Reboot,
    /// An axis reads 5 units off; a sensor reads no number; a laser reads back as on.
    WrongReadback,
    /// An axis sets off and does not arrive.
    Stall,
    /// An axis stands 1 unit beyond its target, and says it arrived.
    Overshoot,
    /// A camera loses a picture, and says so.
    DroppedFrame,
    /// Of a picture only the first half arrives.
    TruncatedFrame,
    /// A camera delivers a black picture.
    BlackFrame,
    /// A camera answers nothing once it is triggered.
    CameraHangs,
    /// A laser's interlock opens: it goes dark, and stays so until it closes.
    InterlockTrip,
    /// The wavelength hops by 0.3 nm.
    WavelengthHop,
    /// The store has no room.
    DiskFull,
    /// Another program holds the database.
    DatabaseBusy,
    /// A stored picture changes on the disk, once its step is stored.
    CorruptBlob,
    /// The wall clock jumps by an hour.
    ClockJump,
}

impl FaultKind {
    /// What a line does, whatever is at its end.
    pub const LINE: [Self; 6] = [
        Self::NoAnswer,
        Self::LateAnswer,
        Self::Garbled,
        Self::Disconnect,
        Self::Refused,
        Self::Reboot,
    ];
}

/// One fault, and when it comes.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    /// Of what: an instrument's name, `store` or `clock`.
    pub instrument: String,
    /// What goes wrong.
    pub kind: FaultKind,
    /// Only in this step.
    pub at_step: Option<u32>,
    /// Only after this time of the session.
    pub after: Option<Duration>,
    /// Only so long from then on, or from the moment in which it came.
    pub lasts: Option<Duration>,
    /// With this probability each time that it could come.
    pub probability: f64,
    /// So many times at most.
    pub times: u32,
}

#[derive(Debug, Default)]
struct Past {
    /// How often it could have come.
    calls: u64,
    /// How often it came.
    came: u32,
    /// When it came first.
    since: Option<Duration>,
}

/// All faults of a rig.
pub struct Faults {
    faults: Vec<(Fault, Mutex<Past>)>,
    streams: Streams,
    clock: Arc<dyn Clock>,
    /// The step under way.
    step: Arc<AtomicU32>,
}

impl Faults {
    /// Faults on a clock, drawn from a seed; `step` holds the number of the step under way.
    #[must_use]
    pub fn new(
        faults: Vec<Fault>,
        seed: u64,
        clock: Arc<dyn Clock>,
        step: Arc<AtomicU32>,
    ) -> Arc<Self> {
        let faults = faults.into_iter().map(|fault| (fault, Mutex::default())).collect();
        Arc::new(Self { faults, streams: Streams::new(seed), clock, step })
    }

    /// What a line does now to what is asked of an instrument over it: for a simulator of its bytes,
    /// which does it itself. Of the kinds of [`FaultKind::LINE`].
    #[must_use]
    pub fn on_the_line(&self, instrument: &str) -> Option<FaultKind> {
        self.strikes(instrument, &FaultKind::LINE)
    }

    /// What goes wrong with an instrument now, of these kinds; it then counts as having come.
    fn strikes(&self, instrument: &str, kinds: &[FaultKind]) -> Option<FaultKind> {
        let all = self.faults.iter().enumerate();
        let mut of_it =
            all.filter(|(_, (f, _))| f.instrument == instrument && kinds.contains(&f.kind));
        of_it
            .find(|(i, (fault, past))| self.comes(*i, fault, past))
            .map(|(_, (fault, _))| fault.kind)
    }

    fn comes(&self, index: usize, fault: &Fault, past: &Mutex<Past>) -> bool {
        let now = self.clock.now().monotonic;
        let mut past = past.lock().unwrap_or_else(PoisonError::into_inner);
        if let (Some(since), Some(lasts)) = (past.since, fault.lasts)
            && now.saturating_sub(since) < lasts
        {
            return true;
        }
        let in_step = fault.at_step.is_none_or(|step| step == self.step.load(Ordering::Relaxed));
        let in_time = fault.after.is_none_or(|after| now >= after);
        if !in_step || !in_time || past.came >= fault.times {
            return false;
        }
        let item = (index as u64) << 32 | past.calls & 0xffff_ffff;
        past.calls += 1;
        let drawn: f64 = self.streams.item(Purpose::Fault, item).random();
        let comes = drawn < fault.probability;
        if comes {
            past.came += 1;
            past.since.get_or_insert(now);
        }
        comes
    }

    /// What a line does to whatever is asked over it.
    async fn line(&self, instrument: &str) -> Result<(), InstrumentError> {
        use FaultKind::{Disconnect, Garbled, LateAnswer, NoAnswer, Reboot, Refused};
        match self.strikes(instrument, &FaultKind::LINE) {
            Some(NoAnswer) => std::future::pending().await,
            Some(LateAnswer) => {
                self.clock.sleep(LATE).await;
                Ok(())
            }
            Some(Garbled) => Err(InstrumentError::Garbled {
                expected: "OK".to_owned(),
                found: "\u{fffd}#\u{7}".to_owned(),
            }),
            Some(Disconnect | Reboot) => Err(InstrumentError::Disconnected("simulated".to_owned())),
            Some(Refused) => Err(InstrumentError::Refused("simulated".to_owned())),
            _ => Ok(()),
        }
    }
}

impl std::fmt::Debug for Faults {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Faults").field("faults", &self.faults).finish_non_exhaustive()
    }
}
