//! A session to a file.

use std::path::{Path, PathBuf};

use beampose_core::SessionId;
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqliteSynchronous};
use sqlx::{AssertSqlSafe, Connection as _, SqliteConnection};

use super::{Transferred, copy, copy_blobs, copy_calibrations, uri};
use crate::error::failed_to;
use crate::open::{connect, migrate};
use crate::tables::{SessionTable, blobs_of_session, session_tables};
use crate::{Store, StoreError};

impl Store {
    /// Writes a session with all that belongs to it into a file of its own. The file appears when
    /// it is whole.
    ///
    /// # Errors
    /// [`StoreError::NotFound`] where there is no such session; [`StoreError::Refused`] where the
    /// file is there already; [`StoreError::NotWritable`], [`StoreError::Disk`].
    pub async fn export_session(
        &self,
        session: SessionId,
        file: &Path,
    ) -> Result<Transferred, StoreError> {
        self.session(session).await?;
        let doing = format!("export session {session} to {}", file.display());
        if file.exists() {
            let reason = "the file is there already".to_owned();
            return Err(StoreError::Refused { doing, reason });
        }
        let part = beside(file);
        let written = self.write(session, &part, &doing).await;
        let finished = match written {
            Ok(transferred) => publish(&part, file).map(|()| transferred),
            Err(error) => Err(error),
        };
        if finished.is_err() {
            let _nothing_to_remove = std::fs::remove_file(&part);
        }
        finished
    }

    async fn write(
        &self,
        session: SessionId,
        part: &Path,
        doing: &str,
    ) -> Result<Transferred, StoreError> {
        let mut connection = fresh_file(part).await?;
        let filled = self.fill(&mut connection, session).await;
        let closed = connection.close().await;
        let filled = filled.map_err(failed_to(doing))?;
        closed.map_err(failed_to(doing))?;
        Ok(filled)
    }

    /// One transaction: what is read is one state of the session, whoever writes meanwhile.
    async fn fill(
        &self,
        connection: &mut SqliteConnection,
        session: SessionId,
    ) -> Result<Transferred, sqlx::Error> {
        let source =
            uri(self.path(), "mode=ro").map_err(|e| sqlx::Error::Protocol(e.to_string()))?;
        sqlx::query("ATTACH DATABASE ? AS source").bind(source).execute(&mut *connection).await?;
        let tables = session_tables(connection, "source").await?;
        let id = session.to_string();
        let mut transaction = connection.begin().await?;
        sqlx::query("PRAGMA defer_foreign_keys = ON").execute(&mut *transaction).await?;
        let ways = ["source", "main"];
        let mut rows = 0;
        for table in &tables {
            let counted = |numbered: &str, value: &str| rank(&tables, numbered, value);
            rows += copy(&mut transaction, table, ways, &id, counted).await?;
        }
        rows += copy_calibrations(&mut transaction, ways, &id).await?.rows;
        let hashes: Vec<String> = sqlx::query_scalar(AssertSqlSafe(format!(
            "SELECT blake3 FROM ({}) WHERE blake3 IS NOT NULL ORDER BY blake3",
            blobs_of_session("source")
        )))
        .bind(&id)
        .fetch_all(&mut *transaction)
        .await?;
        let pictures = copy_blobs(&mut transaction, ways, &hashes).await?;
        transaction.commit().await?;
        Ok(Transferred { session, rows, pictures })
    }
}

/// The place of a row of `numbered` among those of the session, from 1; null stays null.
fn rank(tables: &[SessionTable], numbered: &str, value: &str) -> String {
    let owner = tables.iter().find(|table| table.name == numbered);
    let key = owner.and_then(|table| table.key.first());
    let (Some(owner), Some(key)) = (owner, key) else { return value.to_owned() };
    let (owned, key) = (owner.owned("source", "n"), crate::tables::quoted(key));
    let table = crate::tables::quoted(numbered);
    format!(
        "CASE WHEN {value} IS NOT NULL THEN
            (SELECT count(*) FROM source.{table} n WHERE {owned} AND n.{key} <= {value}) END"
    )
}

/// A name beside `file` that nothing else has.
fn beside(file: &Path) -> PathBuf {
    let mut name = file.as_os_str().to_owned();
    name.push(format!(".{}.part", uuid::Uuid::now_v7()));
    PathBuf::from(name)
}

fn publish(part: &Path, file: &Path) -> Result<(), StoreError> {
    let synced = std::fs::File::open(part).and_then(|written| written.sync_all());
    synced.and_then(|()| std::fs::rename(part, file)).map_err(|error| StoreError::NotWritable {
        path: file.to_owned(),
        reason: error.to_string(),
    })
}

/// An empty database of this schema, the same bytes each time: when a migration was applied, and
/// how long that took, is not kept.
async fn fresh_file(path: &Path) -> Result<SqliteConnection, StoreError> {
    let options = SqliteConnectOptions::new()
        .filename(path)
        .create_if_missing(true)
        .foreign_keys(true)
        // A file that is not whole is thrown away: there is nothing to roll back to.
        .journal_mode(SqliteJournalMode::Memory)
        .synchronous(SqliteSynchronous::Off);
    let not_writable = |reason: String| StoreError::NotWritable { path: path.to_owned(), reason };
    let mut connection =
        connect(&options).await.map_err(|error| not_writable(error.to_string()))?;
    migrate(&mut connection).await.map_err(|error| not_writable(error.to_string()))?;
    for statement in [
        "UPDATE _sqlx_migrations SET installed_on = '1970-01-01 00:00:00', execution_time = 0",
        "VACUUM",
    ] {
        let done = sqlx::query(statement).execute(&mut connection).await;
        done.map_err(|error| not_writable(error.to_string()))?;
    }
    Ok(connection)
}
