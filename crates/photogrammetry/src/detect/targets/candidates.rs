//! From a chord to a disc: the area around it by walks along row and column, then a trace of its edge
//! along rays.

use nalgebra::{Matrix2, Vector2};

use super::TargetOptions;
use super::chords::{Chord, QUIET};
use super::ellipse::Ellipse;
use crate::image::GrayImage;

/// Rays from the centre along which the edge is traced.
const RAYS: usize = 32;

/// Largest semi-axis of a rough ellipse, in those of the largest target.
const REACH: f64 = 1.1;

/// Where a ring is looked for, in radii of a disc that blur may have shrunk, and the smallest part of
/// the contrast by which it changes: 0.41 was the least of 900 small and blurred targets.
const RING_RADII: [f64; 2] = [2.4, 2.8];
const LEAST_CHANGE: f64 = 0.25;

/// An area of less than half so many pixels is small: a pixel matters.
const SMALL: f64 = 3.0;

/// The half-way level between disc and ground, and on which side of it the disc is.
#[derive(Debug, Clone, Copy)]
struct Threshold {
    level: f64,
    is_light: bool,
    /// For whole grey values: those above `limit` are inside, once their bits are turned by `flip`.
    flip: u8,
    limit: u8,
}

impl Threshold {
    /// Half way between the levels of disc and ground.
    fn between(disc: f64, ground: f64) -> Self {
        let (level, is_light) = (0.5 * (disc + ground), disc > ground);
        let (flip, limit) = if is_light { (0, level) } else { (255, 255.0 - level) };
        Self { level, is_light, flip, limit: limit.floor() as u8 }
    }

    /// How far a grey value is inside, grey levels.
    fn inside(&self, value: f64) -> f64 {
        if self.is_light { value - self.level } else { self.level - value }
    }

    /// Whether a pixel is inside.
    fn has_inside(&self, pixel: u8) -> bool {
        pixel ^ self.flip > self.limit
    }
}

/// An area that may be a disc, by its extent along row and column through its middle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Blob {
    centre: Vector2<f64>,
    /// Half its width and height, pixels.
    half: Vector2<f64>,
    threshold: Threshold,
}

impl Blob {
    /// Whether another chord led to the same area, to the pixels of the walks. Small areas have few
    /// chords, and a pixel beside the middle their rays go astray.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        let near = if self.half.min() < SMALL { 0.35 * self.half.min() } else { 1.3 };
        (self.centre - other.centre).amax() < near && (self.half - other.half).amax() < near
    }
}

/// The area around a chord: walks along column and row from edge to edge, in whole pixels, each
/// from the middle of the one before.
pub(super) fn blob(image: &GrayImage, chord: &Chord, options: &TargetOptions) -> Option<Blob> {
    let at = |x: f64| sample(image, x, chord.y);
    let disc = at(chord.x)?;
    let outside = (0.5 + 0.6 * QUIET) * chord.width;
    let ground = mean_seen(&[at(chord.x - outside), at(chord.x + outside)])?;
    if (disc - ground).abs() < 0.7 * options.min_contrast {
        return None;
    }
    let threshold = Threshold::between(disc, ground);
    let mut centre = [chord.x.round() as usize, chord.y as usize];
    let (mut half, mut middle) = (Vector2::zeros(), Vector2::zeros());
    for axis in [1, 0, 1] {
        let [first, last] = walk(image, centre, axis, options, threshold)?;
        centre[axis] = usize::midpoint(first, last);
        middle[axis] = 0.5 * (first + last) as f64;
        half[axis] = 0.5 * (last + 1 - first) as f64;
    }
    // Whole pixels are middle enough, but for small areas.
    let whole = Vector2::new(centre[0] as f64, centre[1] as f64);
    let centre = if half.min() < SMALL { middle } else { whole };
    let threshold = threshold_around(image, &centre, &half, options)?;
    (half.min() > 0.7 * options.min_semi_axis).then_some(Blob { centre, half, threshold })
}

/// Half way between the middle of an area and its quiet zone on four sides, or those of them that
/// the picture shows: the same whichever chord led to the area.
fn threshold_around(
    image: &GrayImage,
    centre: &Vector2<f64>,
    half: &Vector2<f64>,
    options: &TargetOptions,
) -> Option<Threshold> {
    let away = half * (1.0 + 1.2 * QUIET);
    let at = |x: f64, y: f64| sample(image, centre.x + x, centre.y + y);
    let disc = at(0.0, 0.0)?;
    let sides = [at(away.x, 0.0), at(-away.x, 0.0), at(0.0, away.y), at(0.0, -away.y)];
    let ground = mean_seen(&sides)?;
    let is_plain = (disc - ground).abs() > 0.7 * options.min_contrast;
    is_plain.then(|| Threshold::between(disc, ground))
}

