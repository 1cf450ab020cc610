//! Whether a file from elsewhere is what it says: a database of this schema with one whole session.
//! The cheap looks come first, and each is a look that cannot be talked into anything: plain bytes
//! of the header, then the schema as text, then the structure, then sizes, then words.

use std::io::Read as _;
use std::path::Path;

use beampose_core::SessionId;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{AssertSqlSafe, Connection as _, SqliteConnection};

use super::OF_A_CALIBRATION;
use crate::StoreError;
use crate::calibrations::calibrations_of_session;
use crate::error::failed_to;
use crate::open::{APPLICATION_ID, MAGIC, connect, migrate_to, newest_schema};
use crate::stamp::session_id;
use crate::tables::{SessionTable, columns_of, quoted, session_tables};

/// Largest picture, bytes: what import from a folder takes too.
const LARGEST_PICTURE: i64 = 200_000_000;
/// Largest row number: a table whose numbers are used up takes no row any more.
const LARGEST_NUMBER: i64 = 1_000_000_000_000;
/// Longest text in any column, bytes: observations of a camera in one capture have some 100 kB.
const LONGEST_TEXT: i64 = 64_000_000;

fn refused(file: &Path, found: impl Into<String>) -> StoreError {
    StoreError::NotADatabase { path: file.to_owned(), found: found.into() }
}

/// Looks at the first bytes (<https://www.sqlite.org/fileformat.html>, section 1.3), SQLite apart.
pub(super) fn look_at_header(file: &Path) -> Result<(), StoreError> {
    let not_opened = |error: std::io::Error| StoreError::NotOpened {
        path: file.to_owned(),
        reason: error.to_string(),
    };
    if file.is_dir() {
        return Err(refused(file, "it is a folder; `beampose import` reads exchange folders"));
    }
    let mut header = Vec::new();
    let opened = std::fs::File::open(file).map_err(not_opened)?;
    opened.take(100).read_to_end(&mut header).map_err(not_opened)?;
    if header.len() < 100 || !header.starts_with(MAGIC) {
        return Err(refused(file, "it is a file of another kind"));
    }
    let id = header.get(68..72).and_then(|b| <[u8; 4]>::try_from(b).ok()).map(u32::from_be_bytes);
    if id.map(i64::from) != Some(APPLICATION_ID) {
        return Err(refused(file, "it is the SQLite database of another program"));
    }
    let mut log = file.as_os_str().to_owned();
    log.push("-wal");
    if std::fs::metadata(&log).is_ok_and(|log| log.len() > 0) {
        return Err(refused(file, "a program has it open, or died with it open"));
    }
    Ok(())
}

/// Checks the attached database `file`; the one session that it holds.
pub(super) async fn checked(
    connection: &mut SqliteConnection,
    file: &Path,
) -> Result<SessionId, StoreError> {
    let doing = || failed_to(format!("look at {}", file.display()));
    check_schema(connection, file).await?;
    check_structure(connection, file).await?;
    let tables = session_tables(connection, "file").await.map_err(doing())?;
    check_numbers(connection, file, &tables).await?;
    check_sizes(connection, file, &tables).await?;
    let ids: Vec<String> = sqlx::query_scalar("SELECT id FROM file.sessions LIMIT 2")
        .fetch_all(&mut *connection)
        .await
        .map_err(doing())?;
    let [id] = ids.as_slice() else {
        let found = if ids.is_empty() { "it has no session" } else { "it has several sessions" };
        let found = format!("{found}; `beampose sessions export` writes one into a file");
        return Err(refused(file, found));
    };
    let session = session_id(id)?;
    if session.to_string() != *id {
        return Err(refused(file, "its session's id is not written as ids are"));
    }
    for table in &tables {
        let statement = format!(
            "SELECT count(*) FROM file.{} t WHERE ({}) IS NOT TRUE",
            quoted(&table.name),
            table.owned("file", "t")
        );
        let others: i64 = sqlx::query_scalar(AssertSqlSafe(statement))
            .bind(id)
            .fetch_one(&mut *connection)
            .await
            .map_err(doing())?;
        if others > 0 {
            return Err(refused(file, format!("{} has rows of no session", table.name)));
        }
    }
    check_calibrations(connection, file, id).await?;
    Ok(session)
}

/// Every calibration is one that the session used, or that was made from it; and what it was made
/// from are sessions.
async fn check_calibrations(
    connection: &mut SqliteConnection,
    file: &Path,
    session: &str,
) -> Result<(), StoreError> {
    let doing = || failed_to(format!("look at {}", file.display()));
    if columns_of(connection, "file", OF_A_CALIBRATION[0].0).await.map_err(doing())?.is_empty() {
        return Ok(());
    }
    let others: i64 = sqlx::query_scalar(AssertSqlSafe(format!(
        "SELECT count(*) FROM file.calibrations WHERE blake3 NOT IN ({})",
        calibrations_of_session("file")
    )))
    .bind(session)
    .fetch_one(&mut *connection)
    .await
    .map_err(doing())?;
    if others > 0 {
        return Err(refused(file, "calibrations has rows of no session"));
    }
    let made_from: Vec<String> = sqlx::query_scalar(
        "SELECT made_from FROM file.calibration_sources WHERE made_from IS NOT NULL",
    )
    .fetch_all(connection)
    .await
    .map_err(doing())?;
    made_from.iter().try_for_each(|id| session_id(id).map(|_| ()))
}

/// One object of a schema: type, name, table, text.
type Object = (String, String, String, Option<String>);

async fn objects(
    connection: &mut SqliteConnection,
    schema: &str,
) -> Result<Vec<Object>, sqlx::Error> {
    sqlx::query_as(AssertSqlSafe(format!(
        "SELECT type, name, tbl_name, sql FROM {schema}.sqlite_schema ORDER BY type, name"
    )))
    .fetch_all(connection)
    .await
}

