//! `beampose sessions`.

use beampose_core::SessionOutcome;
use beampose_store::{SessionSummary, Store, StoredStep};
use comfy_table::{Cell, CellAlignment, ContentArrangement, Table, presets};

use super::{Database, Ended, close, find};
use crate::output::{Exit, print};

/// List the stored sessions, or show one
///
/// SESSION is an id, a unique beginning of one, or `latest`.
#[derive(clap::Args)]
pub struct Sessions {
    /// Show this session: its steps, events and captures
    session: Option<String>,
    /// Check the session's pictures against their hashes, and the database
    #[arg(long, requires = "session")]
    verify: bool,
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

impl Sessions {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let store = self.database.open_existing().await?;
        let ended = match &self.session {
            None => self.list(&store).await,
            Some(wanted) if self.verify => self.verified(&store, wanted).await,
            Some(wanted) => self.show(&store, wanted).await,
        };
        close(store).await;
        ended
    }

    async fn verified(&self, store: &Store, wanted: &str) -> Result<Exit, Ended> {
        let id = find(store, wanted).await?;
        let found = store.verify(id).await?;
        if self.json {
            let object = serde_json::json!({
                "session": id.to_string(),
                "pictures": found.pictures,
                "bytes": found.bytes,
                "problems": found.problems,
            });
            print(&object.to_string());
        } else {
            print(&format!("{} pictures, {} bytes hashed again", found.pictures, found.bytes));
            found.problems.iter().for_each(|problem| print(problem));
            if found.is_sound() {
                print("all sound");
            }
        }
        Ok(if found.is_sound() { Exit::Success } else { Exit::Failed })
    }

    async fn list(&self, store: &Store) -> Result<Exit, Ended> {
        let sessions = store.sessions().await?;
        if self.json {
            sessions.iter().for_each(|s| print(&json(s).to_string()));
            return Ok(Exit::Success);
        }
        if sessions.is_empty() {
            print("no sessions yet: beampose run experiments/plans/translation-test.yaml");
            return Ok(Exit::Success);
        }
        let mut table = plain_table();
        table.set_header([
            "session",
            "began (UTC)",
            "title",
            "outcome",
            "steps",
            "captures",
            "solved",
        ]);
        for s in &sessions {
            table.add_row([
                Cell::new(s.id),
                Cell::new(s.opened.utc.strftime("%Y-%m-%d %H:%M:%S")),
                Cell::new(&s.title),
                Cell::new(outcome(s.outcome)),
                right(format!("{}/{}", s.steps_stored, s.steps)),
                right(s.captures),
                right(s.solved),
            ]);
        }
        print(&table.to_string());
        Ok(Exit::Success)
    }

    async fn show(&self, store: &Store, wanted: &str) -> Result<Exit, Ended> {
        let id = find(store, wanted).await?;
        let session = store.session(id).await?;
        let steps = store.steps(id).await?;
        let events = store.events(id).await?;
        let captures = store.captures(id).await?;
        if self.json {
            let object = serde_json::json!({
                "session": id.to_string(),
                "title": session.header.title,
                "experiment": session.header.experiment,
                "outcome": outcome(session.outcome),
                "software": session.header.software,
                "seed": session.header.seed,
                "plan_hash": session.header.plan_hash,
                "opened": session.header.opened.utc.to_string(),
                "closed": session.closed.map(|c| c.utc.to_string()),
                "steps": steps.iter().map(step_json).collect::<Vec<_>>(),
                "events": events.iter().map(|e| serde_json::json!({
                    "at": e.event.at.utc.to_string(),
                    "step": e.step.map(|s| s.0),
                    "kind": e.event.kind,
                    "message": e.event.message,
                })).collect::<Vec<_>>(),
                "captures": captures.iter().map(|c| serde_json::json!({
                    "id": c.id.as_str(),
                    "setpoints": c.setpoints,
                    "readings": c.readings,
                    "pictures": c.pictures.iter().map(|p| serde_json::json!({
                        "camera": p.camera.as_str(), "blake3": p.blake3, "bytes": p.size_bytes,
                    })).collect::<Vec<_>>(),
                })).collect::<Vec<_>>(),
            });
            print(&object.to_string());
            return Ok(Exit::Success);
        }
        print(&format!(
            "session {id}\n  {} ({})\n  began {} UTC, {}\n  {}, seed {}\n  plan {}",
            session.header.title,
            session.header.experiment,
            session.header.opened.utc.strftime("%Y-%m-%d %H:%M:%S"),
            outcome(session.outcome),
            session.header.software,
            session.header.seed.map_or_else(|| "none".to_owned(), |s| s.to_string()),
            session.header.plan_hash,
        ));
        for event in &events {
            let step = event.step.map_or_else(String::new, |s| format!(" step {s}:"));
            print(&format!(
                "  {:>10.3} s{step} {}",
                event.event.at.monotonic.as_secs_f64(),
                event.event.message
            ));
        }
        print(&format!("{} steps, {} captures", steps.len(), captures.len()));
        Ok(Exit::Success)
    }
}

fn step_json(step: &StoredStep) -> serde_json::Value {
    serde_json::json!({
        "number": step.number.0,
        "label": step.label,
        "kind": step.kind,
        "started_s": step.started.monotonic.as_secs_f64(),
        "finished_s": step.finished.monotonic.as_secs_f64(),
        "outcome": step.outcome,
    })
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
    })
}

fn outcome(outcome: Option<SessionOutcome>) -> &'static str {
    outcome.map_or("not closed", SessionOutcome::as_str)
}

fn right(text: impl ToString) -> Cell {
    Cell::new(text).set_alignment(CellAlignment::Right)
}

/// A table without ruling, as all tables here.
pub fn plain_table() -> Table {
    let mut table = Table::new();
    table.load_preset(presets::NOTHING).set_content_arrangement(ContentArrangement::Disabled);
    table
}
