//! The exchange folder: pictures, readings and calibrations of a session as other programs write
//! and read them. DESIGN fixes its format; no key of it may change.

mod folder;
mod read;
mod write;

pub use folder::Folder;
pub use read::{ForeignCapture, ForeignSession, read};
pub use write::{ExportError, Exported, export, prepare};

/// The file that says what is in the folder.
pub const SESSION_FILE: &str = "session.yaml";

/// Where [`export`] puts the pattern.
pub const PATTERN_FILE: &str = "pattern.yaml";

/// How a picture's file name ends, by its content; `None` where it is neither JPEG nor PNG.
pub fn picture_kind(bytes: &[u8]) -> Option<&'static str> {
    if bytes.starts_with(&[0xff, 0xd8]) {
        Some("jpg")
    } else if bytes.starts_with(b"\x89PNG") {
        Some("png")
    } else {
        None
    }
}
