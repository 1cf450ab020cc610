//! Poses as they cross rooms. The mathematics of rotations is in `photogrammetry`.

use serde::{Deserialize, Serialize};

/// A module's position and orientation in the world, with its covariance.
///
/// World: the artefact's right-handed frame; on a wall X right, Y up, Z out of the wall towards
/// the cameras. The module frame is x right, y down, z forward.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// The module's position in the world, millimetres.
    pub position_mm: [f64; 3],
    /// Unit quaternion (w, x, y, z) of `world_from_module`.
    pub quaternion_wxyz: [f64; 4],
    /// Covariance: position in mm, then a small rotation vector in rad about the world axes.
    pub covariance: [[f64; 6]; 6],
}
