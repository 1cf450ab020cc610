//! What can go wrong with a simulated world.

/// Why a world cannot be made, or a picture cannot be given.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WorldError {
    /// A number of the configuration makes no sense.
    #[error("{what} is {found}, expected {expected}")]
    Value {
        /// Which number, as a path within the configuration.
        what: String,
        /// What it is.
        found: String,
        /// What it may be.
        expected: &'static str,
    },
    /// The world has no camera of this name.
    #[error("no camera named {0:?} in the simulated world")]
    UnknownCamera(String),
    /// The world has no such stage.
    #[error("no {0} in the simulated world")]
    NoStage(&'static str),
    /// The picture could not be written as JPEG.
    #[error("failed to encode a JPEG: {0}")]
    Encode(String),
}
