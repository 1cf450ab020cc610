//! The store as the engine's [`RunSink`]: one durable transaction a step.

use async_trait::async_trait;
use beampose_core::{
    Answer, CaptureRecord, Event, Gap, InstrumentName, Look, Missing, Reading, RunSink,
    SessionHeader, SessionId, SessionOutcome, SinkError, Stamp, StepNumber, StepOutcome,
    StepRecord,
};

use crate::batch::Batch;
use crate::error::failed_to;
use crate::inputs::insert_files;
use crate::stamp::{numbers_to_json, word_of};
use crate::writer::begin;
use crate::{Store, StoreError};

#[async_trait]
impl RunSink for Store {
    async fn open(&self, header: &SessionHeader) -> Result<(), SinkError> {
        let what = format!("session {}", header.id);
        self.open_session(header).await.map_err(|error| sink_error(what, &error))
    }

    async fn reopen(&self, session: SessionId, gap: &Gap) -> Result<(), SinkError> {
        let what = format!("that session {session} goes on");
        self.reopen_session(session, gap).await.map_err(|error| sink_error(what, &error))
    }

    async fn step(&self, session: SessionId, record: &StepRecord) -> Result<(), SinkError> {
        let what = format!("step {} of session {session}", record.number);
        self.save_step(session, record).await.map_err(|error| sink_error(what, &error))
    }

    async fn close(
        &self,
        session: SessionId,
        outcome: SessionOutcome,
        events: &[Event],
        at: Stamp,
    ) -> Result<(), SinkError> {
        let what = format!("the end of session {session}");
        let closed = self.close_session(session, outcome, events, at).await;
        closed.map_err(|error| sink_error(what, &error))
    }

    fn free_bytes(&self) -> Option<u64> {
        crate::disk::free_bytes(self.path())
    }
}

fn sink_error(what: String, error: &StoreError) -> SinkError {
    SinkError { what, reason: error.to_string() }
}

/// A transaction, and in whose name rows go into it.
struct Rows<'a> {
    batch: Batch,
    session: String,
    doing: &'a str,
}

impl Store {
    async fn open_session(&self, header: &SessionHeader) -> Result<(), StoreError> {
        let doing = "open a session";
        let mut transaction = begin(&self.writer, doing).await?;
        sqlx::query(
            "INSERT INTO sessions (id, title, experiment, plan_text, rig_text, measurement_json,
                plan_hash, software, seed, steps, opened_utc, opened_s, origin_json)
             VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        )
        .bind(header.id.to_string())
        .bind(&header.title)
        .bind(&header.experiment)
        .bind(&header.plan_text)
        .bind(&header.rig_text)
        .bind(&header.measurement_json)
        .bind(&header.plan_hash)
        .bind(&header.software)
        .bind(header.seed.map(|seed| seed.to_string()))
        .bind(header.steps)
        .bind(header.opened.utc.to_string())
        .bind(header.opened.monotonic.as_secs_f64())
        .bind(&header.origin_json)
        .execute(&mut *transaction)
        .await
        .map_err(failed_to(doing))?;
        insert_files(&mut transaction, header.id, None, &header.files)
            .await
            .map_err(failed_to(doing))?;
        transaction.commit().await.map_err(failed_to(doing))
    }

    async fn save_step(&self, session: SessionId, record: &StepRecord) -> Result<(), StoreError> {
        let doing = "store a step";
        let mut rows = Rows { batch: Batch::default(), session: session.to_string(), doing };
        rows.step(record);
        for (instrument, reading) in &record.readings {
            rows.reading(record.number, instrument, reading);
        }
        if let Some(capture) = &record.capture {
            rows.capture(record, capture)?;
        }
        for missing in &record.missing {
            rows.missing(record.number, missing);
        }
        for look in &record.looks {
            rows.look(record.number, look);
        }
        if let Some(answer) = &record.answer {
            rows.answer(record.number, answer);
        }
        for event in &record.events {
            rows.event(Some(record.number), event)?;
        }
        rows.batch.commit(&self.writer, doing).await.map_err(|error| match error {
            // The table says it in its own words: see `STEP`.
            StoreError::Refused { doing, reason } if reason.contains("steps.label") => {
                let reason = format!("step {} of this session is stored already", record.number);
                StoreError::Refused { doing, reason }
            }
            other => other,
        })
    }

    async fn close_session(
        &self,
        session: SessionId,
        outcome: SessionOutcome,
        events: &[Event],
        at: Stamp,
    ) -> Result<(), StoreError> {
        let doing = "close a session";
        let mut transaction = begin(&self.writer, doing).await?;
        for event in events {
            sqlx::query(EVENT)
                .bind(session.to_string())
                .bind(None::<u32>)
                .bind(event.at.utc.to_string())
                .bind(event.at.monotonic.as_secs_f64())
                .bind(word_of(doing, &event.kind)?)
                .bind(&event.message)
                .execute(&mut *transaction)
                .await
                .map_err(failed_to(doing))?;
        }
        let (word, ending) = match outcome {
            SessionOutcome::Stopped | SessionOutcome::Halted => {
                (SessionOutcome::Aborted.as_str(), Some(outcome.as_str()))
            }
            SessionOutcome::Completed | SessionOutcome::Aborted | SessionOutcome::Error => {
                (outcome.as_str(), None)
            }
        };
        let closed = sqlx::query(
            "UPDATE sessions SET outcome = ?, ending = ?, closed_utc = ?, closed_s = ?
             WHERE id = ? AND outcome IS NULL",
        )
        .bind(word)
        .bind(ending)
        .bind(at.utc.to_string())
        .bind(at.monotonic.as_secs_f64())
        .bind(session.to_string())
        .execute(&mut *transaction)
        .await
        .map_err(failed_to(doing))?;
        if closed.rows_affected() != 1 {
            let reason = format!("there is no open session {session}");
            return Err(StoreError::Refused { doing: doing.to_owned(), reason });
        }
        transaction.commit().await.map_err(failed_to(doing))
    }
}

