//! Sessions and what they acquired, read back.

use beampose_core::{
    CaptureId, Event, InstrumentName, Reading, SessionHeader, SessionId, SessionOutcome, Stamp,
    StepNumber, StepOutcome,
};
use sqlx::FromRow;

use crate::error::failed_to;
use crate::rows::{
    SessionSummary, StoredCapture, StoredEvent, StoredReading, StoredSession, StoredStep,
};
use crate::stamp::{count, damaged, from_json, from_word, session_id, stamp, step_number};
use crate::{Store, StoreError};

#[derive(FromRow)]
struct SummaryColumns {
    id: String,
    title: String,
    experiment: String,
    opened_utc: String,
    opened_s: f64,
    closed_utc: Option<String>,
    closed_s: Option<f64>,
    outcome: Option<String>,
    steps: u32,
    seed: Option<String>,
    steps_stored: i64,
    captures: i64,
    solved: i64,
    tags_json: String,
    verdict: Option<String>,
}

impl SummaryColumns {
    fn summary(self) -> Result<SessionSummary, StoreError> {
        Ok(SessionSummary {
            id: session_id(&self.id)?,
            opened: stamp(&self.opened_utc, self.opened_s)?,
            closed: closed(self.closed_utc.as_deref(), self.closed_s)?,
            outcome: outcome(self.outcome.as_deref())?,
            title: self.title,
            experiment: self.experiment,
            steps: self.steps,
            steps_stored: count(self.steps_stored),
            captures: count(self.captures),
            solved: count(self.solved),
            simulated: self.seed.is_some(),
            tags: from_json("a session's tags", &self.tags_json)?,
            verdict: self.verdict,
        })
    }
}

fn closed(utc: Option<&str>, seconds: Option<f64>) -> Result<Option<Stamp>, StoreError> {
    utc.zip(seconds).map(|(utc, seconds)| stamp(utc, seconds)).transpose()
}

fn outcome(word: Option<&str>) -> Result<Option<SessionOutcome>, StoreError> {
    word.map(|word| from_word("a session's outcome", word)).transpose()
}

#[derive(FromRow)]
struct HeaderColumns {
    title: String,
    experiment: String,
    plan_text: String,
    rig_text: String,
    measurement_json: String,
    plan_hash: String,
    origin_json: Option<String>,
    software: String,
    seed: Option<String>,
    steps: u32,
    opened_utc: String,
    opened_s: f64,
    closed_utc: Option<String>,
    closed_s: Option<f64>,
    outcome: Option<String>,
}

impl HeaderColumns {
    fn session(self, id: SessionId) -> Result<StoredSession, StoreError> {
        let seed = self.seed.as_deref().map(str::parse).transpose();
        let header = SessionHeader {
            id,
            title: self.title,
            experiment: self.experiment,
            plan_text: self.plan_text,
            rig_text: self.rig_text,
            measurement_json: self.measurement_json,
            files: Vec::new(),
            plan_hash: self.plan_hash,
            origin_json: self.origin_json,
            software: self.software,
            seed: seed.map_err(|error| damaged("a session's seed", error))?,
            steps: self.steps,
            opened: stamp(&self.opened_utc, self.opened_s)?,
        };
        Ok(StoredSession {
            header,
            closed: closed(self.closed_utc.as_deref(), self.closed_s)?,
            outcome: outcome(self.outcome.as_deref())?,
        })
    }
}

