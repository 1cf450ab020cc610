//! Ellipses: as a conic through points, as an affine map of the unit circle.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

/// An ellipse: `(x - centre)' shape (x - centre) = 1`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ellipse {
    /// Pixels.
    pub(super) centre: Vector2<f64>,
    /// Symmetric, positive definite, 1/px^2.
    pub(super) shape: Matrix2<f64>,
}

impl Ellipse {
    /// Least-squares conic through points near `origin`, which must lie inside: there the constant
    /// term cannot vanish, so it is set to -1 and the problem is linear. `None` unless the conic is
    /// an ellipse.
    pub(super) fn through(points: &[Vector2<f64>], origin: Vector2<f64>) -> Option<Self> {
        let scale = points.iter().map(|p| (p - origin).norm()).fold(0.0, f64::max).max(1e-9);
        let mut normal = SMatrix::<f64, 5, 5>::zeros();
        let mut right = SVector::<f64, 5>::zeros();
        for point in points {
            let p = (point - origin) / scale;
            // Algebraic distances grow with the radius of the point; the weight evens them out.
            let weight = 1.0 / p.norm_squared().max(1e-3);
            let row = SVector::from([p.x * p.x, p.x * p.y, p.y * p.y, p.x, p.y]);
            normal += row * row.transpose() * weight;
            right += row * weight;
        }
        let c = normal.cholesky()?.solve(&right);
        let quadratic = Matrix2::new(c[0], 0.5 * c[1], 0.5 * c[1], c[2]);
        let centre = -0.5 * quadratic.try_inverse()? * Vector2::new(c[3], c[4]);
        let size = 1.0 + (centre.transpose() * quadratic * centre)[0];
        Self::valid(origin + centre * scale, quadratic / (size * scale * scale))
    }

    /// The ellipse, if it is one.
    pub(super) fn valid(centre: Vector2<f64>, shape: Matrix2<f64>) -> Option<Self> {
        let is_ellipse =
            shape.determinant() > 1e-12 && shape.trace() > 0.0 && centre.norm().is_finite();
        is_ellipse.then_some(Self { centre, shape })
    }

    /// Large and small semi-axis, pixels.
    pub(super) fn semi_axes(&self) -> [f64; 2] {
        let [low, high] = self.eigenvalues();
        [low.max(1e-12).sqrt().recip(), high.max(1e-12).sqrt().recip()]
    }

    fn eigenvalues(&self) -> [f64; 2] {
        let mean = 0.5 * self.shape.trace();
        let half = (0.25 * (self.shape[(0, 0)] - self.shape[(1, 1)]).powi(2)
            + self.shape[(0, 1)].powi(2))
        .sqrt();
        [mean - half, mean + half]
    }

    /// Direction of the large semi-axis from x towards y, radians, in (-pi/2, pi/2].
    pub(super) fn angle(&self) -> f64 {
        let (xx, xy, yy) = (self.shape[(0, 0)], self.shape[(0, 1)], self.shape[(1, 1)]);
        0.5 * (-2.0 * xy).atan2(yy - xx)
    }

    /// Maps the unit circle to the ellipse; its determinant is positive, so that clockwise stays
    /// clockwise.
    pub(super) fn map(&self) -> Matrix2<f64> {
        let [large, small] = self.semi_axes();
        let (sin, cos) = self.angle().sin_cos();
        Matrix2::new(large * cos, -small * sin, large * sin, small * cos)
    }

    /// Distance from the centre in radii.
    pub(super) fn radius(&self, at: &Vector2<f64>) -> f64 {
        self.square_radius(at).max(0.0).sqrt()
    }

    /// Its square.
    pub(super) fn square_radius(&self, at: &Vector2<f64>) -> f64 {
        let (u, v) = (at.x - self.centre.x, at.y - self.centre.y);
        let shape = &self.shape;
        shape[(0, 0)] * u * u + 2.0 * shape[(0, 1)] * u * v + shape[(1, 1)] * v * v
    }
}
