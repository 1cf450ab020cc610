//! The ring around a disc: 12 sectors, read through the ellipse's affine map.
//!
//! Every sector must be plainly dark or plainly light, evenly so, and the zone between disc and
//! ring must be quiet; a ring that is not so is refused. Nothing is guessed or corrected.

use nalgebra::{Matrix2, Vector2};

use super::candidates::sample;
use super::edge_fit::{EdgeFit, Levels};
use super::ellipse::Ellipse;
use crate::image::GrayImage;
use crate::scene::{RING_BITS, canonical_code};

const SECTORS: usize = RING_BITS as usize;
/// Directions per sector.
pub(super) const PER_SECTOR: usize = 10;
const DIRECTIONS: usize = SECTORS * PER_SECTOR;
/// Radii on which the ring is read, in radii of the disc; it reaches from 2 to 3.
const RING_RADII: [f64; 3] = [2.3, 2.5, 2.7];
/// Radii on which the quiet zone is checked; it reaches from 1 to 2.
const QUIET_RADII: [f64; 2] = [1.4, 1.6];
/// Part of the directions of a sector, in its middle, that are read: the rest is blurred.
const MIDDLE: f64 = 0.6;
/// Margin of the first reading, through an ellipse that is good to half a pixel: what remains is
/// that the ring changes at regular places only.
const FORGIVING: f64 = 0.55;

/// How far a change around the ring may be from where a sector ends, in sectors: this much for print
/// and lens, and this much more where the blur is as wide as the disc; 0.01 and 0.54 were the worst of
/// 2,000 prints. Rings of other numbers of sectors have changes in between.
const ASTRAY: [f64; 2] = [0.03, 0.6];
/// No less than this: the directions are a tenth of a sector apart, and in perspective the ring of a
/// large disc is not quite about its middle.
const LEAST_ASTRAY: f64 = 0.08;

/// A quick look with few samples, and a reading that forgives much: is there a ring at all? Not so
/// around laser dots, single spots and the ring's own sectors.
pub(super) fn may_be_target(image: &GrayImage, ellipse: &Ellipse) -> bool {
    let map = ellipse.map();
    let ring = |radius: f64| -> Option<[f64; 2 * SECTORS]> {
        let mut values = [0.0; 2 * SECTORS];
        for (value, direction) in values.iter_mut().zip(UNIT.iter().step_by(PER_SECTOR / 2)) {
            let at = ellipse.centre + map * (Vector2::from(*direction) * radius);
            *value = sample(image, at.x, at.y)?;
        }
        Some(values)
    };
    let (Some(disc), Some(quiet)) = (ring(0.4), ring(1.5)) else {
        return false;
    };
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let levels = Levels { disc: mean(&disc), ground: mean(&quiet), slope: Vector2::zeros() };
    let scale = (levels.disc - levels.ground).recip();
    let part = |value: &f64| (value - levels.ground) * scale;
    if !quiet.iter().all(|value| part(value).abs() < 0.5) {
        return false;
    }
    let Some(code) = ring(2.5) else { return false };
    code.iter().any(|value| part(value) > 0.5)
        && code.iter().any(|value| part(value) < 0.5)
        && read(image, ellipse, &levels, Pardon { margin: FORGIVING, astray: 0.5 }).is_some()
}

/// What a reading forgives.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pardon {
    /// How far a value may be from plain ground (0) or plain disc (1).
    margin: f64,
    /// How far a change may be from the end of a sector, sectors.
    astray: f64,
}

impl Pardon {
    /// Of the last reading, through a fitted edge.
    pub(super) fn of(margin: f64, edge: &EdgeFit) -> Self {
        let astray = ASTRAY[0] + ASTRAY[1] * edge.blur / edge.ellipse.semi_axes()[1];
        Self { margin, astray: astray.max(LEAST_ASTRAY) }
    }
}

/// The canonical code; `None` unless it is beyond doubt.
pub(super) fn read(
    image: &GrayImage,
    ellipse: &Ellipse,
    levels: &Levels,
    Pardon { margin, astray }: Pardon,
) -> Option<u16> {
    let reader = Reader { image, ellipse, map: ellipse.map(), levels };
    for radius in QUIET_RADII {
        let quiet = reader.circle(radius)?;
        let loudest = smoothed(&quiet).into_iter().map(f64::abs).fold(0.0, f64::max);
        if loudest > margin + 0.05 {
            return None;
        }
    }
    let circles: Option<Vec<_>> = RING_RADII.iter().map(|&radius| reader.circle(radius)).collect();
    let circles = circles?;
    let mean: [f64; DIRECTIONS] = std::array::from_fn(|i| {
        circles.iter().map(|circle| circle[i]).sum::<f64>() / circles.len() as f64
    });
    let phase = phase(&mean)?;
    if most_astray(&mean, phase) > astray {
        return None;
    }
    let mut bits = 0u16;
    for sector in 0..SECTORS {
        bits = bits << 1
            | u16::from(read_sector(&circles, phase + (sector * PER_SECTOR) as f64, margin)?);
    }
    let all = (1u16 << RING_BITS) - 1;
    (bits != 0 && bits != all).then(|| canonical_code(bits))
}

