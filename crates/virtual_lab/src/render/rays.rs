//! Viewing rays over a small patch of a picture: exact at nine nodes, quadratic between them.
//!
//! The exact inverse of the distortion costs a Newton iteration for each pixel. Over a patch of 30
//! pixels the neglected third derivative (6 k1 in normalised coordinates) leaves some 1e-5 px.

use beampose_photogrammetry::Camera;
use nalgebra::Vector2;

/// Undistorted normalised coordinates as a function of the pixel.
pub(super) struct RayPatch {
    centre: Vector2<f64>,
    half: Vector2<f64>,
    /// Coefficients for x^i y^j, `[j][i]`, of coordinates from -1 to 1.
    coefficients: [[Vector2<f64>; 3]; 3],
}

/// One row of a patch.
pub(super) struct RayRow {
    centre: f64,
    inverse_half: f64,
    pub(super) coefficients: [Vector2<f64>; 3],
}

/// From values at -1, 0, 1 to the coefficients of 1, t, t^2.
fn quadratic([a, b, c]: [Vector2<f64>; 3]) -> [Vector2<f64>; 3] {
    [b, (c - a) / 2.0, (a + c) / 2.0 - b]
}

impl RayPatch {
    /// The rays from `low` to `high`, pixels. `None` where the distortion has no inverse.
    pub(super) fn new(camera: &Camera, low: Vector2<f64>, high: Vector2<f64>) -> Option<Self> {
        let (centre, half) = ((low + high) / 2.0, ((high - low) / 2.0).map(|h| h.max(0.5)));
        let mut rows = [[Vector2::zeros(); 3]; 3];
        for (j, row) in rows.iter_mut().enumerate() {
            for (i, node) in row.iter_mut().enumerate() {
                let step = Vector2::new(i as f64 - 1.0, j as f64 - 1.0);
                *node = camera.normalise(&(centre + half.component_mul(&step)))?;
            }
        }
        let rows = rows.map(quadratic);
        let columns: [[Vector2<f64>; 3]; 3] =
            std::array::from_fn(|i| quadratic(std::array::from_fn(|j| rows[j][i])));
        let coefficients = std::array::from_fn(|j| std::array::from_fn(|i| columns[i][j]));
        Some(Self { centre, half, coefficients })
    }

    pub(super) fn row(&self, y: f64) -> RayRow {
        let t = (y - self.centre.y) / self.half.y;
        let [a, b, c] = &self.coefficients;
        RayRow {
            centre: self.centre.x,
            inverse_half: 1.0 / self.half.x,
            coefficients: std::array::from_fn(|i| a[i] + (b[i] + c[i] * t) * t),
        }
    }
}

impl RayRow {
    /// The running coordinate of a pixel column, from -1 to 1.
    pub(super) fn parameter(&self, x: f64) -> f64 {
        (x - self.centre) * self.inverse_half
    }

    /// Normalised coordinates at a pixel column.
    pub(super) fn at(&self, x: f64) -> Vector2<f64> {
        let t = self.parameter(x);
        let [a, b, c] = &self.coefficients;
        a + (b + c * t) * t
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_between_the_nodes_are_exact_to_a_ten_thousandth_of_a_pixel() {
        let camera = crate::WorldConfig::laboratory().cameras["cam_a"].calibration.model;
        for (x, y) in [(1700.0, 1300.0), (40.0, 60.0), (3400.0, 2500.0)] {
            let (low, high) = (Vector2::new(x, y), Vector2::new(x + 30.0, y + 30.0));
            let patch = RayPatch::new(&camera, low, high).unwrap();
            for (dx, dy) in [(0.0, 0.0), (7.0, 7.0), (22.5, 9.0), (30.0, 23.0)] {
                let exact = camera.normalise(&Vector2::new(x + dx, y + dy)).unwrap();
                let error = (patch.row(y + dy).at(x + dx) - exact).norm() * camera.fx;
                assert!(error < 1e-4, "{error} px at {x} {y} + {dx} {dy}");
            }
        }
    }
}
