//! The files that what solving is told was read from.

use std::collections::BTreeMap;

use beampose_core::{InstrumentName, SessionId, UsedFile};
use sqlx::SqliteConnection;

use crate::error::failed_to;
use crate::rows::ProcessingId;
use crate::{Store, StoreError};

type Row = (Option<i64>, Option<String>, String, String);

fn file((_, camera, file, blake3): Row) -> UsedFile {
    UsedFile { camera: camera.map(InstrumentName), file, blake3 }
}

/// Stores the files of a session, or of one of its processings.
pub(crate) async fn insert_files(
    connection: &mut SqliteConnection,
    session: SessionId,
    processing: Option<ProcessingId>,
    files: &[UsedFile],
) -> Result<(), sqlx::Error> {
    for one in files {
        sqlx::query(
            "INSERT INTO input_files (session, processing, camera, file, blake3)
             VALUES (?, ?, ?, ?, ?)",
        )
        .bind(session.to_string())
        .bind(processing.map(|id| id.0))
        .bind(one.camera.as_ref().map(InstrumentName::as_str))
        .bind(&one.file)
        .bind(&one.blake3)
        .execute(&mut *connection)
        .await?;
    }
    Ok(())
}

impl Store {
    async fn file_rows(&self, session: SessionId) -> Result<Vec<Row>, StoreError> {
        sqlx::query_as(
            "SELECT processing, camera, file, blake3 FROM input_files WHERE session = ? ORDER BY id",
        )
        .bind(session.to_string())
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to("read which files were used"))
    }

    /// Those that the session was run with.
    pub(crate) async fn files_of_session(
        &self,
        session: SessionId,
    ) -> Result<Vec<UsedFile>, StoreError> {
        let rows = self.file_rows(session).await?;
        Ok(rows.into_iter().filter(|row| row.0.is_none()).map(file).collect())
    }

    /// Those of processings that were told others.
    pub(crate) async fn files_of_processings(
        &self,
        session: SessionId,
    ) -> Result<BTreeMap<ProcessingId, Vec<UsedFile>>, StoreError> {
        let mut all: BTreeMap<ProcessingId, Vec<UsedFile>> = BTreeMap::new();
        for row in self.file_rows(session).await? {
            if let Some(processing) = row.0 {
                all.entry(ProcessingId(processing)).or_default().push(file(row));
            }
        }
        Ok(all)
    }
}
