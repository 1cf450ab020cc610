//! What goes for good.

use std::io::{BufRead as _, IsTerminal as _, Write as _};

use beampose_core::SessionId;
use beampose_store::Store;
use serde_json::json;

use super::told;
use crate::cli::{Database, Ended, close, find};
use crate::output::Exit;
use crate::session_lock::SessionLock;

/// Delete a session with all that belongs to it
///
/// Pictures, readings, processings, results, tags, notes. Asks first; without a terminal it needs
/// --yes. What is deleted cannot be had back, except from a file that `sessions export` wrote.
/// `sessions vacuum` gives the space back to the disk. SESSION is an id, a unique beginning of one,
/// or `latest`.
#[derive(clap::Args)]
pub struct Delete {
    /// Which session
    session: String,
    /// Do not ask
    #[arg(long)]
    yes: bool,
    /// Print one JSON object: session, rows, pictures, bytes
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

impl Delete {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let store = self.database.open_existing().await?;
        let id = find(&store, &self.session).await?;
        // A session that runs is not deleted under it.
        let lock = SessionLock::take(store.path(), id).map_err(Ended::input)?;
        if !self.yes {
            confirm(&question(&store, id).await?)?;
        }
        let deleted = store.delete_session(id).await;
        drop(lock);
        close(store).await;
        let deleted = deleted?;
        told(
            self.json,
            || {
                json!({
                    "session": id.to_string(),
                    "rows": deleted.rows,
                    "pictures": deleted.pictures,
                    "bytes": deleted.bytes,
                })
            },
            || {
                format!(
                    "session {id} is deleted: {} pictures, {:.1} MB; `beampose sessions vacuum` gives \
                 the space back",
                    deleted.pictures,
                    deleted.bytes as f64 / 1e6
                )
            },
        );
        Ok(Exit::Success)
    }
}

async fn question(store: &Store, id: SessionId) -> Result<String, Ended> {
    let session = store.session(id).await?;
    let captures = store.captures(id).await?;
    let began = session.header.opened.utc.strftime("%Y-%m-%d %H:%M:%S");
    let title = &session.header.title;
    Ok(format!("delete session {id}, {title:?} of {began} UTC, {} captures", captures.len()))
}

fn confirm(question: &str) -> Result<(), Ended> {
    let kept = "nothing is deleted";
    if !std::io::stdin().is_terminal() {
        return Err(Ended::input(format!(
            "{question}: nobody is there to ask, {kept}\n  help: --yes deletes without asking"
        )));
    }
    let mut out = std::io::stderr().lock();
    write!(out, "{question}? Type yes: ").and_then(|()| out.flush())?;
    let mut answer = String::new();
    std::io::stdin().lock().read_line(&mut answer)?;
    if answer.trim() == "yes" { Ok(()) } else { Err(Ended::input(kept)) }
}

/// Give the space of deleted sessions back to the disk
///
/// Writes the database anew; needs as much free space as it has, and no other program on it.
#[derive(clap::Args)]
pub struct Vacuum {
    /// Print one JSON object: before_bytes, after_bytes
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

impl Vacuum {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let store = self.database.open_existing().await?;
        let done = store.vacuum().await;
        close(store).await;
        let (before, after) = done?;
        told(
            self.json,
            || json!({ "before_bytes": before, "after_bytes": after }),
            || format!("{:.1} MB, was {:.1} MB", after as f64 / 1e6, before as f64 / 1e6),
        );
        Ok(Exit::Success)
    }
}
