//! A small seeded renderer for the tests of detection: dots, speckle, targets, noise. The examples
//! that write pictures for comparison include this file as well.

use beampose_photogrammetry::GrayImage;
use beampose_photogrammetry::scene::ring_sectors;
use nalgebra::{Matrix2, Vector2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Seeded normal deviates.
pub(super) struct Normal(ChaCha8Rng);

impl Normal {
    pub(super) fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// Uniform in `[low, high)`.
    pub(super) fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }

    /// Standard normal (Box and Muller).
    pub(super) fn next(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.0.random::<f64>()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.0.random::<f64>()).cos()
    }
}

/// A Gaussian spot.
#[derive(Clone, Copy)]
pub(super) struct Spot {
    pub(super) at: [f64; 2],
    pub(super) amplitude: f64,
    /// Along its axes.
    pub(super) sigma: [f64; 2],
    /// Of the first axis from x towards y, radians.
    pub(super) angle: f64,
}

impl Spot {
    pub(super) fn round(at: [f64; 2], amplitude: f64, sigma: f64) -> Self {
        Self { at, amplitude, sigma: [sigma, sigma], angle: 0.0 }
    }

    fn value(&self, x: f64, y: f64) -> f64 {
        let (sin, cos) = self.angle.sin_cos();
        let (u, v) = (x - self.at[0], y - self.at[1]);
        let along = (u * cos + v * sin) / self.sigma[0];
        let across = (v * cos - u * sin) / self.sigma[1];
        self.amplitude * (-0.5 * (along * along + across * across)).exp()
    }
}

/// A printed target under an affine view.
#[derive(Clone, Copy)]
pub(super) struct Print {
    pub(super) at: [f64; 2],
    pub(super) code: u16,
    /// Of the centre disc, pixels.
    pub(super) radius: f64,
    /// Foreshortening across `tilt_axis`, radians.
    pub(super) tilt: f64,
    /// Direction of the axis, radians.
    pub(super) tilt_axis: f64,
    /// Where the first sector begins, radians.
    pub(super) turn: f64,
    /// Grey levels of disc and ground.
    pub(super) levels: [f64; 2],
}

impl Print {
    pub(super) fn dark(at: [f64; 2], code: u16, radius: f64) -> Self {
        Self { at, code, radius, tilt: 0.0, tilt_axis: 0.0, turn: 0.3, levels: [60.0, 180.0] }
    }

    fn plane_from_image(&self) -> Matrix2<f64> {
        let (sin, cos) = self.tilt_axis.sin_cos();
        let turn = Matrix2::new(cos, sin, -sin, cos);
        let stretch = Matrix2::new(1.0, 0.0, 0.0, 1.0 / self.tilt.cos());
        turn.transpose() * stretch * turn / self.radius
    }

    /// Mean over a pixel of print and what is beside it.
    fn pixel(&self, inverse: &Matrix2<f64>, x: f64, y: f64, beside: f64) -> f64 {
        const STEPS: usize = 6;
        let shift = |k: usize| (k as f64 + 0.5) / STEPS as f64 - 0.5;
        let value = |i: usize| self.value(inverse, x + shift(i % STEPS), y + shift(i / STEPS));
        let sum: f64 = (0..STEPS * STEPS).map(|i| value(i).unwrap_or(beside)).sum();
        sum / (STEPS * STEPS) as f64
    }

    /// Grey value on the print, `None` beside it.
    fn value(&self, inverse: &Matrix2<f64>, x: f64, y: f64) -> Option<f64> {
        let p = inverse * Vector2::new(x - self.at[0], y - self.at[1]);
        let radius = p.norm();
        if radius > 3.6 {
            return None;
        }
        let turn = (p.y.atan2(p.x) - self.turn).rem_euclid(std::f64::consts::TAU);
        let sector = ((turn / std::f64::consts::TAU * 12.0) as usize).min(11);
        let is_ring = (2.0..3.0).contains(&radius) && ring_sectors(self.code)[sector];
        Some(if radius < 1.0 || is_ring { self.levels[0] } else { self.levels[1] })
    }
}

