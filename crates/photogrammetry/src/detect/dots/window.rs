//! The pixels around a dot, row by row: model, residual and weight of each.
//!
//! Single precision: its rounding is a thousandth of the rounding of grey levels. Rows are padded
//! to whole lanes with pixels of no weight and no light.

use super::gaussian::Gaussian;
use super::weighting::Weighting;
use crate::detect::lanes::{self, LANES};
use crate::image::GrayImage;

/// Widest window that is fitted, pixels.
pub(super) const MAX_WINDOW: usize = 96;

/// A rectangle of pixels, ends excluded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Window {
    /// First column and the one after the last.
    pub(super) x: [usize; 2],
    /// First row and the one after the last.
    pub(super) y: [usize; 2],
}

/// One row of a window; all slices are as long, a multiple of [`LANES`].
pub(super) struct Row<'a> {
    /// Offset from the centre downwards, pixels.
    pub(super) v: f32,
    /// Offsets to the right, pixels.
    pub(super) u: &'a [f32],
    /// The model above the background, grey levels.
    pub(super) f: &'a [f32],
    /// What is seen less the model and the background, grey levels.
    pub(super) e: &'a [f32],
    /// Weights, zero where a pixel takes no part.
    pub(super) w: &'a [f32],
}

/// Room for a row.
struct Buffers {
    u: [f32; MAX_WINDOW],
    /// `-qxx u^2 / 2`.
    along: [f32; MAX_WINDOW],
    grey: [f32; MAX_WINDOW],
    f: [f32; MAX_WINDOW],
    e: [f32; MAX_WINDOW],
    w: [f32; MAX_WINDOW],
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

    /// Number of columns of a padded row.
    pub(super) fn padded_width(&self) -> usize {
        self.width().next_multiple_of(LANES)
    }

    /// The part of the window where the model exceeds a level, grey levels above the background.
    pub(super) fn core(&self, gaussian: &Gaussian, level: f64) -> Option<Self> {
        let [xx, xy, yy] = gaussian.q;
        let square = 2.0 * (gaussian.amplitude / level).ln().max(0.0) / (xx * yy - xy * xy);
        let cut = |centre: f64, half: f64, range: [usize; 2]| {
            let first = (centre - half).ceil().max(range[0] as f64);
            let last = (centre + half).floor().min(range[1] as f64 - 1.0);
            (first <= last).then(|| [first as usize, last as usize + 1])
        };
        Some(Self {
            x: cut(gaussian.x, (yy * square).sqrt(), self.x)?,
            y: cut(gaussian.y, (xx * square).sqrt(), self.y)?,
        })
    }

    /// Calls `each` for every row.
    #[inline]
    pub(super) fn walk(
        &self,
        image: &GrayImage,
        gaussian: &Gaussian,
        weighting: &Weighting,
        mut each: impl FnMut(&Row),
    ) {
        let padded = self.padded_width();
        let mut buffers = Buffers::new();
        buffers.set_columns(self.x[0] as f64 - gaussian.x, padded, gaussian.q[0]);
        for y in self.y[0]..self.y[1] {
            let v = (y as f64 - gaussian.y) as f32;
            buffers.set_pixels(&image.row(y)[self.x[0]..self.x[1]]);
            buffers.fill(v, padded, gaussian);
            weighting.fill(
                &buffers.grey[..padded],
                &buffers.f[..padded],
                &buffers.e[..padded],
                &mut buffers.w[..padded],
            );
            buffers.clear_padding(self.width(), padded);
            each(&Row {
                v,
                u: &buffers.u[..padded],
                f: &buffers.f[..padded],
                e: &buffers.e[..padded],
                w: &buffers.w[..padded],
            });
        }
    }
}

impl Buffers {
    fn new() -> Self {
        let none = [0.0; MAX_WINDOW];
        Self { u: none, along: none, grey: none, f: none, e: none, w: none }
    }

    fn set_columns(&mut self, first: f64, padded: usize, xx: f64) {
        let (first, half) = (first as f32, -0.5 * xx as f32);
        for i in 0..padded {
            let u = first + i as f32;
            self.u[i] = u;
            self.along[i] = half * u * u;
        }
    }

    fn set_pixels(&mut self, pixels: &[u8]) {
        for (grey, &pixel) in self.grey.iter_mut().zip(pixels) {
            *grey = f32::from(pixel);
        }
    }

    /// Model and residuals of a row.
    fn fill(&mut self, v: f32, padded: usize, gaussian: &Gaussian) {
        let (tilt, down) = (-(gaussian.q[1] as f32) * v, -0.5 * gaussian.q[2] as f32 * v * v);
        let (amplitude, background) = (gaussian.amplitude as f32, gaussian.background as f32);
        let columns = self.u[..padded].iter().zip(&self.along[..padded]);
        for (f, (u, along)) in self.f[..padded].iter_mut().zip(columns) {
            *f = amplitude * lanes::exp(along + (tilt * u + down));
        }
        let seen = self.grey[..padded].iter().zip(&self.f[..padded]);
        for (e, (grey, f)) in self.e[..padded].iter_mut().zip(seen) {
            *e = grey - background - f;
        }
    }

    fn clear_padding(&mut self, width: usize, padded: usize) {
        self.f[width..padded].fill(0.0);
        self.e[width..padded].fill(0.0);
        self.w[width..padded].fill(0.0);
    }
}
