//! Covariance of a dot's centre under noise whose speckle part is common to neighbours.
//!
//! The weights take a grain's pixels as one, which is right only for grains much smaller than the
//! dot; the covariance does not rest on that. With `k_i` the shift of the centre per grey level of
//! pixel i and f the model, it is `sum k_i k_i' (n^2 + p f_i) + C^2 sum k_i f_i rho_ij f_j k_j'`.

use nalgebra::Matrix2;

use super::NoiseModel;
use super::fit::Fit;
use super::moments::Polynomial;
use super::window::Row;
use crate::detect::lanes::{self, LANES};
use crate::image::GrayImage;

/// Contrast times amplitude below which, in units of the read noise, grains are left out.
const NO_SPECKLE: f64 = 0.05;

/// Covariance of the centre, square pixels; `None` where the normal equations are singular.
pub(super) fn of_centre(image: &GrayImage, fit: &Fit, noise: &NoiseModel) -> Option<Matrix2<f64>> {
    let gaussian = &fit.gaussian;
    let inverse = fit.normal.try_inverse()?;
    let q =
        Matrix2::new(gaussian.q[0], gaussian.q[1], gaussian.q[1], gaussian.q[2]).try_inverse()?;
    let has_speckle = noise.speckle_contrast * gaussian.amplitude > NO_SPECKLE * noise.read_noise;
    if !has_speckle || noise.grain_area <= 1.0 {
        return Some(q * inverse.fixed_view::<2, 2>(1, 1) * q * noise.background_correlation);
    }
    let to_centre = q * inverse.fixed_rows::<2>(1);
    let polynomials = [0, 1].map(|axis| Polynomial::new(|a| to_centre[(axis, a)]));
    let constants = [to_centre[(0, 6)] as f32, to_centre[(1, 6)] as f32];
    let reach = (1.5 * noise.grain_area.sqrt()).ceil() as usize;
    let mut field = Field::new(fit, reach);
    let mut white = [0.0; 3];
    fit.window.walk(image, gaussian, &fit.weighting(noise), |row| {
        let coefficients = polynomials.map(|p| p.row(row.v));
        let sums = field.add(row, coefficients, constants, noise);
        white.iter_mut().zip(sums).for_each(|(all, sum)| *all += f64::from(sum));
    });
    let white = Matrix2::new(white[0], white[1], white[1], white[2]);
    Some(white + field.grain_sum(noise.grain_area) * noise.speckle_contrast.powi(2))
}

/// The shift of the centre by each pixel's relative error, for both axes, rows one after another
/// with room between them: a shift by up to `reach` pixels never meets the next row.
struct Field {
    reach: usize,
    stride: usize,
    values: [Vec<f32>; 2],
}

impl Field {
    fn new(fit: &Fit, reach: usize) -> Self {
        let stride = (fit.window.padded_width() + reach).next_multiple_of(LANES);
        let room = stride * (fit.window.y[1] - fit.window.y[0]);
        Self { reach, stride, values: [Vec::with_capacity(room), Vec::with_capacity(room)] }
    }

    /// Adds a row; returns its sums of xx, xy, yy of the noise that is independent.
    fn add(
        &mut self,
        row: &Row,
        coefficients: [[f32; 3]; 2],
        constants: [f32; 2],
        noise: &NoiseModel,
    ) -> [f32; 3] {
        let background = (noise.read_noise.powi(2) * noise.background_correlation) as f32;
        let photon_gain = noise.photon_gain as f32;
        let mut sums = [0.0; 3];
        let first = self.values[0].len();
        self.values.iter_mut().for_each(|values| values.resize(first + self.stride, 0.0));
        let [xs, ys] = &mut self.values;
        let places = xs[first..].iter_mut().zip(&mut ys[first..]);
        let pixels = row.u.iter().zip(row.f).zip(row.w);
        for ((x, y), ((&u, &f), &w)) in places.zip(pixels) {
            let shift = |axis: usize| {
                let [a, b, c] = coefficients[axis];
                w * (f * ((c * u + b) * u + a) + constants[axis])
            };
            let (kx, ky) = (shift(0), shift(1));
            let variance = background + photon_gain * f;
            sums[0] += kx * kx * variance;
            sums[1] += kx * ky * variance;
            sums[2] += ky * ky * variance;
            *x = kx * f;
            *y = ky * f;
        }
        sums
    }

    /// `sum h_i rho_ij h_j'` with the Gaussian autocorrelation `exp(-pi d^2 / g)`, whose sum over
    /// all lags is g; separable, so rows are smoothed first and columns then.
    fn grain_sum(&self, grain_area: f64) -> Matrix2<f64> {
        let weight = |lag: usize| (-std::f64::consts::PI * (lag * lag) as f64 / grain_area).exp();
        let weights: Vec<f32> = (0..=self.reach).map(|lag| weight(lag) as f32).collect();
        let smooth = [0, 1].map(|axis| {
            let rows = smoothed(&self.values[axis], 1, &weights);
            smoothed(&rows, self.stride, &weights)
        });
        let sum = |a: usize, b: usize| f64::from(lanes::dot(&self.values[a], &smooth[b]));
        let mixed = 0.5 * (sum(0, 1) + sum(1, 0));
        Matrix2::new(sum(0, 0), mixed, mixed, sum(1, 1))
    }
}

/// Values and their neighbours at multiples of a stride, weighted by distance.
fn smoothed(values: &[f32], stride: usize, weights: &[f32]) -> Vec<f32> {
    let mut smooth = vec![0.0; values.len()];
    for (lag, &weight) in
        weights.iter().enumerate().take_while(|(lag, _)| lag * stride < values.len())
    {
        add_scaled(&mut smooth[lag * stride..], values, weight);
        if lag > 0 {
            add_scaled(&mut smooth, &values[lag * stride..], weight);
        }
    }
    smooth
}

/// `to[i] += weight * from[i]`, which the compiler does several at a time.
fn add_scaled(to: &mut [f32], from: &[f32], weight: f32) {
    for (slot, value) in to.iter_mut().zip(from) {
        *slot += weight * value;
    }
}
