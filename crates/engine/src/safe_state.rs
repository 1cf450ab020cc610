//! The safe state, in one place: lasers off and read back as off, then nothing moves.
//!
//! Off at the start of a session, at its end, on abort and on error; a [`LaserGuard`] sends a last
//! "off" when a run ends in any other way. A laser that does not confirm is reported as unknown:
//! nothing here guesses. Software is no interlock; the hardware's own is beneath all this.

use std::collections::BTreeSet;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

use beampose_core::clock::{Clock, within};
use beampose_core::{Emission, Event, EventKind, InstrumentName, Laser, StepNumber};

use crate::Bench;
use crate::control::Wish;
use crate::machine::Lasers;

/// How long a laser may take to confirm that it is off, and an axis to confirm that it stopped:
/// several tries over a slow serial line, yet short to somebody who stands beside it.
pub const SAFE_STATE_DEADLINE: Duration = Duration::from_secs(5);

/// Why everything is made safe: the reason in the journal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Cause {
    /// The session begins.
    SessionStart,
    /// The plan says so.
    Planned(StepNumber),
    /// A step failed.
    StepFailed(StepNumber),
    /// Somebody asked to stop: how, and why.
    Wished(Wish, String),
    /// A condition does not hold.
    Suspended(String),
    /// The interlock of a laser that was on was not closed.
    Tripped,
    /// The instruments did not all answer.
    NotPrepared,
    /// What a step acquired could not be stored.
    NotStored(StepNumber),
    /// The session ends.
    SessionEnd,
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SessionStart => f.write_str("start of session"),
            Self::Planned(step) => write!(f, "step {step}"),
            Self::StepFailed(step) => write!(f, "step {step} failed"),
            Self::Wished(wish, reason) => write!(f, "{}: {reason}", wish.as_str()),
            Self::Suspended(why) => f.write_str(why),
            Self::Tripped => f.write_str("interlock"),
            Self::NotPrepared => f.write_str("preparation failed"),
            Self::NotStored(step) => write!(f, "step {step} could not be stored"),
            Self::SessionEnd => f.write_str("end of session"),
        }
    }
}

/// Switches one laser off and reads it back. The event says what is known then:
/// [`EventKind::LaserOff`] or [`EventKind::LaserUnknown`].
pub async fn switch_off(
    name: &InstrumentName,
    laser: &dyn Laser,
    clock: &dyn Clock,
    cause: &Cause,
) -> Event {
    let told = within(clock, SAFE_STATE_DEADLINE, laser.off()).await;
    let doubt = match told {
        Err(deadline) => Some(format!("it did not answer \"off\" within {deadline:?}")),
        Ok(Err(error)) => Some(format!("\"off\" failed: {error}")),
        Ok(Ok(())) => match within(clock, SAFE_STATE_DEADLINE, laser.emission()).await {
            Ok(Emission::Off) => None,
            Ok(Emission::On) => Some("it reads back as on".to_owned()),
            Ok(Emission::Unknown) => Some("its emission cannot be read back".to_owned()),
            Err(deadline) => Some(format!("it was not read back within {deadline:?}")),
        },
    };
    let at = clock.now();
    match doubt {
        None => {
            let message = format!("{name} off, read back as off ({cause})");
            Event { at, kind: EventKind::LaserOff, message }
        }
        Some(doubt) => {
            laser.off_without_waiting();
            let message = format!("{name} unknown, assume on: {doubt} ({cause})");
            Event { at, kind: EventKind::LaserUnknown, message }
        }
    }
}

/// What may not be as it should.
#[derive(Debug, Default)]
pub struct Unsettled {
    /// Axes that may move.
    pub moving: BTreeSet<InstrumentName>,
    /// Cameras that may wait for a trigger.
    pub armed: BTreeSet<InstrumentName>,
}

/// Makes everything safe: all lasers off, together; then the axes that may move stopped; then the
/// cameras that may wait for a trigger disarmed.
pub async fn secure(
    bench: &Bench,
    unsettled: Unsettled,
    clock: &dyn Clock,
    cause: &Cause,
) -> (Lasers, Vec<Event>) {
    let offs = bench.lasers.iter().map(|(name, laser)| switch_off(name, &**laser, clock, cause));
    let mut events = futures::future::join_all(offs).await;
    let unknown = events.iter().any(|event| event.kind == EventKind::LaserUnknown);
    events.extend(settle(bench, unsettled, clock, cause).await);
    (if unknown { Lasers::Unknown } else { Lasers::Off }, events)
}

/// Stops the axes that may move, then disarms the cameras that may wait for a trigger.
pub(crate) async fn settle(
    bench: &Bench,
    unsettled: Unsettled,
    clock: &dyn Clock,
    cause: &Cause,
) -> Vec<Event> {
    let stops = unsettled.moving.iter().map(|name| stop(name, bench, clock, cause));
    let stops = futures::future::join_all(stops).await;
    let cameras = unsettled.armed.iter().filter_map(|name| bench.camera(name).ok());
    // A camera that does not answer takes no picture that anybody asks for.
    let disarms = cameras.map(|camera| within(clock, SAFE_STATE_DEADLINE, camera.disarm()));
    let _answers = futures::future::join_all(disarms).await;
    stops
}

async fn stop(name: &InstrumentName, bench: &Bench, clock: &dyn Clock, cause: &Cause) -> Event {
    let stopped = match bench.axis(name) {
        Err(error) => Err(error.to_string()),
        Ok(axis) => match within(clock, SAFE_STATE_DEADLINE, axis.stop()).await {
            Ok(answer) => answer.map_err(|error| error.to_string()),
            Err(deadline) => Err(format!("no answer within {deadline:?}")),
        },
    };
    let at = clock.now();
    match stopped {
        Ok(()) => {
            Event { at, kind: EventKind::Moved, message: format!("{name} stopped ({cause})") }
        }
        Err(reason) => {
            let message = format!("{name} may still move: stopping failed: {reason} ({cause})");
            Event { at, kind: EventKind::StepFailed, message }
        }
    }
}

/// Sends "off" to every laser when it is dropped armed: by a panic, by a run that is dropped
/// midway, by an early return. It waits for no answer, so that it also works while unwinding.
#[derive(Debug)]
pub struct LaserGuard<'a> {
    bench: &'a Bench,
    armed: bool,
}

impl<'a> LaserGuard<'a> {
    /// An armed guard of all lasers on the bench.
    #[must_use]
    pub fn armed(bench: &'a Bench) -> Self {
        Self { bench, armed: true }
    }

    /// For when every laser has confirmed that it is off.
    pub fn disarm(mut self) {
        self.armed = false;
    }
}

impl Drop for LaserGuard<'_> {
    fn drop(&mut self) {
        if !self.armed {
            return;
        }
        for (name, laser) in &self.bench.lasers {
            // One driver's panic must not leave the next laser on.
            if catch_unwind(AssertUnwindSafe(|| laser.off_without_waiting())).is_err() {
                tracing::error!("{name} unknown, assume on: its last \"off\" panicked");
            }
        }
    }
}
