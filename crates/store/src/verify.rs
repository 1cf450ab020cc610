//! Whether what is stored is still what was put there.

use beampose_core::SessionId;

use crate::error::failed_to;
use crate::rows::Verification;
use crate::{Store, StoreError};

impl Store {
    /// Hashes every picture of a session again, and lets SQLite check the whole file: its
    /// structure, its CHECKs and its foreign keys. One picture at a time is in memory.
    ///
    /// # Errors
    /// [`StoreError::NotFound`] where there is no such session; [`StoreError::Busy`] or
    /// [`StoreError::Database`] where it cannot be looked at. Damage is no error of the
    /// verification: it is in [`Verification::problems`].
    pub async fn verify(&self, session: SessionId) -> Result<Verification, StoreError> {
        self.session(session).await?;
        let mut found = Verification::default();
        for capture in self.captures(session).await? {
            if capture.pictures.is_empty() {
                found.problems.push(format!("capture {} has no picture", capture.id));
            }
            for info in &capture.pictures {
                match self.picture(session, &capture.id, &info.camera).await {
                    Ok(bytes) => {
                        found.pictures += 1;
                        found.bytes += bytes.len() as u64;
                    }
                    Err(error @ StoreError::Damaged { .. }) => {
                        found.problems.push(error.to_string());
                    }
                    Err(other) => return Err(other),
                }
            }
        }
        found.problems.extend(self.check_file().await?);
        Ok(found)
    }

    async fn check_file(&self) -> Result<Vec<String>, StoreError> {
        let lines: Vec<String> = sqlx::query_scalar("PRAGMA integrity_check")
            .fetch_all(&self.readers)
            .await
            .map_err(failed_to("check the database's structure"))?;
        let mut problems: Vec<String> = lines.into_iter().filter(|line| line != "ok").collect();
        let orphans: Vec<(String, i64)> = sqlx::query_as(
            "SELECT \"table\" || ' -> ' || parent, count(*) FROM pragma_foreign_key_check
             GROUP BY \"table\", parent",
        )
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to("check the foreign keys"))?;
        problems.extend(
            orphans.into_iter().map(|(relation, rows)| {
                format!("{rows} rows refer to what is not there: {relation}")
            }),
        );
        Ok(problems)
    }
}
