//! Ring-coded targets: found by their centre disc, measured on its edge, read around it.
//!
//! Chords of discs are found on every few rows ([`chords`]); an ellipse ([`ellipse`]) goes through
//! points of the edge ([`candidates`]); the blurred edge itself is then fitted to the pixels
//! ([`edge_fit`]); the ring is read through the ellipse's affine map ([`decode`]). Where a small disc
//! is not read so, the whole print is fitted and its blur undone ([`unmix`], [`pattern`]). A code that
//! is not clear is refused. Not corrected here: the eccentricity of circle images and lens distortion.

mod band;
mod candidates;
mod chords;
mod decode;
mod edge_fit;
mod ellipse;
mod pattern;
#[cfg(test)]
mod tests;
mod unmix;

use std::ops::Range;

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::background::typical_noise;
use super::{ImagePoint, Target, bands};
use crate::image::GrayImage;
use crate::scene::{RING_BITS, canonical_code, ring_sectors};
use candidates::Blob;
use chords::{Chord, ChordScan};
use decode::Pardon;
use edge_fit::EdgeFit;
use ellipse::Ellipse;

/// Areas that are remembered, so that their next chord is not looked at again.
const TRIED_KEPT: usize = 128;

/// A target of less doubt is no part of another's pattern: a few hundred pixels of an edge at a
/// noise of a tenth of its contrast leave a hundredth of the radius.
const PLAIN: f64 = 0.015;

/// Smallest semi-axis of a disc whose sectors are read one by one, pixels: below it they blur into one
/// another.
const LEAST_DISTINCT: f64 = 2.5;

/// Largest rms residual of an edge: in units of the background's noise, as a part of the contrast (what
/// prints and sharpening leave) and in grey levels (what compression leaves at an edge). The sectors of
/// a ring are no ellipses by 0.13 of the contrast.
const MOST_NOISE: f64 = 1.5;
const MOST_UNLIKE: f64 = 0.06;
const MOST_COMPRESSION: f64 = 2.0;

/// What counts as a target.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TargetOptions {
    /// Smallest semi-axis of the centre disc's image, pixels. Default 1.8: a disc of
    /// radius 4 tilted by 60 degrees has 2. The ring's sectors are hardly wider, and below it no fit
    /// tells them apart.
    pub min_semi_axis: f64,
    /// Largest semi-axis, pixels. Default 48.
    pub max_semi_axis: f64,
    /// Largest ratio of the semi-axes. Default 2.6: a tilt of 67 degrees.
    pub max_axis_ratio: f64,
    /// Smallest difference between disc and ground, grey levels. Default 20.
    pub min_contrast: f64,
    /// How far a sector may be from plain dark or light, as a part of the contrast. Default 0.3;
    /// half would be a guess.
    pub code_margin: f64,
}

impl Default for TargetOptions {
    fn default() -> Self {
        Self {
            min_semi_axis: 1.8,
            max_semi_axis: 48.0,
            max_axis_ratio: 2.6,
            min_contrast: 20.0,
            code_margin: 0.3,
        }
    }
}

/// Finds the ring-coded targets of a picture, from top to bottom.
///
/// The same code may come more than once, if the picture shows it more than once.
#[must_use]
pub fn find_targets(image: &GrayImage, options: &TargetOptions) -> Vec<Target> {
    let mut scan = TargetScan::new(image, typical_noise(image), options);
    bands(image).for_each(|band| scan.look(band));
    scan.finish()
}

/// A pass over a picture, band by band.
pub(super) struct TargetScan<'a> {
    chords: ChordScan<'a>,
    search: Search<'a>,
}

impl<'a> TargetScan<'a> {
    /// `noise` is that of the background, grey levels.
    pub(super) fn new(image: &'a GrayImage, noise: f64, options: &'a TargetOptions) -> Self {
        let search = Search {
            image,
            noise,
            options,
            targets: Vec::new(),
            tried: Vec::new(),
            unclear: Vec::new(),
        };
        Self { chords: ChordScan::new(image, noise, options), search }
    }

