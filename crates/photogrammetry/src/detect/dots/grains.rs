//! How large speckle grains are, from products of neighbouring residuals.

use super::NoiseModel;
use super::fit::{Fit, PARAMETERS, Weighting};
use super::noise::{Leverage, dot};
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
/// of neighbouring relative residuals; 1 where grains are fainter than the noise.
pub(super) fn grain_area<'a>(
    image: &GrayImage,
    fits: impl Iterator<Item = &'a Fit>,
    noise: &NoiseModel,
    present: &NoiseModel,
) -> f64 {
    let mut lags = [Lag::default(); LAGS.len()];
    for fit in fits {
        if noise.speckle_contrast * fit.gaussian.amplitude > noise.read_noise {
            add_lags(image, fit, noise, present, &mut lags);
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

/// A bright pixel: residual, intensity, leverage.
type CorePixel = (f64, f64, [f64; PARAMETERS]);

fn core_pixels(
    image: &GrayImage,
    fit: &Fit,
    least: f64,
    present: &NoiseModel,
) -> Option<Vec<Option<CorePixel>>> {
    let gaussian = &fit.gaussian;
    let weighting = Weighting::new(fit, present, true);
    let leverage = Leverage::new(fit)?;
    let mut core = Vec::with_capacity(fit.window.width() * fit.window.height());
    fit.window.walk(image, gaussian, |u, v, pixels, model| {
        for (i, (&pixel, &f)) in pixels.iter().zip(model).enumerate() {
            let pixel = f64::from(pixel);
            let e = pixel - gaussian.background - f;
            let is_core = f > least && weighting.of(pixel, f, e) > 0.0;
            core.push(is_core.then(|| (e, f, leverage.of(f, u + i as f64, v))));
        }
    });
    Some(core)
}

fn add_lags(
    image: &GrayImage,
    fit: &Fit,
    noise: &NoiseModel,
    present: &NoiseModel,
    lags: &mut [Lag],
) {
    let least = (CORE * fit.gaussian.amplitude).max(CORE_IN_NOISE * noise.read_noise);
    let Some(core) = core_pixels(image, fit, least, present) else { return };
    let width = fit.window.width();
    for (at, one) in core.iter().enumerate() {
        let Some((e, f, model)) = one else { continue };
        for (lag, (dx, dy)) in lags.iter_mut().zip(LAGS) {
            let is_inside = at % width + dx < width;
            if let Some(Some((e2, f2, model2))) = core.get(at + dy * width + dx)
                && is_inside
            {
                let growth = noise.pixel_variance(*f) / present.pixel_variance(*f);
                lag.product += e * e2 + growth.min(4.0) * dot(model, model2);
                lag.power += f * f2;
                lag.variance += noise.pixel_variance(*f) * noise.pixel_variance(*f2);
            }
        }
    }
}
