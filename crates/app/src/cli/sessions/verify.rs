//! Whether what is stored is what was put there.

use beampose_core::SessionId;
use beampose_store::{Store, StoreError, Verification};
use serde_json::json;

use super::told;
use crate::cli::{Database, Ended, close, find};
use crate::output::{Exit, print};

/// Check sessions: every hash, every reference, every step accounted for
///
/// Every picture is hashed again, those of earlier attempts too; every step of a completed session
/// must have left a record, every capture step its capture; calibrations must have the hash that each
/// processing names; SQLite checks the file's structure and references. Exit code 4 where anything is
/// wrong. SESSION is an id, a unique beginning of one, or `latest`.
#[derive(clap::Args)]
pub struct Verify {
    /// Which session
    #[arg(default_value = "latest", conflicts_with = "all")]
    session: String,
    /// All sessions
    #[arg(long)]
    all: bool,
    /// Print one JSON object for each session
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

impl Verify {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let store = self.database.open_existing().await?;
        let ended = if self.all {
            all(&store, self.json).await
        } else {
            match find(&store, &self.session).await {
                Ok(id) => one(&store, id, self.json).await,
                Err(error) => Err(error),
            }
        };
        close(store).await;
        ended
    }
}

/// Verifies one session and the file.
pub async fn one(store: &Store, id: SessionId, as_json: bool) -> Result<Exit, Ended> {
    let found = damage(store.verify(id).await)?;
    told(as_json, || object(id, &found), || said(&found));
    Ok(exit(found.is_sound()))
}

/// Verifies all sessions, and the file once.
async fn all(store: &Store, as_json: bool) -> Result<Exit, Ended> {
    let mut sound = true;
    for session in store.sessions().await? {
        let found = damage(store.verify_session(session.id).await)?;
        sound &= found.is_sound();
        told(
            as_json,
            || object(session.id, &found),
            || format!("session {}: {}", session.id, said(&found)),
        );
    }
    let file = store.verify_file().await?;
    if as_json {
        print(
            &json!({ "database": store.path().display().to_string(), "problems": file })
                .to_string(),
        );
    } else {
        file.iter().for_each(|problem| print(problem));
        if sound && file.is_empty() {
            print("the database is sound");
        }
    }
    Ok(exit(sound && file.is_empty()))
}

/// What cannot even be read is a thing that was found.
fn damage(found: Result<Verification, StoreError>) -> Result<Verification, StoreError> {
    match found {
        Err(error @ StoreError::Damaged { .. }) => {
            Ok(Verification { problems: vec![error.to_string()], ..Verification::default() })
        }
        other => other,
    }
}

fn exit(sound: bool) -> Exit {
    if sound { Exit::Success } else { Exit::Failed }
}

fn object(id: SessionId, found: &Verification) -> serde_json::Value {
    json!({
        "session": id.to_string(),
        "pictures": found.pictures,
        "bytes": found.bytes,
        "steps": found.steps,
        "problems": found.problems,
    })
}

fn said(found: &Verification) -> String {
    let mut lines = vec![format!(
        "{} pictures, {} bytes hashed again; {} steps",
        found.pictures, found.bytes, found.steps
    )];
    lines.extend(found.problems.iter().cloned());
    if found.is_sound() {
        lines.push("all sound".to_owned());
    }
    lines.join("\n")
}