/// A picture in grey levels before rounding.
pub(super) struct Canvas {
    width: usize,
    height: usize,
    values: Vec<f64>,
}

impl Canvas {
    pub(super) fn new(width: usize, height: usize, level: f64) -> Self {
        Self { width, height, values: vec![level; width * height] }
    }

    pub(super) fn map(mut self, mut value: impl FnMut(f64, f64, f64) -> f64) -> Self {
        for (i, slot) in self.values.iter_mut().enumerate() {
            *slot = value((i % self.width) as f64, (i / self.width) as f64, *slot);
        }
        self
    }

    /// Row by row.
    pub(super) fn values(&self) -> &[f64] {
        &self.values
    }

    /// Adds spots with speckle of a contrast whose grains have the autocorrelation
    /// `exp(-pi d^2 / g)` (log-normal intensity, as a sum of several patterns nearly has).
    pub(super) fn spots(
        self,
        spots: &[Spot],
        contrast: f64,
        grain_area: f64,
        normal: &mut Normal,
    ) -> Self {
        let (width, height) = (self.width, self.height);
        let spread = (1.0 + contrast * contrast).ln().sqrt();
        let field = grains(width, height, grain_area, normal);
        let light = light(spots, width, height);
        self.map(|x, y, level| {
            let i = y as usize * width + x as usize;
            level + light[i] * (spread * field[i] - 0.5 * spread * spread).exp()
        })
    }

    /// Adds a random normal field of the same kind as speckle grains, of an amplitude in grey levels.
    pub(super) fn clutter(self, amplitude: f64, grain_area: f64, normal: &mut Normal) -> Self {
        let width = self.width;
        let field = grains(width, self.height, grain_area, normal);
        self.map(|x, y, level| level + amplitude * field[y as usize * width + x as usize])
    }

    /// Draws targets, 6 x 6 samples a pixel.
    pub(super) fn prints(mut self, prints: &[Print]) -> Self {
        for print in prints {
            let inverse = print.plane_from_image();
            let reach = 3.6 * print.radius + 1.0;
            let range = |at: f64, size: usize| {
                (at - reach).max(0.0) as usize..((at + reach).max(0.0) as usize + 1).min(size)
            };
            for y in range(print.at[1], self.height) {
                for x in range(print.at[0], self.width) {
                    let slot = &mut self.values[y * self.width + x];
                    *slot = print.pixel(&inverse, x as f64, y as f64, *slot);
                }
            }
        }
        self
    }

    /// Gaussian blur.
    pub(super) fn blur(mut self, sigma: f64) -> Self {
        self.values = smooth(&self.values, self.width, self.height, sigma);
        self
    }

    /// Adds noise and rounds.
    pub(super) fn shoot(&self, noise: f64, normal: &mut Normal) -> GrayImage {
        let data =
            self.values.iter().map(|v| (v + noise * normal.next()).round().clamp(0.0, 255.0) as u8);
        GrayImage { width: self.width, height: self.height, data: data.collect() }
    }
}

/// The sum of spots, each drawn to where it is below 1e-8 of its peak.
fn light(spots: &[Spot], width: usize, height: usize) -> Vec<f64> {
    let mut sum = vec![0.0; width * height];
    for spot in spots {
        let reach = 6.1 * spot.sigma[0].max(spot.sigma[1]);
        let range = |at: f64, size: usize| {
            (at - reach).max(0.0) as usize..((at + reach).max(0.0) as usize + 1).min(size)
        };
        for y in range(spot.at[1], height) {
            for x in range(spot.at[0], width) {
                sum[y * width + x] += spot.value(x as f64, y as f64);
            }
        }
    }
    sum
}