const EVENT: &str = "INSERT INTO events (session, step, at_utc, at_s, kind, message)
     VALUES (?, ?, ?, ?, ?, ?)";

/// A step that is stored is stored once: its label is then nothing, which the table refuses. One
/// that is kept as an earlier attempt, and not yet done again, makes room.
const STEP: &str = "INSERT INTO steps (session, number, label, kind, started_utc, started_s,
        finished_utc, finished_s, outcome, reason, handled)
     VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)
     ON CONFLICT (session, number) DO UPDATE SET
        label = CASE WHEN EXISTS (SELECT 1 FROM attempts a WHERE a.session = steps.session
            AND a.step = steps.number AND a.finished_s = steps.finished_s)
            THEN excluded.label END,
        kind = excluded.kind,
        started_utc = excluded.started_utc, started_s = excluded.started_s,
        finished_utc = excluded.finished_utc, finished_s = excluded.finished_s,
        outcome = excluded.outcome, reason = excluded.reason, handled = excluded.handled";

impl Rows<'_> {
    fn step(&mut self, record: &StepRecord) {
        let (outcome, reason, handled) = match &record.outcome {
            StepOutcome::Done => ("done", None, None),
            StepOutcome::Failed { reason } => ("failed", Some(reason.as_str()), None),
            StepOutcome::PassedOver { reason } => {
                ("failed", Some(reason.as_str()), Some("passed_over"))
            }
            StepOutcome::Skipped => ("skipped", None, None),
        };
        self.batch
            .statement(STEP)
            .bind(self.session.as_str())
            .bind(record.number.0)
            .bind(record.label.as_str())
            .bind(record.kind.as_str())
            .bind(record.started.utc.to_string())
            .bind(record.started.monotonic.as_secs_f64())
            .bind(record.finished.utc.to_string())
            .bind(record.finished.monotonic.as_secs_f64())
            .bind(outcome)
            .bind(reason)
            .bind(handled);
    }

    fn reading(&mut self, step: StepNumber, instrument: &InstrumentName, reading: &Reading) {
        self.batch
            .statement(
                "INSERT INTO readings (session, id, step, instrument, quantity, value,
                    standard_uncertainty, at_utc, at_s)
                 VALUES (?, 1 + (SELECT coalesce(max(id), 0) FROM readings WHERE session = ?),
                    ?, ?, ?, ?, ?, ?, ?)",
            )
            .bind(self.session.as_str())
            .bind(self.session.as_str())
            .bind(step.0)
            .bind(instrument.as_str())
            .bind(reading.quantity.name())
            .bind(reading.value)
            .bind(reading.standard_uncertainty)
            .bind(reading.at.utc.to_string())
            .bind(reading.at.monotonic.as_secs_f64());
    }

    fn missing(&mut self, step: StepNumber, missing: &Missing) {
        self.batch
            .statement(
                "INSERT INTO missing_values (session, step, instrument, reason)
                 VALUES (?, ?, ?, ?)",
            )
            .bind(self.session.as_str())
            .bind(step.0)
            .bind(missing.instrument.as_str())
            .bind(missing.reason.as_str());
    }

    fn look(&mut self, step: StepNumber, look: &Look) {
        self.batch
            .statement(
                "INSERT INTO looks (session, step, commanded, read, dot_x_px, dot_y_px, at_utc, at_s)
                 VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            )
            .bind(self.session.as_str())
            .bind(step.0)
            .bind(look.commanded)
            .bind(look.read)
            .bind(look.dot_px.map(|dot| dot[0]))
            .bind(look.dot_px.map(|dot| dot[1]))
            .bind(look.at.utc.to_string())
            .bind(look.at.monotonic.as_secs_f64());
    }

    fn answer(&mut self, step: StepNumber, answer: &Answer) {
        self.batch
            .statement(
                "INSERT INTO answers (session, step, name, value, given_by)
                 VALUES (?, ?, ?, ?, ?)",
            )
            .bind(self.session.as_str())
            .bind(step.0)
            .bind(answer.name.as_str())
            .bind(answer.value.as_str())
            .bind(answer.by.as_str());
    }

    fn capture(&mut self, record: &StepRecord, capture: &CaptureRecord) -> Result<(), StoreError> {
        let requested = capture.pictures.iter().map(|picture| picture.requested).min();
        let triggered = requested.unwrap_or(record.started);
        let setpoints = numbers_to_json(self.doing, &capture.setpoints)?;
        let readings = numbers_to_json(self.doing, &capture.readings)?;
        self.batch
            .statement(
                "INSERT INTO captures (session, id, step, setpoints_json, readings_json,
                    triggered_utc, triggered_s)
                 VALUES (?, ?, ?, ?, ?, ?, ?)",
            )
            .bind(self.session.as_str())
            .bind(capture.id.as_str())
            .bind(record.number.0)
            .bind(setpoints)
            .bind(readings)
            .bind(triggered.utc.to_string())
            .bind(triggered.monotonic.as_secs_f64());
        for picture in &capture.pictures {
            self.picture(capture, picture);
        }
        Ok(())
    }

    fn picture(&mut self, capture: &CaptureRecord, picture: &beampose_core::Picture) {
        let hash = blake3::hash(&picture.bytes).to_hex();
        self.batch
            .statement("INSERT INTO blobs (blake3, bytes) VALUES (?, ?) ON CONFLICT DO NOTHING")
            .bind(hash.as_str())
            .bind(picture.bytes.as_slice());
        self.batch
            .statement(
                "INSERT INTO pictures (session, capture, camera, blake3, size_bytes,
                    requested_utc, requested_s, delivered_utc, delivered_s)
                 VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
            )
            .bind(self.session.as_str())
            .bind(capture.id.as_str())
            .bind(picture.camera.as_str())
            .bind(hash.as_str())
            .bind(i64::try_from(picture.bytes.len()).unwrap_or(i64::MAX))
            .bind(picture.requested.utc.to_string())
            .bind(picture.requested.monotonic.as_secs_f64())
            .bind(picture.delivered.utc.to_string())
            .bind(picture.delivered.monotonic.as_secs_f64());
    }

    fn event(&mut self, step: Option<StepNumber>, event: &Event) -> Result<(), StoreError> {
        let kind = word_of(self.doing, &event.kind)?;
        self.batch
            .statement(EVENT)
            .bind(self.session.as_str())
            .bind(step.map(|step| step.0))
            .bind(event.at.utc.to_string())
            .bind(event.at.monotonic.as_secs_f64())
            .bind(kind)
            .bind(event.message.as_str());
        Ok(())
    }
}
