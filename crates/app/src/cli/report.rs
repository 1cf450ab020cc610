//! `beampose report`.

use std::path::PathBuf;

use beampose_analysis::Verdict;

use super::{Database, Ended, close, find, report_folder};
use crate::calibration_record::record_run;
use crate::output::{Exit, print};
use crate::session_report::{input, load, write};

/// Analyse a stored session and write its report
///
/// Writes one HTML page with JSON and CSV beside it. SESSION is an id, a unique beginning of one,
/// or `latest`.
#[derive(clap::Args)]
pub struct Report {
    /// Which session
    session: String,
    /// Where to write [default: reports/SESSION]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Print the result as one JSON object and write nothing, unless --out says where
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

impl Report {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let store = self.database.open_existing().await?;
        let id = find(&store, &self.session).await?;
        let loaded = load(&store, id).await?;
        let input = input(&store, &loaded).await?;
        if self.json && self.out.is_none() {
            print(&beampose_analysis::json(&input)?.to_string());
        } else {
            let written = write(&input, &report_folder(self.out.as_ref(), id))?;
            record_run(&store, &input, &loaded.session.header).await?;
            if self.json {
                print(&written.json.to_string());
            } else {
                print(&written.html.display().to_string());
            }
        }
        close(store).await;
        Ok(exit_of(input.verdict))
    }
}

/// The exit code of a verdict on a session that is stored.
pub fn exit_of(verdict: Verdict) -> Exit {
    match verdict {
        Verdict::Pass | Verdict::Inconclusive => Exit::Success,
        Verdict::Fail => Exit::VerdictFail,
        Verdict::Aborted => Exit::Aborted,
        Verdict::Error => Exit::Failed,
    }
}
