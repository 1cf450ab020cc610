//! Local background and noise from a sparse sample of the picture.
//!
//! Medians over tiles: dots and printed targets fill less than half of most tiles. No background
//! picture is made; the level of a place is interpolated between tiles when asked for.

use crate::image::GrayImage;

/// Side of a tile, pixels.
const TILE: usize = 64;
/// Every so many rows are sampled.
const ROW_STEP: usize = 8;
/// Every so many pixels of a sampled row.
const COLUMN_STEP: usize = 4;

/// Where only the typical noise is wanted, every so many rows of tiles are sampled.
const FEWER: usize = 4;

/// Background level and noise on a grid of tiles.
pub(super) struct Background {
    columns: usize,
    rows: usize,
    level: Vec<f64>,
    noise: Vec<f64>,
    /// Median of the noise over all tiles, grey levels.
    pub(super) typical_noise: f64,
}

/// Grey values and steps between neighbours in one tile.
#[derive(Clone)]
struct Sample {
    level: [u16; 256],
    step: [u16; 256],
}

impl Background {
    /// Samples a picture.
    pub(super) fn measure(image: &GrayImage) -> Self {
        let columns = image.width.div_ceil(TILE).max(1);
        let rows = image.height.div_ceil(TILE).max(1);
        let mut level = Vec::with_capacity(columns * rows);
        let mut noise = Vec::with_capacity(columns * rows);
        let empty = Sample { level: [0; 256], step: [0; 256] };
        let mut samples = vec![empty.clone(); columns];
        for tile_row in 0..rows {
            samples.fill(empty.clone());
            sample_rows(image, tile_row * TILE, &mut samples);
            for sample in &samples {
                level.push(quantile(&sample.level, 0.5));
                noise.push(noise_of_steps(&sample.step));
            }
        }
        let typical_noise = median(noise.clone());
        Self { columns, rows, level, noise, typical_noise }
    }

    /// What [`typical_noise`] measures.
    pub(super) fn noise_of_fewer_rows(&self) -> f64 {
        let rows = self.noise.chunks(self.columns).step_by(FEWER);
        no_less_than_rounding(rows.flatten().copied().collect())
    }

    /// Background level and noise at a place, bilinear between the centres of tiles.
    pub(super) fn at(&self, x: f64, y: f64) -> (f64, f64) {
        let (column, across) = split(x, self.columns);
        let (row, down) = split(y, self.rows);
        let right = (column + 1).min(self.columns - 1);
        let below = (row + 1).min(self.rows - 1);
        let mix = |values: &[f64]| {
            let upper = lerp(
                values[row * self.columns + column],
                values[row * self.columns + right],
                across,
            );
            let lower = lerp(
                values[below * self.columns + column],
                values[below * self.columns + right],
                across,
            );
            lerp(upper, lower, down)
        };
        (mix(&self.level), mix(&self.noise).max(self.typical_noise))
    }
}

/// Standard deviation of the background's noise alone, from every fourth row of tiles, grey levels; at
/// least that of rounding.
pub(super) fn typical_noise(image: &GrayImage) -> f64 {
    let columns = image.width.div_ceil(TILE).max(1);
    let mut all = Vec::new();
    let mut samples = vec![Sample { level: [0; 256], step: [0; 256] }; columns];
    for first in (0..image.height).step_by(FEWER * TILE) {
        samples.fill(Sample { level: [0; 256], step: [0; 256] });
        sample_rows(image, first, &mut samples);
        all.extend(samples.iter().map(|sample| noise_of_steps(&sample.step)));
    }
    no_less_than_rounding(all)
}

fn no_less_than_rounding(noise: Vec<f64>) -> f64 {
    median(noise).max(12f64.sqrt().recip())
}

/// The upper one of two, zero of nothing.
fn median(mut all: Vec<f64>) -> f64 {
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).copied().unwrap_or(0.0)
}

fn lerp(a: f64, b: f64, part: f64) -> f64 {
    a + (b - a) * part
}

/// Index of the tile whose centre is at or before a coordinate, and the part of the way on.
fn split(at: f64, count: usize) -> (usize, f64) {
    let tiles = (at / TILE as f64 - 0.5).clamp(0.0, (count - 1) as f64);
    (tiles as usize, tiles.fract())
}

fn sample_rows(image: &GrayImage, first: usize, samples: &mut [Sample]) {
    let last = (first + TILE).min(image.height);
    let middle = (ROW_STEP / 2).min(last.saturating_sub(first + 1));
    for y in (first + middle..last).step_by(ROW_STEP) {
        for (sample, pixels) in samples.iter_mut().zip(image.row(y).chunks(TILE)) {
            for group in pixels.chunks(COLUMN_STEP) {
                sample.level[usize::from(group[0])] += 1;
                if let Some(&next) = group.get(1) {
                    sample.step[usize::from(group[0].abs_diff(next))] += 1;
                }
            }
        }
    }
}

/// A quantile of a histogram of whole numbers, linear within its bin.
fn quantile(histogram: &[u16; 256], part: f64) -> f64 {
    let total: u32 = histogram.iter().map(|&n| u32::from(n)).sum();
    let wanted = f64::from(total) * part;
    let mut below = 0.0;
    for (value, &count) in histogram.iter().enumerate() {
        let count = f64::from(count);
        if count > 0.0 && below + count >= wanted {
            return value as f64 - 0.5 + (wanted - below) / count;
        }
        below += count;
    }
    0.0
}

/// Standard deviation of a pixel from the median absolute step between neighbours: half of a
/// normal distribution's steps are below 0.6745 sqrt(2) sigma. Zero steps fill half a bin.
fn noise_of_steps(steps: &[u16; 256]) -> f64 {
    let total: u32 = steps.iter().map(|&n| u32::from(n)).sum();
    if total == 0 {
        return 0.0;
    }
    let zero = f64::from(steps[0]) / f64::from(total);
    let median = if zero >= 0.5 { 0.25 / zero } else { quantile(steps, 0.5) };
    median.max(0.0) / (0.6745 * std::f64::consts::SQRT_2)
}