/// Mean of the grey values that the picture shows.
fn mean_seen(values: &[Option<f64>]) -> Option<f64> {
    let count = values.iter().flatten().count();
    (count > 0).then(|| values.iter().flatten().sum::<f64>() / count as f64)
}

/// First and last pixel inside along a column (axis 1) or row (axis 0); `None` where the area goes
/// on beyond reach or border, or the quiet zone around it is too narrow.
fn walk(
    image: &GrayImage,
    from: [usize; 2],
    axis: usize,
    options: &TargetOptions,
    threshold: Threshold,
) -> Option<[usize; 2]> {
    let (stride, size) = [(1, image.width), (image.width, image.height)][axis];
    let origin = from[1] * image.width + from[0] - from[axis] * stride;
    let is_inside = |at: usize| threshold.has_inside(image.data[origin + at * stride]);
    let reach = (2.2 * options.max_semi_axis) as usize;
    let (mut first, mut last) = (from[axis], from[axis]);
    if last >= size || !is_inside(last) {
        return None;
    }
    while is_inside(first.checked_sub(1)?) {
        first -= 1;
        if last - first > reach {
            return None;
        }
    }
    while last + 1 < size && is_inside(last + 1) {
        last += 1;
        if last - first > reach {
            return None;
        }
    }
    let quiet = ((QUIET * (last + 1 - first) as f64).round() as usize).max(1);
    // What the border cuts off of the quiet zone disturbs nothing.
    let is_loud = |at: Option<usize>| at.is_some_and(|at| at < size && is_inside(at));
    let is_quiet = !is_loud(Some(last + quiet)) && !is_loud(first.checked_sub(quiet));
    is_quiet.then_some([first, last])
}

/// An area whose diameters are those of an ellipse.
pub(super) struct Round {
    blob: Blob,
    /// Distances from its middle to its edge along every fourth ray; the others are zero.
    lengths: [f64; RAYS],
}

/// Looks along every fourth ray: most areas are no ellipse, and these tell.
pub(super) fn round(image: &GrayImage, blob: &Blob, options: &TargetOptions) -> Option<Round> {
    let mut lengths = [0.0; RAYS];
    for i in (0..RAYS).step_by(4) {
        lengths[i] = ray(image, blob, i, options)?;
    }
    is_round(std::array::from_fn(|i| lengths[4 * i])).then_some(Round { blob: *blob, lengths })
}

impl Round {
    /// Whether something is dark and light in turns where a ring would be: not so around laser dots
    /// on a plain wall, which most areas are.
    pub(super) fn may_have_ring(&self, image: &GrayImage) -> bool {
        let inverse: [f64; 4] = std::array::from_fn(|i| self.half_diameter(4 * i).powi(-2));
        let mixed = 0.5 * (inverse[1] - inverse[3]);
        let shape = Matrix2::new(inverse[0], mixed, mixed, inverse[2]);
        let Some(ellipse) = Ellipse::valid(self.blob.centre, shape) else { return true };
        let map = ellipse.map();
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for radius in RING_RADII {
            for i in 0..RAYS {
                let at = ellipse.centre + map * direction(i) * radius;
                if let Some(value) = sample(image, at.x, at.y) {
                    (low, high) = (low.min(value), high.max(value));
                }
            }
        }
        let Threshold { level, .. } = self.blob.threshold;
        let disc = sample(image, ellipse.centre.x, ellipse.centre.y).unwrap_or(level);
        high - low > LEAST_CHANGE * 2.0 * (disc - level).abs()
    }

    fn half_diameter(&self, ray: usize) -> f64 {
        0.5 * (self.lengths[ray] + self.lengths[ray + RAYS / 2])
    }

    /// The ellipse through the edge, roughly.
    pub(super) fn trace(&self, image: &GrayImage, options: &TargetOptions) -> Option<Ellipse> {
        let mut lengths = self.lengths;
        for i in (0..RAYS).filter(|i| i % 4 != 0) {
            lengths[i] = ray(image, &self.blob, i, options)?;
        }
        let points: [Vector2<f64>; RAYS] =
            std::array::from_fn(|i| self.blob.centre + direction(i) * lengths[i]);
        let ellipse = Ellipse::through(&points, self.blob.centre)?;
        let [large, small] = ellipse.semi_axes();
        let misfit =
            points.iter().map(|p| (ellipse.radius(p) - 1.0).powi(2)).sum::<f64>() / RAYS as f64;
        let allowed = 0.1 + 0.5 / small;
        let is_in_size =
            large < REACH * options.max_semi_axis && small > 0.7 * options.min_semi_axis;
        (is_in_size && misfit.sqrt() < allowed).then_some(ellipse)
    }
}

