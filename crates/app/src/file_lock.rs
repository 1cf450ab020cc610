//! A file that one program at a time holds.
//!
//! The operating system holds the lock and lets it go when the program ends, however it ends: a
//! stale lock holds nobody up. What the file says is for people: who holds it, and, where it still
//! says so although nobody does, who died with it.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read as _, Seek as _, Write as _};
use std::path::{Path, PathBuf};

/// Held until it is dropped.
pub struct FileLock {
    file: File,
    path: PathBuf,
    /// Who held it last, and died before letting it go.
    pub stale: Option<String>,
}

/// Why a lock was not taken.
pub enum NotTaken {
    /// Somebody holds it: what they wrote.
    Held(String),
    /// The file cannot be used.
    Cannot(String),
}

/// More than any holder writes.
const LONGEST: u64 = 4096;

impl FileLock {
    /// Takes the lock at `path`, and writes into it who has it.
    ///
    /// # Errors
    /// [`NotTaken`].
    pub fn take(path: &Path, holder: &str) -> Result<Self, NotTaken> {
        let cannot =
            |error: std::io::Error| NotTaken::Cannot(format!("{}: {error}", path.display()));
        loop {
            // The folder may be one that others write to: what they point at is not ours to change.
            if std::fs::symlink_metadata(path).is_ok_and(|found| found.is_symlink()) {
                return Err(NotTaken::Cannot(format!("{}: it is a link", path.display())));
            }
            let mut options = OpenOptions::new();
            let file = options.read(true).write(true).create(true).truncate(false).open(path);
            let mut file = file.map_err(cannot)?;
            let mut written = String::new();
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    let _for_people_only = file.take(LONGEST).read_to_string(&mut written);
                    return Err(NotTaken::Held(written.trim().to_owned()));
                }
                Err(TryLockError::Error(error)) => return Err(cannot(error)),
            }
            // Whoever held it may have taken the file away between opening and locking: then this
            // is a lock that nobody else will meet.
            if !is_at(&file, path) {
                continue;
            }
            let _for_people_only = (&file).take(LONGEST).read_to_string(&mut written);
            let stale = Some(written.trim().to_owned()).filter(|text| !text.is_empty());
            file.set_len(0).and_then(|()| file.rewind()).map_err(cannot)?;
            writeln!(file, "{holder}").map_err(cannot)?;
            return Ok(Self { file, path: path.to_owned(), stale });
        }
    }

    /// Who holds the lock at `path` just now; `None` where nobody does.
    pub fn holder(path: &Path) -> Option<String> {
        let file = File::open(path).ok()?;
        match file.try_lock_shared() {
            Err(TryLockError::WouldBlock) => {
                let mut written = String::new();
                let _for_people_only = file.take(LONGEST).read_to_string(&mut written);
                Some(written.trim().to_owned())
            }
            // A file that nobody holds is left from a program that died.
            _ => None,
        }
    }
}

#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    let of = |meta: std::fs::Metadata| (meta.dev(), meta.ino());
    match (file.metadata(), std::fs::metadata(path)) {
        (Ok(held), Ok(found)) => of(held) == of(found),
        _ => false,
    }
}

#[cfg(not(unix))]
fn is_at(_: &File, path: &Path) -> bool {
    path.exists()
}

impl Drop for FileLock {
    fn drop(&mut self) {
        // A file that stays is no lock: it is only not tidy.
        let _stays = std::fs::remove_file(&self.path);
        let _released = self.file.unlock();
    }
}

/// This program, for people.
pub fn this_program() -> String {
    let user = std::env::var("USER").or_else(|_| std::env::var("USERNAME"));
    let user = user.map(|user| format!(" of {user}")).unwrap_or_default();
    format!("process {}{user} since {:.0}", std::process::id(), jiff::Timestamp::now())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_holds_it_and_the_other_hears_who() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rail.lock");
        let held = FileLock::take(&path, "process 1").map_err(|_| "taken").unwrap();
        assert!(
            matches!(FileLock::take(&path, "process 2"), Err(NotTaken::Held(by)) if by == "process 1")
        );
        drop(held);
        assert!(FileLock::take(&path, "process 2").is_ok_and(|lock| lock.stale.is_none()));
    }

    #[test]
    fn a_lock_whose_holder_died_is_taken_over_and_says_whose_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rail.lock");
        std::fs::write(&path, "process 1 of ada, session x\n").unwrap();
        let taken = FileLock::take(&path, "process 2").map_err(|_| "held").unwrap();
        assert_eq!(taken.stale.as_deref(), Some("process 1 of ada, session x"));
    }

    #[test]
    fn two_never_hold_it_however_they_race() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rail.lock");
        let holders = std::sync::atomic::AtomicU32::new(0);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..500 {
                        if let Ok(_lock) = FileLock::take(&path, "racer") {
                            let order = std::sync::atomic::Ordering::SeqCst;
                            assert_eq!(holders.fetch_add(1, order), 0);
                            std::thread::yield_now();
                            holders.fetch_sub(1, order);
                        }
                    }
                });
            }
        });
    }
}
