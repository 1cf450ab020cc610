//! Sessions in SQLite: everything acquired, solved and reported, in one file.
//!
//! The only SQL in the project is here and in `migrations/`. The store knows nothing of
//! photogrammetry: solutions come and go as JSON and plain rows. What a simulation knows in secret
//! goes through [`truth`] and nowhere else.
//!
//! One connection writes, another the steps of a run in turn with it, a few read: SQLite has one
//! writer at a time anyway, and so a session's step never waits for a reader. Every write is one
//! durable transaction (WAL with `synchronous=FULL`): it is on the disk when the call returns.
//!
//! To add a table: a new file in `migrations/`, rows in [`rows`], reads and writes in one module.

mod batch;
mod calibrations;
mod disk;
mod error;
mod gaps;
mod history;
mod inputs;
mod labels;
mod open;
mod pictures;
mod policies;
mod processing;
mod remove;
pub mod rows;
mod sessions;
mod sink;
mod spoil;
mod stamp;
mod tables;
#[cfg(test)]
mod tests;
mod transfer;
pub mod truth;
mod verify;
mod writer;

use std::path::{Path, PathBuf};

use sqlx::SqlitePool;

use self::writer::Writer;

pub use error::StoreError;
pub use history::PastSession;
pub use open::path_of;
pub use processing::fresh_batch;
pub use remove::Deleted;
pub use rows::{
    Attempt, Calibration, CalibrationHead, CalibrationKind, CalibrationSource, Kept, NewProcessing,
    Note, PictureInfo, PoseRow, Processing, ProcessingId, ResultRow, SessionSummary, SolutionRow,
    StoredCapture, StoredEvent, StoredReading, StoredSession, StoredStep, Verification,
};
pub use transfer::Transferred;

/// A database of sessions. Cheap to clone: clones share the connections.
#[derive(Debug, Clone)]
pub struct Store {
    path: PathBuf,
    /// One at a time, so that writes queue here instead of failing as busy.
    writer: Writer,
    readers: SqlitePool,
}

impl Store {
    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Waits for what is under way, folds the write-ahead log into the file and closes it.
    pub async fn close(self) {
        self.readers.close().await;
        self.writer.close().await;
    }
}
