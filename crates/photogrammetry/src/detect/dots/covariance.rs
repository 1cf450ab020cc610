//! Covariance of a dot's centre under noise whose speckle part is common to neighbours.
//!
//! The weights take a grain's pixels as one, which is right only for grains much smaller than the
//! dot; the covariance does not rest on that. With `k_i` the shift of the centre per grey level of
//! pixel i and f the model, it is `sum k_i k_i' (n^2 + p f_i) + C^2 sum k_i f_i rho_ij f_j k_j'`.

use nalgebra::{Matrix2, Vector2};

use super::NoiseModel;
use super::fit::{Fit, Weighting};
use crate::image::GrayImage;

/// Contrast times amplitude below which, in units of the read noise, grains are left out.
const NO_SPECKLE: f64 = 0.05;

/// Covariance of the centre, square pixels; `None` where the normal equations are singular.
pub(super) fn of_centre(image: &GrayImage, fit: &Fit, noise: &NoiseModel) -> Option<Matrix2<f64>> {
    let gaussian = &fit.gaussian;
    let weighting = Weighting::new(fit, noise, true);
    let inverse = fit.normal.try_inverse()?;
    let q =
        Matrix2::new(gaussian.q[0], gaussian.q[1], gaussian.q[1], gaussian.q[2]).try_inverse()?;
    let to_centre = q * inverse.fixed_rows::<2>(1);
    let has_speckle = noise.speckle_contrast * gaussian.amplitude > NO_SPECKLE * noise.read_noise;
    if !has_speckle || noise.grain_area <= 1.0 {
        return Some(q * inverse.fixed_view::<2, 2>(1, 1) * q * noise.background_correlation);
    }
    let mut white = Matrix2::zeros();
    let size = fit.window.width() * fit.window.height();
    let mut influence = [Vec::with_capacity(size), Vec::with_capacity(size)];
    fit.window.walk(image, gaussian, |u, v, pixels, model| {
        for (i, (&pixel, &f)) in pixels.iter().zip(model).enumerate() {
            let u = u + i as f64;
            let pixel = f64::from(pixel);
            let w = weighting.of(pixel, f, pixel - gaussian.background - f);
            let row = nalgebra::SVector::<f64, 7>::from([
                f,
                f * u,
                f * v,
                f * u * u,
                f * u * v,
                f * v * v,
                1.0,
            ]);
            let k: Vector2<f64> = to_centre * row * w;
            let background = noise.read_noise.powi(2) * noise.background_correlation;
            white += k * k.transpose() * (background + noise.photon_gain * f);
            influence[0].push(k.x * f);
            influence[1].push(k.y * f);
        }
    });
    let speckle = grain_sum(&influence, fit.window.width(), noise.grain_area);
    Some(white + speckle * noise.speckle_contrast.powi(2))
}

/// `sum h_i rho_ij h_j'` with the Gaussian autocorrelation `exp(-pi d^2 / g)`, whose sum over all
/// lags is g; separable, so rows are smoothed first and columns then.
fn grain_sum(influence: &[Vec<f64>; 2], width: usize, grain_area: f64) -> Matrix2<f64> {
    let reach = (1.5 * grain_area.sqrt()).ceil() as usize;
    let weight = |lag: usize| (-std::f64::consts::PI * (lag * lag) as f64 / grain_area).exp();
    let weights: Vec<f64> = (0..=reach).map(weight).collect();
    let smooth = [0, 1].map(|axis| {
        let rows = smooth_rows(&influence[axis], width, &weights);
        smooth_columns(&rows, width, &weights)
    });
    let sum =
        |a: usize, b: usize| influence[a].iter().zip(&smooth[b]).map(|(x, y)| x * y).sum::<f64>();
    let mixed = 0.5 * (sum(0, 1) + sum(1, 0));
    Matrix2::new(sum(0, 0), mixed, mixed, sum(1, 1))
}

/// `to[i] += weight * from[i]`, which the compiler does several at a time.
fn add_scaled(to: &mut [f64], from: &[f64], weight: f64) {
    for (slot, value) in to.iter_mut().zip(from) {
        *slot += weight * value;
    }
}

fn smooth_rows(values: &[f64], width: usize, weights: &[f64]) -> Vec<f64> {
    let mut smooth = vec![0.0; values.len()];
    for (to, from) in smooth.chunks_mut(width).zip(values.chunks(width)) {
        for (lag, &weight) in weights.iter().enumerate().take(width) {
            add_scaled(&mut to[lag..], from, weight);
            if lag > 0 {
                add_scaled(to, &from[lag..], weight);
            }
        }
    }
    smooth
}

fn smooth_columns(values: &[f64], width: usize, weights: &[f64]) -> Vec<f64> {
    let mut smooth = vec![0.0; values.len()];
    for (lag, &weight) in weights.iter().enumerate().take(values.len() / width.max(1)) {
        add_scaled(&mut smooth[lag * width..], values, weight);
        if lag > 0 {
            add_scaled(&mut smooth, &values[lag * width..], weight);
        }
    }
    smooth
}
