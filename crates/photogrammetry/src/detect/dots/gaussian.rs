//! The model of a dot: an elliptical Gaussian on a flat background.

/// `background + amplitude exp(-(qxx u^2 + 2 qxy u v + qyy v^2) / 2)`, u = x - `x`, v = y - `y`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Gaussian {
    /// Centre, pixels.
    pub(super) x: f64,
    /// Centre, pixels.
    pub(super) y: f64,
    /// Peak above the background, grey levels.
    pub(super) amplitude: f64,
    /// Grey levels.
    pub(super) background: f64,
    /// Inverse covariance of the spot: xx, xy, yy, in 1/px^2.
    pub(super) q: [f64; 3],
}

impl Gaussian {
    /// Standard deviations along the principal axes (large, small), pixels.
    pub(super) fn sigma(&self) -> [f64; 2] {
        let [xx, xy, yy] = self.q;
        let mean = 0.5 * (xx + yy);
        let half = (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
        [1.0 / (mean - half).max(1e-12).sqrt(), 1.0 / (mean + half).max(1e-12).sqrt()]
    }

    /// Square of the distance from the centre in standard deviations.
    pub(super) fn square_radius(&self, x: f64, y: f64) -> f64 {
        let (u, v) = (x - self.x, y - self.y);
        self.q[0] * u * u + 2.0 * self.q[1] * u * v + self.q[2] * v * v
    }
}
