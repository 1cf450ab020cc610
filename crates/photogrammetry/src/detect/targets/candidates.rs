//! Where discs may be: chords on every few rows, then a trace of the edge.
//!
//! A row that crosses a disc shows two opposite edges with nothing between them and a quiet zone at
//! least half as wide as the chord on either side. Rows are compared with themselves three pixels
//! on, block by block, which the compiler does 16 pixels at a time.

use nalgebra::{Matrix2, Vector2};

use super::TargetOptions;
use super::ellipse::Ellipse;
use crate::image::GrayImage;

/// Pixels of a row that are compared at once.
const BLOCK: usize = 32;
/// Distance of the pixels whose difference shows an edge: blurred edges are that wide.
const REACH: usize = 3;
/// Rays from the centre along which the edge is traced.
const RAYS: usize = 32;
/// Part of a chord's width that must be quiet on both sides; half of it is printed quiet.
const QUIET: f64 = 0.3;

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

/// Calls `each` for every chord, rows from top to bottom.
pub(super) fn each_chord(
    image: &GrayImage,
    noise: f64,
    options: &TargetOptions,
    mut each: impl FnMut(Chord),
) {
    let row_step = (options.min_semi_axis.floor() as usize).max(1);
    let least = (5.5 * noise).max(0.4 * options.min_contrast).clamp(4.0, 250.0) as u8;
    let widest = 2.2 * options.max_semi_axis;
    let mut edges = Vec::new();
    for y in (row_step / 2..image.height).step_by(row_step) {
        find_edges(image.row(y), least, &mut edges);
        for (i, pair) in edges.windows(2).enumerate() {
            let width = pair[1].x - pair[0].x;
            if pair[0].rises == pair[1].rises || width > widest || width < options.min_semi_axis {
                continue;
            }
            let before = if i > 0 { pair[0].x - edges[i - 1].x } else { pair[0].x };
            let after = edges.get(i + 2).map_or(image.width as f64, |edge| edge.x) - pair[1].x;
            if before.min(after) > QUIET * width {
                each(Chord { x: 0.5 * (pair[0].x + pair[1].x), y: y as f64, width });
            }
        }
    }
}

/// The edges of a row, from left to right.
fn find_edges(row: &[u8], least: u8, edges: &mut Vec<Edge>) {
    edges.clear();
    if row.len() <= REACH {
        return;
    }
    let ahead = &row[REACH..];
    let mut open: Option<OpenEdge> = None;
    for (index, (near, far)) in row.chunks(BLOCK).zip(ahead.chunks(BLOCK)).enumerate() {
        if steepest(near, far) < least {
            if let Some(edge) = open.take() {
                edges.push(edge.close());
            }
            continue;
        }
        for (i, (&a, &b)) in near.iter().zip(far).enumerate() {
            let rises = b > a;
            let step = f64::from(a.abs_diff(b));
            let is_edge = a.abs_diff(b) >= least;
            if let Some(edge) = open.take_if(|edge| !is_edge || edge.rises != rises) {
                edges.push(edge.close());
            }
            if is_edge {
                let edge = open.get_or_insert(OpenEdge { rises, weight: 0.0, moment: 0.0 });
                edge.weight += step;
                edge.moment += step * (index * BLOCK + i) as f64;
            }
        }
    }
    edges.extend(open.map(|edge| edge.close()));
}

/// An edge whose end has not been seen yet.
struct OpenEdge {
    rises: bool,
    weight: f64,
    moment: f64,
}

impl OpenEdge {
    fn close(&self) -> Edge {
        Edge { x: self.moment / self.weight + 0.5 * REACH as f64, rises: self.rises }
    }
}

/// The largest difference in a block.
fn steepest(near: &[u8], far: &[u8]) -> u8 {
    match (<&[u8; BLOCK]>::try_from(near), <&[u8; BLOCK]>::try_from(far)) {
        (Ok(near), Ok(far)) => {
            near.iter().zip(far).fold(0, |most, (a, b)| most.max(a.abs_diff(*b)))
        }
        _ => near.iter().zip(far).fold(0, |most, (a, b)| most.max(a.abs_diff(*b))),
    }
}

/// The half-way level between disc and ground, and on which side of it the disc is.
#[derive(Debug, Clone, Copy)]
struct Threshold {
    level: f64,
    is_light: bool,
}

