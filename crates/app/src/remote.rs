//! Who may stop a run, and let it go on: signals, the terminal, and `beampose tell` from elsewhere.

use std::path::{Path, PathBuf};
use std::time::Duration;

use beampose_core::SessionId;
use beampose_engine::{Control, Wish};

use crate::output::complain;

/// How often the mailbox is looked into.
const LOOK: Duration = Duration::from_millis(200);
/// What is longer is no word for a run.
const LONGEST: u64 = 64;

/// What a run can be told.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Word {
    /// Pause before the next step
    Pause,
    /// Pause now: a wait or a move is broken off, and done anew when the run goes on
    PauseNow,
    /// Go on after a pause
    GoOn,
    /// End early and tidily: finish the step, run `finally`
    Stop,
    /// Break off: make everything safe, run `finally`
    Abort,
    /// Break off at once: make everything safe, and nothing else
    Halt,
}

impl Word {
    /// The word in the mailbox.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Pause => "pause",
            Self::PauseNow => "pause-now",
            Self::GoOn => "go-on",
            Self::Stop => "stop",
            Self::Abort => "abort",
            Self::Halt => "halt",
        }
    }

    fn tell(self, control: &Control, by: &str) {
        match self {
            Self::Pause => control.request(Wish::Pause, by),
            Self::PauseNow => control.request(Wish::PauseNow, by),
            Self::GoOn => control.go_on(),
            Self::Stop => control.request(Wish::Stop, by),
            Self::Abort => control.request(Wish::Abort, by),
            Self::Halt => control.request(Wish::Halt, by),
        }
    }
}

/// A file beside the database in which a word for a run is left. A file, since that works on every
/// system, for every user who may write beside the database, and over a network share.
pub struct Mailbox {
    path: PathBuf,
}

impl Mailbox {
    /// The mailbox of a session in a database.
    pub fn of(database: &Path, session: SessionId) -> Self {
        let mut path = database.as_os_str().to_owned();
        path.push(format!(".{session}.word"));
        Self { path: path.into() }
    }

    /// Leaves a word: it is there as a whole or not at all.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn leave(&self, word: Word) -> std::io::Result<()> {
        let half = self.path.with_extension(format!("word.{}", std::process::id()));
        std::fs::write(&half, word.as_str())?;
        std::fs::rename(&half, &self.path)
    }

    fn take(&self) -> Option<Word> {
        let length = std::fs::metadata(&self.path).ok()?.len();
        let text =
            if length <= LONGEST { std::fs::read_to_string(&self.path) } else { Ok(String::new()) };
        let _gone = std::fs::remove_file(&self.path);
        let text = text.ok()?;
        let word = clap::ValueEnum::from_str(text.trim(), false);
        if word.is_err() {
            complain(&format!("beampose: {} held no word that a run knows", self.path.display()));
        }
        word.ok()
    }

    /// Obeys what is left, until the task is dropped.
    pub async fn obey(self, control: Control) {
        // What was left for an earlier run is not for this one.
        let _stale = self.take();
        loop {
            tokio::time::sleep(LOOK).await;
            if let Some(word) = self.take() {
                complain(&format!("beampose: told to {}", word.as_str()));
                word.tell(&control, "beampose tell");
            }
        }
    }
}

/// Turns signals into wishes, until the task is dropped.
pub async fn listen(control: Control) {
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        let (Ok(mut term), Ok(mut hangup)) =
            (signal(SignalKind::terminate()), signal(SignalKind::hangup()))
        else {
            complain("beampose: signals cannot be caught; only Ctrl-C stops the run tidily");
            return;
        };
        loop {
            tokio::select! {
                _ = tokio::signal::ctrl_c() => once_more(&control),
                _ = term.recv() => at_once(&control, "SIGTERM"),
                _ = hangup.recv() => at_once(&control, "SIGHUP"),
            }
        }
    }
    #[cfg(not(unix))]
    while tokio::signal::ctrl_c().await.is_ok() {
        once_more(&control);
    }
}

/// Ctrl-C: once to pause before the next step, twice to pause now, three times to abort.
fn once_more(control: &Control) {
    let (wish, told) = match control.wish().map(|(wish, _)| wish) {
        None => (Wish::Pause, "pausing before the next step (Ctrl-C again: now)"),
        Some(Wish::Pause) => (Wish::PauseNow, "pausing now (Ctrl-C again: abort)"),
        Some(Wish::PauseNow | Wish::Stop) => {
            (Wish::Abort, "aborting: laser off first, then `finally` (Ctrl-C again: halt)")
        }
        Some(Wish::Abort) => (Wish::Halt, "halting: laser off, and nothing else"),
        Some(Wish::Halt) => (Wish::Halt, "already halting"),
    };
    complain(&format!("beampose: {told}"));
    control.request(wish, "Ctrl-C");
}

#[cfg(unix)]
fn at_once(control: &Control, signal: &str) {
    if control.wish().is_some_and(|(wish, _)| wish >= Wish::Abort) {
        complain("beampose: already stopping: laser off first, then `finally`");
    }
    control.request(Wish::Abort, signal);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_further_ctrl_c_is_more_urgent() {
        let control = Control::new();
        let mut heard = Vec::new();
        for _ in 0..5 {
            once_more(&control);
            heard.extend(control.wish().map(|(wish, _)| wish));
        }
        assert_eq!(heard, [Wish::Pause, Wish::PauseNow, Wish::Abort, Wish::Halt, Wish::Halt]);
    }
}
