//! `beampose run`.

use std::path::PathBuf;

use beampose_core::{SessionHeader, SessionId, Stamp};

use super::{Database, Ended};
use crate::conduct::{Session, Shown};
use crate::estimating::learned;
use crate::input::{Checked, Origin, checked};
use crate::output::{Exit, complain};
use crate::pipeline::SOFTWARE;
use crate::session_lock::SessionLock;
use crate::settings::Overrides;
use crate::wiring::{self, Before, Laboratory};

/// Run a plan on a rig, solve while it runs, analyse and report
///
/// Everything that is acquired goes into the database, one durable transaction a step; each capture
/// is solved while the run goes on. Ctrl-C pauses before the next step (Enter, or `beampose tell
/// SESSION go-on`, lets it go on), twice pauses now, three times aborts: laser off first, `finally`
/// runs, what it has is kept; `beampose resume` goes on with it. SIGTERM and SIGHUP abort.
#[derive(clap::Args)]
pub struct Run {
    /// The plan, a YAML file
    plan: PathBuf,
    /// The rig, a YAML file; without it the one that the plan names
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    #[command(flatten)]
    shown: Shown,
    #[command(flatten)]
    overrides: Overrides,
    #[command(flatten)]
    database: Database,
}

impl Run {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let mut checked =
            checked(&self.plan, self.rig.as_deref(), &self.overrides).map_err(Ended::input)?;
        for warning in &checked.summary.warnings {
            complain(&warning.to_string());
        }
        let laboratory = wiring::laboratory(
            &checked.rig,
            &checked.rig_folder,
            &Before::default(),
            self.shown.recorder()?,
        )
        .map_err(Ended::input)?;
        let answers = self.shown.read_answers()?;
        self.shown.refuse_a_file()?;
        let store = self.database.open().await?;
        checked.summary.estimate = learned(&store, &checked.summary).await?;
        let origin = Origin::of(&self.plan, &checked, self.overrides)?;
        let header = header(&checked, &laboratory, &origin)?;
        let lock = SessionLock::take(store.path(), header.id).map_err(Ended::input)?;
        let (earlier, captures) = (None, Vec::new());
        let session = Session { checked, laboratory, header, earlier, captures, answers };
        session.conduct(store, lock, &self.shown).await
    }
}

fn header(
    checked: &Checked,
    laboratory: &Laboratory,
    origin: &Origin,
) -> anyhow::Result<SessionHeader> {
    let opened: Stamp = laboratory.clock.shared().now();
    Ok(SessionHeader {
        id: SessionId::fresh(),
        title: checked.summary.title.clone(),
        experiment: checked.plan.experiment.as_str().to_owned(),
        plan_text: checked.plan.source.text().to_owned(),
        rig_text: checked.rig.source.text().to_owned(),
        measurement_json: serde_json::to_string(&laboratory.setup)?,
        files: laboratory.files.clone(),
        plan_hash: checked.summary.plan_hash.clone(),
        origin_json: Some(serde_json::to_string(origin)?),
        software: SOFTWARE.to_owned(),
        seed: wiring::seed(&checked.rig),
        steps: u32::try_from(checked.summary.steps.len())?,
        opened,
    })
}
