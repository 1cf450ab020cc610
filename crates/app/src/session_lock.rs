//! One program at a time runs a session, or solves sessions together.

use std::path::{Path, PathBuf};

use beampose_core::SessionId;

use crate::file_lock::{FileLock, NotTaken, this_program};

/// Held while a session runs, or sessions are solved.
pub struct SessionLock(#[expect(dead_code, reason = "held, not read")] FileLock);

impl SessionLock {
    /// Takes the lock of a session in a database.
    ///
    /// # Errors
    /// Who holds it, or why it cannot be taken, for people.
    pub fn take(database: &Path, session: SessionId) -> Result<Self, String> {
        Self::named(database, &session.to_string(), &format!("session {session} is being run"))
    }

    /// Takes the lock of sessions that are solved together.
    ///
    /// # Errors
    /// As [`SessionLock::take`].
    pub fn of_batch(database: &Path, batch: &str) -> Result<Self, String> {
        Self::named(database, &format!("solve-{batch}"), "these sessions are being solved")
    }

    /// Who runs a session just now, for people; `None` where nobody does.
    pub fn holder(database: &Path, session: SessionId) -> Option<String> {
        FileLock::holder(&path(database, &session.to_string()))
    }

    fn named(database: &Path, name: &str, what: &str) -> Result<Self, String> {
        match FileLock::take(&path(database, name), &this_program()) {
            Ok(lock) => Ok(Self(lock)),
            Err(NotTaken::Held(by)) => {
                Err(format!("{what} by {by}\n  help: stop it first (Ctrl-C there)"))
            }
            Err(NotTaken::Cannot(why)) => Err(why),
        }
    }
}

fn path(database: &Path, name: &str) -> PathBuf {
    let mut path = database.as_os_str().to_owned();
    path.push(format!(".{name}.lock"));
    PathBuf::from(path)
}