/// The schema must be ours, word for word, as it was at some migration. So it has no trigger, no
/// virtual table, no expression but those that we wrote.
async fn check_schema(connection: &mut SqliteConnection, file: &Path) -> Result<(), StoreError> {
    let doing = || failed_to(format!("look at {}", file.display()));
    let theirs = objects(connection, "file").await.map_err(doing())?;
    let mut memory = connect(&SqliteConnectOptions::new().in_memory(true)).await.map_err(doing())?;
    for version in 1..=newest_schema() {
        let migrated = migrate_to(&mut memory, version).await;
        migrated.map_err(|error| refused(file, error.to_string()))?;
        if objects(&mut memory, "main").await.map_err(doing())? == theirs {
            return memory.close().await.map_err(doing());
        }
    }
    memory.close().await.map_err(doing())?;
    let newest: Result<i64, _> =
        sqlx::query_scalar("SELECT max(version) FROM file._sqlx_migrations")
            .fetch_one(connection)
            .await;
    match newest {
        Ok(version) if version > newest_schema() => {
            Err(StoreError::NewerSchema { path: file.to_owned(), version, known: newest_schema() })
        }
        _ => Err(refused(file, "its tables are not those of a session file")),
    }
}

async fn check_structure(connection: &mut SqliteConnection, file: &Path) -> Result<(), StoreError> {
    let doing = || failed_to(format!("look at {}", file.display()));
    let damage: String = sqlx::query_scalar("PRAGMA file.quick_check(1)")
        .fetch_one(&mut *connection)
        .await
        .map_err(doing())?;
    if damage != "ok" {
        let what = file.display().to_string();
        return Err(StoreError::Damaged { what, reason: damage });
    }
    let orphans = sqlx::query("PRAGMA file.foreign_key_check")
        .fetch_optional(connection)
        .await
        .map_err(doing())?;
    if orphans.is_some() {
        return Err(refused(file, "its rows refer to what is not there"));
    }
    Ok(())
}

async fn check_numbers(
    connection: &mut SqliteConnection,
    file: &Path,
    tables: &[SessionTable],
) -> Result<(), StoreError> {
    for table in tables {
        let own = table.columns.iter().find(|c| c.numbers.as_deref() == Some(&*table.name));
        let Some(key) = own.map(|column| quoted(&column.name)) else { continue };
        let (least, most): (Option<i64>, Option<i64>) = sqlx::query_as(AssertSqlSafe(format!(
            "SELECT min({key}), max({key}) FROM file.{}",
            quoted(&table.name)
        )))
        .fetch_one(&mut *connection)
        .await
        .map_err(failed_to(format!("look at {}", file.display())))?;
        if least.is_some_and(|n| n < 1) || most.is_some_and(|n| n > LARGEST_NUMBER) {
            return Err(refused(file, format!("{} has row numbers out of range", table.name)));
        }
    }
    Ok(())
}

/// Sizes first, since they are known without reading what has them; then control characters in
/// what is printed on terminals. Texts of files and JSON are never printed as they are.
async fn check_sizes(
    connection: &mut SqliteConnection,
    file: &Path,
    tables: &[SessionTable],
) -> Result<(), StoreError> {
    let largest: Option<i64> = sqlx::query_scalar("SELECT max(length(bytes)) FROM file.blobs")
        .fetch_one(&mut *connection)
        .await
        .map_err(failed_to(format!("look at {}", file.display())))?;
    if largest.unwrap_or(0) > LARGEST_PICTURE {
        return Err(refused(file, format!("a picture has more than {LARGEST_PICTURE} bytes")));
    }
    let doing = || failed_to(format!("look at {}", file.display()));
    let mut texts = Vec::new();
    for table in tables {
        let of_table = table.columns.iter().filter(|column| column.is_text);
        texts.extend(of_table.map(|column| (table.name.clone(), column.name.clone())));
    }
    for (table, _) in OF_A_CALIBRATION {
        let columns = columns_of(connection, "file", table).await.map_err(doing())?;
        texts.extend(columns.into_iter().map(|column| (table.to_owned(), column)));
    }
    for (table, column) in texts {
        let odd = check_texts(connection, &table, &column).await.map_err(doing())?;
        if let Some(what) = odd {
            return Err(refused(file, format!("{column} has {what}")));
        }
    }
    Ok(())
}

/// What is odd about the texts of a column.
async fn check_texts(
    connection: &mut SqliteConnection,
    table: &str,
    column: &str,
) -> Result<Option<String>, sqlx::Error> {
    let (table, name) = (quoted(table), quoted(column));
    let statement = format!("SELECT max(octet_length({name})) FROM file.{table}");
    let longest: Option<i64> =
        sqlx::query_scalar(AssertSqlSafe(statement)).fetch_one(&mut *connection).await?;
    if longest.unwrap_or(0) > LONGEST_TEXT {
        return Ok(Some(format!("a text of more than {LONGEST_TEXT} bytes")));
    }
    if column.ends_with("_json") || column.ends_with("_text") {
        return Ok(None);
    }
    let statement = format!(
        "SELECT count(*) FROM file.{table} WHERE {name} GLOB ?1
            OR instr(CAST({name} AS BLOB), x'00') > 0"
    );
    let hidden: i64 = sqlx::query_scalar(AssertSqlSafe(statement))
        .bind("*[\u{1}-\u{8}\u{b}-\u{1f}\u{7f}-\u{9f}]*")
        .fetch_one(connection)
        .await?;
    Ok((hidden > 0).then(|| "control characters".to_owned()))
}
