//! Chords of what may be discs, on every few rows.
//!
//! A row that crosses a disc shows two opposite edges with nothing between them and a quiet zone at
//! least half as wide as the chord on either side. Rows are compared with themselves three pixels
//! on, block by block, 16 pixels at a time; only blocks that have an edge anywhere in a band of rows
//! are looked at closely.

use std::ops::Range;

use wide::u8x16;

use super::TargetOptions;
use crate::image::GrayImage;

/// Pixels of a row that are compared at once.
const BLOCK: usize = 16;
/// Distance of the pixels whose difference shows an edge: blurred edges are that wide.
const REACH: usize = 3;
/// Part of a chord's width that must be quiet on both sides; half of it is printed quiet.
pub(super) const QUIET: f64 = 0.3;

/// A step of grey values along a row.
#[derive(Debug, Clone, Copy)]
struct Edge {
    x: f64,
    rises: bool,
}

/// A chord of what may be a disc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Chord {
    /// Its middle, pixels.
    pub(super) x: f64,
    /// Its row.
    pub(super) y: f64,
    /// Its width, pixels.
    pub(super) width: f64,
}

/// A pass over a picture for chords, band by band.
pub(super) struct ChordScan<'a> {
    image: &'a GrayImage,
    options: &'a TargetOptions,
    /// Every so many rows are looked at.
    row_step: usize,
    /// Smallest step of an edge, grey levels.
    least: u8,
    edges: Vec<Edge>,
    blocks: Vec<usize>,
    /// Room for the largest step of each column.
    steepest: Vec<u8>,
}

impl<'a> ChordScan<'a> {
    /// `noise` is that of the background, grey levels.
    pub(super) fn new(image: &'a GrayImage, noise: f64, options: &'a TargetOptions) -> Self {
        Self {
            image,
            options,
            row_step: (options.min_semi_axis.round() as usize).max(1),
            least: (5.5 * noise).max(0.4 * options.min_contrast).clamp(4.0, 250.0) as u8,
            edges: Vec::new(),
            blocks: Vec::new(),
            steepest: Vec::new(),
        }
    }

    /// Calls `each` for every chord of a band, rows from top to bottom.
    pub(super) fn look(&mut self, band: Range<usize>, mut each: impl FnMut(Chord)) {
        let offset = self.row_step / 2;
        let first = (band.start.saturating_sub(offset)).next_multiple_of(self.row_step) + offset;
        let rows = (first..band.end).step_by(self.row_step);
        find_blocks(self.image, rows.clone(), self.least, &mut self.steepest, &mut self.blocks);
        for y in rows {
            find_edges(self.image.row(y), &self.blocks, self.least, &mut self.edges);
            chords_of_row(&self.edges, y, self.options, &mut each);
        }
    }
}

/// The blocks in which some row of a band has an edge, from left to right; `steepest` is room for
/// the largest step of each column.
fn find_blocks(
    image: &GrayImage,
    rows: impl Iterator<Item = usize>,
    least: u8,
    steepest: &mut Vec<u8>,
    blocks: &mut Vec<usize>,
) {
    steepest.clear();
    steepest.resize(image.width.saturating_sub(REACH), 0);
    for y in rows {
        let row = image.row(y);
        let ahead = row.get(REACH..).unwrap_or_default();
        for ((most, &a), &b) in steepest.iter_mut().zip(row).zip(ahead) {
            // The difference, as two operations that 16 pixels share.
            *most = (*most).max(a.max(b) - a.min(b));
        }
    }
    blocks.clear();
    let has_edge = |block: &[u8]| block.iter().fold(0, |a, &b| a.max(b)) >= least;
    let all = steepest.chunks(BLOCK).enumerate();
    blocks.extend(all.filter(|(_, block)| has_edge(block)).map(|(i, _)| i));
}

fn chords_of_row(edges: &[Edge], y: usize, options: &TargetOptions, each: &mut impl FnMut(Chord)) {
    let widest = 2.2 * options.max_semi_axis;
    for (i, pair) in edges.windows(2).enumerate() {
        let chord = pair[1].x - pair[0].x;
        if pair[0].rises == pair[1].rises || chord > widest || chord < options.min_semi_axis {
            continue;
        }
        // The border disturbs nothing.
        let before = if i > 0 { pair[0].x - edges[i - 1].x } else { f64::INFINITY };
        let after = edges.get(i + 2).map_or(f64::INFINITY, |edge| edge.x - pair[1].x);
        if before.min(after) > QUIET * chord {
            each(Chord { x: 0.5 * (pair[0].x + pair[1].x), y: y as f64, width: chord });
        }
    }
}

/// The edges of a row, from left to right; only these blocks have any.
fn find_edges(row: &[u8], blocks: &[usize], least: u8, edges: &mut Vec<Edge>) {
    edges.clear();
    let mut open = OpenEdge::default();
    for &block in blocks {
        let first = block * BLOCK;
        let (near, far) = (&row[first..], &row[first + REACH..]);
        let [rises, falls] = steps_of(near, far, least);
        let mut left = rises | falls;
        while left != 0 {
            // The next run of steps that go the same way.
            let begin = left.trailing_zeros() as usize;
            let is_rise = rises >> begin & 1 == 1;
            let length = (if is_rise { rises } else { falls } >> begin).trailing_ones() as usize;
            if open.weight > 0 && (open.end != first + begin || open.rises != is_rise) {
                edges.push(open.close());
                open = OpenEdge::default();
            }
            open.rises = is_rise;
            let run = begin..begin + length;
            for (x, (a, b)) in (first + begin..).zip(near[run.clone()].iter().zip(&far[run])) {
                let step = u64::from(a.abs_diff(*b));
                open.weight += step;
                open.moment += step * x as u64;
            }
            open.end = first + begin + length;
            left = left >> (begin + length) << (begin + length);
        }
    }
    if open.weight > 0 {
        edges.push(open.close());
    }
}

/// Where the pixels of one block are at least so much below those of another, and where above: a bit
/// for each. The slices begin with the blocks; where one is shorter there are no steps.
#[inline]
fn steps_of(near: &[u8], far: &[u8], least: u8) -> [u32; 2] {
    let (Some(a), Some(b)) = (near.first_chunk(), far.first_chunk()) else {
        let length = near.len().min(far.len()).min(BLOCK);
        let filled = |from: &[u8]| std::array::from_fn(|i| if i < length { from[i] } else { 0 });
        return masks(&filled(near), &filled(far), least);
    };
    masks(a, b, least)
}

#[inline]
fn masks(near: &[u8; BLOCK], far: &[u8; BLOCK], least: u8) -> [u32; 2] {
    let (near, far, least) = (u8x16::from(*near), u8x16::from(*far), u8x16::splat(least));
    let (up, down) = (far.saturating_sub(near), near.saturating_sub(far));
    [up.max(least).simd_eq(up).to_bitmask(), down.max(least).simd_eq(down).to_bitmask()]
}

/// An edge whose end has not been seen yet.
#[derive(Default)]
struct OpenEdge {
    rises: bool,
    weight: u64,
    moment: u64,
    /// The column after its last step.
    end: usize,
}

impl OpenEdge {
    fn close(&self) -> Edge {
        Edge { x: self.moment as f64 / self.weight as f64 + 0.5 * REACH as f64, rises: self.rises }
    }
}
