//! The contacts of the lasers that are on, looked at all the time: while a step moves, waits or
//! acquires, and while it is stored.
//!
//! [`Lit`] is what is on. The runner's steps say so, and [`Lit::watch`] runs beside them on the same
//! task. A contact that is open or cannot be read trips: the light goes out, and nothing here lets it
//! come back. Where nothing that has a contact is on, nothing is looked at and nothing waits.

use std::collections::BTreeSet;
use std::convert::Infallible;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use beampose_core::clock::{Clock, within};
use beampose_core::{Event, EventKind, InstrumentName, Laser};
use futures::future::join_all;
use tokio::sync::Notify;

use crate::Bench;
use crate::safe_state::{Cause, switch_off};

/// From one look to the next: two a second is what a laser of class 3B asks for at least.
const EVERY: Duration = Duration::from_millis(400);
/// A contact that has not answered after so long counts as open.
const ANSWER: Duration = Duration::from_secs(2);

/// A laser whose contact was not closed while it was on, and what was read instead.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Trip {
    pub(crate) laser: InstrumentName,
    pub(crate) why: String,
}

/// The lasers that are on, and what befell them. Clones are one.
#[derive(Debug, Clone, Default)]
pub(crate) struct Lit(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    state: Mutex<State>,
    changed: Notify,
}

#[derive(Debug, Default)]
struct State {
    on: BTreeSet<InstrumentName>,
    /// The first trip since everything was made safe.
    trip: Option<Trip>,
    /// What is not in the journal yet.
    events: Vec<Event>,
}

impl Lit {
    fn state(&self) -> MutexGuard<'_, State> {
        self.0.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.state().on.is_empty()
    }

    pub(crate) fn insert(&self, laser: InstrumentName) {
        self.state().on.insert(laser);
        self.0.changed.notify_waiters();
    }

    /// It was switched off, whatever befell it before.
    pub(crate) fn remove(&self, laser: &InstrumentName) {
        let mut state = self.state();
        state.on.remove(laser);
        state.trip.take_if(|trip| trip.laser == *laser);
    }

    /// All were switched off.
    pub(crate) fn clear(&self) {
        let mut state = self.state();
        state.on.clear();
        state.trip = None;
    }

    pub(crate) fn trip(&self) -> Option<Trip> {
        self.state().trip.clone()
    }

    /// What happened since it was last asked.
    pub(crate) fn take_events(&self) -> Vec<Event> {
        std::mem::take(&mut self.state().events)
    }

    /// Ready when a contact was not closed.
    pub(crate) async fn tripped(&self) -> Trip {
        self.until(|state| state.trip.clone()).await
    }

    async fn until<T>(&self, is_so: impl Fn(&State) -> Option<T>) -> T {
        loop {
            let mut changed = std::pin::pin!(self.0.changed.notified());
            // Registered before looking: a change in between is not missed.
            changed.as_mut().enable();
            let found = is_so(&self.state());
            if let Some(found) = found {
                return found;
            }
            changed.await;
        }
    }

    /// Looks at the contact of every laser that is on, for as long as it is polled.
    pub(crate) async fn watch(&self, bench: &Bench, clock: &dyn Clock) -> Infallible {
        loop {
            let lasers = self.until(|state| with_contacts(&state.on, bench)).await;
            let next = clock.now().monotonic + EVERY;
            join_all(lasers.into_iter().map(|(name, it)| self.look(name, it, clock))).await;
            clock.sleep(next.saturating_sub(clock.now().monotonic)).await;
        }
    }

    async fn look(&self, name: InstrumentName, laser: &dyn Laser, clock: &dyn Clock) {
        let Err(why) = is_closed(laser, clock).await else { return };
        {
            let mut state = self.state();
            // Told off while it was asked: whatever it said, there is no light.
            if !state.on.remove(&name) {
                return;
            }
            // Before anything that waits.
            laser.off_without_waiting();
            let message = format!("{name}: its interlock {why} while it was on");
            let kind = EventKind::InterlockTripped;
            state.events.push(Event { at: clock.now(), kind, message });
            state.trip.get_or_insert(Trip { laser: name.clone(), why });
        }
        self.0.changed.notify_waiters();
        let off = switch_off(&name, laser, clock, &Cause::Tripped).await;
        self.state().events.push(off);
    }
}

/// The lasers among those that are on that have a contact; `None` where none has.
fn with_contacts<'a>(
    on: &BTreeSet<InstrumentName>,
    bench: &'a Bench,
) -> Option<Vec<(InstrumentName, &'a dyn Laser)>> {
    let named = on.iter().filter_map(|name| Some((name.clone(), bench.laser(name).ok()?)));
    let lasers: Vec<_> = named.filter(|(_, laser)| laser.interlock().is_some()).collect();
    (!lasers.is_empty()).then_some(lasers)
}

/// Whether a laser's contact is closed, or it has none; why not, to follow "its interlock".
pub(crate) async fn is_closed(laser: &dyn Laser, clock: &dyn Clock) -> Result<(), String> {
    let Some(interlock) = laser.interlock() else { return Ok(()) };
    match within(clock, ANSWER, interlock.is_closed()).await {
        Ok(Ok(true)) => Ok(()),
        Ok(Ok(false)) => Err("was open".to_owned()),
        Ok(Err(error)) => Err(format!("could not be read ({error})")),
        Err(limit) => Err(format!("did not answer within {limit:?}")),
    }
}
