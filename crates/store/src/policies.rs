//! What the plan's policies left: missing values, and answers of operators.

use beampose_core::{Answer, InstrumentName, Missing, SessionId, StepNumber};

use crate::error::failed_to;
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
}