/// Unit-variance normal field with the autocorrelation `exp(-pi d^2 / g)`.
fn grains(width: usize, height: usize, grain_area: f64, normal: &mut Normal) -> Vec<f64> {
    let white: Vec<f64> = (0..width * height).map(|_| normal.next()).collect();
    // A kernel of standard deviation s gives the autocorrelation exp(-d^2 / (4 s^2)).
    let sigma = (grain_area / (4.0 * std::f64::consts::PI)).sqrt();
    let field = smooth(&white, width, height, sigma);
    let power = field.iter().map(|v| v * v).sum::<f64>() / field.len() as f64;
    field.iter().map(|v| v / power.sqrt()).collect()
}

/// Separable Gaussian smoothing, borders repeated.
fn smooth(values: &[f64], width: usize, height: usize, sigma: f64) -> Vec<f64> {
    let reach = (4.0 * sigma).ceil() as i64;
    let mut kernel: Vec<f64> =
        (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma.max(1e-6)).powi(2)).exp()).collect();
    let total: f64 = kernel.iter().sum();
    kernel.iter_mut().for_each(|w| *w /= total);
    let at = |i: usize, k: usize, size: usize| {
        (i as i64 + k as i64 - reach).clamp(0, size as i64 - 1) as usize
    };
    let pass = |from: &[f64], index: &dyn Fn(usize, usize, usize) -> usize| -> Vec<f64> {
        (0..width * height)
            .map(|i| {
                kernel
                    .iter()
                    .enumerate()
                    .map(|(k, w)| w * from[index(i % width, i / width, k)])
                    .sum()
            })
            .collect()
    };
    let rows = pass(values, &|x, y, k| y * width + at(x, k, width));
    pass(&rows, &|x, y, k| at(y, k, height) * width + x)
}

/// A picture of `count` x `count` dots in speckle, and where they are: amplitude 150, standard
/// deviation 3 pixels, background 30, noise 4, on a jittered grid of 45 pixels. Grains are white
/// noise smoothed by a Gaussian of standard deviation `grain` pixels: area `4 pi grain^2`.
pub(super) fn speckle_cell(
    contrast: f64,
    grain: f64,
    count: usize,
    seed: u64,
) -> (GrayImage, Vec<Spot>) {
    let mut normal = Normal::new(seed);
    let place = |k: usize, normal: &mut Normal| 45.0 * (k as f64 + 1.0) + normal.uniform(-1.0, 1.0);
    let spots: Vec<Spot> = (0..count * count)
        .map(|i| {
            let at = [place(i % count, &mut normal), place(i / count, &mut normal)];
            Spot::round(at, 150.0, 3.0)
        })
        .collect();
    let size = 45 * (count + 1);
    let area = 4.0 * std::f64::consts::PI * grain * grain;
    let canvas = Canvas::new(size, size, 30.0).spots(&spots, contrast, area, &mut normal);
    (canvas.shoot(4.0, &mut normal), spots)
}

/// A hundred targets of one kind in a grid, of random codes and turns, and where they are.
pub(super) fn target_cell(
    kind: Print,
    blur: f64,
    noise: f64,
    codes: &[u16],
) -> (GrayImage, Vec<Print>) {
    let mut normal = Normal::new(5);
    let pitch = 7.6 * kind.radius;
    let prints: Vec<Print> = (0..100)
        .map(|i| {
            let place =
                |k: usize, normal: &mut Normal| (k as f64 + 0.6) * pitch + normal.uniform(0.0, 1.0);
            let at = [place(i % 10, &mut normal), place(i / 10, &mut normal)];
            let code = codes[7 * i % codes.len()];
            Print { at, code, turn: i as f64, tilt_axis: 0.1 * i as f64, ..kind }
        })
        .collect();
    let size = (10.4 * pitch) as usize;
    let canvas = Canvas::new(size, size, kind.levels[1]).prints(&prints).blur(blur);
    (canvas.shoot(noise, &mut normal), prints)
}