/// Whether four diameters, 45 degrees apart, may be those of an ellipse: the inverse squares of two
/// that cross at right angles have the same sum in any direction. Half of the sum is left for
/// pixels and a centre that is not quite one.
fn is_round(lengths: [f64; 8]) -> bool {
    let inverse: [f64; 4] = std::array::from_fn(|i| (0.5 * (lengths[i] + lengths[i + 4])).powi(-2));
    let ratio = (inverse[0] + inverse[2]) / (inverse[1] + inverse[3]);
    (0.6..1.67).contains(&ratio)
}

/// The directions of the rays, evenly around the circle from x towards y.
fn direction(i: usize) -> Vector2<f64> {
    /// Sines from 0 to 90 degrees.
    const SINES: [f64; RAYS / 4 + 1] = [
        0.0,
        0.195_090_322_016_128_27,
        0.382_683_432_365_089_8,
        0.555_570_233_019_602_2,
        0.707_106_781_186_547_5,
        0.831_469_612_302_545_2,
        0.923_879_532_511_286_7,
        0.980_785_280_403_230_4,
        1.0,
    ];
    let quarter = RAYS / 4;
    let (sin, cos) = (SINES[i % quarter], SINES[quarter - i % quarter]);
    match i / quarter {
        0 => Vector2::new(cos, sin),
        1 => Vector2::new(-sin, cos),
        2 => Vector2::new(-cos, -sin),
        _ => Vector2::new(sin, -cos),
    }
}

/// Parts of a pixel in which a ray counts its way.
const FIXED: f64 = 65_536.0;

/// Distance from the middle of an area to its edge along a ray, pixels.
fn ray(image: &GrayImage, blob: &Blob, index: usize, options: &TargetOptions) -> Option<f64> {
    let reach = 1.5 * REACH * options.max_semi_axis;
    way_out(image, &blob.centre, &direction(index), reach, blob.threshold)
}

/// Distance from inside to the edge along a direction, pixels; `None` where there is none within
/// reach or inside the picture. Whole pixels are looked at up to the edge, and its place is then
/// interpolated.
fn way_out(
    image: &GrayImage,
    from: &Vector2<f64>,
    direction: &Vector2<f64>,
    reach: f64,
    threshold: Threshold,
) -> Option<f64> {
    let fixed = |value: f64| (value * FIXED) as i64;
    let (dx, dy) = (fixed(direction.x), fixed(direction.y));
    let (mut x, mut y) = (fixed(from.x + 0.5), fixed(from.y + 0.5));
    let (width, height) = (fixed(image.width as f64), fixed(image.height as f64));
    for step in 1..=reach as usize {
        (x, y) = (x + dx, y + dy);
        if x < 0 || y < 0 || x >= width || y >= height {
            return None;
        }
        let at = (y >> 16) as usize * image.width + (x >> 16) as usize;
        if !threshold.has_inside(image.data[at]) {
            return cross(image, from, direction, step as f64, threshold);
        }
    }
    None
}

/// Where the edge is next to a length at which the nearest pixel was outside.
fn cross(
    image: &GrayImage,
    from: &Vector2<f64>,
    direction: &Vector2<f64>,
    length: f64,
    threshold: Threshold,
) -> Option<f64> {
    let inside = |length: f64| {
        let at = from + direction * length;
        Some(threshold.inside(sample(image, at.x, at.y)?))
    };
    let mut before = inside(length - 1.0)?;
    for step in 0..3 {
        let here = inside(length + f64::from(step))?;
        if before > 0.0 && here <= 0.0 {
            return Some(length + f64::from(step) - 1.0 + before / (before - here));
        }
        before = here;
    }
    Some(length - 0.5)
}

/// Grey value between pixels, bilinear; `None` outside.
pub(super) fn sample(image: &GrayImage, x: f64, y: f64) -> Option<f64> {
    if !(x >= 0.0 && y >= 0.0) {
        return None;
    }
    // By way of `i32`, which takes one instruction; a larger picture cannot be decoded.
    let (column, row) = (x as i32 as usize, y as i32 as usize);
    if column + 1 >= image.width {
        return None;
    }
    let (right, down) = (x - column as f64, y - row as f64);
    let first = row * image.width + column;
    let &[a, b] = image.data.get(first..)?.first_chunk()?;
    let &[c, d] = image.data.get(first + image.width..)?.first_chunk()?;
    let [a, b, c, d] = [a, b, c, d].map(|pixel| f64::from(i32::from(pixel)));
    let (top, bottom) = (a + (b - a) * right, c + (d - c) * right);
    Some(top + (bottom - top) * down)
}
