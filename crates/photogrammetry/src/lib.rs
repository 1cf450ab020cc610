//! Image -> observations -> adjustment -> pose, with covariance.
//!
//! Pure: slices and structs in, structs out; no files, clocks, logging or globals; randomness is a
//! seed argument; sums in a fixed order, so the same input gives the same bits for any number of
//! threads. Inside this crate plain `f64` is in millimetres, radians and pixels; the centre of the
//! top-left pixel is (0, 0), x right, y down. Camera and module frames: x right, y down, z forward.

// Test helpers that the examples include name this crate from outside.
#[cfg(test)]
extern crate self as beampose_photogrammetry;

pub mod adjust;
pub mod calibrate;
pub mod camera;
pub mod detect;
pub mod identify;
pub mod image;
pub mod initial;
pub mod pattern;
pub mod pose;
pub mod print;
pub mod rotation;
pub mod scene;
pub mod sight;
pub mod solve;
pub mod wavelength;

pub use camera::{CalibratedCamera, Camera, InteriorSigma};
pub use image::{GrayImage, ImageError, decode};
pub use pattern::{Beam, Order, Pattern, PatternModel, PatternUncertainty};
pub use scene::{
    Artefact, ArtefactTarget, ModulePrior, Setup, TieTargets, WavelengthByTemperature,
};
pub use wavelength::{Wavelength, WavelengthSource, WavelengthUse};
