//! Is the background's noise independent from pixel to pixel?
//!
//! A centre feels the noise of areas as large as the dot. Differences of neighbouring boxes of that
//! size, beside the dots, show it; a quantile of them does not mind a neighbour in some.

use nalgebra::{Matrix2, Vector2};

use super::NoiseModel;
use super::fit::Fit;
use crate::image::GrayImage;

/// Fewer boxes say nothing.
const LEAST: usize = 500;
/// Distance of the boxes from any dot, in its standard deviations.
const DISTANCE: f64 = 4.0;
/// Distance of the first ring of boxes beyond that, and of the second from the first, in boxes.
const FIRST_RING: f64 = 1.6;
const RING_STEP: f64 = 2.4;
/// Places of boxes around a dot, on two rings.
const PLACES: usize = 32;
/// Part of the departures below which the quantile is taken, and what it is for a normal
/// distribution: more efficient than the median, and a fifth of the boxes may see something else.
const QUANTILE: (f64, f64) = (0.75, 1.1503);

/// Variance of box sums over that of independent pixels, from 0.25 to 4; 1 where unknown.
pub(super) fn background_correlation(image: &GrayImage, fits: &[Fit], noise: &NoiseModel) -> f64 {
    let mut departures = Vec::with_capacity(2 * PLACES * fits.len());
    for fit in fits {
        add_departures(image, fit, fits, noise, &mut departures);
    }
    if departures.len() < LEAST {
        return 1.0;
    }
    departures.sort_by(f64::total_cmp);
    let index = (QUANTILE.0 * departures.len() as f64) as usize;
    (departures[index] / QUANTILE.1).powi(2).clamp(0.25, 4.0)
}

/// Adds the departures of the boxes around a dot, in units of what independent pixels give.
fn add_departures(
    image: &GrayImage,
    fit: &Fit,
    fits: &[Fit],
    noise: &NoiseModel,
    departures: &mut Vec<f64>,
) {
    let place = |fit: &Fit| Vector2::new(fit.gaussian.x, fit.gaussian.y);
    let [large, small] = fit.gaussian.sigma();
    let side = (1.8 * small).round().max(2.0);
    let clear = DISTANCE * large + 1.5 * side;
    let farthest = DISTANCE * large + side * (FIRST_RING + RING_STEP);
    let near: Vec<Vector2<f64>> = fits
        .iter()
        .map(|other| place(other) - place(fit))
        .filter(|offset| offset.norm_squared() < (farthest + clear).powi(2))
        .collect();
    let expected = std::f64::consts::SQRT_2 * side * noise.read_noise;
    let (sin, cos) = (std::f64::consts::TAU / PLACES as f64).sin_cos();
    let turn = Matrix2::new(cos, -sin, sin, cos);
    let mut direction = Vector2::new(1.0, 0.0);
    for i in 0..PLACES {
        let distance = DISTANCE * large + side * (FIRST_RING + RING_STEP * (i % 2) as f64);
        let offset = direction * distance;
        direction = turn * direction;
        if near.iter().any(|other| (other - offset).norm_squared() < clear * clear) {
            continue;
        }
        let at = place(fit) + offset;
        let boxes = [(at.x - side, at.y - side), (at.x, at.y - side), (at.x - side, at.y)]
            .map(|at| box_sum(image, at, side as usize));
        if let [Some(here), Some(right), Some(below)] = boxes {
            departures.push((right - here).abs() / expected);
            departures.push((below - here).abs() / expected);
        }
    }
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
    let row_sum = |y: usize| image.row(y)[x..x + side].iter().map(|&p| u32::from(p)).sum::<u32>();
    Some((y..y + side).map(row_sum).sum::<u32>().into())
}
