//! `beampose tell`.

use super::{Database, Ended, close, find};
use crate::output::{Exit, complain};
use crate::remote::{Mailbox, Word};
use crate::session_lock::SessionLock;

/// Tell a session that runs to pause, to go on, or to stop
///
/// From another terminal, or over ssh. Whatever it is told, the laser goes off first, and is on
/// again, settled as the plan lets it settle, before a paused run goes on. A session that was
/// stopped, aborted or halted can be resumed.
#[derive(clap::Args)]
pub struct Tell {
    /// Which session: an id, a unique beginning of one, or `latest`
    session: String,
    /// What
    #[arg(value_enum)]
    word: Word,
    #[command(flatten)]
    database: Database,
}

impl Tell {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let store = self.database.open_existing().await?;
        let id = find(&store, &self.session).await?;
        if SessionLock::holder(store.path(), id).is_none() {
            close(store).await;
            return Err(Ended::input(format!("no program runs session {id}")));
        }
        let left = Mailbox::of(store.path(), id).leave(self.word);
        close(store).await;
        left.map_err(|error| Ended::input(format!("the word cannot be left: {error}")))?;
        complain(&format!("told session {id} to {}", self.word.as_str()));
        Ok(Exit::Success)
    }
}
