//! Conversations kept, byte for byte, and played back to a driver in a test.
//!
//! A recording is JSON Lines: `{"t": 1.234567, "line": "rail", "sent": "/1 get pos\n"}`, with
//! `received` for the other way. Bytes that are no printable ASCII stand as `\xNN`.

use std::collections::VecDeque;
use std::io::{self, BufRead, Write};
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use async_trait::async_trait;
use beampose_core::InstrumentError;
use beampose_core::transport::Transport;
use serde::{Deserialize, Serialize};

/// Which way bytes went.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// To the instrument.
    Sent,
    /// From the instrument.
    Received,
}

#[derive(Serialize, Deserialize)]
struct Entry {
    t: f64,
    line: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sent: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    received: Option<String>,
}

/// Writes what goes over lines into a file.
pub struct Recorder {
    file: Mutex<std::fs::File>,
    start: Instant,
}

impl Recorder {
    /// Begins a recording, in place of a file that may be there.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn create(path: &Path) -> io::Result<Self> {
        Ok(Self { file: Mutex::new(std::fs::File::create(path)?), start: Instant::now() })
    }

    /// Adds bytes that went over a line.
    pub fn note(&self, line: &str, direction: Direction, bytes: &[u8]) {
        let text = Some(escaped(bytes));
        let (sent, received) = match direction {
            Direction::Sent => (text, None),
            Direction::Received => (None, text),
        };
        let t = (self.start.elapsed().as_secs_f64() * 1e6).round() / 1e6;
        let entry = Entry { t, line: line.to_owned(), sent, received };
        let Ok(mut text) = serde_json::to_string(&entry) else { return };
        text.push('\n');
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        // A recording that cannot be written does not stop the instrument it listens to.
        if let Err(error) = file.write_all(text.as_bytes()) {
            tracing::warn!("the recording of the wire is incomplete: {error}");
        }
    }
}

fn escaped(bytes: &[u8]) -> String {
    let mut text = String::with_capacity(bytes.len());
    for byte in bytes {
        match byte {
            b'\\' => text.push_str("\\\\"),
            b'\r' => text.push_str("\\r"),
            b'\n' => text.push_str("\\n"),
            b' '..=b'~' => text.push(char::from(*byte)),
            other => text.push_str(&format!("\\x{other:02x}")),
        }
    }
    text
}

fn unescaped(text: &str) -> Option<Vec<u8>> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        if byte != b'\\' {
            bytes.push(byte);
            continue;
        }
        match rest.next()? {
            b'\\' => bytes.push(b'\\'),
            b'r' => bytes.push(b'\r'),
            b'n' => bytes.push(b'\n'),
            b'x' => {
                let digits = [rest.next()?, rest.next()?];
                let digits = std::str::from_utf8(&digits).ok()?;
                bytes.push(u8::from_str_radix(digits, 16).ok()?);
            }
            _ => return None,
        }
    }
    Some(bytes)
}

/// What one side said.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Said {
    /// Which side.
    pub direction: Direction,
    /// What.
    pub bytes: Vec<u8>,
}

/// A recording as a line: gives what was received when what was sent is sent again.
pub struct Replay {
    left: Mutex<VecDeque<Said>>,
}

impl Replay {
    /// Plays what was said.
    #[must_use]
    pub fn new(said: impl IntoIterator<Item = Said>) -> Self {
        Self { left: Mutex::new(said.into_iter().collect()) }
    }

    /// Reads one line's part of a recording.
    ///
    /// # Errors
    /// What the operating system says, or the number of the line that is no entry.
    pub fn load(path: &Path, line: &str) -> io::Result<Self> {
        let mut said = Vec::new();
        for (number, text) in io::BufReader::new(std::fs::File::open(path)?).lines().enumerate() {
            let wrong = |why: String| {
                let place = format!("{}:{}: {why}", path.display(), number + 1);
                io::Error::new(io::ErrorKind::InvalidData, place)
            };
            let entry: Entry =
                serde_json::from_str(&text?).map_err(|error| wrong(error.to_string()))?;
            if entry.line != line {
                continue;
            }
            let (direction, text) = match (entry.sent, entry.received) {
                (Some(text), None) => (Direction::Sent, text),
                (None, Some(text)) => (Direction::Received, text),
                _ => return Err(wrong("expected `sent` or `received`".to_owned())),
            };
            let bytes = unescaped(&text).ok_or_else(|| wrong("no such escape".to_owned()))?;
            said.push(Said { direction, bytes });
        }
        Ok(Self::new(said))
    }

    /// Whether all of it was played.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.left().is_empty()
    }

    fn left(&self) -> MutexGuard<'_, VecDeque<Said>> {
        self.left.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Moves what was received next into `into`, until `enough`.
    fn receive(
        &self,
        deadline: Duration,
        enough: impl Fn(&[u8]) -> Option<usize>,
    ) -> Result<Vec<u8>, InstrumentError> {
        let mut left = self.left();
        let mut bytes = Vec::new();
        loop {
            if let Some(count) = enough(&bytes) {
                let rest = bytes.split_off(count);
                if !rest.is_empty() {
                    left.push_front(Said { direction: Direction::Received, bytes: rest });
                }
                return Ok(bytes);
            }
            match left.front() {
                Some(said) if said.direction == Direction::Received => {
                    bytes.extend(left.pop_front().map(|said| said.bytes).unwrap_or_default());
                }
                _ => return Err(InstrumentError::Timeout(deadline)),
            }
        }
    }
}

#[async_trait]
impl Transport for Replay {
    async fn open(&self, _: Duration) -> Result<u64, InstrumentError> {
        Ok(1)
    }

    async fn send(&self, bytes: &[u8], _: Duration) -> Result<(), InstrumentError> {
        let mut left = self.left();
        let expected = left.pop_front();
        match expected {
            Some(said) if said.direction == Direction::Sent && said.bytes == bytes => Ok(()),
            Some(said) => Err(InstrumentError::Fault(format!(
                "the recording has {} here, {} was sent",
                escaped(&said.bytes),
                escaped(bytes)
            ))),
            None => Err(InstrumentError::Fault(format!(
                "the recording is over, {} was sent",
                escaped(bytes)
            ))),
        }
    }

    async fn receive_until(&self, end: u8, limit: Duration) -> Result<Vec<u8>, InstrumentError> {
        self.receive(limit, |bytes| Some(1 + bytes.iter().position(|byte| *byte == end)?))
    }

    async fn receive_exactly(
        &self,
        count: usize,
        limit: Duration,
    ) -> Result<Vec<u8>, InstrumentError> {
        self.receive(limit, |bytes| (bytes.len() >= count).then_some(count))
    }

    async fn discard(&self, _: Duration) -> Result<(), InstrumentError> {
        let mut left = self.left();
        while left.front().is_some_and(|said| said.direction == Direction::Received) {
            left.pop_front();
        }
        Ok(())
    }

    async fn close(&self) {}

    fn send_without_waiting(&self, _: &[u8]) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_comes_back() {
        let all: Vec<u8> = (0..=255).collect();
        assert_eq!(unescaped(&escaped(&all)).unwrap(), all);
        assert_eq!(unescaped("\\q"), None);
        assert_eq!(unescaped("\\x4"), None);
    }
}
