//! Opening a database: what is at the path, the connections' settings, the migrations.
//!
//! Nothing is written to a file that is not ours: the file is looked at first, through a
//! connection that changes no setting.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use beampose_core::clock::BoxFuture;
use sqlx::migrate::{Migrate, MigrateError, Migrator};
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{ConnectOptions, Connection, SqliteConnection};

use crate::Store;
use crate::error::{StoreError, sqlite_code};
use crate::writer::Writer;

static MIGRATOR: Migrator = sqlx::migrate!("../../migrations");

/// The table that sqlx keeps, so that its own tools know it too.
const MIGRATIONS_TABLE: &str = "_sqlx_migrations";
/// Longer than any transaction of ours takes, a verification of a long session aside.
pub(crate) const BUSY_TIMEOUT: Duration = Duration::from_secs(10);
/// A reader each for the report, the web pages, the solving pipeline and one to spare.
const READERS: u32 = 4;
/// `PRAGMA application_id` of the first migration: 'bpos'.
pub(crate) const APPLICATION_ID: i64 = 1_651_535_731;
/// How every SQLite file begins (<https://www.sqlite.org/fileformat.html>, section 1.3.1).
pub(crate) const MAGIC: &[u8; 16] = b"SQLite format 3\0";

/// The path that a `--db` argument or `DATABASE_URL` means: `sqlite:` and `sqlite://` in front of
/// it, and `?mode=...` behind it then, are taken off.
#[must_use]
pub fn path_of(text: &str) -> PathBuf {
    let Some(rest) = text.strip_prefix("sqlite:") else {
        return PathBuf::from(text);
    };
    let rest = rest.strip_prefix("//").unwrap_or(rest);
    PathBuf::from(rest.split_once('?').map_or(rest, |(path, _)| path))
}

impl Store {
    /// Opens the database at `path`, made if there is none, and brings it up to this schema.
    ///
    /// # Errors
    /// [`StoreError::IsAFolder`], [`StoreError::NoSuchFolder`], [`StoreError::NotADatabase`],
    /// [`StoreError::NewerSchema`], [`StoreError::NotWritable`], [`StoreError::Busy`] as their
    /// names say; [`StoreError::NotOpened`] for the rest.
    pub async fn open(path: &Path) -> Result<Self, StoreError> {
        let fresh = look_at(path)?;
        let options = SqliteConnectOptions::new()
            .filename(path)
            .create_if_missing(true)
            .busy_timeout(BUSY_TIMEOUT)
            .foreign_keys(true)
            // How long a statement took on a slow disk is no warning that anybody can heed.
            .disable_statement_logging();
        let mut first = connect(&options).await.map_err(|error| cannot(path, &error))?;
        let prepared = prepare(path, &mut first, fresh).await;
        // The error of preparing says more than the one of closing would.
        let closed = first.close().await;
        prepared?;
        closed.map_err(|error| cannot(path, &error))?;

        let writing = options
            .clone()
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full);
        let writer = in_turn(path, writing).await?;
        let reading = options.create_if_missing(false).read_only(true);
        let readers =
            pool(READERS).connect_with(reading).await.map_err(|error| cannot(path, &error))?;
        Ok(Self { path: path.to_owned(), writer, readers })
    }
}

/// The writing connection. Going over to the write-ahead log does not wait for another program that
/// does the same, as every other statement would: it is busy at once.
async fn in_turn(path: &Path, options: SqliteConnectOptions) -> Result<Writer, StoreError> {
    let end = Instant::now() + BUSY_TIMEOUT;
    loop {
        match connect(&options).await.map_err(|error| cannot(path, &error)) {
            Err(StoreError::Busy { .. }) if Instant::now() < end => {
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
            connected => return connected.map(|connection| Writer::new(path, connection)),
        }
    }
}

/// Connections that stay: closing the last one would fold the write-ahead log each time.
fn pool(size: u32) -> SqlitePoolOptions {
    SqlitePoolOptions::new()
        .max_connections(size)
        .min_connections(1)
        .idle_timeout(None)
        .max_lifetime(None)
        // A verification may hold a reader for long; giving up earlier helps nobody.
        .acquire_timeout(Duration::from_secs(120))
}

/// Says what is wrong with a path before SQLite does, more clearly; true where nothing is there.
fn look_at(path: &Path) -> Result<bool, StoreError> {
    if path.is_dir() {
        return Err(StoreError::IsAFolder { path: path.to_owned() });
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
        return Err(StoreError::NoSuchFolder { path: path.to_owned(), folder: folder.to_owned() });
    }
    let mut file = match std::fs::File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(true),
        Err(error) => {
            return Err(StoreError::NotOpened { path: path.to_owned(), reason: error.to_string() });
        }
    };
    let mut start = Vec::new();
    let read = file.by_ref().take(MAGIC.len() as u64).read_to_end(&mut start);
    read.map_err(|error| StoreError::NotOpened {
        path: path.to_owned(),
        reason: error.to_string(),
    })?;
    if start.is_empty() {
        return Ok(true);
    }
    if start != MAGIC {
        let found = "it is a file of another kind".to_owned();
        return Err(StoreError::NotADatabase { path: path.to_owned(), found });
    }
    Ok(false)
}

