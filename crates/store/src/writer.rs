//! The one connection that writes, and the one beside it for the steps of a run, in turn.
//!
//! Not a pool of one: a pool asks a connection whether it is still there each time that it lends it
//! and takes it back, which for a step of a run was a third of all work.

use std::ops::{Deref, DerefMut};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use sqlx::{Connection as _, SqliteConnection};
use tokio::sync::{Mutex, OwnedMappedMutexGuard, OwnedMutexGuard};

use crate::batch::Batches;
use crate::error::{StoreError, failed_to};

/// How long a write waits for its turn. A verification or a deletion may take long; giving up
/// earlier helps nobody.
const TURN: Duration = Duration::from_secs(120);

/// The writing connection. Clones are one.
#[derive(Debug, Clone)]
pub(crate) struct Writer(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    connection: Arc<Mutex<Option<SqliteConnection>>>,
    batches: Batches,
    /// A transaction was given up and not yet rolled back.
    unfinished: AtomicBool,
}

/// The connection, for as long as it is borrowed.
pub(crate) type Turn = OwnedMappedMutexGuard<Option<SqliteConnection>, SqliteConnection>;

impl Writer {
    pub(crate) fn new(path: &Path, connection: SqliteConnection) -> Self {
        let connection = Arc::new(Mutex::new(Some(connection)));
        let batches = Batches::of(path);
        Self(Arc::new(Inner { connection, batches, unfinished: AtomicBool::new(false) }))
    }

    /// Where a batch goes that has its turn.
    pub(crate) fn batches(&self) -> &Batches {
        &self.0.batches
    }

    /// Waits for its turn.
    pub(crate) async fn turn(&self, doing: &str) -> Result<Turn, StoreError> {
        let busy = || StoreError::Busy { doing: doing.to_owned() };
        let turn = tokio::time::timeout(TURN, self.0.connection.clone().lock_owned());
        let turn = turn.await.map_err(|_| busy())?;
        let mut turn = OwnedMutexGuard::try_map(turn, Option::as_mut)
            .map_err(|_| failed_to(doing)(sqlx::Error::PoolClosed))?;
        if self.0.unfinished.swap(false, Ordering::SeqCst) {
            // Where SQLite has rolled back by itself there is nothing left to do.
            let _done = sqlx::query("ROLLBACK").execute(&mut *turn).await;
        }
        Ok(turn)
    }

    /// Waits for what is under way and closes the connections.
    pub(crate) async fn close(&self) {
        if let Some(connection) = self.0.connection.lock().await.take()
            && let Err(error) = connection.close().await
        {
            tracing::warn!("the writing connection was not closed properly: {error}");
        }
        self.0.batches.close().await;
    }
}

/// A transaction. What is not committed is rolled back.
pub(crate) struct Write {
    turn: Turn,
    writer: Writer,
    finished: bool,
}

/// Begins a transaction that writes from its first statement on, so that it cannot fail later for
/// want of the lock.
pub(crate) async fn begin(writer: &Writer, doing: &str) -> Result<Write, StoreError> {
    let turn = writer.turn(doing).await?;
    let mut write = Write { turn, writer: writer.clone(), finished: false };
    sqlx::query("BEGIN IMMEDIATE").execute(&mut *write).await.map_err(failed_to(doing))?;
    Ok(write)
}

impl Write {
    /// Makes it durable: it is on the disk when this returns.
    pub(crate) async fn commit(mut self) -> Result<(), sqlx::Error> {
        sqlx::query("COMMIT").execute(&mut *self).await?;
        self.finished = true;
        Ok(())
    }
}

impl Deref for Write {
    type Target = SqliteConnection;

    fn deref(&self) -> &SqliteConnection {
        &self.turn
    }
}

impl DerefMut for Write {
    fn deref_mut(&mut self) -> &mut SqliteConnection {
        &mut self.turn
    }
}

impl Drop for Write {
    fn drop(&mut self) {
        if self.finished {
            return;
        }
        self.writer.0.unfinished.store(true, Ordering::SeqCst);
        // Rolled back as soon as this is gone, so that no other program waits for it; else by
        // whoever writes next.
        if let Ok(runtime) = tokio::runtime::Handle::try_current() {
            let writer = self.writer.clone();
            runtime.spawn(async move {
                let _rolled_back = writer.turn("roll back").await;
            });
        }
    }
}
