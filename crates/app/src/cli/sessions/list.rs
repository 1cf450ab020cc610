//! The list of sessions.

use beampose_store::{SessionSummary, Store};
use comfy_table::Cell;

use super::{outcome, plain_table, right};
use crate::cli::Ended;
use crate::cli::filter::{Filter, verdict};
use crate::output::{Exit, print};

/// Lists the sessions that `filter` leaves.
pub async fn list(store: &Store, filter: &Filter, as_json: bool) -> Result<Exit, Ended> {
    let sessions = filter.sessions(store).await?;
    if as_json {
        sessions.iter().for_each(|session| print(&json(session).to_string()));
        return Ok(Exit::Success);
    }
    if sessions.is_empty() {
        print(if filter.is_empty() {
            "no sessions yet: beampose run experiments/plans/translation-test.yaml"
        } else {
            "no such session"
        });
        return Ok(Exit::Success);
    }
    print(&table(&sessions));
    Ok(Exit::Success)
}

fn table(sessions: &[SessionSummary]) -> String {
    let mut table = plain_table();
    table.set_header([
        "session",
        "began (UTC)",
        "title",
        "outcome",
        "steps",
        "captures",
        "solved",
        "verdict",
        "tags",
    ]);
    for s in sessions {
        table.add_row([
            Cell::new(s.id),
            Cell::new(s.opened.utc.strftime("%Y-%m-%d %H:%M:%S")),
            Cell::new(&s.title),
            Cell::new(outcome(s.outcome)),
            right(format!("{}/{}", s.steps_stored, s.steps)),
            right(s.captures),
            right(s.solved),
            Cell::new(verdict(s)),
            Cell::new(s.tags.join(" ")),
        ]);
    }
    table.to_string()
}

fn json(s: &SessionSummary) -> serde_json::Value {
    serde_json::json!({
        "session": s.id.to_string(),
        "title": s.title,
        "experiment": s.experiment,
        "opened": s.opened.utc.to_string(),
        "closed": s.closed.map(|c| c.utc.to_string()),
        "outcome": outcome(s.outcome),
        "steps": s.steps,
        "steps_stored": s.steps_stored,
        "captures": s.captures,
        "solved": s.solved,
        "simulated": s.simulated,
        "verdict": verdict(s),
        "tags": s.tags,
    })
}
