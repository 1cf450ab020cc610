//! Is the background's noise independent from pixel to pixel?
//!
//! A centre feels the noise of areas as large as the dot. Differences of neighbouring boxes of that
//! size, beside the dots, show it; a quantile of them does not mind a neighbour in some.

use super::NoiseModel;
use super::fit::Fit;
use crate::image::GrayImage;

/// Fewer boxes say nothing.
const LEAST: usize = 500;
/// Distance of the boxes from any dot, in its standard deviations.
const DISTANCE: f64 = 4.0;
/// Places of boxes around a dot, on two rings.
const PLACES: usize = 32;
/// Part of the departures below which the quantile is taken, and what it is for a normal
/// distribution: more efficient than the median, and a fifth of the boxes may see something else.
const QUANTILE: (f64, f64) = (0.75, 1.1503);

/// Variance of box sums over that of independent pixels, from 0.25 to 4; 1 where unknown.
pub(super) fn background_correlation(image: &GrayImage, fits: &[Fit], noise: &NoiseModel) -> f64 {
    let mut departures = Vec::with_capacity(2 * PLACES * fits.len());
    for fit in fits {
        let [large, small] = fit.gaussian.sigma();
        let side = (1.8 * small).round().max(2.0);
        for i in 0..PLACES {
            let (sin, cos) = (std::f64::consts::TAU * i as f64 / PLACES as f64).sin_cos();
            let distance = DISTANCE * large + side * (1.6 + 2.4 * (i % 2) as f64);
            let (x, y) = (fit.gaussian.x + distance * cos, fit.gaussian.y + distance * sin);
            let clear = (DISTANCE * large + 1.5 * side).powi(2);
            if fits.iter().any(|other| {
                (other.gaussian.x - x).powi(2) + (other.gaussian.y - y).powi(2) < clear
            }) {
                continue;
            }
            let boxes = [(x - side, y - side), (x, y - side), (x - side, y)]
                .map(|at| box_sum(image, at, side as usize));
            if let [Some(here), Some(right), Some(below)] = boxes {
                let expected = std::f64::consts::SQRT_2 * side * noise.read_noise;
                departures.push((right - here).abs() / expected);
                departures.push((below - here).abs() / expected);
            }
        }
    }
    if departures.len() < LEAST {
        return 1.0;
    }
    departures.sort_by(f64::total_cmp);
    let index = (QUANTILE.0 * departures.len() as f64) as usize;
    (departures[index] / QUANTILE.1).powi(2).clamp(0.25, 4.0)
}

/// Sum over a square whose first pixel is at a place; `None` where the border cuts it.
fn box_sum(image: &GrayImage, at: (f64, f64), side: usize) -> Option<f64> {
    if at.0 < 0.0 || at.1 < 0.0 {
        return None;
    }
    let (x, y) = (at.0 as usize, at.1 as usize);
    if x + side > image.width || y + side > image.height {
        return None;
    }
    let row_sum = |y: usize| image.row(y)[x..x + side].iter().map(|&p| u64::from(p)).sum::<u64>();
    Some((y..y + side).map(row_sum).sum::<u64>() as f64)
}