/// Unit vectors around the circle, from x towards y.
pub(super) const UNIT: [[f64; 2]; DIRECTIONS] = unit_vectors();

/// By the series of sine and cosine: 40 terms leave 1e-13 of a whole turn.
const fn unit_vectors() -> [[f64; 2]; DIRECTIONS] {
    let mut vectors = [[0.0; 2]; DIRECTIONS];
    let mut i = 0;
    while i < DIRECTIONS {
        let angle = std::f64::consts::TAU * i as f64 / DIRECTIONS as f64;
        let (mut term, mut power) = (1.0, 0);
        while power < 40 {
            let sign = if power % 4 < 2 { 1.0 } else { -1.0 };
            vectors[i][power % 2] += sign * term;
            power += 1;
            term *= angle / power as f64;
        }
        i += 1;
    }
    vectors
}

struct Reader<'a> {
    image: &'a GrayImage,
    ellipse: &'a Ellipse,
    map: Matrix2<f64>,
    levels: &'a Levels,
}

impl Reader<'_> {
    /// Values on a circle of the target's plane, clockwise in the picture: 0 ground, 1 disc.
    fn circle(&self, radius: f64) -> Option<[f64; DIRECTIONS]> {
        let Levels { disc, ground, slope } = self.levels;
        let (map, scale) = (self.map * radius, (disc - ground).recip());
        let mut values = [0.0; DIRECTIONS];
        for (value, direction) in values.iter_mut().zip(&UNIT) {
            let offset = map * Vector2::from(*direction);
            let at = self.ellipse.centre + offset;
            *value = sample(self.image, at.x, at.y)?;
            // The light is even in the quick look, and a division takes long.
            if *slope != Vector2::zeros() {
                *value /= (1.0 + slope.dot(&offset)).clamp(0.4, 2.5);
            }
            *value = (*value - ground) * scale;
        }
        Some(values)
    }
}

/// Means over five directions: half a sector, so that single noisy pixels do not speak.
fn smoothed(values: &[f64; DIRECTIONS]) -> [f64; DIRECTIONS] {
    std::array::from_fn(|i| {
        (0..5).map(|k| values[(i + DIRECTIONS + k - 2) % DIRECTIONS]).sum::<f64>() / 5.0
    })
}

/// Where the first sector begins, in directions from 0 to `PER_SECTOR`: the changes around the ring
/// repeat every sector, so the phase of their squared steps at that period is the place of the
/// borders.
fn phase(mean: &[f64; DIRECTIONS]) -> Option<f64> {
    let mut weights = [0.0; PER_SECTOR];
    for i in 0..DIRECTIONS {
        let step = mean[(i + 1) % DIRECTIONS] - mean[i];
        weights[i % PER_SECTOR] += step * step;
    }
    let (mut real, mut imaginary, mut total) = (0.0f64, 0.0f64, 0.0f64);
    for (i, weight) in weights.iter().enumerate() {
        // The step lies half a direction on.
        let (sin, cos) = (std::f64::consts::TAU * (i as f64 + 0.5) / PER_SECTOR as f64).sin_cos();
        real += weight * cos;
        imaginary += weight * sin;
        total += weight;
    }
    let clarity = real.hypot(imaginary) / total.max(1e-12);
    let turn = imaginary.atan2(real) / std::f64::consts::TAU;
    (total > 0.05 && clarity > 0.4).then(|| turn.rem_euclid(1.0) * PER_SECTOR as f64)
}

/// The largest distance of a change around the ring from the end of a sector, in sectors.
fn most_astray(mean: &[f64; DIRECTIONS], phase: f64) -> f64 {
    let mut worst = 0.0f64;
    for i in 0..DIRECTIONS {
        let (before, after) = (mean[i] - 0.5, mean[(i + 1) % DIRECTIONS] - 0.5);
        if (before > 0.0) != (after > 0.0) {
            // `phase` takes a step for half a direction further on, as this does.
            let place = (i as f64 + before / (before - after) - phase) / PER_SECTOR as f64;
            worst = worst.max((place - place.round()).abs());
        }
    }
    worst
}

/// One sector's bit; `None` where it is neither plain nor even.
fn read_sector(circles: &[[f64; DIRECTIONS]], begin: f64, margin: f64) -> Option<bool> {
    let edge = 0.5 * (1.0 - MIDDLE) * PER_SECTOR as f64;
    let first = (begin + edge).ceil() as usize;
    let last = (begin + PER_SECTOR as f64 - edge).floor() as usize;
    let (mut sum, mut squares, mut count) = (0.0f64, 0.0f64, 0.0f64);
    for circle in circles {
        for i in first..=last {
            let value = circle[i % DIRECTIONS];
            sum += value;
            squares += value * value;
            count += 1.0;
        }
    }
    let mean = sum / count;
    let spread = (squares / count - mean * mean).max(0.0).sqrt();
    let bit = mean > 0.5;
    let departure = (mean - f64::from(u8::from(bit))).abs();
    (departure <= margin && spread <= margin).then_some(bit)
}
