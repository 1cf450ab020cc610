//! One session: header, events, interruptions, processings, labels.

use beampose_analysis::report::Interruption;
use beampose_core::SessionId;
use beampose_store::{
    Note, Processing, Store, StoredCapture, StoredEvent, StoredSession, StoredStep,
};
use serde_json::{Value, json};

use super::outcome;
use crate::cli::{Database, Ended, close, find};
use crate::interruptions::interruptions;
use crate::output::{Exit, print};

/// Show a session: events, interruptions, processings, tags and notes
///
/// SESSION is an id, a unique beginning of one, or `latest`.
#[derive(clap::Args)]
pub struct Show {
    /// Which session
    session: String,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

impl Show {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let store = self.database.open_existing().await?;
        let id = find(&store, &self.session).await?;
        let ended = show(&store, id, self.json).await;
        close(store).await;
        ended
    }
}

/// All that is shown.
struct Shown {
    id: SessionId,
    session: StoredSession,
    steps: Vec<StoredStep>,
    events: Vec<StoredEvent>,
    captures: Vec<StoredCapture>,
    interruptions: Vec<Interruption>,
    processings: Vec<Processing>,
    tags: Vec<String>,
    notes: Vec<Note>,
}

/// Shows a session.
pub async fn show(store: &Store, id: SessionId, as_json: bool) -> Result<Exit, Ended> {
    let shown = Shown {
        id,
        session: store.session(id).await?,
        steps: store.steps(id).await?,
        events: store.events(id).await?,
        captures: store.captures(id).await?,
        interruptions: interruptions(store, id).await?,
        processings: store.processings(id).await?,
        tags: store.tags(id).await?,
        notes: store.notes(id).await?,
    };
    if as_json {
        print(&shown.json().to_string());
    } else {
        print(&shown.text());
    }
    Ok(Exit::Success)
}

impl Shown {
    fn json(&self) -> Value {
        let header = &self.session.header;
        json!({
            "session": self.id.to_string(),
            "title": header.title,
            "experiment": header.experiment,
            "outcome": outcome(self.session.outcome),
            "software": header.software,
            "seed": header.seed,
            "plan_hash": header.plan_hash,
            "opened": header.opened.utc.to_string(),
            "closed": self.session.closed.map(|c| c.utc.to_string()),
            "steps": self.steps.iter().map(step_json).collect::<Vec<_>>(),
            "events": self.events.iter().map(event_json).collect::<Vec<_>>(),
            "captures": self.captures.iter().map(capture_json).collect::<Vec<_>>(),
            "interruptions": self.interruptions.iter().map(interruption_json).collect::<Vec<_>>(),
            "processings": self.processings.iter().map(processing_json).collect::<Vec<_>>(),
            "tags": self.tags,
            "notes": self.notes.iter().map(note_json).collect::<Vec<_>>(),
        })
    }

    fn text(&self) -> String {
        let header = &self.session.header;
        let mut lines = vec![format!(
            "session {}\n  {} ({})\n  began {} UTC, {}\n  {}, seed {}\n  plan {}",
            self.id,
            header.title,
            header.experiment,
            header.opened.utc.strftime("%Y-%m-%d %H:%M:%S"),
            outcome(self.session.outcome),
            header.software,
            header.seed.map_or_else(|| "none".to_owned(), |s| s.to_string()),
            header.plan_hash,
        )];
        if !self.tags.is_empty() {
            lines.push(format!("  tags {}", self.tags.join(" ")));
        }
        for note in &self.notes {
            lines.push(format!("  note {}: {}", note.written.strftime("%Y-%m-%d"), note.text));
        }
        for event in &self.events {
            let step = event.step.map_or_else(String::new, |s| format!(" step {s}:"));
            let seconds = event.event.at.monotonic.as_secs_f64();
            lines.push(format!("  {seconds:>10.3} s{step} {}", event.event.message));
        }
        lines.extend(self.interruptions.iter().flat_map(interruption_lines));
        lines.extend(self.processings.iter().map(processing_line));
        lines.push(format!("{} steps, {} captures", self.steps.len(), self.captures.len()));
        lines.join("\n")
    }
}

fn interruption_lines(one: &Interruption) -> Vec<String> {
    let at = |stamp: &beampose_core::Stamp| stamp.utc.strftime("%Y-%m-%d %H:%M:%S").to_string();
    let mut lines = vec![format!(
        "  interrupted {} UTC ({}), went on {} UTC, {:.0} s later",
        at(&one.stopped),
        one.reason,
        at(&one.resumed),
        one.seconds()
    )];
    lines.extend(one.restored.iter().map(|what| format!("    restored: {what}")));
    for step in &one.redone {
        let (number, label, before) = (step.number, &step.label, &step.before);
        lines.push(format!("    done again: step {number}, {label} ({before})"));
    }
    lines
}

fn processing_line(one: &Processing) -> String {
    let options: Option<Value> = serde_json::from_str(&one.start.options_json).ok();
    let methods = options.as_ref().and_then(|o| o.get("methods")?.as_array());
    let methods: Vec<&str> = methods.into_iter().flatten().filter_map(Value::as_str).collect();
    let told = if one.start.measurement_json.is_some() { ", other calibrations" } else { "" };
    let finished = if one.finished.is_some() { "" } else { ", not finished" };
    let at = one.start.created.strftime("%Y-%m-%d %H:%M:%S");
    format!("  processing {} {at} UTC: {}{told}{finished}", one.id, methods.join(", "))
}

fn step_json(step: &StoredStep) -> Value {
    json!({
        "number": step.number.0,
        "label": step.label,
        "kind": step.kind,
        "started_s": step.started.monotonic.as_secs_f64(),
        "finished_s": step.finished.monotonic.as_secs_f64(),
        "outcome": step.outcome,
    })
}

fn event_json(e: &StoredEvent) -> Value {
    json!({
        "at": e.event.at.utc.to_string(),
        "step": e.step.map(|s| s.0),
        "kind": e.event.kind,
        "message": e.event.message,
    })
}

fn capture_json(c: &StoredCapture) -> Value {
    let pictures = c
        .pictures
        .iter()
        .map(|p| json!({ "camera": p.camera.as_str(), "blake3": p.blake3, "bytes": p.size_bytes }));
    json!({
        "id": c.id.as_str(),
        "setpoints": c.setpoints,
        "readings": c.readings,
        "pictures": pictures.collect::<Vec<_>>(),
    })
}

fn interruption_json(one: &Interruption) -> Value {
    json!({
        "stopped": one.stopped.utc.to_string(),
        "resumed": one.resumed.utc.to_string(),
        "duration_s": one.seconds(),
        "reason": one.reason,
        "restored": one.restored,
        "redone": one.redone,
    })
}

fn processing_json(one: &Processing) -> Value {
    let parsed = |text: &str| serde_json::from_str(text).unwrap_or(Value::Null);
    json!({
        "processing": one.id,
        "created": one.start.created.to_string(),
        "finished": one.finished.map(|at| at.to_string()),
        "software": one.start.software,
        "options": parsed(&one.start.options_json),
        "lineage": parsed(&one.start.lineage_json),
        "other_measurement": one.start.measurement_json.is_some(),
    })
}

fn note_json(note: &Note) -> Value {
    json!({ "written": note.written.to_string(), "text": note.text })
}
