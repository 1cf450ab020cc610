//! What people put on a session.

use beampose_store::{Note, StoreError};
use serde_json::json;

use super::told;
use crate::cli::{Database, Ended, close, find};
use crate::output::Exit;

/// Tag a session, to find it again: `beampose sessions --tag TAG`
#[derive(clap::Args)]
pub struct Tag {
    /// Which session: an id, a unique beginning of one, or `latest`
    session: String,
    /// One or more words
    #[arg(required = true, value_name = "TAG")]
    tags: Vec<String>,
    /// Print one JSON object: session, tags
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

impl Tag {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let store = self.database.open_existing().await?;
        let id = find(&store, &self.session).await?;
        for tag in &self.tags {
            store.tag(id, tag, jiff::Timestamp::now()).await.map_err(at_fault)?;
        }
        let tags = store.tags(id).await?;
        close(store).await;
        told(
            self.json,
            || json!({ "session": id.to_string(), "tags": tags }),
            || format!("session {id}: {}", tags.join(" ")),
        );
        Ok(Exit::Success)
    }
}

/// Take tags off a session
#[derive(clap::Args)]
pub struct Untag {
    /// Which session: an id, a unique beginning of one, or `latest`
    session: String,
    /// One or more of its tags
    #[arg(required = true, value_name = "TAG")]
    tags: Vec<String>,
    /// Print one JSON object: session, tags
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

impl Untag {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let store = self.database.open_existing().await?;
        let id = find(&store, &self.session).await?;
        let before = store.tags(id).await?;
        if let Some(none) = self.tags.iter().find(|tag| !before.contains(tag)) {
            let tags = if before.is_empty() { "none".to_owned() } else { before.join(" ") };
            return Err(Ended::input(format!("session {id} has no tag {none:?}; it has {tags}")));
        }
        for tag in &self.tags {
            store.untag(id, tag).await?;
        }
        let tags = store.tags(id).await?;
        close(store).await;
        told(
            self.json,
            || json!({ "session": id.to_string(), "tags": tags }),
            || format!("session {id}: {}", tags.join(" ")),
        );
        Ok(Exit::Success)
    }
}

/// Write a note beside a session; it is dated, and stays
#[derive(clap::Args)]
pub struct WriteNote {
    /// Which session: an id, a unique beginning of one, or `latest`
    session: String,
    /// What to remember
    text: String,
    /// Print one JSON object: session, written, text
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

impl WriteNote {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let store = self.database.open_existing().await?;
        let id = find(&store, &self.session).await?;
        let note = Note { written: jiff::Timestamp::now(), text: self.text };
        store.add_note(id, &note).await.map_err(at_fault)?;
        close(store).await;
        let written = note.written.to_string();
        told(
            self.json,
            || json!({ "session": id.to_string(), "written": written, "text": note.text }),
            || format!("session {id}: noted"),
        );
        Ok(Exit::Success)
    }
}

/// What the store refuses here is what was typed.
fn at_fault(error: StoreError) -> Ended {
    match error {
        StoreError::Refused { .. } => Ended::input(error.to_string()),
        other => other.into(),
    }
}
