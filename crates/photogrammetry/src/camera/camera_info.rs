//! ROS `camera_info` YAML (`plumb_bob`), so that calibrations travel to and from OpenCV.

use std::fmt::Write as _;

use serde::Deserialize;

use super::Camera;

/// Why a `camera_info` file cannot be used.
#[derive(Debug, Clone, thiserror::Error)]
pub enum CameraInfoError {
    /// It is not YAML of the right form; the reader's words hold line and column.
    #[error("{0}")]
    Syntax(String),
    /// Another distortion model.
    #[error("distortion_model is {0:?}; only plumb_bob (five coefficients) is known")]
    Model(String),
    /// A number that no camera has.
    #[error("{0}")]
    Value(String),
    /// A matrix of the wrong size.
    #[error("{name} has {found} numbers, expected {expected}")]
    Size {
        /// Which matrix.
        name: &'static str,
        /// How many numbers it has.
        found: usize,
        /// How many it should have.
        expected: usize,
    },
}

#[derive(Deserialize)]
struct CameraInfo {
    image_width: usize,
    image_height: usize,
    distortion_model: String,
    camera_matrix: Matrix,
    distortion_coefficients: Matrix,
}

#[derive(Deserialize)]
struct Matrix {
    data: Vec<f64>,
}

/// Reads a `camera_info` file. Rectification and projection matrices are not used, and any field
/// that ROS may add is passed over: the format is theirs.
///
/// # Errors
/// [`CameraInfoError`].
pub fn read_camera_info(text: &str) -> Result<Camera, CameraInfoError> {
    let info: CameraInfo =
        serde_yaml::from_str(text).map_err(|e| CameraInfoError::Syntax(e.to_string()))?;
    if info.distortion_model != "plumb_bob" {
        return Err(CameraInfoError::Model(info.distortion_model));
    }
    let size = |name, found: usize, expected| {
        if found == expected {
            Ok(())
        } else {
            Err(CameraInfoError::Size { name, found, expected })
        }
    };
    let (k, d) = (&info.camera_matrix.data, &info.distortion_coefficients.data);
    size("camera_matrix", k.len(), 9)?;
    size("distortion_coefficients", d.len(), 5)?;
    let camera = Camera {
        width: info.image_width,
        height: info.image_height,
        fx: k[0],
        fy: k[4],
        cx: k[2],
        cy: k[5],
        k1: d[0],
        k2: d[1],
        p1: d[2],
        p2: d[3],
        k3: d[4],
    };
    plausible(&camera).map_err(CameraInfoError::Value)?;
    Ok(camera)
}

/// Numbers that no camera has are a slip in the file.
fn plausible(c: &Camera) -> Result<(), String> {
    let all = [c.fx, c.fy, c.cx, c.cy, c.k1, c.k2, c.p1, c.p2, c.k3];
    if !all.iter().all(|x| x.is_finite()) {
        return Err("a number of the calibration is not finite".to_owned());
    }
    if c.fx <= 0.0 || c.fy <= 0.0 {
        return Err(format!("the focal lengths {} and {} must be above zero", c.fx, c.fy));
    }
    let inside = |at: f64, size: usize| at >= 0.0 && at <= size as f64;
    if !inside(c.cx, c.width) || !inside(c.cy, c.height) {
        return Err(format!(
            "the principal point ({}, {}) is outside the picture of {} x {} pixels",
            c.cx, c.cy, c.width, c.height
        ));
    }
    Ok(())
}

/// Writes a `camera_info` file as ROS' and OpenCV's tools read it.
#[must_use]
pub fn write_camera_info(name: &str, camera: &Camera) -> String {
    let c = camera;
    let mut text = String::new();
    let _ = write!(
        text,
        "image_width: {}\nimage_height: {}\ncamera_name: {name}\ndistortion_model: plumb_bob\n\
         camera_matrix:\n  rows: 3\n  cols: 3\n  data: [{}, 0.0, {}, 0.0, {}, {}, 0.0, 0.0, 1.0]\n\
         distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [{}, {}, {}, {}, {}]\n\
         rectification_matrix:\n  rows: 3\n  cols: 3\n  \
         data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]\n\
         projection_matrix:\n  rows: 3\n  cols: 4\n  \
         data: [{}, 0.0, {}, 0.0, 0.0, {}, {}, 0.0, 0.0, 0.0, 1.0, 0.0]\n",
        c.width,
        c.height,
        c.fx,
        c.cx,
        c.fy,
        c.cy,
        c.k1,
        c.k2,
        c.p1,
        c.p2,
        c.k3,
        c.fx,
        c.cx,
        c.fy,
        c.cy
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_reads_back() {
        let camera = Camera {
            width: 3456,
            height: 2592,
            fx: 3529.25,
            fy: 3530.5,
            cx: 1727.5,
            cy: 1295.5,
            k1: -0.1,
            k2: 0.02,
            p1: 1e-4,
            p2: -2e-4,
            k3: 0.0,
        };
        assert_eq!(read_camera_info(&write_camera_info("cam_a", &camera)).unwrap(), camera);
    }

    #[test]
    fn another_distortion_model_is_refused() {
        let text = write_camera_info(
            "c",
            &Camera {
                width: 1,
                height: 1,
                fx: 1.0,
                fy: 1.0,
                cx: 0.0,
                cy: 0.0,
                k1: 0.0,
                k2: 0.0,
                p1: 0.0,
                p2: 0.0,
                k3: 0.0,
            },
        );
        let fisheye = text.replace("plumb_bob", "equidistant");
        assert!(matches!(read_camera_info(&fisheye), Err(CameraInfoError::Model(_))));
    }
}
