//! The model of a dot: an elliptical Gaussian on a flat background, and its values on a window.

use crate::image::GrayImage;

/// Widest window that is fitted, pixels.
pub(super) const MAX_WINDOW: usize = 96;

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

    /// The part above the background along a row, from `u` in steps of one pixel. Two
    /// multiplications a pixel: the ratio of neighbours changes by the constant `exp(-qxx)`.
    pub(super) fn fill_row(&self, u: f64, v: f64, values: &mut [f64]) {
        let [xx, xy, yy] = self.q;
        let exponent = |u: f64| -0.5 * (xx * u * u + 2.0 * xy * u * v + yy * v * v);
        let start = exponent(u);
        if start < -300.0 {
            for (i, value) in values.iter_mut().enumerate() {
                *value = self.amplitude * exponent(u + i as f64).exp();
            }
            return;
        }
        let mut value = self.amplitude * start.exp();
        let mut ratio = (-0.5 * (xx * (2.0 * u + 1.0) + 2.0 * xy * v)).exp();
        let change = (-xx).exp();
        for slot in values {
            *slot = value;
            value *= ratio;
            ratio *= change;
        }
    }
}

/// A rectangle of pixels, ends excluded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Window {
    /// First column and the one after the last.
    pub(super) x: [usize; 2],
    /// First row and the one after the last.
    pub(super) y: [usize; 2],
}

impl Window {
    /// `half` pixels around a place, cut by the picture's border; `None` outside.
    pub(super) fn around(image: &GrayImage, at: (f64, f64), half: f64) -> Option<Self> {
        let half = half.min((MAX_WINDOW / 2 - 1) as f64);
        let cut = |centre: f64, size: usize| {
            let first = (centre - half).ceil().max(0.0);
            let last = (centre + half).floor().min(size as f64 - 1.0);
            (first <= last).then(|| [first as usize, last as usize + 1])
        };
        Some(Self { x: cut(at.0, image.width)?, y: cut(at.1, image.height)? })
    }

    /// Number of columns.
    pub(super) fn width(&self) -> usize {
        self.x[1] - self.x[0]
    }

    /// Number of rows.
    pub(super) fn height(&self) -> usize {
        self.y[1] - self.y[0]
    }

    /// Calls `each(u, v, pixels, model)` for every row: u and v are the first pixel's offsets from
    /// the centre of the Gaussian, `model` its values above the background.
    pub(super) fn walk(
        &self,
        image: &GrayImage,
        gaussian: &Gaussian,
        mut each: impl FnMut(f64, f64, &[u8], &[f64]),
    ) {
        let mut buffer = [0.0; MAX_WINDOW];
        let model = &mut buffer[..self.width()];
        let u = self.x[0] as f64 - gaussian.x;
        for y in self.y[0]..self.y[1] {
            let v = y as f64 - gaussian.y;
            gaussian.fill_row(u, v, model);
            each(u, v, &image.row(y)[self.x[0]..self.x[1]], model);
        }
    }
}
