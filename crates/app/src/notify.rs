//! A command of the laboratory's own that hears when a run ends or needs a person.

use std::io::Write as _;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use beampose_core::EventKind;
use beampose_engine::{Notice, Observer};
use serde_json::{Value, json};

/// How long the command may take; it is then stopped.
const PATIENCE: Duration = Duration::from_secs(30);

/// Runs the command with each event on its standard input, one JSON object.
#[derive(Debug, Clone)]
pub struct Hook {
    command: String,
    session: String,
}

impl Hook {
    /// The hook of a session.
    pub fn new(command: &str, session: beampose_core::SessionId) -> Self {
        Self { command: command.to_owned(), session: session.to_string() }
    }

    /// Tells of something. What becomes of the command is logged, and changes nothing.
    pub fn tell(&self, event: &str, mut more: Value) {
        if let Some(members) = more.as_object_mut() {
            members.insert("event".to_owned(), event.into());
            members.insert("session".to_owned(), self.session.clone().into());
        }
        if let Err(error) = self.run(&more.to_string()) {
            tracing::warn!("the command to notify failed: {}: {error}", self.command);
        }
    }

    fn run(&self, text: &str) -> std::io::Result<()> {
        let (shell, option) = if cfg!(windows) { ("cmd", "/C") } else { ("sh", "-c") };
        let mut command = Command::new(shell);
        command.args([option, &self.command]).stdin(Stdio::piped()).stdout(Stdio::null());
        let mut child = command.spawn()?;
        if let Some(mut input) = child.stdin.take() {
            // A command that does not read is told by its arguments that something happened.
            let _unread = writeln!(input, "{text}");
        }
        let end = Instant::now() + PATIENCE;
        while Instant::now() < end {
            if let Some(status) = child.try_wait()? {
                let failed = || std::io::Error::other(status.to_string());
                return if status.success() { Ok(()) } else { Err(failed()) };
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        child.kill()?;
        child.wait()?;
        Err(std::io::Error::other(format!("not done within {PATIENCE:?}")))
    }
}

/// On a thread of its own: a slow command holds nothing up.
impl Observer for Hook {
    fn notice(&mut self, notice: &Notice) {
        match notice {
            Notice::Paused { reason } => self.tell("paused", json!({ "reason": reason })),
            Notice::Event(event) if event.kind == EventKind::Asked => {
                self.tell("asked", json!({ "question": event.message }));
            }
            Notice::Event(event) if event.kind == EventKind::LaserUnknown => {
                self.tell("laser_unknown", json!({ "message": event.message }));
            }
            _ => {}
        }
    }
}
