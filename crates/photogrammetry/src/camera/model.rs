//! Projection, its derivatives, and its inverse.

use nalgebra::{Matrix2, Matrix2x3, SMatrix, Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// Interior orientation: focal lengths and principal point in pixels, Brown-Conrady distortion
/// (OpenCV's order k1, k2, p1, p2, k3; ROS' `plumb_bob`).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Picture width in pixels.
    pub width: usize,
    /// Picture height in pixels.
    pub height: usize,
    /// Focal length in pixels, along x.
    pub fx: f64,
    /// Focal length in pixels, along y.
    pub fy: f64,
    /// Principal point, x.
    pub cx: f64,
    /// Principal point, y.
    pub cy: f64,
    /// Radial distortion, second order.
    pub k1: f64,
    /// Radial distortion, fourth order.
    pub k2: f64,
    /// Tangential distortion.
    pub p1: f64,
    /// Tangential distortion.
    pub p2: f64,
    /// Radial distortion, sixth order.
    pub k3: f64,
}

/// A projected point with its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    /// The image point, pixels.
    pub pixel: Vector2<f64>,
    /// d pixel / d point in the camera frame, pixels per millimetre.
    pub by_point: Matrix2x3<f64>,
    /// d pixel / d (fx, fy, cx, cy, k1, k2, p1, p2, k3).
    pub by_interior: SMatrix<f64, 2, 9>,
}

impl Camera {
    /// A pinhole: picture size (width, height), focal lengths and principal point (x, y), pixels.
    #[must_use]
    pub const fn without_distortion(
        [width, height]: [usize; 2],
        [fx, fy]: [f64; 2],
        [cx, cy]: [f64; 2],
    ) -> Self {
        Self { width, height, fx, fy, cx, cy, k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0 }
    }

