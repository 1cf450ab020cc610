//! What can go wrong, one variant for each thing that the caller can do about it.

use std::path::PathBuf;

/// Why the store did not do as asked. Each text fits after "failed to ...: ".
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The path is a folder: name a file.
    #[error("{} is a folder: name a file in it, as in {}", path.display(), path.join("beampose.db").display())]
    IsAFolder {
        /// What was named.
        path: PathBuf,
    },
    /// The folder of the path does not exist: make it.
    #[error("{} cannot be made: the folder {} does not exist", path.display(), folder.display())]
    NoSuchFolder {
        /// What was named.
        path: PathBuf,
        /// What is missing.
        folder: PathBuf,
    },
    /// The file is something else: name another one.
    #[error("{} is not a beampose database: {found}", path.display())]
    NotADatabase {
        /// What was named.
        path: PathBuf,
        /// What it is instead.
        found: String,
    },
    /// A newer program wrote it: update this one.
    #[error("{} was made by a newer beampose (schema {version}, this program knows up to {known}): update the program", path.display())]
    NewerSchema {
        /// What was named.
        path: PathBuf,
        /// The newest migration applied to it.
        version: i64,
        /// The newest migration that this program knows.
        known: i64,
    },
    /// No right to write: change the rights or name another file.
    #[error("{} cannot be written: {reason}", path.display())]
    NotWritable {
        /// What was named.
        path: PathBuf,
        /// What the system says.
        reason: String,
    },
    /// The file cannot be opened for a reason of the system.
    #[error("{} cannot be opened: {reason}", path.display())]
    NotOpened {
        /// What was named.
        path: PathBuf,
        /// What SQLite or the system says.
        reason: String,
    },
    /// Another program holds the database: wait and try again.
    #[error(
        "failed to {doing}: the database is held by another program; try again when it has finished"
    )]
    Busy {
        /// What was being done.
        doing: String,
    },
    /// The disk is full or failing: make room.
    #[error("failed to {doing}: the disk is full or failing: {reason}")]
    Disk {
        /// What was being done.
        doing: String,
        /// What SQLite says.
        reason: String,
    },
    /// What is stored is not what was put there: restore it from a backup.
    #[error("{what} is damaged: {reason}")]
    Damaged {
        /// What is damaged.
        what: String,
        /// How that shows.
        reason: String,
    },
    /// The database's rules forbid it, as for a second capture of the same name: a caller's mistake.
    #[error("refused to {doing}: {reason}")]
    Refused {
        /// What was being done.
        doing: String,
        /// Which rule.
        reason: String,
    },
    /// No session, capture or picture of that name: `nearest` are the likely ones.
    #[error("there is no {what}{}", hint(nearest))]
    NotFound {
        /// What was looked for.
        what: String,
        /// What there is instead.
        nearest: Vec<String>,
    },
    /// The beginning fits several sessions: write more of it.
    #[error("{wanted:?} fits {} sessions:\n  {}", candidates.len(), candidates.join("\n  "))]
    Ambiguous {
        /// What was written.
        wanted: String,
        /// The sessions that it fits, each with its title.
        candidates: Vec<String>,
    },
    /// Anything else that the database says.
    #[error("failed to {doing}: {source}")]
    Database {
        /// What was being done.
        doing: String,
        /// What the database says.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}

fn hint(nearest: &[String]) -> String {
    if nearest.is_empty() {
        return String::new();
    }
    format!("; there is:\n  {}", nearest.join("\n  "))
}

/// SQLite's primary result code of `error`, if it comes from SQLite
/// (<https://www.sqlite.org/rescode.html>: extended codes keep it in the low byte).
pub(crate) fn sqlite_code(error: &sqlx::Error) -> Option<u32> {
    let code = error.as_database_error()?.code()?;
    code.parse::<u32>().ok().map(|extended| extended & 0xff)
}

/// Turns what the database says into what the caller can do, `doing` being what was tried.
pub(crate) fn failed_to(doing: impl Into<String>) -> impl FnOnce(sqlx::Error) -> StoreError {
    let doing = doing.into();
    move |source| {
        let reason = source
            .as_database_error()
            .map_or_else(|| source.to_string(), |error| error.message().to_owned());
        by_code(doing, sqlite_code(&source), reason, source.into())
    }
}

/// [`failed_to`] for the connection of the steps.
pub(crate) fn step_failed_to(doing: &str, source: rusqlite::Error) -> StoreError {
    let (code, reason) = match &source {
        rusqlite::Error::SqliteFailure(failure, text) => {
            let code = u32::try_from(failure.extended_code & 0xff).ok();
            (code, text.clone().unwrap_or_else(|| failure.to_string()))
        }
        other => (None, other.to_string()),
    };
    by_code(doing.to_owned(), code, reason, source.into())
}

/// The thread that writes steps did not begin, or has ended.
pub(crate) fn without_thread(doing: &str, reason: String) -> StoreError {
    let source = format!("the thread that writes steps: {reason}").into();
    StoreError::Database { doing: doing.to_owned(), source }
}

fn by_code(
    doing: String,
    code: Option<u32>,
    reason: String,
    source: Box<dyn std::error::Error + Send + Sync>,
) -> StoreError {
    match code {
        // SQLITE_BUSY, SQLITE_LOCKED
        Some(5 | 6) => StoreError::Busy { doing },
        // SQLITE_IOERR, SQLITE_FULL
        Some(10 | 13) => StoreError::Disk { doing, reason },
        // SQLITE_CORRUPT, SQLITE_NOTADB
        Some(11 | 26) => StoreError::Damaged { what: "the database".to_owned(), reason },
        // SQLITE_READONLY, SQLITE_TOOBIG, SQLITE_CONSTRAINT
        Some(8 | 18 | 19) => StoreError::Refused { doing, reason },
        _ => StoreError::Database { doing, source },
    }
}
