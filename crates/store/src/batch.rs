//! A transaction as one parcel: all its statements go at once to a connection on a thread of its own.
//!
//! A step of a run is a handful of inserts, and there are hundreds of thousands of steps. `sqlx`
//! answers each statement by itself, and each answer wakes the engine's thread: that took a third of
//! a step's processor time. Here the engine is woken once, when all is durable.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError, mpsc};
use std::thread::JoinHandle;

use rusqlite::types::{ToSql, ToSqlOutput, Value};
use rusqlite::{Connection, OpenFlags, TransactionBehavior, params_from_iter};
use tokio::sync::oneshot;

use crate::error::{StoreError, step_failed_to, without_thread};
use crate::open::BUSY_TIMEOUT;
use crate::writer::{Turn, Writer};

/// More than the texts that a step may need.
const PREPARED: usize = 32;

/// Statements and what is bound to them, in order.
#[derive(Debug, Default)]
pub(crate) struct Batch {
    statements: Vec<(&'static str, Vec<Value>)>,
    refused: Option<rusqlite::Error>,
}

impl Batch {
    /// Adds a statement; its values follow by [`Batch::bind`].
    pub(crate) fn statement(&mut self, sql: &'static str) -> &mut Self {
        self.statements.push((sql, Vec::new()));
        self
    }

    /// Binds the next value of the newest statement.
    pub(crate) fn bind(&mut self, value: impl ToSql) -> &mut Self {
        match (value.to_sql().and_then(owned), self.statements.last_mut()) {
            (Ok(value), Some((_, values))) => values.push(value),
            (Err(error), _) => _ = self.refused.get_or_insert(error),
            (Ok(_), None) => {}
        }
        self
    }

    /// Does it all: durable when this returns, or nothing of it is there. Once it has its turn it is
    /// done to its end even where nobody waits for it any more.
    pub(crate) async fn commit(self, writer: &Writer, doing: &str) -> Result<(), StoreError> {
        if let Some(error) = self.refused {
            return Err(step_failed_to(doing, error));
        }
        let turn = writer.turn(doing).await?;
        let (done, answer) = oneshot::channel();
        writer.batches().send(Job { batch: self, turn, done }, doing)?;
        match answer.await {
            Ok(written) => written.map_err(|error| step_failed_to(doing, error)),
            Err(gone) => Err(without_thread(doing, gone.to_string())),
        }
    }

    pub(crate) fn write(&self, connection: &mut Connection) -> rusqlite::Result<()> {
        let transaction = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
        for (sql, values) in &self.statements {
            transaction.prepare_cached(sql)?.execute(params_from_iter(values))?;
        }
        transaction.commit()
    }
}

fn owned(value: ToSqlOutput<'_>) -> rusqlite::Result<Value> {
    match value {
        ToSqlOutput::Owned(value) => Ok(value),
        ToSqlOutput::Borrowed(value) => Ok(value.try_into()?),
        other => Err(rusqlite::Error::ToSqlConversionFailure(format!("{other:?}").into())),
    }
}

/// A batch and its turn, which ends with it.
struct Job {
    batch: Batch,
    turn: Turn,
    done: oneshot::Sender<rusqlite::Result<()>>,
}

/// The thread that writes batches. It begins with the first of them: most commands write none.
#[derive(Debug)]
pub(crate) struct Batches {
    path: PathBuf,
    thread: Mutex<Option<(mpsc::Sender<Job>, JoinHandle<()>)>>,
}

impl Batches {
    pub(crate) fn of(path: &Path) -> Self {
        Self { path: path.to_owned(), thread: Mutex::new(None) }
    }

    fn send(&self, job: Job, doing: &str) -> Result<(), StoreError> {
        let gone = |reason: String| without_thread(doing, reason);
        let mut thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner);
        if thread.as_ref().is_none_or(|(_, thread)| thread.is_finished()) {
            let (jobs, incoming) = mpsc::channel();
            let path = self.path.clone();
            let begun = std::thread::Builder::new()
                .name("beampose-steps".to_owned())
                .spawn(move || serve(&path, &incoming));
            *thread = Some((jobs, begun.map_err(|error| gone(error.to_string()))?));
        }
        let (jobs, _) = thread.as_ref().ok_or_else(|| gone("it has ended".to_owned()))?;
        jobs.send(job).map_err(|error| gone(error.to_string()))
    }

    /// Waits for the batches under way and closes the connection.
    pub(crate) async fn close(&self) {
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some((jobs, thread)) = thread {
            drop(jobs);
            // Whoever waited for a batch has been told by now, so that a panic is no news.
            let _ended = tokio::task::spawn_blocking(|| thread.join()).await;
        }
    }
}

/// Writes what comes in until nobody can send any more.
fn serve(path: &Path, incoming: &mpsc::Receiver<Job>) {
    let mut connection = None;
    for Job { batch, turn, done } in incoming {
        let written = match &mut connection {
            Some(connection) => batch.write(connection),
            // Tried again with the next batch where it fails.
            none => open(path).and_then(|opened| batch.write(none.insert(opened))),
        };
        // The next batch may be sent as soon as this one's sender knows.
        drop(turn);
        // Nobody waits any more where the caller gave up.
        let _told = done.send(written);
    }
}

/// With the settings of the other writing connection.
pub(crate) fn open(path: &Path) -> rusqlite::Result<Connection> {
    let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags(path, flags)?;
    connection.busy_timeout(BUSY_TIMEOUT)?;
    connection.pragma_update(None, "foreign_keys", true)?;
    connection.pragma_update(None, "synchronous", "FULL")?;
    connection.set_prepared_statement_cache_capacity(PREPARED);
    Ok(connection)
}