    /// Projects a point of the camera frame. `None` behind the camera, and beyond the radius where
    /// the distortion polynomial folds back.
    #[must_use]
    pub fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        if point.z <= 1e-9 {
            return None;
        }
        let normal = Vector2::new(point.x / point.z, point.y / point.z);
        if !self.invertible_at(&normal) {
            return None;
        }
        let d = self.distort(&normal);
        Some(Vector2::new(self.fx * d.x + self.cx, self.fy * d.y + self.cy))
    }

    /// Projects with all derivatives. `None` as [`Camera::project`].
    #[inline]
    #[must_use]
    pub fn project_with_derivatives(&self, point: &Vector3<f64>) -> Option<Projection> {
        if point.z <= 1e-9 {
            return None;
        }
        let inv_z = 1.0 / point.z;
        let n = Vector2::new(point.x * inv_z, point.y * inv_z);
        if !self.invertible_at(&n) {
            return None;
        }
        let d = self.distort(&n);
        let focal = Matrix2::new(self.fx, 0.0, 0.0, self.fy);
        let by_normal = Matrix2x3::new(inv_z, 0.0, -n.x * inv_z, 0.0, inv_z, -n.y * inv_z);
        let by_point = focal * self.distortion_jacobian(&n) * by_normal;
        let (x, y) = (n.x, n.y);
        let r2 = x * x + y * y;
        let (r4, r6) = (r2 * r2, r2 * r2 * r2);
        let (fx, fy) = (self.fx, self.fy);
        #[rustfmt::skip]
        let by_interior = SMatrix::<f64, 2, 9>::from_row_slice(&[
            d.x, 0.0, 1.0, 0.0, fx * x * r2, fx * x * r4, fx * 2.0 * x * y, fx * (r2 + 2.0 * x * x), fx * x * r6,
            0.0, d.y, 0.0, 1.0, fy * y * r2, fy * y * r4, fy * (r2 + 2.0 * y * y), fy * 2.0 * x * y, fy * y * r6,
        ]);
        let pixel = Vector2::new(fx * d.x + self.cx, fy * d.y + self.cy);
        Some(Projection { pixel, by_point, by_interior })
    }

    /// The undistorted normalised coordinates (x/z, y/z) of an image point, by Newton's method.
    /// `None` where the distortion has no inverse.
    #[must_use]
    pub fn normalise(&self, pixel: &Vector2<f64>) -> Option<Vector2<f64>> {
        let target = Vector2::new((pixel.x - self.cx) / self.fx, (pixel.y - self.cy) / self.fy);
        let mut n = target;
        for _ in 0..20 {
            let step = self.distortion_jacobian(&n).try_inverse()? * (self.distort(&n) - target);
            n -= step;
            if step.norm() < 1e-14 {
                break;
            }
        }
        let close = (self.distort(&n) - target).norm() < 1e-9;
        (close && self.invertible_at(&n)).then_some(n)
    }

    /// The viewing ray of an image point in the camera frame, of unit length.
    #[must_use]
    pub fn ray(&self, pixel: &Vector2<f64>) -> Option<Vector3<f64>> {
        self.normalise(pixel).map(|n| Vector3::new(n.x, n.y, 1.0).normalize())
    }

    /// True where the radial polynomial still grows with the radius.
    #[inline]
    fn invertible_at(&self, n: &Vector2<f64>) -> bool {
        let r2 = n.norm_squared();
        1.0 + r2 * (3.0 * self.k1 + r2 * (5.0 * self.k2 + r2 * 7.0 * self.k3)) > 0.0
    }

    #[inline]
    fn distort(&self, n: &Vector2<f64>) -> Vector2<f64> {
        let (x, y) = (n.x, n.y);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        Vector2::new(
            x * radial + 2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x),
            y * radial + self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        )
    }

    #[inline]
    fn distortion_jacobian(&self, n: &Vector2<f64>) -> Matrix2<f64> {
        let (x, y) = (n.x, n.y);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let slope = 2.0 * (self.k1 + r2 * (2.0 * self.k2 + r2 * 3.0 * self.k3));
        let mixed = slope * x * y + 2.0 * self.p1 * x + 2.0 * self.p2 * y;
        Matrix2::new(
            radial + slope * x * x + 2.0 * self.p1 * y + 6.0 * self.p2 * x,
            mixed,
            mixed,
            radial + slope * y * y + 6.0 * self.p1 * y + 2.0 * self.p2 * x,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera {
            width: 3456,
            height: 2592,
            fx: 3529.4,
            fy: 3530.1,
            cx: 1730.2,
            cy: 1291.7,
            k1: -0.11,
            k2: 0.05,
            p1: 4e-4,
            p2: -3e-4,
            k3: -0.004,
        }
    }

    #[test]
    fn derivatives_agree_with_finite_differences() {
        let (camera, point) = (camera(), Vector3::new(310.0, -240.0, 1400.0));
        let at = camera.project_with_derivatives(&point).unwrap();
        for axis in 0..3 {
            let mut step = Vector3::zeros();
            step[axis] = 1e-3;
            let slope = (camera.project(&(point + step)).unwrap()
                - camera.project(&(point - step)).unwrap())
                / 2e-3;
            assert!((slope - at.by_point.column(axis)).norm() < 1e-7, "axis {axis}");
        }
        let values = [
            camera.fx, camera.fy, camera.cx, camera.cy, camera.k1, camera.k2, camera.p1, camera.p2,
            camera.k3,
        ];
        let with = |values: [f64; 9]| {
            let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = values;
            Camera { fx, fy, cx, cy, k1, k2, p1, p2, k3, ..camera }.project(&point).unwrap()
        };
        for column in 0..9 {
            let step = 1e-5;
            let (mut more, mut less) = (values, values);
            more[column] += step;
            less[column] -= step;
            let slope = (with(more) - with(less)) / (2.0 * step);
            let error = (slope - at.by_interior.column(column)).norm();
            assert!(error < 1e-4 * slope.norm().max(1.0), "interior {column}: {error}");
        }
    }

    #[test]
    fn normalise_undoes_project() {
        let camera = camera();
        for (x, y) in [(0.0, 0.0), (0.0, 2591.0), (3455.0, 0.0), (3455.0, 2591.0), (1700.0, 300.0)]
        {
            let n = camera.normalise(&Vector2::new(x, y)).unwrap();
            let back = camera.project(&Vector3::new(n.x, n.y, 1.0)).unwrap();
            assert!((back - Vector2::new(x, y)).norm() < 1e-8);
        }
    }

    #[test]
    fn a_point_behind_the_camera_has_no_image() {
        assert_eq!(camera().project(&Vector3::new(1.0, 1.0, -5.0)), None);
    }
}
