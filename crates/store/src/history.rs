//! What steps took in stored sessions.

use crate::error::failed_to;
use crate::{Store, StoreError};

/// How many of the newest sessions are looked at.
const NEWEST: i64 = 20;

/// A session that ran on some rig, for whoever estimates the next.
#[derive(Debug, Clone, PartialEq)]
pub struct PastSession {
    /// The rig's text as run.
    pub rig_text: String,
    /// From its opening to its closing, s; `None` of one that did not complete without a gap.
    pub took_s: Option<f64>,
    /// Its steps that were done: label and time, s.
    pub steps: Vec<(String, f64)>,
    /// Its pictures: camera and bytes.
    pub pictures: Vec<(String, u64)>,
}

impl Store {
    /// The newest sessions that were run, each with what its steps took.
    ///
    /// # Errors
    /// [`StoreError::Busy`] or [`StoreError::Database`].
    pub async fn past_sessions(&self) -> Result<Vec<PastSession>, StoreError> {
        let doing = "read what earlier sessions took";
        let rows: Vec<(String, String, Option<f64>)> = sqlx::query_as(
            "SELECT id, rig_text, CASE WHEN outcome = 'completed'
                AND NOT EXISTS (SELECT 1 FROM gaps g WHERE g.session = s.id)
                THEN closed_s - opened_s END
             FROM sessions s WHERE origin_json IS NOT NULL ORDER BY number DESC LIMIT ?",
        )
        .bind(NEWEST)
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to(doing))?;
        let mut sessions = Vec::new();
        for (id, rig_text, took_s) in rows {
            let steps = sqlx::query_as(
                "SELECT label, finished_s - started_s FROM steps
                 WHERE session = ? AND outcome = 'done' ORDER BY number",
            );
            let steps = steps.bind(&id).fetch_all(&self.readers).await.map_err(failed_to(doing))?;
            let pictures: Vec<(String, i64)> =
                sqlx::query_as("SELECT camera, size_bytes FROM pictures WHERE session = ?")
                    .bind(&id)
                    .fetch_all(&self.readers)
                    .await
                    .map_err(failed_to(doing))?;
            let pictures = pictures.into_iter().map(|(c, n)| (c, n.unsigned_abs())).collect();
            sessions.push(PastSession { rig_text, took_s, steps, pictures });
        }
        Ok(sessions)
    }
}
