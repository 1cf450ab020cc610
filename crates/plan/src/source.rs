//! From what the caller got when it read a file to text, or to a fault like any other.
//!
//! This room opens no files: whoever does hands over the result, error or not.

use std::io::ErrorKind;

use crate::fault::{Fault, Source};

/// The text of a file, from the result of reading it.
///
/// # Errors
/// A fault when the file could not be read (missing, a directory, ...) or is not UTF-8.
pub fn text(name: &str, read: Result<Vec<u8>, std::io::Error>) -> Result<Source, Fault> {
    match read {
        Ok(bytes) => utf8(name, &bytes),
        Err(error) => Err(unreadable(name, &error)),
    }
}

/// The fault of a file that could not be read.
#[must_use]
pub fn unreadable(name: &str, error: &std::io::Error) -> Fault {
    let message = match error.kind() {
        ErrorKind::NotFound => "no such file".to_owned(),
        ErrorKind::IsADirectory => "expected a file, found a directory".to_owned(),
        ErrorKind::PermissionDenied => "permission denied".to_owned(),
        _ => format!("cannot be read: {error}"),
    };
    Fault::of_file(name, message)
}

/// Bytes as UTF-8 text; a byte order mark at the beginning is passed over.
pub(crate) fn utf8(name: &str, bytes: &[u8]) -> Result<Source, Fault> {
    match std::str::from_utf8(bytes) {
        Ok(text) => Ok(Source::new(name, text.strip_prefix('\u{feff}').unwrap_or(text))),
        Err(error) => {
            let place = error.valid_up_to();
            let line = bytes.iter().take(place).filter(|b| **b == b'\n').count() + 1;
            Err(Fault::of_file(name, format!("not UTF-8 text: byte {place} in line {line}")))
        }
    }
}
