//! What releases the camera. Each way is waited for to its end.

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use beampose_core::InstrumentError;

/// A file in the folder in which the program that fills it says where it takes releases.
pub(super) const ANNOUNCED: &str = ".beampose-release";

/// What releases the camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Release {
    /// Somebody else, unless the folder says otherwise.
    Elsewhere,
    /// A program with its arguments.
    Command(Vec<String>),
    /// A program that listens there.
    Listener(String),
}

impl Release {
    /// As the option has it. `None` for quotation marks that are not closed.
    pub(super) fn read(text: &str) -> Option<Self> {
        if let Some(place) = text.strip_prefix("tcp:") {
            return Some(Self::Listener(place.trim().to_owned()));
        }
        let words = words(text)?;
        Some(if words.is_empty() { Self::Elsewhere } else { Self::Command(words) })
    }

    /// Releases. What the command complains of goes to `complaints`. Real time, at most `within`.
    ///
    /// # Errors
    /// In the words of whatever failed.
    pub(super) fn fire(
        &self,
        folder: &Path,
        complaints: &Path,
        within: Duration,
    ) -> Result<(), InstrumentError> {
        match self {
            Self::Command(words) => command(words, complaints, within),
            Self::Listener(place) => ask(place, within),
            Self::Elsewhere => match announced(folder) {
                Some(place) => ask(&place, within),
                None => Ok(()),
            },
        }
    }
}

fn announced(folder: &Path) -> Option<String> {
    let text = std::fs::read_to_string(folder.join(ANNOUNCED)).ok()?;
    Some(text.trim().strip_prefix("tcp:")?.to_owned())
}

/// Words as a shell would have them, without anything else that a shell does.
fn words(text: &str) -> Option<Vec<String>> {
    let mut all = Vec::new();
    let mut word: Option<String> = None;
    let mut quote = None;
    for letter in text.chars() {
        match (letter, quote) {
            (_, Some(mark)) if letter == mark => quote = None,
            ('"' | '\'', None) => {
                quote = Some(letter);
                word.get_or_insert_default();
            }
            (_, None) if letter.is_whitespace() => all.extend(word.take()),
            _ => word.get_or_insert_default().push(letter),
        }
    }
    all.extend(word);
    quote.is_none().then_some(all)
}

fn command(words: &[String], complaints: &Path, within: Duration) -> Result<(), InstrumentError> {
    let Some((program, arguments)) = words.split_first() else { return Ok(()) };
    let cannot =
        |error: std::io::Error| InstrumentError::Refused(format!("release: {program}: {error}"));
    let said = std::fs::File::create(complaints).map_err(cannot)?;
    let mut child = Command::new(program)
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(said)
        .spawn()
        .map_err(cannot)?;
    let until = Instant::now() + within;
    loop {
        if let Some(status) = child.try_wait().map_err(cannot)? {
            if status.success() {
                return Ok(());
            }
            let said = std::fs::read_to_string(complaints).unwrap_or_default();
            let said = said.lines().rfind(|line| !line.trim().is_empty()).unwrap_or_default();
            let why = format!("release: {program} ended with {status}: {said}");
            return Err(InstrumentError::Refused(why));
        }
        if Instant::now() >= until {
            let _ = child.kill();
            let _ = child.wait();
            return Err(InstrumentError::Timeout(within));
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn ask(place: &str, within: Duration) -> Result<(), InstrumentError> {
    let gone = |error: std::io::Error| {
        if matches!(error.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut) {
            return InstrumentError::Timeout(within);
        }
        let cure = "does the program that takes the pictures run?";
        InstrumentError::Disconnected(format!("release at {place}: {error}: {cure}"))
    };
    let none = || std::io::Error::other("expected host:port");
    let to = place.to_socket_addrs().map_err(gone)?.next().ok_or_else(none).map_err(gone)?;
    let mut stream = TcpStream::connect_timeout(&to, within).map_err(gone)?;
    stream.set_nodelay(true).map_err(gone)?;
    stream.set_read_timeout(Some(within)).map_err(gone)?;
    stream.write_all(b"RELEASE\n").map_err(gone)?;
    let mut answer = String::new();
    BufReader::new(stream).read_line(&mut answer).map_err(gone)?;
    match answer.trim_end() {
        "OK" => Ok(()),
        other => match other.strip_prefix("ERROR ") {
            Some(why) => Err(InstrumentError::Refused(format!("release: {why}"))),
            None => Err(InstrumentError::Garbled {
                expected: "OK or ERROR from the release".to_owned(),
                found: other.to_owned(),
            }),
        },
    }
}

/// Where a command's complaints go.
pub(super) fn complaints(scratch: &Path, name: &str) -> PathBuf {
    scratch.join(format!("{name}-release.txt"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn command_lines_are_taken_apart() {
        let command = |words: &[&str]| {
            Some(Release::Command(words.iter().map(|word| (*word).to_owned()).collect()))
        };
        assert_eq!(Release::read(" "), Some(Release::Elsewhere));
        assert_eq!(
            Release::read("tcp:10.0.0.7:99"),
            Some(Release::Listener("10.0.0.7:99".to_owned()))
        );
        assert_eq!(Release::read("a  -b 'c d'\"e\""), command(&["a", "-b", "c de"]));
        assert_eq!(Release::read("a ''"), command(&["a", ""]));
        assert_eq!(Release::read("a 'b"), None);
    }

    #[test]
    fn a_command_that_fails_or_hangs_says_so() {
        let scratch = tempfile::tempdir().unwrap();
        let complaints = complaints(scratch.path(), "left");
        let fire = |text: &str, within: u64| {
            let within = Duration::from_millis(within);
            Release::read(text).unwrap().fire(scratch.path(), &complaints, within)
        };
        assert_eq!(fire("true", 5000), Ok(()));
        let error = fire("sh -c 'echo battery empty >&2; exit 3'", 5000).unwrap_err().to_string();
        assert!(error.contains("battery empty") && error.contains('3'), "{error}");
        assert!(matches!(fire("sleep 20", 30), Err(InstrumentError::Timeout(_))));
        let error = fire("no-such-program-here", 30).unwrap_err().to_string();
        assert!(error.contains("no-such-program-here"), "{error}");
        assert!(matches!(fire("tcp:127.0.0.1:1", 300), Err(InstrumentError::Disconnected(_))));
    }
}
