//! The streaming pass: runs of pixels above the local background, row by row.
//!
//! Blocks of a band of rows are compared as a whole, which the compiler does 16 pixels at a time;
//! only where one exceeds its threshold are pixels looked at.

use std::ops::Range;

use super::DotOptions;
use super::components::{Candidate, Collector, Run};
use crate::detect::BAND_ROWS;
use crate::detect::background::Background;
use crate::image::GrayImage;

/// Pixels of a row that share a threshold and are compared at once.
const BLOCK: usize = 32;

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

/// A pass over a picture, band by band.
pub(in crate::detect) struct DotScan<'a> {
    image: &'a GrayImage,
    options: &'a DotOptions,
    background: Background,
    collector: Collector,
    /// Room for the brightest pixel of each column, and for the blocks that are looked at.
    brightest: Vec<u8>,
    blocks: Vec<(usize, Level)>,
}

impl<'a> DotScan<'a> {
    /// Samples the background.
    pub(in crate::detect) fn new(image: &'a GrayImage, options: &'a DotOptions) -> Self {
        Self {
            image,
            options,
            background: Background::measure(image),
            collector: Collector::new(12.0 * options.max_sigma),
            brightest: Vec::new(),
            blocks: Vec::new(),
        }
    }

    /// What was sampled.
    pub(in crate::detect) fn background(&self) -> &Background {
        &self.background
    }

    /// Looks at a band; bands from top to bottom.
    pub(in crate::detect) fn look(&mut self, band: Range<usize>) {
        find_brightest(self.image, band.clone(), &mut self.brightest);
        let levels = block_levels(self.image, &self.background, band.start, self.options);
        let has_any = |block: &[u8], level: &Level| {
            block.iter().fold(0, |most, &pixel| most.max(pixel)) > level.threshold
        };
        let pairs = self.brightest.chunks(BLOCK).zip(&levels).enumerate();
        self.blocks.clear();
        self.blocks
            .extend(pairs.filter(|(_, (b, level))| has_any(b, level)).map(|(i, (_, l))| (i, *l)));
        for y in band {
            self.collector.begin_row(y);
            scan_row(self.image.row(y), &self.blocks, &mut self.collector);
        }
    }

    /// What all bands showed.
    pub(super) fn finish(self) -> Scanned {
        let noise = self.background.typical_noise.max(12f64.sqrt().recip());
        Scanned { candidates: self.collector.finish(), noise }
    }
}

/// The brightest pixel of each column of a band.
fn find_brightest(image: &GrayImage, rows: Range<usize>, brightest: &mut Vec<u8>) {
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
    let middle = (y + BAND_ROWS / 2) as f64;
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
