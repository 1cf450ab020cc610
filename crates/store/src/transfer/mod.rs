//! A whole session as one file: an SQLite database of this schema that holds it alone.
//!
//! Row numbers mean nothing outside of their database: in a file they count from 1, and are counted
//! on from what is there when it is read. So the same session gives the same bytes, wherever it has
//! been. Where plan and rig lay on the disk stays behind: it means nothing elsewhere, and a file
//! must not name files to be read.
//!
//! Calibrations belong to no session, but travel with those that used them, and with those that they
//! were made from: in a file too one can tell where a pose comes from. The sessions that they were
//! made from do not come along. One that is stored already stays as it is.

mod check;
mod export;
mod import;

use std::path::Path;

use sqlx::{AssertSqlSafe, SqliteConnection};

use crate::StoreError;
use crate::calibrations::calibrations_of_session;
use crate::tables::{SessionTable, columns_of, quoted};

/// Set to null on the way.
const STAYS_BEHIND: (&str, &str) = ("sessions", "origin_json");

/// What a calibration consists of: the tables, and the column with its hash.
const OF_A_CALIBRATION: [(&str, &str); 2] =
    [("calibrations", "blake3"), ("calibration_sources", "calibration")];
/// What became of a session here is nothing that travels.
const OF_THIS_DATABASE: &str = "deleted_utc";

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

/// What travelled of calibrations.
#[derive(Default)]
struct Calibrations {
    /// Those that were not there already, by their hashes.
    new: Vec<String>,
    /// Rows of all of their tables.
    rows: u64,
}

/// Copies the calibrations that a session used, and those made from it.
async fn copy_calibrations(
    connection: &mut SqliteConnection,
    [from, to]: [&str; 2],
    session: &str,
) -> Result<Calibrations, sqlx::Error> {
    let mut copied = Calibrations::default();
    if columns_of(connection, from, OF_A_CALIBRATION[0].0).await?.is_empty() {
        // A file from before there were any.
        return Ok(copied);
    }
    let statement = AssertSqlSafe(calibrations_of_session(from));
    let hashes: Vec<String> =
        sqlx::query_scalar(statement).bind(session).fetch_all(&mut *connection).await?;
    for hash in hashes {
        let [calibration, sources] = OF_A_CALIBRATION;
        let rows = copy_calibration(connection, calibration, [from, to], &hash).await?;
        if rows > 0 {
            copied.rows += rows + copy_calibration(connection, sources, [from, to], &hash).await?;
            copied.new.push(hash);
        }
    }
    Ok(copied)
}

async fn copy_calibration(
    connection: &mut SqliteConnection,
    (table, column): (&str, &str),
    [from, to]: [&str; 2],
    hash: &str,
) -> Result<u64, sqlx::Error> {
    let (mut names, mut values) = (Vec::new(), Vec::new());
    for name in columns_of(connection, from, table).await? {
        values.push(if name == OF_THIS_DATABASE { "NULL".to_owned() } else { quoted(&name) });
        names.push(quoted(&name));
    }
    let statement = format!(
        "INSERT INTO {to}.{table} ({}) SELECT {} FROM {from}.{table} WHERE {column} = ?1
         ON CONFLICT DO NOTHING",
        names.join(", "),
        values.join(", "),
    );
    let copied = sqlx::query(AssertSqlSafe(statement)).bind(hash).execute(connection).await?;
    Ok(copied.rows_affected())
}
