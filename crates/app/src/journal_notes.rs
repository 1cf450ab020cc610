//! What of a session's journal a reader of the report needs: what failed, was waited for, is
//! missing, was answered; and how long it took against the estimate.

use beampose_core::units::Second;
use beampose_core::{EventKind, SessionId};
use beampose_plan::check::clock;
use beampose_store::{Store, StoredSession};

use crate::input::Origin;

/// More of one kind than this are counted, not listed.
const LISTED: usize = 12;

/// The kinds of events that a report tells of, and what it calls them.
const TOLD: [(EventKind, &str); 13] = [
    (EventKind::LaserUnknown, "Laser unknown, assume on"),
    (EventKind::InterlockTripped, "Interlock"),
    (EventKind::StepFailed, "Failed"),
    (EventKind::Retried, "Tried again"),
    (EventKind::Skipped, "Skipped"),
    (EventKind::Missing, "Missing"),
    (EventKind::OutOfLimits, "Outside the limits"),
    (EventKind::Suspended, "Waited"),
    (EventKind::Released, "Went on"),
    (EventKind::Paused, "Paused"),
    (EventKind::StoreFailed, "Stored later"),
    (EventKind::ClockJumped, "Clock"),
    (EventKind::Answered, "Answered"),
];

/// Remarks on a session, one sentence each.
///
/// # Errors
/// When the store fails.
pub async fn notes(store: &Store, session: &StoredSession) -> anyhow::Result<Vec<String>> {
    let id = session.header.id;
    let mut notes: Vec<String> = took(session).into_iter().collect();
    let events = store.events(id).await?;
    for (kind, name) in TOLD {
        let of_kind: Vec<_> = events.iter().filter(|stored| stored.event.kind == kind).collect();
        for stored in of_kind.iter().take(LISTED) {
            let at = stored.event.at.utc.strftime("%H:%M:%S");
            notes.push(format!("{name} ({at} UTC): {}", stored.event.message));
        }
        if of_kind.len() > LISTED {
            notes.push(format!("{name}: {} more, in the journal", of_kind.len() - LISTED));
        }
    }
    Ok(notes)
}

/// How long a session took, against what was estimated when it began.
fn took(session: &StoredSession) -> Option<String> {
    let closed = session.closed?;
    let took = closed.monotonic.saturating_sub(session.header.opened.monotonic).as_secs_f64();
    let origin: Origin = serde_json::from_str(session.header.origin_json.as_deref()?).ok()?;
    let [estimate, from, to] = origin.estimated_s?.map(|seconds| clock(Second(seconds)));
    let took = clock(Second(took));
    Some(format!("It took {took}; estimated at its beginning: {estimate} ({from} to {to})"))
}

/// The readings outside the limits that the plan accepts, as reasons of the verdict.
///
/// # Errors
/// When the store fails.
pub async fn out_of_limits(store: &Store, id: SessionId) -> anyhow::Result<Vec<String>> {
    let events = store.events(id).await?;
    let outside = events.into_iter().filter(|stored| stored.event.kind == EventKind::OutOfLimits);
    Ok(outside.map(|stored| stored.event.message).collect())
}
