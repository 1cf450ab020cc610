//! A whole session as one file.

use std::path::PathBuf;

use beampose_store::StoreError;
use serde_json::json;

use super::told;
use crate::cli::{Database, Ended, close, find};
use crate::output::Exit;

/// Write a whole session into one file
///
/// Pictures, readings, calibrations, every processing and result, tags and notes; a simulated session's
/// truth too. The file is an SQLite database of its own: `--db FILE` and docs/sql-views.md work on
/// it. The same session gives the same bytes. Where plan and rig lay on this machine stays behind, so
/// an imported session cannot be resumed. SESSION is an id, a unique beginning of one, or `latest`.
#[derive(clap::Args)]
pub struct ExportFile {
    /// Which session
    session: String,
    /// The file to write
    file: PathBuf,
    /// Replace the file if it is there
    #[arg(long)]
    force: bool,
    /// Print one JSON object: session, file, rows, pictures
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

impl ExportFile {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let store = self.database.open_existing().await?;
        let id = find(&store, &self.session).await?;
        let shown = self.file.display().to_string();
        if self.file.exists() {
            let ours =
                std::path::absolute(store.path()).ok() == std::path::absolute(&self.file).ok();
            if !self.force || ours || !self.file.is_file() {
                let help = "\n  help: --force replaces a file of an earlier export";
                return Err(Ended::input(format!("{shown} is there already{help}")));
            }
            std::fs::remove_file(&self.file)?;
        }
        let written = store.export_session(id, &self.file).await;
        close(store).await;
        let written = written.map_err(at_fault)?;
        told(
            self.json,
            || {
                json!({
                    "session": id.to_string(),
                    "file": shown,
                    "rows": written.rows,
                    "pictures": written.pictures,
                })
            },
            || format!("{shown}: session {id}, {} pictures", written.pictures),
        );
        Ok(Exit::Success)
    }
}

/// Read a session from a file that `sessions export` wrote
///
/// All of it or nothing; a session that is stored already is never touched. The file may come from
/// anybody: its schema has to be beampose's word for word, nothing in it is executed, and every
/// picture is hashed again.
#[derive(clap::Args)]
pub struct ImportFile {
    /// The file
    file: PathBuf,
    /// Print one JSON object: session, rows, pictures
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

impl ImportFile {
    pub async fn execute(self) -> Result<Exit, Ended> {
        if !self.file.exists() {
            return Err(Ended::input(format!("there is no file {}", self.file.display())));
        }
        let store = self.database.open().await?;
        let read = store.import_session(&self.file).await;
        close(store).await;
        let read = read.map_err(at_fault)?;
        told(
            self.json,
            || {
                json!({
                    "session": read.session.to_string(),
                    "rows": read.rows,
                    "pictures": read.pictures,
                })
            },
            || format!("session {}: {} pictures imported", read.session, read.pictures),
        );
        Ok(Exit::Success)
    }
}

/// What is wrong with the file is an input at fault; a full disk or a held database is not.
fn at_fault(error: StoreError) -> Ended {
    match error {
        StoreError::Busy { .. } | StoreError::Disk { .. } | StoreError::Database { .. } => {
            error.into()
        }
        other => Ended::input(other.to_string()),
    }
}
