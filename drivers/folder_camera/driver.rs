//! A camera whose pictures come as files.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use async_trait::async_trait;
use beampose_core::{Camera, Clock, Frame, Identity, Instrument, InstrumentError};
use futures::lock::Mutex;

use super::protocol::{End, Pattern, Seen, end_of, is_picture, look};
use super::release::{Release, complaints};
use crate::aside::aside;
use crate::registry::{Connected, Role, Setting};
use crate::transport::Address;

/// Between two looks into the folder.
const POLL: Duration = Duration::from_millis(20);
/// How long a file must stay the same whose end mark is not quite at its end.
const STILL: Duration = Duration::from_millis(500);
/// A release may take at least so long, of real time: a program starts, a camera focuses.
const RELEASE: Duration = Duration::from_secs(30);
/// Until a picture is here, where the rig does not say.
const DELIVERY: Duration = Duration::from_millis(2500);

/// A watched folder.
pub struct FolderCamera {
    name: String,
    folder: PathBuf,
    pattern: Pattern,
    release: Release,
    keep: bool,
    /// How long a picture is waited for.
    wait: Duration,
    /// How long another one is waited for where an older one may still come.
    settle: Duration,
    complaints: PathBuf,
    clock: Arc<dyn Clock>,
    simulated: bool,
    ledger: Mutex<Ledger>,
}

/// What is known of the folder.
#[derive(Default)]
struct Ledger {
    /// Not to be taken for a picture to come.
    known: BTreeSet<String>,
    /// Released for, and not here: also where nobody waited to the end.
    missing: usize,
    /// Whether the missing ones were given their time once more.
    waited: bool,
}

pub(super) fn connect(setting: Setting) -> Result<Connected, InstrumentError> {
    let refused = |why: &str| InstrumentError::Refused(format!("{}: {why}", setting.name));
    let Role::Camera { delivery, .. } = setting.role else {
        return Err(refused("it is no camera"));
    };
    let Address::Folder(folder) = &setting.address else {
        return Err(refused("its address must be folder:PATH"));
    };
    let pattern = Pattern::read(setting.options.text("pattern")?);
    let release = Release::read(setting.options.text("release")?);
    let settle = delivery.unwrap_or(DELIVERY).max(POLL);
    Ok(Connected::Camera(Arc::new(FolderCamera {
        folder: folder.clone(),
        pattern: pattern.ok_or_else(|| refused("option pattern is empty"))?,
        release: release.ok_or_else(|| refused("option release: a quotation mark is open"))?,
        keep: setting.options.switch("keep")?,
        wait: settle * 4,
        settle,
        complaints: complaints(&setting.scratch, &setting.name),
        clock: setting.clock,
        simulated: setting.simulated,
        ledger: Mutex::default(),
        name: setting.name,
    })))
}

/// A file, and whether all of it is there.
type Looked = (Seen, End);

impl FolderCamera {
    /// The pictures that are not known.
    async fn new_files(&self, known: &BTreeSet<String>) -> Result<Vec<Looked>, InstrumentError> {
        let (folder, pattern, known) = (self.folder.clone(), self.pattern.clone(), known.clone());
        aside(&*self.clock, &self.name, move || {
            let seen = look(&folder, &pattern).map_err(|error| no_folder(&folder, &error))?;
            let new = seen.into_iter().filter(|it| !known.contains(&it.name));
            // What goes away again, or cannot be read yet, is not there yet.
            Ok(new
                .map(|it| {
                    let end = end_of(&folder.join(&it.name), it.size).unwrap_or(End::Missing);
                    (it, end)
                })
                .collect())
        })
        .await
    }

    /// Notes what is there now. What came since it was noted last belongs to no release.
    async fn note(&self, ledger: &mut Ledger) -> Result<(), InstrumentError> {
        let here = self.new_files(&BTreeSet::new()).await?;
        let names: BTreeSet<String> = here.into_iter().map(|(seen, _)| seen.name).collect();
        for name in names.difference(&ledger.known) {
            if ledger.missing > 0 {
                ledger.missing -= 1;
                let camera = &self.name;
                tracing::warn!(%camera, %name, "came too late for its trigger; left in the folder");
            }
        }
        // A name that is gone may come again.
        ledger.known = names;
        Ok(())
    }

    /// Gives missing pictures their time once more, so that they do not come amid the next.
    async fn await_missing(&self, ledger: &mut Ledger) -> Result<(), InstrumentError> {
        self.note(ledger).await?;
        let since = self.clock.now().monotonic;
        while ledger.missing > 0 && !ledger.waited {
            if self.clock.now().monotonic - since >= self.wait {
                ledger.waited = true;
            }
            self.clock.sleep(POLL).await;
            self.note(ledger).await?;
        }
        Ok(())
    }