impl Store {
    /// All sessions, the oldest first.
    ///
    /// # Errors
    /// [`StoreError::Damaged`], [`StoreError::Busy`] or [`StoreError::Database`].
    pub async fn sessions(&self) -> Result<Vec<SessionSummary>, StoreError> {
        let rows: Vec<SummaryColumns> = sqlx::query_as(
            "SELECT s.id, s.title, s.experiment, s.opened_utc, s.opened_s, s.closed_utc,
                s.closed_s, COALESCE(s.ending, s.outcome) AS outcome, s.steps, s.seed,
                (SELECT count(*) FROM steps WHERE session = s.id) AS steps_stored,
                (SELECT count(*) FROM captures WHERE session = s.id) AS captures,
                (SELECT count(DISTINCT capture) FROM poses
                 WHERE status = 'solved' AND processing =
                    (SELECT id FROM processings WHERE session = s.id
                     ORDER BY finished_utc IS NULL, id DESC LIMIT 1)) AS solved,
                (SELECT json_group_array(tag ORDER BY tag) FROM tags WHERE session = s.id)
                    AS tags_json,
                (SELECT json_extract(r.result_json, '$.verdict') FROM results r
                 WHERE r.id = (SELECT max(n.id) FROM processings q
                    JOIN results n ON n.processing = q.id WHERE q.session = s.id)) AS verdict
             FROM sessions s ORDER BY s.number",
        )
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to("list the sessions"))?;
        rows.into_iter().map(SummaryColumns::summary).collect()
    }

    /// The session that `wanted` means: an id, the unique beginning of one, or `latest`.
    ///
    /// # Errors
    /// [`StoreError::NotFound`] with the nearest ids, [`StoreError::Ambiguous`] with all that fit.
    pub async fn find_session(&self, wanted: &str) -> Result<SessionId, StoreError> {
        let ids: Vec<(String, String)> =
            sqlx::query_as("SELECT id, title FROM sessions ORDER BY number")
                .fetch_all(&self.readers)
                .await
                .map_err(failed_to("look for a session"))?;
        let wanted = wanted.trim().to_lowercase();
        let fits: Vec<_> = match wanted.as_str() {
            "latest" => ids.last().into_iter().collect(),
            "" => Vec::new(),
            beginning => ids.iter().filter(|(id, _)| id.starts_with(beginning)).collect(),
        };
        match fits.as_slice() {
            [(id, _)] => session_id(id),
            [] => Err(StoreError::NotFound {
                what: not_found(&wanted, ids.is_empty()),
                nearest: nearest(&wanted, &ids),
            }),
            several => Err(StoreError::Ambiguous {
                wanted,
                candidates: several.iter().map(|session| named(session)).collect(),
            }),
        }
    }

    /// A session's header, and how it ended.
    ///
    /// # Errors
    /// [`StoreError::NotFound`] where there is none of that id.
    pub async fn session(&self, id: SessionId) -> Result<StoredSession, StoreError> {
        let row: Option<HeaderColumns> = sqlx::query_as(
            "SELECT title, experiment, plan_text, rig_text, measurement_json, plan_hash, origin_json, software,
                seed, steps, opened_utc, opened_s, closed_utc, closed_s,
                COALESCE(ending, outcome) AS outcome
             FROM sessions WHERE id = ?",
        )
        .bind(id.to_string())
        .fetch_optional(&self.readers)
        .await
        .map_err(failed_to("read a session"))?;
        let mut session = row
            .ok_or_else(|| StoreError::NotFound {
                what: format!("session {id}"),
                nearest: Vec::new(),
            })?
            .session(id)?;
        session.header.files = self.files_of_session(id).await?;
        Ok(session)
    }

    /// The steps that were run, in their order.
    ///
    /// # Errors
    /// [`StoreError::Damaged`], [`StoreError::Busy`] or [`StoreError::Database`].
    pub async fn steps(&self, session: SessionId) -> Result<Vec<StoredStep>, StoreError> {
        let rows: Vec<StepColumns> = sqlx::query_as(
            "SELECT number, label, kind, started_utc, started_s, finished_utc, finished_s,
                outcome, reason, handled
             FROM steps WHERE session = ? ORDER BY number",
        )
        .bind(session.to_string())
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to("read the steps"))?;
        rows.into_iter().map(StepColumns::step).collect()
    }

    /// What happened, in the order in which it was stored.
    ///
    /// # Errors
    /// [`StoreError::Damaged`], [`StoreError::Busy`] or [`StoreError::Database`].
    pub async fn events(&self, session: SessionId) -> Result<Vec<StoredEvent>, StoreError> {
        let rows: Vec<(Option<i64>, String, f64, String, String)> = sqlx::query_as(
            "SELECT step, at_utc, at_s, kind, message FROM events WHERE session = ? ORDER BY id",
        )
        .bind(session.to_string())
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to("read the events"))?;
        rows.into_iter()
            .map(|(step, utc, seconds, kind, message)| {
                let step = step.map(step_number).transpose()?.map(StepNumber);
                let kind = from_word("an event's kind", &kind)?;
                Ok(StoredEvent { step, event: Event { at: stamp(&utc, seconds)?, kind, message } })
            })
            .collect()
    }

    /// All readings, in the order in which they were taken.
    ///
    /// # Errors
    /// [`StoreError::Damaged`], [`StoreError::Busy`] or [`StoreError::Database`].
    pub async fn readings(&self, session: SessionId) -> Result<Vec<StoredReading>, StoreError> {
        let rows: Vec<ReadingColumns> = sqlx::query_as(
            "SELECT step, instrument, quantity, value, standard_uncertainty, at_utc, at_s
             FROM readings WHERE session = ? ORDER BY id",
        )
        .bind(session.to_string())
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to("read the readings"))?;
        rows.into_iter().map(ReadingColumns::reading).collect()
    }

    /// All captures in the order in which they were taken, without the pictures' bytes.
    ///
    /// # Errors
    /// [`StoreError::Damaged`], [`StoreError::Busy`] or [`StoreError::Database`].
    pub async fn captures(&self, session: SessionId) -> Result<Vec<StoredCapture>, StoreError> {
        let rows: Vec<CaptureColumns> = sqlx::query_as(
            "SELECT id, step, setpoints_json, readings_json, triggered_utc, triggered_s
             FROM captures WHERE session = ? ORDER BY step",
        )
        .bind(session.to_string())
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to("read the captures"))?;
        let mut pictures = self.picture_infos(session).await?;
        rows.into_iter()
            .map(|row| {
                let infos = pictures.remove(&row.id).unwrap_or_default();
                row.capture(infos)
            })
            .collect()
    }
}