    /// Looks at a band; bands from top to bottom.
    pub(super) fn look(&mut self, band: Range<usize>) {
        let Self { chords, search } = self;
        chords.look(band, |chord| search.look(&chord));
    }

    /// The targets of all bands.
    pub(super) fn finish(self) -> Vec<Target> {
        self.search.finish()
    }
}

/// What was found so far.
struct Search<'a> {
    image: &'a GrayImage,
    /// Of the background, grey levels.
    noise: f64,
    options: &'a TargetOptions,
    targets: Vec<Target>,
    /// Areas that were looked at, targets or not: every disc has many chords.
    tried: Vec<Blob>,
    /// Discs around which something is that was not read at once.
    unclear: Vec<Ellipse>,
}

impl Search<'_> {
    /// Measures what is around a chord, unless it was before.
    fn look(&mut self, chord: &Chord) {
        let place = Vector2::new(chord.x, chord.y);
        if self.is_taken(&place) {
            return;
        }
        let Some(blob) = candidates::blob(self.image, chord, self.options) else { return };
        if self.tried.iter().rev().take(TRIED_KEPT).any(|other| other.is_same(&blob)) {
            return;
        }
        self.tried.push(blob);
        let round = candidates::round(self.image, &blob, self.options);
        let Some(round) = round.filter(|round| round.may_have_ring(self.image)) else { return };
        let Some(ellipse) = round.trace(self.image, self.options) else { return };
        if let Some(target) = measure(self.image, &ellipse, self.noise, self.options) {
            keep(&mut self.targets, target);
        } else if unmix::may_be_target(self.image, &ellipse, self.options) {
            self.unclear.push(ellipse);
        }
    }

    /// Whether a place is on a target: rings do not overlap, so nothing is looked for on that of a
    /// plain target.
    fn is_taken(&self, place: &Vector2<f64>) -> bool {
        let radii = |target: &Target| if doubt(target) < PLAIN { 3.0 } else { 1.0 };
        self.targets.iter().any(|target| target.covers(place, radii(target)))
    }

    /// Reads what was not clear at once, and is on no target that was.
    fn finish(mut self) -> Vec<Target> {
        for ellipse in std::mem::take(&mut self.unclear) {
            if !self.is_taken(&ellipse.centre)
                && let Some(target) = unmix::read(self.image, &ellipse, self.noise, self.options)
            {
                keep(&mut self.targets, target);
            }
        }
        self.targets
    }
}

/// Adds a target, unless it lies on another that is more plainly one: rings do not overlap, so one
/// of the two is a part of the other's pattern.
fn keep(targets: &mut Vec<Target>, target: Target) {
    let overlaps =
        |a: &Target, b: &Target| a.covers(&b.point.at, 3.0) || b.covers(&a.point.at, 3.0);
    if targets.iter().all(|other| !overlaps(other, &target) || doubt(&target) < doubt(other)) {
        targets.retain(|other| !overlaps(other, &target));
        targets.push(target);
    }
}

/// Uncertainty of a target's centre as a part of its radius.
fn doubt(target: &Target) -> f64 {
    target.point.covariance.trace().sqrt() / target.semi_axes[1]
}

/// A disc without regard to what is around it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PlainDisc {
    /// The ellipse's centre.
    pub(crate) point: ImagePoint,
    /// Semi-axes (large, small), pixels.
    pub(crate) semi_axes: [f64; 2],
    /// Disc minus ground, grey levels: below zero for a dark disc.
    pub(crate) contrast: f64,
}