impl Threshold {
    /// How far a grey value is inside, grey levels.
    fn inside(&self, value: f64) -> f64 {
        if self.is_light { value - self.level } else { self.level - value }
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
    /// Whether another chord led to the same area, to the pixels of the walks.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        (self.centre - other.centre).amax() < 1.3 && (self.half - other.half).amax() < 1.3
    }
}

/// The area around a chord: walks along column and row from edge to edge, in whole pixels, each
/// from the middle of the one before.
pub(super) fn blob(image: &GrayImage, chord: &Chord, options: &TargetOptions) -> Option<Blob> {
    let at = |x: f64| sample(image, x, chord.y);
    let disc = at(chord.x)?;
    let outside = 0.5 + 0.6 * QUIET;
    let ground =
        0.5 * (at(chord.x - outside * chord.width)? + at(chord.x + outside * chord.width)?);
    if (disc - ground).abs() < 0.7 * options.min_contrast {
        return None;
    }
    let threshold = Threshold { level: 0.5 * (disc + ground), is_light: disc > ground };
    let mut centre = [chord.x.round() as usize, chord.y as usize];
    let mut half = Vector2::zeros();
    for axis in [1, 0, 1] {
        let [first, last] = walk(image, centre, axis, options, threshold)?;
        centre[axis] = usize::midpoint(first, last);
        half[axis] = 0.5 * (last + 1 - first) as f64;
    }
    let centre = Vector2::new(centre[0] as f64, centre[1] as f64);
    (half.min() > 0.7 * options.min_semi_axis).then_some(Blob { centre, half, threshold })
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
    let is_inside = |at: usize| threshold.inside(f64::from(image.data[origin + at * stride])) > 0.0;
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
    let quiet = (QUIET * (last + 1 - first) as f64) as usize + 1;
    let is_quiet =
        last + quiet < size && !is_inside(last + quiet) && !is_inside(first.checked_sub(quiet)?);
    is_quiet.then_some([first, last])
}

/// The ellipse through the edge of an area, roughly.
pub(super) fn trace(image: &GrayImage, blob: &Blob, options: &TargetOptions) -> Option<Ellipse> {
    let reach = 1.1 * options.max_semi_axis;
    let mut points = Vec::with_capacity(RAYS);
    let (sin, cos) = (std::f64::consts::TAU / RAYS as f64).sin_cos();
    let turn = Matrix2::new(cos, -sin, sin, cos);
    let mut direction = Vector2::new(1.0, 0.0);
    for _ in 0..RAYS {
        let length = ray(image, &blob.centre, &direction, 1.5 * reach, blob.threshold)?;
        points.push(blob.centre + direction * length);
        direction = turn * direction;
    }
    let ellipse = Ellipse::through(&points, blob.centre)?;
    let [large, small] = ellipse.semi_axes();
    let misfit =
        points.iter().map(|p| (ellipse.radius(p) - 1.0).powi(2)).sum::<f64>() / RAYS as f64;
    let allowed = 0.1 + 0.5 / small;
    (large < reach && small > 0.7 * options.min_semi_axis && misfit.sqrt() < allowed)
        .then_some(ellipse)
}

/// Distance from inside to the edge along a direction, pixels; `None` where there is none within
/// reach or inside the picture. Whole pixels are looked at up to the edge, and its place is then
/// interpolated.
fn ray(
    image: &GrayImage,
    from: &Vector2<f64>,
    direction: &Vector2<f64>,
    reach: f64,
    threshold: Threshold,
) -> Option<f64> {
    let mut length = 1.0;
    while length <= reach {
        let at = from + direction * length;
        if !(at.x >= 0.0 && at.y >= 0.0) {
            return None;
        }
        let (x, y) = ((at.x + 0.5) as usize, (at.y + 0.5) as usize);
        if x >= image.width || y >= image.height {
            return None;
        }
        if threshold.inside(f64::from(image.data[y * image.width + x])) <= 0.0 {
            return cross(image, from, direction, length, threshold);
        }
        length += 1.0;
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
    let (column, row) = (x as usize, y as usize);
    if column + 1 >= image.width || row + 1 >= image.height {
        return None;
    }
    let (right, down) = (x - column as f64, y - row as f64);
    let upper = row * image.width + column;
    let value = |index: usize| f64::from(image.data[index]);
    let top = value(upper) + (value(upper + 1) - value(upper)) * right;
    let lower = upper + image.width;
    let bottom = value(lower) + (value(lower + 1) - value(lower)) * right;
    Some(top + (bottom - top) * down)
}
