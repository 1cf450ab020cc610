//! `beampose sessions`. Each of its commands is a file here and a line in `Action`.

pub mod compare;
mod delete;
mod file;
mod labels;
mod list;
mod show;
mod verify;

use beampose_core::SessionOutcome;
use comfy_table::{Cell, CellAlignment, ContentArrangement, Table, presets};

use super::filter::Filter;
use super::{Database, Ended, close, find};
use crate::output::{Exit, print};

/// List the stored sessions, show one, compare, verify, export, delete
///
/// Without a command: the list, filtered if asked for, or with SESSION that session. SESSION is an
/// id, a unique beginning of one, or `latest`.
#[derive(clap::Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Sessions {
    #[command(subcommand)]
    action: Option<Action>,
    /// Show this session: its steps, events and captures
    session: Option<String>,
    /// Check the session's pictures against their hashes, and the database
    #[arg(long, requires = "session")]
    verify: bool,
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
    #[command(flatten)]
    filter: Filter,
}

// What each does is told in its own file: a comment here would hide the longer help there.
#[derive(clap::Subcommand)]
enum Action {
    Show(show::Show),
    Tag(labels::Tag),
    Untag(labels::Untag),
    Note(labels::WriteNote),
    Compare(compare::Compare),
    Verify(verify::Verify),
    Export(file::ExportFile),
    Import(file::ImportFile),
    Delete(delete::Delete),
    Vacuum(delete::Vacuum),
}

impl Sessions {
    pub async fn execute(self) -> Result<Exit, Ended> {
        match self.action {
            Some(Action::Show(show)) => show.execute().await,
            Some(Action::Tag(tag)) => tag.execute().await,
            Some(Action::Untag(untag)) => untag.execute().await,
            Some(Action::Note(note)) => note.execute().await,
            Some(Action::Compare(compare)) => compare.execute().await,
            Some(Action::Verify(verify)) => verify.execute().await,
            Some(Action::Export(export)) => export.execute().await,
            Some(Action::Import(import)) => import.execute().await,
            Some(Action::Delete(delete)) => delete.execute().await,
            Some(Action::Vacuum(vacuum)) => vacuum.execute().await,
            None => self.of_old().await,
        }
    }

    /// The list, or one session.
    async fn of_old(self) -> Result<Exit, Ended> {
        if self.session.is_some() && !self.filter.is_empty() {
            return Err(Ended::input("one session is shown whole: no filter applies to it"));
        }
        let store = self.database.open_existing().await?;
        let ended = match &self.session {
            None => list::list(&store, &self.filter, self.json).await,
            Some(wanted) => match find(&store, wanted).await {
                Err(error) => Err(error),
                Ok(id) if self.verify => verify::one(&store, id, self.json).await,
                Ok(id) => show::show(&store, id, self.json).await,
            },
        };
        close(store).await;
        ended
    }
}

fn outcome(outcome: Option<SessionOutcome>) -> &'static str {
    outcome.map_or("not closed", SessionOutcome::as_str)
}

fn right(text: impl ToString) -> Cell {
    Cell::new(text).set_alignment(CellAlignment::Right)
}

/// A table without ruling, as all tables here.
pub fn plain_table() -> Table {
    let mut table = Table::new();
    table.load_preset(presets::NOTHING).set_content_arrangement(ContentArrangement::Disabled);
    table
}

/// Prints an object in one line, or what is said instead.
fn told(json: bool, object: impl FnOnce() -> serde_json::Value, said: impl FnOnce() -> String) {
    if json {
        print(&object().to_string());
    } else {
        print(&said());
    }
}
