//! `beampose check`.

use std::path::PathBuf;

use super::{Database, Ended, close};
use crate::estimating::learned;
use crate::input::checked;
use crate::output::{Exit, print};
use crate::settings::Overrides;
use crate::wiring::{self, Before};

/// Check a plan against its rig without doing anything
///
/// Lists every fault at once with file, line, column and the nearest valid name; else prints the
/// steps with estimated time and disk use. Nothing is moved, lit or written.
#[derive(clap::Args)]
pub struct Check {
    /// The plan, a YAML file
    plan: PathBuf,
    /// The rig, a YAML file; without it the one that the plan names
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// Print only the summary, not each step
    #[arg(short, long)]
    quiet: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

impl Check {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let mut checked = checked(&self.plan, self.rig.as_deref(), &Overrides::default())
            .map_err(Ended::input)?;
        // Instruments are built, not connected: what `run` would refuse, `check` says.
        wiring::laboratory(&checked.rig, &checked.rig_folder, &Before::default(), None)
            .map_err(Ended::input)?;
        // What is stored of this rig says more than the rig; a database is not made for that.
        if let Ok(store) = self.database.open_existing().await {
            checked.summary.estimate = learned(&store, &checked.summary).await?;
            close(store).await;
        }
        let summary = &checked.summary;
        let estimate = summary.estimate.as_ref();
        if self.json {
            let object = serde_json::json!({
                "title": summary.title,
                "rig": summary.rig_title,
                "steps": summary.steps,
                "plan_hash": summary.plan_hash,
                "expected_s": summary.expected.0,
                "estimated_s": estimate.map(|e| e.time.0),
                "estimated_range_s": estimate.map(|e| e.range.map(|time| time.0)),
                "estimated_bytes": estimate.map(|e| e.bytes),
                "estimated_from_sessions": estimate.map_or(0, |e| e.sessions),
                "captures": summary.captures,
                "pictures": summary.pictures,
                "picture_bytes": summary.picture_bytes,
                "warnings": summary.warnings.iter().map(ToString::to_string).collect::<Vec<_>>(),
            });
            print(&object.to_string());
            return Ok(Exit::Success);
        }
        if !self.quiet {
            print(&summary.step_list());
        }
        print(&summary.to_string());
        Ok(Exit::Success)
    }
}
