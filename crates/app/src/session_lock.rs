//! One program at a time runs a session, or solves sessions together.
//!
//! The operating system holds the lock and lets it go when the program ends, however it ends: there
//! is no stale lock. The file says who holds it, for people.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Seek as _, Write as _};
use std::path::{Path, PathBuf};

use beampose_core::SessionId;

/// Held while a session runs, or sessions are solved.
pub struct SessionLock {
    file: File,
    path: PathBuf,
}

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
        let path = path(database, &session.to_string());
        let file = File::open(&path).ok()?;
        match file.try_lock_shared() {
            Err(TryLockError::WouldBlock) => {
                Some(std::fs::read_to_string(&path).unwrap_or_default().trim().to_owned())
            }
            // A file that nobody holds is left from a program that died.
            _ => None,
        }
    }

    fn named(database: &Path, name: &str, what: &str) -> Result<Self, String> {
        let path = path(database, name);
        let cannot = |error: std::io::Error| format!("{}: {error}", path.display());
        let mut options = OpenOptions::new();
        let file = options.read(true).write(true).create(true).truncate(false).open(&path);
        let mut file = file.map_err(cannot)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let holder = std::fs::read_to_string(&path).unwrap_or_default();
                return Err(format!(
                    "{what} by {}\n  help: stop it first (Ctrl-C there)",
                    holder.trim()
                ));
            }
            Err(TryLockError::Error(error)) => return Err(cannot(error)),
        }
        let now = jiff::Timestamp::now();
        file.set_len(0).and_then(|()| file.rewind()).map_err(cannot)?;
        writeln!(file, "process {} since {now:.0}", std::process::id()).map_err(cannot)?;
        Ok(Self { file, path })
    }
}

fn path(database: &Path, name: &str) -> PathBuf {
    let mut path = database.as_os_str().to_owned();
    path.push(format!(".{name}.lock"));
    PathBuf::from(path)
}

impl Drop for SessionLock {
    fn drop(&mut self) {
        // A file that stays is no lock: it is only not tidy.
        let _stays = std::fs::remove_file(&self.path);
        let _released = self.file.unlock();
    }
}
