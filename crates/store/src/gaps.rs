//! Sessions that go on: gaps, and earlier attempts at steps that are done again.

use beampose_core::{Gap, SessionId, StepNumber};
use sqlx::FromRow;

use crate::error::failed_to;
use crate::rows::Attempt;
use crate::sessions::StepColumns;
use crate::stamp::{damaged, stamp};
use crate::writer::{Write, begin};
use crate::{Store, StoreError};

impl Store {
    /// Opens a session again: its outcome is forgotten, the gap recorded, and what the steps to be
    /// done again left becomes an earlier attempt.
    pub(crate) async fn reopen_session(
        &self,
        session: SessionId,
        gap: &Gap,
    ) -> Result<(), StoreError> {
        let doing = "resume a session";
        let id = session.to_string();
        let mut transaction = begin(&self.writer, doing).await?;
        let restored = serde_json::to_string(&gap.restored)
            .map_err(|error| damaged("what is re-established", error))?;
        let inserted = sqlx::query(
            "INSERT INTO gaps (session, stopped_utc, stopped_s, resumed_utc, resumed_s, reason,
                restored_json)
             SELECT id, ?, ?, ?, ?, ?, ? FROM sessions WHERE id = ?",
        )
        .bind(gap.stopped.utc.to_string())
        .bind(gap.stopped.monotonic.as_secs_f64())
        .bind(gap.resumed.utc.to_string())
        .bind(gap.resumed.monotonic.as_secs_f64())
        .bind(&gap.reason)
        .bind(restored)
        .bind(&id)
        .execute(&mut *transaction)
        .await
        .map_err(failed_to(doing))?;
        if inserted.rows_affected() != 1 {
            let reason = format!("there is no session {session}");
            return Err(StoreError::Refused { doing: doing.to_owned(), reason });
        }
        let number = inserted.last_insert_rowid();
        for step in &gap.redone {
            set_aside(&mut transaction, number, &id, *step).await.map_err(failed_to(doing))?;
        }
        sqlx::query(
            "UPDATE sessions SET outcome = NULL, ending = NULL, closed_utc = NULL, closed_s = NULL
             WHERE id = ?",
        )
        .bind(&id)
        .execute(&mut *transaction)
        .await
        .map_err(failed_to(doing))?;
        transaction.commit().await.map_err(failed_to(doing))
    }

    /// The gaps of a session, in order, with how many steps were done again after each.
    ///
    /// # Errors
    /// [`StoreError::Damaged`], [`StoreError::Busy`] or [`StoreError::Database`].
    pub async fn gaps(&self, session: SessionId) -> Result<Vec<Gap>, StoreError> {
        let rows: Vec<(i64, String, f64, String, f64, String, String)> = sqlx::query_as(
            "SELECT id, stopped_utc, stopped_s, resumed_utc, resumed_s, reason, restored_json
             FROM gaps WHERE session = ? ORDER BY id",
        )
        .bind(session.to_string())
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to("read the gaps"))?;
        let mut gaps = Vec::new();
        for (id, stopped_utc, stopped_s, resumed_utc, resumed_s, reason, restored) in rows {
            let redone: Vec<u32> =
                sqlx::query_scalar("SELECT step FROM attempts WHERE gap = ? ORDER BY step")
                    .bind(id)
                    .fetch_all(&self.readers)
                    .await
                    .map_err(failed_to("read the earlier attempts"))?;
            gaps.push(Gap {
                stopped: stamp(&stopped_utc, stopped_s)?,
                resumed: stamp(&resumed_utc, resumed_s)?,
                reason,
                redone: redone.into_iter().map(StepNumber).collect(),
                restored: serde_json::from_str(&restored)
                    .map_err(|error| damaged("what was re-established", error))?,
            });
        }
        Ok(gaps)
    }
}

#[derive(FromRow)]
struct AttemptColumns {
    gap: i64,
    captured: bool,
    #[sqlx(flatten)]
    step: StepColumns,
}

