//! Damage on demand, for faults that a simulated rig declares: what a failing disk does.

use beampose_core::{SessionId, StepNumber};

use crate::error::failed_to;
use crate::writer::begin;
use crate::{Store, StoreError};

impl Store {
    /// Changes the last byte of the last picture that a step took, behind the back of its hash. A
    /// step without pictures stays as it is.
    ///
    /// # Errors
    /// [`StoreError::Busy`] or [`StoreError::Database`] where that cannot be written.
    pub async fn spoil_picture(
        &self,
        session: SessionId,
        step: StepNumber,
    ) -> Result<(), StoreError> {
        let doing = "damage a picture on demand";
        let mut transaction = begin(&self.writer, doing).await?;
        let picture: Option<(String, Vec<u8>)> = sqlx::query_as(
            "SELECT b.blake3, b.bytes FROM captures c
             JOIN pictures p ON p.session = c.session AND p.capture = c.id
             JOIN blobs b ON b.blake3 = p.blake3
             WHERE c.session = ? AND c.step = ? ORDER BY p.camera DESC LIMIT 1",
        )
        .bind(session.to_string())
        .bind(step.0)
        .fetch_optional(&mut *transaction)
        .await
        .map_err(failed_to(doing))?;
        let Some((hash, mut bytes)) = picture else { return Ok(()) };
        if let Some(last) = bytes.last_mut() {
            *last ^= 0xff;
        }
        sqlx::query("UPDATE blobs SET bytes = ? WHERE blake3 = ?")
            .bind(bytes)
            .bind(hash)
            .execute(&mut *transaction)
            .await
            .map_err(failed_to(doing))?;
        transaction.commit().await.map_err(failed_to(doing))
    }
}
