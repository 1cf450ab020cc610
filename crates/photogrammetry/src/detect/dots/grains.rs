//! How large speckle grains are, from products of neighbouring residuals.

use super::NoiseModel;
use super::fit::Fit;
use super::moments::PARAMETERS;
use super::window::Row;
use crate::detect::lanes::{self, LANES, Lanes};
use crate::image::GrayImage;

/// Lags at which residuals are compared: along rows, columns and diagonals.
const LAGS: [(usize, usize); 14] = [
    (1, 0),
    (0, 1),
    (1, 1),
    (2, 0),
    (0, 2),
    (2, 1),
    (1, 2),
    (2, 2),
    (3, 0),
    (0, 3),
    (4, 0),
    (0, 4),
    (6, 0),
    (0, 6),
];
/// Only pixels brighter than this part of the amplitude, and than so many times the read noise,
/// show grains.
const CORE: f64 = 0.2;
const CORE_IN_NOISE: f64 = 3.0;
/// Largest ratio of the new variance to that of the fit for which what the fit followed is made good.
const MOST_GROWTH: f32 = 4.0;
/// Standard deviations by which neighbouring residuals must be alike.
const SURE: f64 = 4.0;
/// Areas that are tried: from 1 to 57 square pixels in steps of 3 %.
const TRIALS: i32 = 137;
const TRIAL_RATIO: f64 = 1.03;

/// Sums of residual products for one lag.
#[derive(Clone, Copy, Default)]
struct Lag {
    /// Sum of products of residuals.
    product: f64,
    /// Sum of products of intensities.
    power: f64,
    /// Variance of `product` if pixels were independent.
    variance: f64,
}

/// The grain area whose Gaussian autocorrelation `exp(-pi d^2 / g)` agrees best with the products
/// of neighbouring relative residuals; 1 where grains are fainter than the noise. Pixels whose model
/// is above `brightest`, grey levels, are cut by the picture's range and say nothing. `noise` is the
/// new one, `present` that of the fits.
pub(super) fn grain_area<'a>(
    image: &GrayImage,
    fits: impl Iterator<Item = &'a Fit>,
    [noise, present]: [&NoiseModel; 2],
    brightest: f64,
) -> f64 {
    let mut lags = [Lag::default(); LAGS.len()];
    for fit in fits {
        let is_grainy = noise.speckle_contrast * fit.gaussian.amplitude > noise.read_noise;
        if is_grainy && let Some(core) = Core::of(image, fit, [noise, present], brightest) {
            core.add_lags(&mut lags);
        }
    }
    // Neighbours that are not surely alike: no grains, whatever made the contrast.
    let near = &lags[..2];
    let product: f64 = near.iter().map(|lag| lag.product).sum();
    let variance: f64 = near.iter().map(|lag| lag.variance).sum();
    if product <= SURE * variance.sqrt() {
        return 1.0;
    }
    let mut best = (1.0, f64::INFINITY);
    for trial in 0..TRIALS {
        let area = TRIAL_RATIO.powi(trial);
        let cost = misfit(&lags, area, noise.speckle_contrast.powi(2));
        if cost < best.1 {
            best = (area, cost);
        }
    }
    best.0
}

/// Sum of squares between the products seen and those expected, nearer lags first.
fn misfit(lags: &[Lag], area: f64, contrast2: f64) -> f64 {
    let seen = lags.iter().zip(LAGS).filter(|(lag, _)| lag.power > 0.0);
    seen.map(|(lag, (dx, dy))| {
        let square = (dx * dx + dy * dy) as f64;
        let expected = (-std::f64::consts::PI * square / area).exp();
        (lag.product - lag.power * contrast2 * expected).powi(2) / (lag.variance * (1.0 + square))
    })
    .sum()
}

/// What is kept of every bright pixel: residual, intensity, variance under the new noise, then
/// `L^-1 j` (the product of two pixels' is the covariance of the model at them), then the same times
/// how much the variance has grown over that of the fit.
const PLANES: usize = 3 + 2 * PARAMETERS;

/// Bright pixels of a dot, plane by plane, rows one after another with room between them and behind
/// the last: a shift by a lag never meets the next row or plane. Zero where a pixel is not bright.
struct Core {
    stride: usize,
    /// Length of a plane, and of the room behind it.
    size: usize,
    room: usize,
    planes: Vec<f32>,
}

/// The largest lag along a row or column.
const MOST_LAG: usize = 6;
/// Lags whose sums are made side by side.
const TOGETHER: usize = 4;

/// Factor of a normal matrix: lower triangle, the diagonal inverted.
type Factor = [[f32; PARAMETERS]; PARAMETERS];

fn factor(fit: &Fit) -> Option<Factor> {
    let lower = fit.normal.cholesky()?.unpack();
    let entry = |i: usize, j: usize| if i == j { 1.0 / lower[(i, i)] } else { lower[(i, j)] };
    Some(std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j) as f32)))
}

