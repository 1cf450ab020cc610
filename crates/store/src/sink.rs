//! The store as the engine's [`RunSink`]: one durable transaction a step.

use async_trait::async_trait;
use beampose_core::{
    Answer, CaptureRecord, Event, Gap, InstrumentName, Missing, Reading, RunSink, SessionHeader,
    SessionId, SessionOutcome, SinkError, Stamp, StepNumber, StepOutcome, StepRecord,
};
use sqlx::{Sqlite, Transaction};

use crate::error::failed_to;
use crate::open::begin;
use crate::stamp::{numbers_to_json, word_of};
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
    transaction: &'a mut Transaction<'static, Sqlite>,
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
        transaction.commit().await.map_err(failed_to(doing))
    }

    async fn save_step(&self, session: SessionId, record: &StepRecord) -> Result<(), StoreError> {
        let doing = "store a step";
        let mut transaction = begin(&self.writer, doing).await?;
        let mut rows = Rows { transaction: &mut transaction, session: session.to_string(), doing };
        rows.step(record).await?;
        for (instrument, reading) in &record.readings {
            rows.reading(record.number, instrument, reading).await?;
        }
        if let Some(capture) = &record.capture {
            rows.capture(record, capture).await?;
        }
        for missing in &record.missing {
            rows.missing(record.number, missing).await?;
        }
        if let Some(answer) = &record.answer {
            rows.answer(record.number, answer).await?;
        }
        for event in &record.events {
            rows.event(Some(record.number), event).await?;
        }
        transaction.commit().await.map_err(failed_to(doing))
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
        let mut rows = Rows { transaction: &mut transaction, session: session.to_string(), doing };
        for event in events {
            rows.event(None, event).await?;
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

impl Rows<'_> {
    async fn step(&mut self, record: &StepRecord) -> Result<(), StoreError> {
        let (outcome, reason, handled) = match &record.outcome {
            StepOutcome::Done => ("done", None, None),
            StepOutcome::Failed { reason } => ("failed", Some(reason), None),
            StepOutcome::PassedOver { reason } => ("failed", Some(reason), Some("passed_over")),
            StepOutcome::Skipped => ("skipped", None, None),
        };
        let stored = sqlx::query(
            "INSERT INTO steps (session, number, label, kind, started_utc, started_s,
                finished_utc, finished_s, outcome, reason, handled)
             VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)
             ON CONFLICT (session, number) DO UPDATE SET
                label = excluded.label, kind = excluded.kind,
                started_utc = excluded.started_utc, started_s = excluded.started_s,
                finished_utc = excluded.finished_utc, finished_s = excluded.finished_s,
                outcome = excluded.outcome, reason = excluded.reason,
                handled = excluded.handled
             -- Only what is kept as an earlier attempt, and not yet done again.
             WHERE EXISTS (SELECT 1 FROM attempts a WHERE a.session = steps.session
                AND a.step = steps.number AND a.finished_s = steps.finished_s)",
        )
        .bind(&self.session)
        .bind(record.number.0)
        .bind(&record.label)
        .bind(&record.kind)
        .bind(record.started.utc.to_string())
        .bind(record.started.monotonic.as_secs_f64())
        .bind(record.finished.utc.to_string())
        .bind(record.finished.monotonic.as_secs_f64())
        .bind(outcome)
        .bind(reason)
        .bind(handled)
        .execute(&mut **self.transaction)
        .await
        .map_err(failed_to(self.doing))?;
        if stored.rows_affected() != 1 {
            let reason = format!("step {} of this session is stored already", record.number);
            return Err(StoreError::Refused { doing: self.doing.to_owned(), reason });
        }
        Ok(())
    }

    async fn reading(
        &mut self,
        step: StepNumber,
        instrument: &InstrumentName,
        reading: &Reading,
    ) -> Result<(), StoreError> {
        sqlx::query(
            "INSERT INTO readings (session, step, instrument, quantity, value,
                standard_uncertainty, at_utc, at_s)
             VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
        )
        .bind(&self.session)
        .bind(step.0)
        .bind(instrument.as_str())
        .bind(reading.quantity.name())
        .bind(reading.value)
        .bind(reading.standard_uncertainty)
        .bind(reading.at.utc.to_string())
        .bind(reading.at.monotonic.as_secs_f64())
        .execute(&mut **self.transaction)
        .await
        .map_err(failed_to(self.doing))?;
        Ok(())
    }

    async fn missing(&mut self, step: StepNumber, missing: &Missing) -> Result<(), StoreError> {
        sqlx::query(
            "INSERT INTO missing_values (session, step, instrument, reason) VALUES (?, ?, ?, ?)",
        )
        .bind(&self.session)
        .bind(step.0)
        .bind(missing.instrument.as_str())
        .bind(&missing.reason)
        .execute(&mut **self.transaction)
        .await
        .map_err(failed_to(self.doing))?;
        Ok(())
    }

    async fn answer(&mut self, step: StepNumber, answer: &Answer) -> Result<(), StoreError> {
        sqlx::query(
            "INSERT INTO answers (session, step, name, value, given_by) VALUES (?, ?, ?, ?, ?)",
        )
        .bind(&self.session)
        .bind(step.0)
        .bind(&answer.name)
        .bind(&answer.value)
        .bind(&answer.by)
        .execute(&mut **self.transaction)
        .await
        .map_err(failed_to(self.doing))?;
        Ok(())
    }

    async fn capture(
        &mut self,
        record: &StepRecord,
        capture: &CaptureRecord,
    ) -> Result<(), StoreError> {
        let requested = capture.pictures.iter().map(|picture| picture.requested).min();
        let triggered = requested.unwrap_or(record.started);
        sqlx::query(
            "INSERT INTO captures (session, id, step, setpoints_json, readings_json,
                triggered_utc, triggered_s)
             VALUES (?, ?, ?, ?, ?, ?, ?)",
        )
        .bind(&self.session)
        .bind(capture.id.as_str())
        .bind(record.number.0)
        .bind(numbers_to_json(self.doing, &capture.setpoints)?)
        .bind(numbers_to_json(self.doing, &capture.readings)?)
        .bind(triggered.utc.to_string())
        .bind(triggered.monotonic.as_secs_f64())
        .execute(&mut **self.transaction)
        .await
        .map_err(failed_to(self.doing))?;
        for picture in &capture.pictures {
            self.picture(capture, picture).await?;
        }
        Ok(())
    }

    async fn picture(
        &mut self,
        capture: &CaptureRecord,
        picture: &beampose_core::Picture,
    ) -> Result<(), StoreError> {
        let hash = blake3::hash(&picture.bytes).to_hex();
        sqlx::query("INSERT INTO blobs (blake3, bytes) VALUES (?, ?) ON CONFLICT DO NOTHING")
            .bind(hash.as_str())
            .bind(picture.bytes.as_slice())
            .execute(&mut **self.transaction)
            .await
            .map_err(failed_to(self.doing))?;
        sqlx::query(
            "INSERT INTO pictures (session, capture, camera, blake3, size_bytes, requested_utc,
                requested_s, delivered_utc, delivered_s)
             VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
        )
        .bind(&self.session)
        .bind(capture.id.as_str())
        .bind(picture.camera.as_str())
        .bind(hash.as_str())
        .bind(i64::try_from(picture.bytes.len()).unwrap_or(i64::MAX))
        .bind(picture.requested.utc.to_string())
        .bind(picture.requested.monotonic.as_secs_f64())
        .bind(picture.delivered.utc.to_string())
        .bind(picture.delivered.monotonic.as_secs_f64())
        .execute(&mut **self.transaction)
        .await
        .map_err(failed_to(self.doing))?;
        Ok(())
    }

    async fn event(&mut self, step: Option<StepNumber>, event: &Event) -> Result<(), StoreError> {
        sqlx::query(
            "INSERT INTO events (session, step, at_utc, at_s, kind, message)
             VALUES (?, ?, ?, ?, ?, ?)",
        )
        .bind(&self.session)
        .bind(step.map(|step| step.0))
        .bind(event.at.utc.to_string())
        .bind(event.at.monotonic.as_secs_f64())
        .bind(word_of(self.doing, &event.kind)?)
        .bind(&event.message)
        .execute(&mut **self.transaction)
        .await
        .map_err(failed_to(self.doing))?;
        Ok(())
    }
}