    /// Waits for the files that come after a release: one, or with the missing ones before it.
    async fn arrivals(&self, ledger: &Ledger) -> Result<Vec<Seen>, InstrumentError> {
        let since = self.clock.now().monotonic;
        let (mut last, mut steady_since): (Vec<Looked>, _) = (Vec::new(), since);
        loop {
            let files = self.new_files(&ledger.known).await?;
            let now = self.clock.now().monotonic;
            if files != last {
                steady_since = now;
            }
            let steady = now - steady_since;
            let near = files.iter().any(|(_, end)| *end == End::Near);
            let ended = files.iter().all(|(_, end)| *end != End::Missing);
            let long_enough = if ledger.missing > 0 {
                self.settle.max(STILL)
            } else if near {
                STILL
            } else {
                POLL
            };
            if !files.is_empty() && ended && steady >= long_enough {
                return Ok(files.into_iter().map(|(seen, _)| seen).collect());
            }
            if now - since >= self.wait + self.settle {
                return Err(self.nothing_whole(&files));
            }
            if now - since >= self.wait && files.is_empty() {
                return Err(InstrumentError::Timeout(self.wait));
            }
            last = files;
            self.clock.sleep(POLL).await;
        }
    }

    fn nothing_whole(&self, files: &[Looked]) -> InstrumentError {
        let found: Vec<String> =
            files.iter().map(|(it, _)| format!("{}, {} bytes", it.name, it.size)).collect();
        let expected = format!("a whole JPEG or PNG file in {}", self.folder.display());
        InstrumentError::Garbled { expected, found: found.join("; ") }
    }

    /// Which of the files is that of the last release.
    fn own(&self, mut files: Vec<Seen>, ledger: &mut Ledger) -> Result<Seen, InstrumentError> {
        ledger.known.extend(files.iter().map(|it| it.name.clone()));
        let names: Vec<String> = files.iter().map(|it| it.name.clone()).collect();
        // The missing ones before it were waited for: they come ahead of it or never.
        let most = ledger.missing;
        match files.pop() {
            Some(newest) if files.len() < most => {
                for late in files {
                    let (camera, name) = (&self.name, late.name);
                    tracing::warn!(%camera, %name, "came too late for its trigger; left in the folder");
                }
                Ok(newest)
            }
            _ => Err(InstrumentError::Garbled {
                expected: format!("one picture for one release in {}", self.folder.display()),
                found: names.join(", "),
            }),
        }
    }

    async fn read(&self, seen: Seen) -> Result<Vec<u8>, InstrumentError> {
        let (path, keep) = (self.folder.join(&seen.name), self.keep);
        aside(&*self.clock, &self.name, move || {
            let failed = |error: std::io::Error| {
                InstrumentError::Fault(format!("{}: {error}", path.display()))
            };
            let bytes = std::fs::read(&path).map_err(failed)?;
            if !is_picture(&bytes) {
                let found = format!("{}, {} bytes", path.display(), bytes.len());
                let expected = "a JPEG or PNG file".to_owned();
                return Err(InstrumentError::Garbled { expected, found });
            }
            if !keep {
                std::fs::remove_file(&path).map_err(failed)?;
            }
            Ok(bytes)
        })
        .await
    }
}

fn no_folder(folder: &Path, error: &std::io::Error) -> InstrumentError {
    let cure = "does it exist, and is the share mounted?";
    InstrumentError::Disconnected(format!("{}: {error}: {cure}", folder.display()))
}

#[async_trait]
impl Instrument for FolderCamera {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        self.new_files(&BTreeSet::new()).await?;
        let model = format!("pictures in {}", self.folder.display());
        Ok(Identity { model, serial: None, simulated: self.simulated })
    }
}

#[async_trait]
impl Camera for FolderCamera {
    async fn arm(&self) -> Result<(), InstrumentError> {
        self.await_missing(&mut *self.ledger.lock().await).await
    }

    async fn trigger(&self) -> Result<Frame, InstrumentError> {
        let mut ledger = self.ledger.lock().await;
        self.await_missing(&mut ledger).await?;
        let requested = self.clock.now();
        let (release, wait) = (self.release.clone(), self.wait.max(RELEASE));
        let (folder, complaints) = (self.folder.clone(), self.complaints.clone());
        // Counted before anything can end this call: then it is missing.
        let before = ledger.missing;
        (ledger.missing, ledger.waited) = (before + 1, false);
        aside(&*self.clock, &self.name, move || release.fire(&folder, &complaints, wait)).await?;
        let files = {
            let known = ledger.known.clone();
            self.arrivals(&Ledger { known, missing: before, waited: true }).await?
        };
        let own = self.own(files, &mut ledger)?;
        // Whatever was missing before did not come in all that time.
        ledger.missing = 0;
        let bytes = self.read(own).await?;
        Ok(Frame { bytes, requested, delivered: self.clock.now() })
    }
}

#[cfg(test)]
mod tests;
