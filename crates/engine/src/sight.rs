//! Who finds dots in a picture, for steps that go by what a camera sees.

use beampose_core::InstrumentName;

/// Finds spots of light, and knows the nominal fan. `app` gives one that uses the same detector as
/// solving does.
pub trait Sight: Send + Sync {
    /// The centres of all spots in a picture, pixels at the camera's full size.
    ///
    /// # Errors
    /// Why the picture cannot be used, for people.
    fn spots(&self, camera: &InstrumentName, picture: &[u8]) -> Result<Vec<[f64; 2]>, String>;
    /// How far from the zero order a beam stands, degrees: to the right for one of its row, and
    /// downwards for one of its column. `None` where the pattern has no such beam.
    fn off_zero_deg(&self, dot: [i32; 2]) -> Option<f64>;
}
