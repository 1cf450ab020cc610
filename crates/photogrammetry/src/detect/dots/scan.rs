//! The streaming pass: runs of pixels above the local background, row by row.
//!
//! Blocks of a band of rows are compared as a whole, which the compiler does 16 pixels at a time;
//! only where one exceeds its threshold are pixels looked at.

use super::DotOptions;
use super::components::{Candidate, Collector, Run};
use crate::detect::background::Background;
use crate::image::GrayImage;

/// Pixels of a row that share a threshold and are compared at once.
const BLOCK: usize = 32;
/// Rows that share thresholds.
const BAND: usize = 16;

/// What the pass found.
pub(super) struct Scanned {
    /// Places that may be dots, the strongest first.
    pub(super) candidates: Vec<Candidate>,
    /// Standard deviation of the background, grey levels, at least that of rounding.
    pub(super) noise: f64,
}

/// Level and threshold of one block.
#[derive(Clone, Copy)]
struct Level {
    background: f64,
    /// A pixel above this is of interest.
    threshold: u8,
}

/// Passes over a picture.
pub(super) fn scan(image: &GrayImage, options: &DotOptions) -> Scanned {
    let background = Background::measure(image);
    let mut collector = Collector::new(12.0 * options.max_sigma);
    let (mut brightest, mut blocks) = (Vec::new(), Vec::new());
    for first in (0..image.height).step_by(BAND) {
        let last = (first + BAND).min(image.height);
        find_brightest(image, first..last, &mut brightest);
        let levels = block_levels(image, &background, first, options);
        blocks.clear();
        let has_any = |block: &[u8], level: &Level| {
            block.iter().fold(0, |most, &pixel| most.max(pixel)) > level.threshold
        };
        let pairs = brightest.chunks(BLOCK).zip(&levels).enumerate();
        blocks.extend(pairs.filter(|(_, (b, level))| has_any(b, level)).map(|(i, (_, l))| (i, *l)));
        for y in first..last {
            collector.begin_row(y);
            scan_row(image.row(y), &blocks, &mut collector);
        }
    }
    let noise = background.typical_noise.max(12f64.sqrt().recip());
    Scanned { candidates: collector.finish(), noise }
}

/// The brightest pixel of each column of a band.
fn find_brightest(image: &GrayImage, rows: std::ops::Range<usize>, brightest: &mut Vec<u8>) {
    brightest.clear();
    brightest.resize(image.width, 0);
    for y in rows {
        for (most, &pixel) in brightest.iter_mut().zip(image.row(y)) {
            *most = (*most).max(pixel);
        }
    }
}

fn block_levels(
    image: &GrayImage,
    background: &Background,
    y: usize,
    options: &DotOptions,
) -> Vec<Level> {
    let middle = (y + BAND / 2) as f64;
    (0..image.width.div_ceil(BLOCK))
        .map(|block| {
            let (level, noise) = background.at((block * BLOCK + BLOCK / 2) as f64, middle);
            let step = (options.threshold_in_noise * noise).max(options.min_contrast);
            // Above 250 no dot could show, but a saturated one still must.
            let threshold = (level + step).clamp(0.0, 250.0) as u8;
            Level { background: level, threshold }
        })
        .collect()
}

/// Finds the runs of a row and hands them on; only these blocks have any.
fn scan_row(row: &[u8], blocks: &[(usize, Level)], collector: &mut Collector) {
    let mut open: Option<Run> = None;
    for (index, level) in blocks {
        let first = index * BLOCK;
        let pixels = &row[first..(first + BLOCK).min(row.len())];
        if pixels.iter().fold(0, |most, &pixel| most.max(pixel)) <= level.threshold {
            continue;
        }
        for (i, &pixel) in pixels.iter().enumerate() {
            if pixel > level.threshold {
                let x = first + i;
                match &mut open {
                    Some(run) if run.takes(x) => run.add(x, pixel),
                    _ => {
                        let step = f64::from(level.threshold) - level.background;
                        let run = Run::new(x, pixel, level.background, step);
                        if let Some(done) = open.replace(run) {
                            collector.add(done);
                        }
                    }
                }
            }
        }
    }
    if let Some(run) = open {
        collector.add(run);
    }
}
