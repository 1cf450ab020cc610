//! `beampose report`.

use std::path::PathBuf;

use beampose_analysis::Verdict;

use super::sessions::compare::processing_of;
use super::{Database, Ended, close, report_folder};
use crate::calibration_record::record_run;
use crate::output::{Exit, print};
use crate::session_report::{input_beside, write};
use crate::side_by_side::Wanted;

/// Analyse a stored session and write its report
///
/// Writes one HTML page with JSON and CSV beside it. SESSION is an id, a unique beginning of one,
/// or `latest`; `latest@2` is its processing 2 (`sessions show` numbers them) instead of the newest.
/// Processings of a translation test that differ are held side by side.
#[derive(clap::Args)]
pub struct Report {
    /// Which session
    session: String,
    /// Hold these processings side by side, by their numbers and perhaps a name: 3="data sheet"
    /// [default: all that differ]
    #[arg(long, value_name = "PROCESSING[=NAME]", num_args = 1.., value_parser = Wanted::parse)]
    compare: Vec<Wanted>,
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
        let loaded = processing_of(&store, &self.session, None).await?;
        let id = loaded.session.header.id;
        let input = input_beside(&store, &loaded, &self.compare).await?;
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