impl Core {
    fn of(
        image: &GrayImage,
        fit: &Fit,
        [noise, present]: [&NoiseModel; 2],
        brightest: f64,
    ) -> Option<Self> {
        let least = (CORE * fit.gaussian.amplitude).max(CORE_IN_NOISE * noise.read_noise);
        let window = fit.window.core(&fit.gaussian, least)?;
        let limits = [least, brightest].map(|limit| limit as f32);
        let factor = factor(fit)?;
        let stride = (window.padded_width() + MOST_LAG).next_multiple_of(LANES);
        let size = stride * (window.y[1] - window.y[0]);
        let room = (MOST_LAG + 1) * stride;
        let mut core = Self { stride, size, room, planes: vec![0.0; (size + room) * PLANES] };
        let mut first = 0;
        let variances = [&Variance::new(noise), &Variance::new(present)];
        window.walk(image, &fit.gaussian, &fit.weighting(present), |row| {
            for at in (0..row.u.len()).step_by(LANES) {
                let values = bright(row, at, limits, &factor, variances);
                for (plane, value) in core.planes.chunks_exact_mut(size + room).zip(values) {
                    plane[first + at..first + at + LANES].copy_from_slice(&value.values());
                }
            }
            first += stride;
        });
        Some(core)
    }

    /// Adds the sums of products at all lags, several lags side by side.
    fn add_lags(&self, lags: &mut [Lag]) {
        let planes: Vec<&[f32]> = self.planes.chunks_exact(self.size + self.room).collect();
        let (model, grown) = planes[3..].split_at(PARAMETERS);
        for (lags, shifts) in lags.chunks_mut(TOGETHER).zip(LAGS.chunks(TOGETHER)) {
            let offsets: [usize; TOGETHER] = std::array::from_fn(|i| {
                let (dx, dy) = shifts[i.min(shifts.len() - 1)];
                dy * self.stride + dx
            });
            let sums = |a: &[f32], b: &[f32]| {
                let shifted = offsets.map(|offset| &b[offset..offset + self.size]);
                lanes::dots(&a[..self.size], shifted).map(f64::from)
            };
            let [product, power, variance] = [0, 1, 2].map(|i| sums(planes[i], planes[i]));
            let mut followed = [0.0; TOGETHER];
            for part in grown.iter().zip(model).map(|(a, b)| sums(a, b)) {
                followed.iter_mut().zip(part).for_each(|(all, sum)| *all += sum);
            }
            for (i, lag) in lags.iter_mut().enumerate() {
                lag.product += product[i] + followed[i];
                lag.power += power[i];
                lag.variance += variance[i];
            }
        }
    }
}

/// A noise's variance of a pixel, in single precision.
struct Variance {
    read: f32,
    photon: f32,
    speckle: f32,
}

impl Variance {
    fn new(noise: &NoiseModel) -> Self {
        Self {
            read: noise.read_noise.powi(2) as f32,
            photon: noise.photon_gain as f32,
            speckle: noise.speckle_contrast.powi(2) as f32,
        }
    }

    fn of(&self, f: Lanes) -> Lanes {
        let [read, photon, speckle] = [self.read, self.photon, self.speckle].map(Lanes::all);
        read + f * (photon + speckle * f)
    }
}

/// The planes' values of a few pixels; zero where they are not bright.
fn bright(
    row: &Row,
    at: usize,
    [least, most]: [f32; 2],
    factor: &Factor,
    [noise, present]: [&Variance; 2],
) -> [Lanes; PLANES] {
    let lanes = |values: &[f32]| Lanes::from_slice(&values[at..at + LANES]);
    let (u, f, e, w) = (lanes(row.u), lanes(row.f), lanes(row.e), lanes(row.w));
    let v = Lanes::all(row.v);
    let infinite = Lanes::all(f32::INFINITY);
    let mask = Lanes::all(1.0).where_between(Lanes::all(least), f, Lanes::all(most)).where_between(
        Lanes::ZERO,
        w,
        infinite,
    );
    let variance = noise.of(f);
    let growth = (variance / present.of(f)).min(Lanes::all(MOST_GROWTH));
    let fm = f * mask;
    let mut model = [fm, fm * u, fm * v, fm * u * u, fm * u * v, fm * v * v, mask];
    for k in 0..PARAMETERS {
        for j in 0..k {
            model[k] += model[j] * Lanes::all(-factor[k][j]);
        }
        model[k] = model[k] * Lanes::all(factor[k][k]);
    }
    let mut values = [Lanes::ZERO; PLANES];
    (values[0], values[1], values[2]) = (e * mask, fm, variance * mask);
    for (k, model) in model.into_iter().enumerate() {
        values[3 + k] = model;
        values[3 + PARAMETERS + k] = model * growth;
    }
    values
}
