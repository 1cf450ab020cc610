//! Start values from nothing: where cameras and points are, from image points alone.
//!
//! Cameras that see points of known place are resected on them; where none does, two cameras are
//! oriented to one another. Then, in turns, points are triangulated and further cameras resected on
//! them. The result starts an adjustment, and is worth no more than that.

mod network;
mod relative;

pub use network::{InitialError, initial_values};
pub use relative::{RelativeOrientation, relative_orientations};
