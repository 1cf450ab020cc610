//! What steps leave beside readings and captures: missing values, answers of operators, looks.

use beampose_core::{Answer, InstrumentName, Look, Missing, SessionId, StepNumber};

use crate::error::failed_to;
use crate::stamp::stamp;
use crate::{Store, StoreError};

impl Store {
    /// What is missing of a session, in the order of its steps.
    ///
    /// # Errors
    /// [`StoreError::Busy`] or [`StoreError::Database`].
    pub async fn missing(
        &self,
        session: SessionId,
    ) -> Result<Vec<(StepNumber, Missing)>, StoreError> {
        let rows: Vec<(u32, String, String)> = sqlx::query_as(
            "SELECT step, instrument, reason FROM missing_values WHERE session = ? ORDER BY id",
        )
        .bind(session.to_string())
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to("read what is missing"))?;
        let missing = |(step, instrument, reason)| {
            (StepNumber(step), Missing { instrument: InstrumentName(instrument), reason })
        };
        Ok(rows.into_iter().map(missing).collect())
    }

    /// What operators answered in a session, in the order in which they did.
    ///
    /// # Errors
    /// [`StoreError::Busy`] or [`StoreError::Database`].
    pub async fn answers(
        &self,
        session: SessionId,
    ) -> Result<Vec<(StepNumber, Answer)>, StoreError> {
        let rows: Vec<(u32, String, String, String)> = sqlx::query_as(
            "SELECT step, name, value, given_by FROM answers WHERE session = ? ORDER BY id",
        )
        .bind(session.to_string())
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to("read the answers"))?;
        let answer = |(step, name, value, by)| (StepNumber(step), Answer { name, value, by });
        Ok(rows.into_iter().map(answer).collect())
    }

    /// The looks of the session's closings-in, in their order, each with its step; those of an
    /// earlier attempt at a step are left out.
    ///
    /// # Errors
    /// [`StoreError::Damaged`], [`StoreError::Busy`] or [`StoreError::Database`].
    pub async fn looks(&self, session: SessionId) -> Result<Vec<(StepNumber, Look)>, StoreError> {
        type Row = (u32, f64, f64, Option<f64>, Option<f64>, String, f64);
        let rows: Vec<Row> = sqlx::query_as(
            "SELECT l.step, l.commanded, l.read, l.dot_x_px, l.dot_y_px, l.at_utc, l.at_s
             FROM looks l JOIN steps s ON s.session = l.session AND s.number = l.step
             WHERE l.session = ? AND l.at_s >= s.started_s ORDER BY l.id",
        )
        .bind(session.to_string())
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to("read the looks"))?;
        let look = |(step, commanded, read, x, y, utc, seconds): Row| {
            let dot_px = x.zip(y).map(|(x, y)| [x, y]);
            let at = stamp(&utc, seconds)?;
            Ok((StepNumber(step), Look { at, commanded, read, dot_px }))
        };
        rows.into_iter().map(look).collect()
    }
}
