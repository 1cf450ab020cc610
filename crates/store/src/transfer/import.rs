//! A session from a file that may have been made by anybody.
//!
//! The file is looked at before anything of it is used ([`super::check`]); then its rows are copied
//! under this database's own rules, in one transaction. Nothing that the file's schema says is
//! executed: it has to be ours, word for word.

use std::path::Path;

use beampose_core::SessionId;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{AssertSqlSafe, Connection as _, SqliteConnection};

use super::check::{checked, look_at_header};
use super::{Transferred, copy, copy_blobs, copy_calibrations, uri};
use crate::calibrations::damage;
use crate::error::failed_to;
use crate::open::{BUSY_TIMEOUT, connect};
use crate::stamp::damaged;
use crate::tables::{SessionTable, blobs_of_session, quoted, session_tables};
use crate::{Store, StoreError};

impl Store {
    /// Reads a session from a file that [`Store::export_session`] wrote. All of it or nothing; a
    /// session that is stored already is never touched.
    ///
    /// # Errors
    /// [`StoreError::NotADatabase`], [`StoreError::NewerSchema`], [`StoreError::Damaged`] for a
    /// file that is not what it should be; [`StoreError::Refused`] where the session is stored
    /// already or breaks a rule.
    pub async fn import_session(&self, file: &Path) -> Result<Transferred, StoreError> {
        look_at_header(file)?;
        let doing = format!("import {}", file.display());
        let options = SqliteConnectOptions::new()
            .filename(self.path())
            .busy_timeout(BUSY_TIMEOUT)
            .foreign_keys(true)
            .pragma("trusted_schema", "OFF")
            .pragma("cell_size_check", "ON");
        let mut connection = connect(&options).await.map_err(failed_to(&*doing))?;
        let imported = import(&mut connection, file, &doing).await;
        let closed = connection.close().await;
        let imported = imported?;
        closed.map_err(failed_to(doing))?;
        Ok(imported)
    }
}

async fn import(
    connection: &mut SqliteConnection,
    file: &Path,
    doing: &str,
) -> Result<Transferred, StoreError> {
    // Immutable: no lock, no journal and no log beside the file is looked at or made.
    sqlx::query("ATTACH DATABASE ? AS file")
        .bind(uri(file, "immutable=1")?)
        .execute(&mut *connection)
        .await
        .map_err(failed_to(doing))?;
    let session = checked(connection, file).await?;
    let tables = session_tables(connection, "file").await.map_err(failed_to(doing))?;
    let mut transaction =
        connection.begin_with("BEGIN IMMEDIATE").await.map_err(failed_to(doing))?;
    refuse_stored(&mut transaction, session, doing).await?;
    let mut rows = copy_rows(&mut transaction, &tables, session).await.map_err(failed_to(doing))?;
    rows += copy_hashed_calibrations(&mut transaction, session, file).await?;
    let pictures = copy_pictures(&mut transaction, session, file).await?;
    transaction.commit().await.map_err(failed_to(doing))?;
    Ok(Transferred { session, rows, pictures })
}

async fn refuse_stored(
    connection: &mut SqliteConnection,
    session: SessionId,
    doing: &str,
) -> Result<(), StoreError> {
    let stored: i64 = sqlx::query_scalar("SELECT count(*) FROM main.sessions WHERE id = ?")
        .bind(session.to_string())
        .fetch_one(connection)
        .await
        .map_err(failed_to(doing))?;
    if stored == 0 {
        return Ok(());
    }
    let reason = format!("session {session} is stored already, and stays as it is");
    Err(StoreError::Refused { doing: doing.to_owned(), reason })
}

async fn copy_rows(
    connection: &mut SqliteConnection,
    tables: &[SessionTable],
    session: SessionId,
) -> Result<u64, sqlx::Error> {
    sqlx::query("PRAGMA defer_foreign_keys = ON").execute(&mut *connection).await?;
    // Where each table's row numbers go on. Before the first row is copied: they grow meanwhile.
    let mut offsets = Vec::new();
    for table in tables {
        let own = table.columns.iter().find(|c| c.numbers.as_deref() == Some(&*table.name));
        if let Some(key) = own {
            let offset = next_number(connection, &table.name, &key.name).await?;
            offsets.push((table.name.clone(), offset));
        }
    }
    let mut rows = 0;
    for table in tables {
        let shifted = |numbered: &str, value: &str| {
            let offset = offsets.iter().find(|(name, _)| name == numbered).map_or(0, |o| o.1);
            format!("{value} + {offset}")
        };
        rows += copy(connection, table, ["file", "main"], &session.to_string(), shifted).await?;
    }
    Ok(rows)
}

/// The largest row number that a table has or had.
async fn next_number(
    connection: &mut SqliteConnection,
    table: &str,
    key: &str,
) -> Result<i64, sqlx::Error> {
    sqlx::query_scalar(AssertSqlSafe(format!(
        "SELECT max(coalesce((SELECT max({key}) FROM main.{table}), 0),
            coalesce((SELECT seq FROM main.sqlite_sequence WHERE name = ?1), 0))",
        key = quoted(key),
        table = quoted(table),
    )))
    .bind(table)
    .fetch_one(connection)
    .await
}

/// Copies the calibrations and hashes each that is new.
async fn copy_hashed_calibrations(
    connection: &mut SqliteConnection,
    session: SessionId,
    file: &Path,
) -> Result<u64, StoreError> {
    let doing = || failed_to(format!("import {}", file.display()));
    let ways = ["file", "main"];
    let copied = copy_calibrations(connection, ways, &session.to_string()).await.map_err(doing())?;
    for hash in copied.new {
        let content: String =
            sqlx::query_scalar("SELECT content_text FROM main.calibrations WHERE blake3 = ?")
                .bind(&hash)
                .fetch_one(&mut *connection)
                .await
                .map_err(doing())?;
        if let Some(reason) = damage(&hash, &content) {
            return Err(damaged(&format!("{}: calibration {hash}", file.display()), reason));
        }
    }
    Ok(copied.rows)
}

/// Copies the pictures and hashes each: what goes in is what its name says.
async fn copy_pictures(
    connection: &mut SqliteConnection,
    session: SessionId,
    file: &Path,
) -> Result<u64, StoreError> {
    let doing = || failed_to(format!("import {}", file.display()));
    let hashes: Vec<Option<String>> = sqlx::query_scalar(AssertSqlSafe(blobs_of_session("main")))
        .bind(session.to_string())
        .fetch_all(&mut *connection)
        .await
        .map_err(doing())?;
    let hashes: Vec<String> = hashes.into_iter().flatten().collect();
    copy_blobs(connection, ["file", "main"], &hashes).await.map_err(doing())?;
    for hash in &hashes {
        let bytes: Option<Vec<u8>> =
            sqlx::query_scalar("SELECT bytes FROM main.blobs WHERE blake3 = ?")
                .bind(hash)
                .fetch_optional(&mut *connection)
                .await
                .map_err(doing())?;
        let what = format!("{}: picture {hash}", file.display());
        let bytes = bytes.ok_or_else(|| damaged(&what, "its bytes are missing"))?;
        let found = blake3::hash(&bytes).to_hex();
        if found.as_str() != hash {
            return Err(damaged(&what, format!("its BLAKE3 is {found}")));
        }
    }
    Ok(hashes.len() as u64)
}