/// Makes sure that the database is ours, then migrates it; both while nobody else writes, so that
/// two programs that start together on a new file do not migrate twice.
async fn prepare(
    path: &Path,
    connection: &mut SqliteConnection,
    fresh: bool,
) -> Result<(), StoreError> {
    if !fresh {
        refuse_others(path, connection).await?;
    }
    let mut transaction =
        connection.begin_with("BEGIN IMMEDIATE").await.map_err(|error| cannot(path, &error))?;
    migrate(&mut transaction).await.map_err(|error| cannot_migrate(path, error))?;
    transaction.commit().await.map_err(|error| cannot(path, &error))
}

/// Applies what is missing. `Migrator::run` would do, but its future cannot cross threads when it
/// is given a connection, and given a pool it takes no lock.
pub(crate) async fn migrate(connection: &mut SqliteConnection) -> Result<(), MigrateError> {
    migrate_to(connection, newest_schema()).await
}

/// Applies what is missing up to a version.
pub(crate) async fn migrate_to(
    connection: &mut SqliteConnection,
    newest: i64,
) -> Result<(), MigrateError> {
    connection.ensure_migrations_table(MIGRATIONS_TABLE).await?;
    let applied = connection.list_applied_migrations(MIGRATIONS_TABLE).await?;
    for one in &applied {
        match MIGRATOR.iter().find(|known| known.version == one.version) {
            None => return Err(MigrateError::VersionMissing(one.version)),
            Some(known) if known.checksum != one.checksum => {
                return Err(MigrateError::VersionMismatch(one.version));
            }
            Some(_) => {}
        }
    }
    for migration in MIGRATOR.iter().filter(|one| one.version <= newest) {
        if !applied.iter().any(|one| one.version == migration.version) {
            connection.apply(MIGRATIONS_TABLE, migration).await?;
        }
    }
    Ok(())
}

/// Boxed, because the compiler cannot see that the future may cross threads.
pub(crate) fn connect(
    options: &SqliteConnectOptions,
) -> BoxFuture<'_, Result<SqliteConnection, sqlx::Error>> {
    Box::pin(options.connect())
}

async fn refuse_others(path: &Path, connection: &mut SqliteConnection) -> Result<(), StoreError> {
    let looked: Result<(i64, i64), sqlx::Error> = async {
        let id = sqlx::query_scalar("PRAGMA application_id").fetch_one(&mut *connection).await?;
        let tables =
            sqlx::query_scalar("SELECT count(*) FROM sqlite_schema").fetch_one(connection).await?;
        Ok((id, tables))
    }
    .await;
    let (id, tables) = looked.map_err(|error| cannot(path, &error))?;
    if id == APPLICATION_ID || tables == 0 {
        return Ok(());
    }
    let found = "it is the SQLite database of another program".to_owned();
    Err(StoreError::NotADatabase { path: path.to_owned(), found })
}

/// The newest migration that this program knows; they are counted from 1 without a gap.
pub(crate) fn newest_schema() -> i64 {
    MIGRATOR.iter().map(|migration| migration.version).max().unwrap_or(0)
}

fn cannot_migrate(path: &Path, error: MigrateError) -> StoreError {
    let known = newest_schema();
    match error {
        MigrateError::VersionMissing(version) if version > known => {
            StoreError::NewerSchema { path: path.to_owned(), version, known }
        }
        MigrateError::Execute(error) | MigrateError::ExecuteMigration(error, _) => {
            cannot(path, &error)
        }
        other => StoreError::NotOpened { path: path.to_owned(), reason: other.to_string() },
    }
}

fn cannot(path: &Path, error: &sqlx::Error) -> StoreError {
    let path = path.to_owned();
    let reason =
        error.as_database_error().map_or_else(|| error.to_string(), |e| e.message().to_owned());
    match sqlite_code(error) {
        Some(5 | 6) => StoreError::Busy { doing: format!("open {}", path.display()) },
        // SQLITE_PERM, SQLITE_READONLY
        Some(3 | 8) => StoreError::NotWritable { path, reason },
        Some(26) => StoreError::NotADatabase { path, found: reason },
        Some(11) => StoreError::Damaged { what: path.display().to_string(), reason },
        // SQLITE_CANTOPEN: the folder of a new file, or the files beside it, cannot be written.
        Some(14) => StoreError::NotWritable { path, reason },
        _ => StoreError::NotOpened { path, reason },
    }
}
