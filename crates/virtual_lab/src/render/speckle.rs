//! Speckle: a field of mean one, gamma-distributed, with grains of a given size.
//!
//! The intensity of speckle summed over M independent patterns follows a gamma distribution of
//! shape M = 1 / C^2 (Goodman, Speckle Phenomena in Optics, section 4). A normal field, smoothed to
//! the grain and scaled back to unit variance, is mapped to it by the Wilson-Hilferty
//! transformation, whose mean and standard deviation are right to 0.2 % up to contrast 1.

use rand_chacha::ChaCha8Rng;

use crate::config::SpeckleConfig;
use crate::streams::normal;

/// `width * height` factors, row by row.
pub(super) fn field(
    config: &SpeckleConfig,
    width: usize,
    height: usize,
    rng: &mut ChaCha8Rng,
) -> Vec<f32> {
    let c2 = config.contrast * config.contrast;
    let (offset, slope) = (1.0 - c2 / 9.0, config.contrast / 3.0);
    // E (a + b z)^3 = a^3 + 3 a b^2: divided out, so that the mean is one for any contrast.
    let mean = offset.powi(3) + 3.0 * offset * slope * slope;
    let gamma = |z: f64| ((offset + slope * z).max(0.0).powi(3) / mean) as f32;
    normal_field(config.grain_px, width, height, rng).into_iter().map(gamma).collect()
}

/// Unit normal numbers whose correlation area is `grain_px` squared. A Gaussian kernel of standard
/// deviation s correlates them as exp(-r^2 / 4 s^2), an area of 4 pi s^2.
fn normal_field(grain_px: f64, width: usize, height: usize, rng: &mut ChaCha8Rng) -> Vec<f64> {
    if grain_px <= 1.0 {
        return (0..width * height).map(|_| normal(rng)).collect();
    }
    let sigma = grain_px / (2.0 * std::f64::consts::PI.sqrt());
    let kernel = unit_kernel(sigma);
    let (wide, high) = (width + kernel.len() - 1, height + kernel.len() - 1);
    let white: Vec<f64> = (0..wide * high).map(|_| normal(rng)).collect();
    let sum = |at: &dyn Fn(usize) -> f64| kernel.iter().enumerate().map(|(k, w)| w * at(k)).sum();
    let rows: Vec<f64> =
        (0..high * width).map(|i| sum(&|k| white[i / width * wide + i % width + k])).collect();
    (0..height * width).map(|i| sum(&|k| rows[i + k * width])).collect()
}

/// Weights whose squares sum to one.
fn unit_kernel(sigma: f64) -> Vec<f64> {
    let reach = (4.0 * sigma).ceil() as i32;
    let weights: Vec<f64> =
        (-reach..=reach).map(|k| (-f64::from(k * k) / (2.0 * sigma * sigma)).exp()).collect();
    let norm = weights.iter().map(|w| w * w).sum::<f64>().sqrt();
    weights.into_iter().map(|w| w / norm).collect()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    const SIDE: usize = 400;

    fn sample(contrast: f64, grain_px: f64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let config = SpeckleConfig { contrast, grain_px };
        field(&config, SIDE, SIDE, &mut rng).into_iter().map(f64::from).collect()
    }

    fn covariance(field: &[f64], lag: usize) -> f64 {
        let pairs = field.len() - lag;
        field[lag..].iter().zip(field).map(|(a, b)| (a - 1.0) * (b - 1.0)).sum::<f64>()
            / pairs as f64
    }

    #[test]
    fn speckle_has_mean_one_the_given_contrast_and_is_never_negative() {
        for (contrast, grain) in [(0.35, 1.0), (0.35, 3.0), (1.0, 1.0)] {
            let field = sample(contrast, grain);
            let independent = field.len() as f64 / (grain * grain);
            let mean = field.iter().sum::<f64>() / field.len() as f64;
            assert!((mean - 1.0).abs() < 5.0 * contrast / independent.sqrt() + 2e-3, "{mean}");
            let found = covariance(&field, 0).sqrt();
            assert!((found / contrast - 1.0).abs() < 0.02, "contrast {found}, not {contrast}");
            assert!(field.iter().all(|&f| f >= 0.0));
        }
    }

    #[test]
    fn grains_have_the_given_correlation_area() {
        let field = sample(0.35, 3.0);
        let unit = covariance(&field, 0);
        let along: f64 = (1..=8).map(|lag| covariance(&field, lag) / unit).sum();
        // Along one axis the correlation's integral is the grain's side.
        assert!((1.0 + 2.0 * along - 3.0).abs() < 0.2, "{}", 1.0 + 2.0 * along);
        let white = sample(0.35, 1.0);
        assert!((covariance(&white, 1) / covariance(&white, 0)).abs() < 5.0 / SIDE as f64);
    }
}
