//! Deleting sessions, and giving back the space that they had.

use beampose_core::SessionId;
use sqlx::AssertSqlSafe;

use crate::error::failed_to;
use crate::stamp::count;
use crate::tables::{quoted, session_tables};
use crate::writer::{Write, begin};
use crate::{Store, StoreError};

/// What a deletion took away.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Deleted {
    /// Rows of all tables.
    pub rows: u64,
    /// Pictures that no other session has.
    pub pictures: u64,
    /// Their bytes.
    pub bytes: u64,
}

/// A picture that neither a capture nor an earlier attempt of any session names.
const UNNAMED: &str = "
    blake3 NOT IN (SELECT blake3 FROM pictures)
    AND blake3 NOT IN (
        SELECT json_extract(p.value, '$.blake3')
        FROM attempts a, json_each(a.capture_json, '$.pictures') p
        WHERE json_extract(p.value, '$.blake3') IS NOT NULL)";

impl Store {
    /// Deletes a session with everything that belongs to it, in one transaction. Pictures that
    /// another session has too stay, and so do calibrations: they say that it is gone.
    ///
    /// # Errors
    /// [`StoreError::NotFound`] where there is no such session; [`StoreError::Busy`],
    /// [`StoreError::Disk`] or [`StoreError::Database`]: it is then still there, whole.
    pub async fn delete_session(&self, session: SessionId) -> Result<Deleted, StoreError> {
        let doing = "delete a session";
        self.session(session).await?;
        let mut transaction = begin(&self.writer, doing).await?;
        let deleted = delete(&mut transaction, session).await.map_err(failed_to(doing))?;
        transaction.commit().await.map_err(failed_to(doing))?;
        Ok(deleted)
    }

    /// Gives the space of what was deleted back to the disk; how many bytes the file had, and has.
    ///
    /// # Errors
    /// [`StoreError::Busy`] while another program uses the database; [`StoreError::Disk`] where
    /// there is no room for a second copy.
    pub async fn vacuum(&self) -> Result<(u64, u64), StoreError> {
        let doing = "vacuum the database";
        let size = || std::fs::metadata(self.path()).map_or(0, |file| file.len());
        self.fold(doing).await?;
        let before = size();
        let mut writer = self.writer.turn(doing).await?;
        sqlx::query("VACUUM").execute(&mut *writer).await.map_err(failed_to(doing))?;
        drop(writer);
        self.fold(doing).await?;
        Ok((before, size()))
    }

    /// Folds the write-ahead log into the file.
    async fn fold(&self, doing: &str) -> Result<(), StoreError> {
        let mut writer = self.writer.turn(doing).await?;
        let (busy, _, _): (i64, i64, i64) = sqlx::query_as("PRAGMA wal_checkpoint(TRUNCATE)")
            .fetch_one(&mut *writer)
            .await
            .map_err(failed_to(doing))?;
        if busy == 0 { Ok(()) } else { Err(StoreError::Busy { doing: doing.to_owned() }) }
    }
}

async fn delete(transaction: &mut Write, session: SessionId) -> Result<Deleted, sqlx::Error> {
    // Until the commit rows may refer to what is gone: the order of the tables is of no matter.
    sqlx::query("PRAGMA defer_foreign_keys = ON").execute(&mut **transaction).await?;
    let mut tables = session_tables(transaction, "main").await?;
    // What says whose rows the others are goes last.
    tables.sort_by_key(|table| table.name == "processings");
    let mut deleted = Deleted::default();
    for table in tables {
        let name = quoted(&table.name);
        let statement = format!("DELETE FROM {name} WHERE {}", table.owned("main", &name));
        let done = sqlx::query(AssertSqlSafe(statement))
            .bind(session.to_string())
            .execute(&mut **transaction)
            .await?;
        deleted.rows += done.rows_affected();
    }
    // A calibration stays, and says what became of what it was made from.
    sqlx::query(
        "UPDATE calibration_sources SET deleted_utc = strftime('%Y-%m-%dT%H:%M:%SZ', 'now')
         WHERE made_from = ?",
    )
    .bind(session.to_string())
    .execute(&mut **transaction)
    .await?;
    let (pictures, bytes): (i64, i64) = sqlx::query_as(AssertSqlSafe(format!(
        "SELECT count(*), coalesce(sum(length(bytes)), 0) FROM blobs WHERE {UNNAMED}"
    )))
    .fetch_one(&mut **transaction)
    .await?;
    sqlx::query(AssertSqlSafe(format!("DELETE FROM blobs WHERE {UNNAMED}")))
        .execute(&mut **transaction)
        .await?;
    (deleted.pictures, deleted.bytes) = (count(pictures), count(bytes));
    Ok(deleted)
}