#[derive(FromRow)]
pub(crate) struct StepColumns {
    number: i64,
    label: String,
    kind: String,
    started_utc: String,
    started_s: f64,
    finished_utc: String,
    finished_s: f64,
    outcome: String,
    reason: Option<String>,
    handled: Option<String>,
}

impl StepColumns {
    pub(crate) fn step(self) -> Result<StoredStep, StoreError> {
        let outcome = match (self.outcome.as_str(), self.reason) {
            ("done", _) => StepOutcome::Done,
            ("failed", Some(reason)) if self.handled.is_some() => {
                StepOutcome::PassedOver { reason }
            }
            ("failed", Some(reason)) => StepOutcome::Failed { reason },
            ("skipped", _) => StepOutcome::Skipped,
            (other, _) => return Err(damaged("a step's outcome", other)),
        };
        Ok(StoredStep {
            number: StepNumber(step_number(self.number)?),
            label: self.label,
            kind: self.kind,
            started: stamp(&self.started_utc, self.started_s)?,
            finished: stamp(&self.finished_utc, self.finished_s)?,
            outcome,
        })
    }
}

#[derive(FromRow)]
struct ReadingColumns {
    step: i64,
    instrument: String,
    quantity: String,
    value: f64,
    standard_uncertainty: Option<f64>,
    at_utc: String,
    at_s: f64,
}

impl ReadingColumns {
    fn reading(self) -> Result<StoredReading, StoreError> {
        Ok(StoredReading {
            step: StepNumber(step_number(self.step)?),
            instrument: InstrumentName(self.instrument),
            reading: Reading {
                quantity: from_word("a reading's quantity", &self.quantity)?,
                value: self.value,
                standard_uncertainty: self.standard_uncertainty,
                at: stamp(&self.at_utc, self.at_s)?,
            },
        })
    }
}

#[derive(FromRow)]
struct CaptureColumns {
    id: String,
    step: i64,
    setpoints_json: String,
    readings_json: String,
    triggered_utc: String,
    triggered_s: f64,
}

impl CaptureColumns {
    fn capture(self, pictures: Vec<crate::PictureInfo>) -> Result<StoredCapture, StoreError> {
        Ok(StoredCapture {
            id: CaptureId(self.id),
            step: StepNumber(step_number(self.step)?),
            setpoints: from_json("a capture's setpoints", &self.setpoints_json)?,
            readings: from_json("a capture's readings", &self.readings_json)?,
            triggered: stamp(&self.triggered_utc, self.triggered_s)?,
            pictures,
        })
    }
}

fn named((id, title): &(String, String)) -> String {
    format!("{id}  {title}")
}

fn not_found(wanted: &str, none_at_all: bool) -> String {
    match (none_at_all, wanted) {
        (true, _) => "session in this database yet".to_owned(),
        (false, wanted) => format!("session {wanted:?}"),
    }
}

/// The sessions whose ids begin most like `wanted`, the newest first among equals.
fn nearest(wanted: &str, ids: &[(String, String)]) -> Vec<String> {
    const SHOWN: usize = 3;
    let mut ranked: Vec<_> = ids
        .iter()
        .rev()
        .map(|session| {
            let beginning: String = session.0.chars().take(wanted.chars().count()).collect();
            (edits(wanted, &beginning), session)
        })
        .collect();
    ranked.sort_by_key(|(distance, _)| *distance);
    ranked.into_iter().take(SHOWN).map(|(_, session)| named(session)).collect()
}

/// Levenshtein distance: insertions, deletions and substitutions from `a` to `b`.
fn edits(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, from) in a.chars().enumerate() {
        let mut diagonal = i;
        row[0] = i + 1;
        for (j, to) in b.iter().enumerate() {
            let substituted = diagonal + usize::from(from != *to);
            diagonal = row[j + 1];
            row[j + 1] = substituted.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}