impl Store {
    /// The steps that were done again after a gap, as they had ended before it.
    ///
    /// # Errors
    /// [`StoreError::Damaged`], [`StoreError::Busy`] or [`StoreError::Database`].
    pub async fn attempts(&self, session: SessionId) -> Result<Vec<Attempt>, StoreError> {
        let rows: Vec<AttemptColumns> = sqlx::query_as(
            "SELECT (SELECT count(*) FROM gaps g WHERE g.session = a.session AND g.id < a.gap)
                    AS gap, a.capture_json IS NOT NULL AS captured, a.step AS number, a.label,
                a.kind, a.started_utc, a.started_s, a.finished_utc, a.finished_s, a.outcome,
                a.reason, a.handled
             FROM attempts a WHERE a.session = ? ORDER BY a.gap, a.step",
        )
        .bind(session.to_string())
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to("read the earlier attempts"))?;
        rows.into_iter()
            .map(|row| {
                let gap = usize::try_from(row.gap).map_err(|e| damaged("a gap's number", e))?;
                Ok(Attempt { gap, step: row.step.step()?, captured: row.captured })
            })
            .collect()
    }
}

/// Makes a stored step an earlier attempt. Its row stays until the step is done again; its capture
/// makes room for the one to come.
async fn set_aside(
    transaction: &mut Write,
    gap: i64,
    session: &str,
    step: StepNumber,
) -> Result<(), sqlx::Error> {
    sqlx::query(
        "INSERT INTO attempts (gap, session, step, label, kind, started_utc, started_s,
            finished_utc, finished_s, outcome, reason, handled, capture_json)
         SELECT ?, s.session, s.number, s.label, s.kind, s.started_utc, s.started_s,
            s.finished_utc, s.finished_s, s.outcome, s.reason, s.handled,
            (SELECT json_object('id', c.id, 'setpoints', json(c.setpoints_json),
                'readings', json(c.readings_json), 'pictures',
                (SELECT json_group_array(json_object('camera', p.camera, 'blake3', p.blake3,
                    'requested_utc', p.requested_utc, 'delivered_utc', p.delivered_utc))
                 FROM pictures p WHERE p.session = c.session AND p.capture = c.id))
             FROM captures c WHERE c.session = s.session AND c.step = s.number)
         FROM steps s WHERE s.session = ? AND s.number = ?
            -- What an earlier gap set aside, and nobody has done again since, is set aside.
            AND NOT EXISTS (SELECT 1 FROM attempts a WHERE a.session = s.session
                AND a.step = s.number AND a.finished_s = s.finished_s)",
    )
    .bind(gap)
    .bind(session)
    .bind(step.0)
    .execute(&mut **transaction)
    .await?;
    let capture: Option<String> =
        sqlx::query_scalar("SELECT id FROM captures WHERE session = ? AND step = ?")
            .bind(session)
            .bind(step.0)
            .fetch_optional(&mut **transaction)
            .await?;
    let Some(capture) = capture else { return Ok(()) };
    // What was solved of it follows from it and can be solved again; the truth goes with the world.
    let of_processings = "processing IN (SELECT id FROM processings WHERE session = ?)";
    for table in ["observations", "poses", "solutions"] {
        let statement = format!("DELETE FROM {table} WHERE capture = ? AND {of_processings}");
        sqlx::query(sqlx::AssertSqlSafe(statement))
            .bind(&capture)
            .bind(session)
            .execute(&mut **transaction)
            .await?;
    }
    crate::truth::forget_capture(transaction, session, &capture).await?;
    for statement in [
        "DELETE FROM pictures WHERE capture = ? AND session = ?",
        "DELETE FROM captures WHERE id = ? AND session = ?",
    ] {
        sqlx::query(statement).bind(&capture).bind(session).execute(&mut **transaction).await?;
    }
    Ok(())
}
