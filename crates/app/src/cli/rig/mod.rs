//! `beampose rig`: instruments by hand.

mod check;
mod hand;
mod probe;
pub mod simulate;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use beampose_core::InstrumentName;
use beampose_core::clock::BoxFuture;
use beampose_plan::Rig as RigFile;

use super::Ended;
use crate::input;
use crate::output::Exit;
use crate::rig_lock::RigLock;
use crate::settings::Overrides;
use crate::wiring::{self, Before, Laboratory, Recorder};

/// Find instruments, check a rig, and drive single instruments by hand
///
/// Nothing here lights a laser. Connecting switches one off.
#[derive(clap::Args)]
pub struct Rig {
    #[command(subcommand)]
    action: Action,
}

#[derive(clap::Subcommand)]
enum Action {
    Probe(probe::Probe),
    Check(check::Check),
    Read(check::Read),
    Jog(hand::Jog),
    Laser(hand::LaserAction),
    Capture(hand::Capture),
}

impl Rig {
    pub async fn execute(self) -> Result<Exit, Ended> {
        match self.action {
            Action::Probe(it) => it.execute().await,
            Action::Check(it) => it.execute().await,
            Action::Read(it) => it.execute().await,
            Action::Jog(it) => it.execute().await,
            Action::Laser(it) => it.execute().await,
            Action::Capture(it) => it.execute().await,
        }
    }
}

/// Which rig.
#[derive(clap::Args)]
pub struct Which {
    /// The rig, a YAML file
    rig: PathBuf,
    /// Keep what goes over the lines to instruments, byte for byte, one JSON object a line
    #[arg(long, value_name = "FILE")]
    record_wire: Option<PathBuf>,
}

/// A rig's instruments, ours alone.
pub struct Bench {
    rig: RigFile,
    laboratory: Laboratory,
    _lock: RigLock,
}

impl Which {
    /// Makes the rig's instruments; nothing is sent yet.
    ///
    /// # Errors
    /// Faults of the file; somebody else drives one of its instruments.
    fn open(&self) -> Result<Bench, Ended> {
        let rig = input::rig(&self.rig, &Overrides::default()).map_err(Ended::input)?;
        let recorder = match &self.record_wire {
            Some(path) => Some(Arc::new(Recorder::create(path).map_err(|error| {
                Ended::input(format!("--record-wire {}: {error}", path.display()))
            })?)),
            None => None,
        };
        let lock = RigLock::take(&rig, "beampose rig").map_err(Ended::input)?;
        let folder = self.rig.parent().unwrap_or(Path::new(""));
        let laboratory =
            wiring::laboratory(&rig, folder, &Before::default(), recorder).map_err(Ended::input)?;
        Ok(Bench { rig, laboratory, _lock: lock })
    }
}

impl Bench {
    async fn drive<'a, T: Send + 'a>(&self, future: BoxFuture<'a, T>) -> T {
        self.laboratory.clock.drive(future).await
    }

    /// The names of some instruments, or of all: one that the rig does not have is named.
    fn named(&self, wanted: &[String]) -> Result<Vec<InstrumentName>, Ended> {
        let known = || self.rig.instruments.keys().map(InstrumentName::as_str);
        wanted
            .iter()
            .map(|name| {
                let name = InstrumentName::from(name.as_str());
                if self.rig.instruments.contains_key(&name) {
                    Ok(name)
                } else {
                    let known: Vec<&str> = known().collect();
                    Err(Ended::input(format!(
                        "the rig has no instrument `{name}`; it has {}",
                        known.join(", ")
                    )))
                }
            })
            .collect()
    }
}
