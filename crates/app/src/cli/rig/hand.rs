//! Single instruments by hand: `jog`, `laser off`, `capture`.

use std::path::PathBuf;

use beampose_core::instrument::AxisUnit;
use beampose_core::{Emission, InstrumentName};

use super::check::unit;
use super::{Ended, Which};
use crate::output::{Exit, complain, print};

/// Move an axis, by hand and at once
///
/// Ctrl-C stops it. The rig's soft limits hold.
#[derive(clap::Args)]
#[command(group = clap::ArgGroup::new("where").required(true))]
pub struct Jog {
    #[command(flatten)]
    which: Which,
    /// The axis' name in the rig
    axis: String,
    /// To this place, in millimetres or degrees
    #[arg(long, value_name = "PLACE", group = "where", allow_hyphen_values = true)]
    to: Option<f64>,
    /// By so much from where it stands
    #[arg(long, value_name = "DISTANCE", group = "where", allow_hyphen_values = true)]
    by: Option<f64>,
    /// To its reference: the search may take it over all of its travel
    #[arg(long, group = "where")]
    home: bool,
}

impl Jog {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let bench = self.which.open()?;
        let name = bench.named(std::slice::from_ref(&self.axis))?.remove(0);
        let Some(axis) = bench.laboratory.bench.axes.get(&name).cloned() else {
            return Err(Ended::input(format!("`{name}` is no axis")));
        };
        let (to, by, home) = (self.to, self.by, self.home);
        let moving = {
            let axis = axis.clone();
            bench.drive(Box::pin(async move {
                if home {
                    return match axis.homing() {
                        Some(homing) => homing.home().await,
                        None => Err(beampose_core::InstrumentError::Refused(
                            "it has no reference to search".to_owned(),
                        )),
                    };
                }
                let target = match (to, by) {
                    (Some(to), _) => to,
                    (None, by) => axis.position().await?.value + by.unwrap_or_default(),
                };
                axis.move_to(target).await
            }))
        };
        let moved = tokio::select! {
            moved = moving => Some(moved),
            _ = tokio::signal::ctrl_c() => None,
        };
        let Some(moved) = moved else {
            let stopped = bench.drive(Box::pin(async { axis.stop().await })).await;
            stopped.map_err(|error| {
                anyhow::anyhow!("{name} may still move: stop was not confirmed: {error}")
            })?;
            complain(&format!("{name} was stopped"));
            return Ok(Exit::Aborted);
        };
        moved.map_err(|error| anyhow::anyhow!("{name}: {error}"))?;
        let reading = bench.drive(Box::pin(async { axis.position().await })).await;
        let reading = reading.map_err(|error| anyhow::anyhow!("{name}: {error}"))?;
        let shown = match axis.unit() {
            AxisUnit::Millimetre => unit(&reading),
            AxisUnit::Degree => "deg",
        };
        print(&format!("{name}  {} {shown}", reading.value));
        Ok(Exit::Success)
    }
}

/// Switch a laser, by hand: off is all there is
#[derive(clap::Args)]
pub struct LaserAction {
    #[command(subcommand)]
    action: Switch,
}

#[derive(clap::Subcommand)]
enum Switch {
    /// Switch lasers off and read back that they are
    Off(Off),
}

#[derive(clap::Args)]
struct Off {
    #[command(flatten)]
    which: Which,
    /// Which lasers [default: all]
    names: Vec<String>,
}

impl LaserAction {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let Switch::Off(Off { which, names }) = self.action;
        let bench = which.open()?;
        let lasers = &bench.laboratory.bench.lasers;
        let names: Vec<InstrumentName> = if names.is_empty() {
            lasers.keys().cloned().collect()
        } else {
            bench.named(&names)?
        };
        let mut all_off = true;
        for name in names {
            let Some(laser) = lasers.get(&name) else {
                return Err(Ended::input(format!("`{name}` is no laser")));
            };
            let ended = bench
                .drive(Box::pin(async {
                    let off = laser.off().await;
                    (off, laser.emission().await)
                }))
                .await;
            match ended {
                (Ok(()), Emission::Off) => print(&format!("{name}  off, read back")),
                (off, _) => {
                    all_off = false;
                    let why = off.err().map_or_else(String::new, |error| format!(" ({error})"));
                    print(&format!("{name}  UNKNOWN: assume it is on; take its key out{why}"));
                }
            }
        }
        Ok(if all_off { Exit::Success } else { Exit::Failed })
    }
}

/// Take a picture with each camera, without the laser
#[derive(clap::Args)]
pub struct Capture {
    #[command(flatten)]
    which: Which,
    /// Which cameras [default: all]
    names: Vec<String>,
    /// Where to write the pictures
    #[arg(long, value_name = "FOLDER", default_value = ".")]
    out: PathBuf,
}

impl Capture {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let bench = self.which.open()?;
        let cameras = &bench.laboratory.bench.cameras;
        let names: Vec<InstrumentName> = if self.names.is_empty() {
            cameras.keys().cloned().collect()
        } else {
            bench.named(&self.names)?
        };
        std::fs::create_dir_all(&self.out)
            .map_err(|error| Ended::input(format!("{}: {error}", self.out.display())))?;
        let mut taken = Vec::new();
        for name in names {
            let camera = cameras.get(&name).cloned();
            let camera = camera.ok_or_else(|| Ended::input(format!("`{name}` is no camera")))?;
            taken.push((name, camera));
        }
        let shots = bench
            .drive(Box::pin(async {
                let shots = taken.iter().map(async |(name, camera)| {
                    let frame = match camera.arm().await {
                        Ok(()) => camera.trigger().await,
                        Err(error) => Err(error),
                    };
                    (name, frame)
                });
                futures::future::join_all(shots).await
            }))
            .await;
        let mut all_well = true;
        for (name, frame) in shots {
            match frame {
                Ok(frame) => {
                    let png = frame.bytes.starts_with(b"\x89PNG");
                    let file = self.out.join(format!("{name}.{}", if png { "png" } else { "jpg" }));
                    std::fs::write(&file, &frame.bytes)
                        .map_err(|error| anyhow::anyhow!("{}: {error}", file.display()))?;
                    print(&format!("{name}  {} ({} bytes)", file.display(), frame.bytes.len()));
                }
                Err(error) => {
                    all_well = false;
                    print(&format!("{name}  FAILED: {error}"));
                }
            }
        }
        Ok(if all_well { Exit::Success } else { Exit::Failed })
    }
}
