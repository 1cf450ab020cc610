//! One program at a time runs a session.

use std::path::{Path, PathBuf};

use beampose_core::SessionId;

use crate::file_lock::{FileLock, NotTaken, this_program};

/// Held while a session runs.
pub struct SessionLock(#[expect(dead_code, reason = "held, not read")] FileLock);

impl SessionLock {
    /// Takes the lock of a session in a database.
    ///
    /// # Errors
    /// Who holds it, or why it cannot be taken, for people.
    pub fn take(database: &Path, session: SessionId) -> Result<Self, String> {
        let mut path = database.as_os_str().to_owned();
        path.push(format!(".{session}.lock"));
        match FileLock::take(&PathBuf::from(path), &this_program()) {
            Ok(lock) => Ok(Self(lock)),
            Err(NotTaken::Held(by)) => Err(format!(
                "session {session} is being run by {by}\n  help: stop it first (Ctrl-C there)"
            )),
            Err(NotTaken::Cannot(why)) => Err(why),
        }
    }
}
