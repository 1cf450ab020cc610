//! A whole session as one file: an SQLite database of this schema that holds it alone.
//!
//! Row numbers mean nothing outside of their database: in a file they count from 1, and are counted
//! on from what is there when it is read. So the same session gives the same bytes, wherever it has
//! been. Where plan and rig lay on the disk stays behind: it means nothing elsewhere, and a file
//! must not name files to be read.

mod check;
mod export;
mod import;

use std::path::Path;

use sqlx::{AssertSqlSafe, SqliteConnection};

use crate::StoreError;
use crate::tables::{SessionTable, quoted};

/// Set to null on the way.
const STAYS_BEHIND: (&str, &str) = ("sessions", "origin_json");

/// What was written or read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Transferred {
    /// The session.
    pub session: beampose_core::SessionId,
    /// Rows, pictures aside.
    pub rows: u64,
    /// Pictures, each once.
    pub pictures: u64,
}

/// The URI of a file for `ATTACH`, whatever characters its path has.
fn uri(path: &Path, mode: &str) -> Result<String, StoreError> {
    let not_opened = |reason: String| StoreError::NotOpened { path: path.to_owned(), reason };
    let absolute = std::path::absolute(path).map_err(|error| not_opened(error.to_string()))?;
    let text = absolute.to_str().ok_or_else(|| not_opened("its path is not UTF-8".to_owned()))?;
    let mut uri = "file:".to_owned();
    for byte in text.bytes() {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'/' | b'.' | b'_' | b'-' => {
                uri.push(char::from(byte));
            }
            other => uri.push_str(&format!("%{other:02x}")),
        }
    }
    Ok(format!("{uri}?{mode}"))
}

/// Copies a session's rows of one table, each value as `value` says.
async fn copy(
    connection: &mut SqliteConnection,
    table: &SessionTable,
    [from, to]: [&str; 2],
    session: &str,
    value: impl Fn(&str, &str) -> String,
) -> Result<u64, sqlx::Error> {
    let mut names = Vec::new();
    let mut values = Vec::new();
    for column in &table.columns {
        let name = quoted(&column.name);
        values.push(if (table.name.as_str(), column.name.as_str()) == STAYS_BEHIND {
            "NULL".to_owned()
        } else if let Some(numbered) = &column.numbers {
            value(numbered, &format!("t.{name}"))
        } else {
            format!("t.{name}")
        });
        names.push(name);
    }
    let order: Vec<String> = table.key.iter().map(|name| format!("t.{}", quoted(name))).collect();
    let statement = format!(
        "INSERT INTO {to}.{table} ({names}) SELECT {values} FROM {from}.{table} t
         WHERE {owned} ORDER BY {order}",
        table = quoted(&table.name),
        names = names.join(", "),
        values = values.join(", "),
        owned = table.owned(from, "t"),
        order = order.join(", "),
    );
    let copied = sqlx::query(AssertSqlSafe(statement)).bind(session).execute(connection).await?;
    Ok(copied.rows_affected())
}

/// Copies the pictures, one at a time; how many.
async fn copy_blobs(
    connection: &mut SqliteConnection,
    [from, to]: [&str; 2],
    hashes: &[String],
) -> Result<u64, sqlx::Error> {
    let statement = format!(
        "INSERT INTO {to}.blobs (blake3, bytes) SELECT blake3, bytes FROM {from}.blobs
         WHERE blake3 = ?1 ON CONFLICT (blake3) DO NOTHING"
    );
    let mut copied = 0;
    for hash in hashes {
        let one = sqlx::query(AssertSqlSafe(statement.clone())).bind(hash);
        copied += one.execute(&mut *connection).await?.rows_affected();
    }
    Ok(copied)
}
