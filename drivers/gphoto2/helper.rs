//! The program beside this one that holds the session with one camera.

use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use beampose_core::InstrumentError;

use super::protocol::{Reply, reply};

/// Its name as a program.
const PROGRAM: &str = "beampose-camera-helper";
/// How long it may take to end a session by itself.
const FAREWELL: Duration = Duration::from_millis(500);

/// Where the helper is: where the environment's `BEAMPOSE_CAMERA_HELPER` says, beside this program,
/// or on the path.
///
/// # Errors
/// How to get it, where it is nowhere.
pub(super) fn find() -> Result<PathBuf, String> {
    if let Some(said) = std::env::var_os("BEAMPOSE_CAMERA_HELPER") {
        return Ok(PathBuf::from(said));
    }
    let own = std::env::current_exe().unwrap_or_default();
    // Tests and examples of cargo lie one folder deeper.
    let beside = own.ancestors().skip(1).take(2).map(Path::to_owned);
    let path = std::env::var_os("PATH").unwrap_or_default();
    let on_path: Vec<PathBuf> = std::env::split_paths(&path).collect();
    let mut places = beside.chain(on_path).map(|folder| folder.join(PROGRAM));
    places.find(|place| place.is_file()).ok_or_else(|| {
        format!(
            "the program {PROGRAM} is not here: install libgphoto2-dev, then `cargo build \
             --release -p beampose-drivers --features gphoto2` and put it beside this program"
        )
    })
}

/// What came from the helper.
#[derive(Debug)]
pub(super) enum Said {
    Reply(Reply),
    Picture { name: String, bytes: Vec<u8> },
    Garbage(String),
}

/// A helper that runs. Dropped, it is told to end its session, and ended where it does not.
pub(super) struct Helper {
    child: Child,
    ask: Option<ChildStdin>,
    said: Receiver<Said>,
    complaints: PathBuf,
    /// It did not answer: it is not given time for a farewell.
    stuck: bool,
}

impl Helper {
    /// Starts the program `program`. Its complaints go to a file.
    pub(super) fn start(
        program: &Path,
        arguments: &[&str],
        complaints: &Path,
    ) -> Result<Self, InstrumentError> {
        let cannot = |error: std::io::Error| {
            InstrumentError::Disconnected(format!("{}: {error}", program.display()))
        };
        let stderr = std::fs::File::create(complaints).map_err(cannot)?;
        let mut command = Command::new(program);
        command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(stderr);
        let mut child = spawn(&mut command).map_err(cannot)?;
        let (ask, out) = (child.stdin.take(), child.stdout.take());
        let (send, said) = channel();
        let complaints = complaints.to_owned();
        let helper = Self { child, ask, said, complaints, stuck: false };
        if let Some(out) = out {
            let listen = move || listen(out, &send);
            let thread = std::thread::Builder::new().name("camera".to_owned()).spawn(listen);
            thread.map_err(cannot)?;
        }
        Ok(helper)
    }

    /// Sends a line. It does not wait for anything: a line is shorter than a pipe is deep.
    pub(super) fn ask(&mut self, line: &str) -> Result<(), InstrumentError> {
        let sent = match &mut self.ask {
            Some(ask) => ask.write_all(line.as_bytes()),
            None => Err(ErrorKind::BrokenPipe.into()),
        };
        sent.map_err(|_| self.ended())
    }

    /// The next that it says.
    pub(super) fn next(&mut self, until: Instant) -> Result<Said, InstrumentError> {
        let wait = until.saturating_duration_since(Instant::now());
        match self.said.recv_timeout(wait) {
            Ok(said) => Ok(said),
            Err(RecvTimeoutError::Timeout) => {
                self.stuck = true;
                Err(InstrumentError::Timeout(wait))
            }
            Err(RecvTimeoutError::Disconnected) => Err(self.ended()),
        }
    }

    fn ended(&mut self) -> InstrumentError {
        self.stuck = true;
        let said = std::fs::read_to_string(&self.complaints).unwrap_or_default();
        let last = said.lines().rfind(|line| !line.trim().is_empty()).unwrap_or("it said nothing");
        InstrumentError::Disconnected(format!("the camera's helper program has ended: {last}"))
    }
}

/// A program that is being written this moment, by an update, is there in the next.
fn spawn(command: &mut Command) -> std::io::Result<Child> {
    let until = Instant::now() + FAREWELL;
    loop {
        match command.spawn() {
            Err(error)
                if error.kind() == ErrorKind::ExecutableFileBusy && Instant::now() < until =>
            {
                std::thread::sleep(Duration::from_millis(10));
            }
            other => return other,
        }
    }
}

/// A process that is ended by a signal leaves the camera's session open; so it is asked first.
impl Drop for Helper {
    fn drop(&mut self) {
        self.ask = None;
        let until = Instant::now() + if self.stuck { Duration::ZERO } else { FAREWELL };
        while Instant::now() < until {
            if !matches!(self.child.try_wait(), Ok(None)) {
                return;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Passes on what the helper says until it ends, or until nobody listens.
fn listen(out: ChildStdout, to: &Sender<Said>) {
    let mut out = BufReader::new(out);
    loop {
        let mut line = Vec::new();
        if !matches!(out.by_ref().take(1 << 12).read_until(b'\n', &mut line), Ok(1..)) {
            return;
        }
        let text = String::from_utf8_lossy(&line);
        let text = text.trim_end_matches(['\r', '\n']);
        let said = match reply(text) {
            Some(Reply::Picture { length, name }) => {
                let mut bytes = Vec::new();
                let read = out.by_ref().take(length as u64).read_to_end(&mut bytes);
                if read.ok() != Some(length) {
                    return;
                }
                Said::Picture { name, bytes }
            }
            Some(reply) => Said::Reply(reply),
            None => Said::Garbage(text.to_owned()),
        };
        if to.send(said).is_err() {
            return;
        }
    }
}
