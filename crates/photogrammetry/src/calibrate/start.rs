//! First values from nothing: the focal length from the homographies sheet -> picture.
//!
//! Zhang (2000), section 3.1, with the principal point in the middle of the picture and square
//! pixels: then each view gives two equations in the one unknown `1 / f^2`, which noise cannot make
//! absurd. Distortion starts at zero.

use nalgebra::{Matrix3, Vector2};

use super::View;
use super::adjust::CalibrationError;
use crate::camera::Camera;
use crate::pose::homography;

/// Least sum of the squared coefficients: one view whose sheet is tilted by t radians gives
/// `(t^2 / 2)^2`, so this is a single tilt of 2.5 degrees. With less the focal length cannot be told
/// from the distance.
const LEAST_PERSPECTIVE: f64 = 1e-6;

/// A camera to start from, without distortion.
///
/// # Errors
/// That the views leave the focal length open.
pub fn start_camera(
    views: &[View],
    [width, height]: [usize; 2],
) -> Result<Camera, CalibrationError> {
    let middle = Vector2::new(0.5 * (width as f64 - 1.0), 0.5 * (height as f64 - 1.0));
    // Pixels in units of the picture's size: the unknown is then about one.
    let unit = width.max(height).max(1) as f64;
    let (mut numerator, mut denominator) = (0.0, 0.0);
    for view in views {
        let Some(h) = sheet_homography(view, &middle, unit) else { continue };
        let (a, b) = (h.column(0), h.column(1));
        // h1' w h2 = 0 and h1' w h1 = h2' w h2 with w = diag(s, s, 1).
        let equations = [
            (a.x * b.x + a.y * b.y, -a.z * b.z),
            (a.x * a.x + a.y * a.y - b.x * b.x - b.y * b.y, b.z * b.z - a.z * a.z),
        ];
        for (left, right) in equations {
            numerator += left * right;
            denominator += left * left;
        }
    }
    let inverse_square = numerator / denominator;
    if !(inverse_square.is_finite() && inverse_square > 0.0) || denominator < LEAST_PERSPECTIVE {
        return Err(CalibrationError::NoPerspective);
    }
    let f = unit / inverse_square.sqrt();
    let (cx, cy) = (middle.x, middle.y);
    Ok(Camera::without_distortion([width, height], [f, f], [cx, cy]))
}

/// The homography of a view, its first two columns of unit size together.
fn sheet_homography(view: &View, middle: &Vector2<f64>, unit: f64) -> Option<Matrix3<f64>> {
    let from: Vec<Vector2<f64>> = view.points.iter().map(|p| p.on_sheet).collect();
    let to: Vec<Vector2<f64>> = view.points.iter().map(|p| (p.pixel - middle) / unit).collect();
    let h = homography(&from, &to)?;
    let scale = h.column(0).norm().hypot(h.column(1).norm());
    (scale > 0.0).then(|| h / scale)
}
