//! The camera: Brown-Conrady interior orientation as OpenCV and ROS write it.

mod camera_info;
mod model;

pub use camera_info::{CameraInfoError, read_camera_info, write_camera_info};
pub use model::{Camera, Projection};

use serde::{Deserialize, Serialize};

/// Standard uncertainties of a calibrated interior orientation, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InteriorSigma {
    /// Of the focal length (fx and fy move together).
    pub focal_px: f64,
    /// Of the principal point, per axis (x, y).
    pub principal_point_px: [f64; 2],
}

/// A camera with what its calibration is worth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibratedCamera {
    /// The interior orientation.
    pub model: Camera,
    /// Its standard uncertainties.
    pub sigma: InteriorSigma,
}