/// Every disc of a picture, coded or not, from top to bottom: for sheets of plain dots.
pub(crate) fn find_plain_discs(image: &GrayImage, options: &TargetOptions) -> Vec<PlainDisc> {
    let mut tried: Vec<Blob> = Vec::new();
    let mut known: Vec<Ellipse> = Vec::new();
    let mut discs = Vec::new();
    let mut chords = ChordScan::new(image, typical_noise(image), options);
    let mut look = |chord: Chord| {
        let Some(blob) = candidates::blob(image, &chord, options) else { return };
        if tried.iter().rev().take(TRIED_KEPT).any(|other| other.is_same(&blob)) {
            return;
        }
        tried.push(blob);
        let Some(round) = candidates::round(image, &blob, options) else { return };
        let Some(ellipse) = round.trace(image, options) else { return };
        if known.iter().any(|other| other.square_radius(&ellipse.centre) < 1.0) {
            return;
        }
        known.push(ellipse);
        let Some(EdgeFit { ellipse, levels, covariance, .. }) = edge_fit::fit(image, &ellipse)
        else {
            return;
        };
        if is_wanted(&ellipse, levels.contrast(), options) {
            let point = ImagePoint { at: ellipse.centre, covariance };
            let contrast = levels.disc - levels.ground;
            discs.push(PlainDisc { point, semi_axes: ellipse.semi_axes(), contrast });
        }
    };
    bands(image).for_each(|band| chords.look(band, &mut look));
    discs
}

/// Whether size, tilt and contrast are those of a disc that is looked for.
fn is_wanted(ellipse: &Ellipse, contrast: f64, options: &TargetOptions) -> bool {
    let [large, small] = ellipse.semi_axes();
    small >= options.min_semi_axis
        && large <= options.max_semi_axis
        && large <= options.max_axis_ratio * small
        && contrast >= options.min_contrast
}

/// Whether a code serves well: canonical, different from all its own rotations, and with at least
/// four changes around the ring, so that no stray mark beside a disc can pass for it.
#[must_use]
pub fn is_usable_code(code: u16) -> bool {
    let sectors = ring_sectors(code);
    let count = sectors.len();
    let changes = (0..count).filter(|&i| sectors[i] != sectors[(i + 1) % count]).count();
    let is_symmetric =
        (1..count).any(|turn| (0..count).all(|i| sectors[i] == sectors[(i + turn) % count]));
    code < 1 << RING_BITS && canonical_code(code) == code && changes >= 4 && !is_symmetric
}

/// All codes that serve well, ascending.
#[must_use]
pub fn usable_codes() -> Vec<u16> {
    (0..1 << RING_BITS).filter(|&code| is_usable_code(code)).collect()
}

/// Edge and code of a traced disc; `noise` is that of the background, grey levels.
fn measure(
    image: &GrayImage,
    ellipse: &Ellipse,
    noise: f64,
    options: &TargetOptions,
) -> Option<Target> {
    if !decode::may_be_target(image, ellipse) {
        return None;
    }
    let edge = edge_fit::fit(image, ellipse)?;
    let EdgeFit { ellipse, levels, misfit, covariance, .. } = edge;
    let is_distinct = ellipse.semi_axes()[1] >= LEAST_DISTINCT;
    let unlike = (MOST_UNLIKE * levels.contrast()).hypot(MOST_COMPRESSION);
    let is_ellipse = misfit < unlike.hypot(MOST_NOISE * noise);
    if !is_distinct || !is_ellipse || !is_wanted(&ellipse, levels.contrast(), options) {
        return None;
    }
    let code = decode::read(image, &ellipse, &levels, Pardon::of(options.code_margin, &edge))?;
    let point = ImagePoint { at: ellipse.centre, covariance };
    Some(Target { code, point, semi_axes: ellipse.semi_axes(), angle: ellipse.angle() })
}

impl Target {
    /// Whether a place lies within so many radii of the centre disc, measured in the plane of the
    /// target: 1 is the disc's edge, 3 the outer edge of the ring.
    #[must_use]
    pub fn covers(&self, at: &Vector2<f64>, radii: f64) -> bool {
        let offset = at - self.point.at;
        // Most places are nowhere near.
        if offset.amax() > radii * self.semi_axes[0] {
            return false;
        }
        let (sin, cos) = self.angle.sin_cos();
        let along = (offset.x * cos + offset.y * sin) / self.semi_axes[0];
        let across = (offset.y * cos - offset.x * sin) / self.semi_axes[1];
        along.hypot(across) < radii
    }
}
