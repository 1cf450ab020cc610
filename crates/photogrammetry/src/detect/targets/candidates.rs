//! Where discs may be: chords on every few rows, then a trace of the edge.
//!
//! A row that crosses a disc shows two opposite edges with nothing between them and a quiet zone at
//! least half as wide as the chord on either side. Rows are compared with themselves three pixels
//! on, block by block, which the compiler does 16 pixels at a time.

use nalgebra::Vector2;

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
#[derive(Clone, Copy)]
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

/// The ellipse through the edge around a chord, roughly.
pub(super) fn trace(image: &GrayImage, chord: &Chord, options: &TargetOptions) -> Option<Ellipse> {
    let at = |x: f64| sample(image, x, chord.y);
    let disc = at(chord.x)?;
    let outside = 0.5 + 0.6 * QUIET;
    let ground =
        0.5 * (at(chord.x - outside * chord.width)? + at(chord.x + outside * chord.width)?);
    if (disc - ground).abs() < 0.7 * options.min_contrast {
        return None;
    }
    let threshold = Threshold { level: 0.5 * (disc + ground), is_light: disc > ground };
    let reach = 1.1 * options.max_semi_axis;
    let mut centre = Vector2::new(chord.x, chord.y);
    let mut size = Vector2::new(0.5 * chord.width, 0.0);
    for axis in [1, 0, 1, 0, 1] {
        let mut direction = Vector2::zeros();
        direction[axis] = 1.0;
        let forward = ray(image, &centre, &direction, 2.0 * reach, threshold)?;
        let backward = ray(image, &centre, &-direction, 2.0 * reach, threshold)?;
        centre[axis] += 0.5 * (forward - backward);
        size[axis] = 0.5 * (forward + backward);
    }
    if size.max() > reach || size.min() < 0.7 * options.min_semi_axis {
        return None;
    }
    let mut points = Vec::with_capacity(RAYS);
    for i in 0..RAYS {
        let (sin, cos) = (std::f64::consts::TAU * i as f64 / RAYS as f64).sin_cos();
        let direction = Vector2::new(cos, sin);
        let length = ray(image, &centre, &direction, 1.5 * reach, threshold)?;
        points.push(centre + direction * length);
    }
    let ellipse = Ellipse::through(&points, centre)?;
    let [large, small] = ellipse.semi_axes();
    let misfit =
        points.iter().map(|p| (ellipse.radius(p) - 1.0).powi(2)).sum::<f64>() / RAYS as f64;
    let allowed = 0.1 + 0.5 / small;
    (large < reach && small > 0.7 * options.min_semi_axis && misfit.sqrt() < allowed)
        .then_some(ellipse)
}

/// Distance from inside to the edge along a direction, pixels; `None` where there is none within
/// reach or inside the picture.
fn ray(
    image: &GrayImage,
    from: &Vector2<f64>,
    direction: &Vector2<f64>,
    reach: f64,
    threshold: Threshold,
) -> Option<f64> {
    let mut before = threshold.inside(sample(image, from.x, from.y)?);
    if before <= 0.0 {
        return None;
    }
    let mut length = 1.0;
    while length <= reach {
        let at = from + direction * length;
        let here = threshold.inside(sample(image, at.x, at.y)?);
        if here <= 0.0 {
            return Some(length - 1.0 + before / (before - here));
        }
        before = here;
        length += 1.0;
    }
    None
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
