//! Two runs never drive the same instruments.
//!
//! What is locked is the line to each instrument (driver and address), not the rig's file: two rigs
//! may name the same rail. The locks are in one folder for all users of the machine. Instruments
//! that are simulated without an address are each run's own.

use std::path::PathBuf;

use beampose_plan::Rig;

use crate::file_lock::{FileLock, NotTaken, this_program};
use crate::output::complain;

/// Held while instruments are driven.
pub struct RigLock(#[expect(dead_code, reason = "held, not read")] Vec<FileLock>);

impl RigLock {
    /// Takes the locks of all instruments of a rig, or none, for what is said in `purpose`.
    ///
    /// # Errors
    /// Who drives which instrument, or why a lock cannot be taken, for people.
    pub fn take(rig: &Rig, purpose: &str) -> Result<Self, String> {
        let holder = format!("{}, {purpose}", this_program());
        let mut lines: Vec<(String, &str)> = Vec::new();
        for (name, instrument) in &rig.instruments {
            let address = instrument.address().map_or("", |address| address.value.as_str());
            // A simulator that this program starts is this run's own.
            if address.starts_with("simulator:") {
                continue;
            }
            if !instrument.is_simulated() || !address.is_empty() {
                lines.push((format!("{} {address}", instrument.driver().value), name.as_str()));
            }
        }
        // One line may serve two instruments; in one order for all, so that nobody waits crosswise.
        lines.sort();
        lines.dedup_by(|a, b| a.0 == b.0);
        let folder = if lines.is_empty() { PathBuf::new() } else { folder()? };
        let mut held = Vec::new();
        for (line, name) in lines {
            let file = format!("{}.lock", blake3::hash(line.as_bytes()).to_hex());
            match FileLock::take(&folder.join(file), &holder) {
                Ok(lock) => {
                    if let Some(stale) = &lock.stale {
                        complain(&format!(
                            "beampose: {name} was driven by {stale}, which died; it is taken over"
                        ));
                    }
                    held.push(lock);
                }
                Err(NotTaken::Held(by)) => {
                    return Err(format!(
                        "{name} ({line}) is driven by {by}\n  help: wait for it, or stop it with `beampose tell`"
                    ));
                }
                Err(NotTaken::Cannot(why)) => return Err(why),
            }
        }
        Ok(Self(held))
    }
}

/// The folder of the locks: `BEAMPOSE_LOCKS`, else one that all users of this machine share.
fn folder() -> Result<PathBuf, String> {
    let folder = std::env::var_os("BEAMPOSE_LOCKS")
        .map_or_else(|| std::env::temp_dir().join("beampose-locks"), PathBuf::from);
    if !folder.is_dir() {
        std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt as _;
            // As /tmp itself: everybody may lock, nobody may take another's file away.
            let shared = std::fs::Permissions::from_mode(0o1777);
            let _others_may_not = std::fs::set_permissions(&folder, shared);
        }
    }
    Ok(folder)
}
