//! A whole target as a blurred picture shows it: disc and sectors of the ring, each with its own
//! grey level, and how every pixel changes with place, shape and blur.
//!
//! The print is summed up from points on disc and sectors, each a round Gaussian in the picture: lens
//! and pixel together. Points are hardly farther apart than the blur, where such sums are good to a
//! hundredth of the contrast.

use std::f64::consts::TAU;
use std::ops::Range;

use nalgebra::{Matrix2, Vector2};

use crate::detect::lanes::{self, LANES, Lanes};
use crate::image::GrayImage;
use crate::scene::RING_BITS;

pub(super) const SECTORS: usize = RING_BITS as usize;
/// Centre of the disc 2, centre of the ring 2, map from the print 4, blur.
pub(super) const SHAPE: usize = 9;
/// Index of the disc among the greys: after the ground and its slope; the sectors follow.
pub(super) const DISC: usize = 3;
/// Ground, its slope 2, disc, sectors.
pub(super) const GREYS: usize = DISC + 1 + SECTORS;
/// All unknowns: shape, then greys.
pub(super) const UNKNOWNS: usize = SHAPE + GREYS;

/// What is fitted goes so far, in radii of the disc: beyond it there may be something else.
const REACH: f64 = 3.2;
/// Where a point's light ends, in standard deviations of the blur.
const TAIL: f64 = 3.5;
/// Distance of points, in standard deviations of the blur.
const APART: f64 = 1.25;
/// Most blocks of pixels across a patch.
const BLOCKS: usize = 16;

/// Where and how sharp the print is seen.
#[derive(Debug, Clone, Copy)]
pub(super) struct View {
    /// Of the disc, pixels.
    pub(super) centre: Vector2<f64>,
    /// Of the ring: in a perspective view the two differ a little.
    pub(super) ring: Vector2<f64>,
    /// Maps the print, in radii of the disc and its first sector from the x axis on, to pixels.
    pub(super) map: Matrix2<f64>,
    /// Standard deviation of lens and pixel together, pixels.
    pub(super) blur: f64,
}

impl View {
    /// The view after a step.
    pub(super) fn moved(&self, step: &[f64]) -> Self {
        Self {
            centre: self.centre + Vector2::new(step[0], step[1]),
            ring: self.ring + Vector2::new(step[2], step[3]),
            map: self.map + Matrix2::new(step[4], step[5], step[6], step[7]),
            blur: self.blur + step[8],
        }
    }

    /// Half the width and height of a circle of the print, pixels.
    fn half(&self, radius: f64) -> Vector2<f64> {
        let spread = self.map * self.map.transpose();
        Vector2::new(spread[(0, 0)], spread[(1, 1)]).map(f64::sqrt) * radius
    }
}

/// The pixels around a target: a rectangle, filled up to whole lanes.
pub(super) struct Patch {
    columns: Range<usize>,
    rows: Range<usize>,
    /// 1 where a pixel takes part, 0 elsewhere, row by row.
    inside: Vec<f32>,
    /// Above their mean, 0 where a pixel takes no part.
    greys: Vec<f32>,
    /// Pixels that take part.
    pub(super) count: f64,
}

/// Derivatives of each pixel by the unknowns, an array for each; those by the shape are for the
/// greys of the moment.
pub(super) struct Columns(Vec<Vec<f32>>);

impl Columns {
    /// Those by shape and greys.
    pub(super) fn all(&self) -> &[Vec<f32>] {
        &self.0
    }

    /// Those by the greys.
    pub(super) fn greys(&self) -> &[Vec<f32>] {
        &self.0[SHAPE..]
    }
}

impl Patch {
    /// `None` where the picture does not show all of it, or it is too large.
    pub(super) fn around(image: &GrayImage, view: &View) -> Option<Self> {
        let half = view.half(REACH);
        let range = |centre: f64, half: f64, size: usize| {
            let (first, last) = ((centre - half).floor(), (centre + half).ceil());
            (first >= 0.0 && last < size as f64).then(|| first as usize..last as usize + 1)
        };
        let seen = range(view.centre.x, half.x, image.width)?;
        let rows = range(view.centre.y, half.y, image.height)?;
        let columns = seen.start..seen.start + seen.len().next_multiple_of(LANES);
        if columns.len() > BLOCKS * LANES {
            return None;
        }
        let shape = (view.map * view.map.transpose()).try_inverse()?;
        let (mut inside, mut greys) = (Vec::new(), Vec::new());
        for y in rows.clone() {
            for x in columns.clone() {
                let offset = Vector2::new(x as f64, y as f64) - view.centre;
                let is_near = (offset.transpose() * shape * offset)[0] < REACH * REACH;
                let part = f32::from(u8::from(is_near && seen.contains(&x)));
                inside.push(part);
                greys.push(if part > 0.0 { f32::from(image.row(y)[x]) } else { 0.0 });
            }
        }
        let count: f32 = inside.iter().sum();
        let mean = greys.iter().sum::<f32>() / count;
        greys.iter_mut().zip(&inside).for_each(|(grey, part)| *grey -= mean * part);
        Some(Self { columns, rows, inside, greys, count: f64::from(count) })
    }

    /// The grey levels above their mean.
    pub(super) fn greys(&self) -> &[f32] {
        &self.greys
    }

    /// What greys leave unexplained.
    pub(super) fn left(&self, columns: &Columns, greys: &[f64]) -> Vec<f32> {
        let mut left = self.greys.clone();
        for (column, &grey) in columns.greys().iter().zip(greys) {
            left.iter_mut().zip(column).for_each(|(left, by)| *left -= grey as f32 * by);
        }
        left
    }

    /// Correlation of residuals with their right and lower neighbours.
    pub(super) fn correlation(&self, left: &[f32]) -> f64 {
        let (width, square) = (self.columns.len(), f64::from(lanes::dot(left, left)));
        let products = |shift: usize| -> f64 {
            left.iter().zip(&left[shift..]).map(|(a, b)| f64::from(a * b)).sum()
        };
        (products(1) + products(width)) / (2.0 * square)
    }

    /// The derivatives at a view; those by the shape only with greys.
    pub(super) fn columns(&self, view: &View, greys: Option<&[f64]>) -> Columns {
        let mut columns = vec![vec![0.0; self.greys.len()]; UNKNOWNS];
        self.fill_ground(view, &mut columns[SHAPE..SHAPE + DISC]);
        for part in 0..=SECTORS {
            let grey = greys.map(|greys| greys[DISC + part] as f32);
            for_points(part, view, |point, area| {
                self.add_point(view, part, Point { at: point, area, grey }, &mut columns);
            });
        }
        if let Some(greys) = greys {
            add_area(view, greys, &mut columns);
        }
        for column in &mut columns {
            column.iter_mut().zip(&self.inside).for_each(|(value, part)| *value *= part);
        }
        Columns(columns)
    }

    /// One, and the place.
    fn fill_ground(&self, view: &View, ground: &mut [Vec<f32>]) {
        let width = self.columns.len();
        let [one, across, down] = ground else { return };
        for (i, ((one, across), down)) in one.iter_mut().zip(across).zip(down).enumerate() {
            *one = 1.0;
            *across = ((self.columns.start + i % width) as f64 - view.centre.x) as f32;
            *down = ((self.rows.start + i / width) as f64 - view.centre.y) as f32;
        }
    }

    /// Adds the light of a point of disc (part 0) or sector.
    fn add_point(&self, view: &View, part: usize, point: Point, columns: &mut [Vec<f32>]) {
        let (from, first) = if part == 0 { (view.centre, 0) } else { (view.ring, 2) };
        let at = from + view.map * point.at - self.corner();
        let blur = view.blur as f32;
        let precision = 1.0 / (blur * blur);
        let peak = point.area as f32 * precision / std::f32::consts::TAU;
        let reach = TAIL * view.blur;
        let bound = |at: f64, end: usize| at.clamp(0.0, end as f64) as usize;
        let rows =
            bound(at.y - reach + 1.0, self.rows.len())..bound(at.y + reach + 1.0, self.rows.len());
        let width = self.columns.len();
        let blocks =
            bound(at.x - reach, width) / LANES..bound(at.x + reach + 1.0, width).div_ceil(LANES);
        let mut across = [[Lanes::ZERO; 2]; BLOCKS];
        for (slot, block) in across.iter_mut().zip(blocks.clone()) {
            let away: [f32; LANES] =
                std::array::from_fn(|i| ((block * LANES + i) as f64 - at.x) as f32);
            let bells = away.map(|d| peak * lanes::exp(-0.5 * d * d * precision));
            *slot = [Lanes::new(away), Lanes::new(bells)];
        }
        let [px, py] = [point.at.x as f32, point.at.y as f32].map(Lanes::all);
        for y in rows {
            let dy = (y as f64 - at.y) as f32;
            let down = lanes::exp(-0.5 * dy * dy * precision);
            for (block, &[dx, bell]) in blocks.clone().zip(&across) {
                let place = y * width + block * LANES;
                let mut add = |column: usize, value: Lanes| {
                    let slot = &mut columns[column][place..place + LANES];
                    slot.copy_from_slice(&(Lanes::from_slice(slot) + value).values());
                };
                let light = bell * Lanes::all(down);
                add(SHAPE + DISC + part, light);
                let Some(grey) = point.grey else { continue };
                let pull = light * Lanes::all(grey * precision);
                let (gx, gy) = (pull * dx, pull * Lanes::all(dy));
                add(first, gx);
                add(first + 1, gy);
                add(4, gx * px);
                add(5, gx * py);
                add(6, gy * px);
                add(7, gy * py);
                let spread = gx * dx + gy * Lanes::all(dy) - light * Lanes::all(2.0 * grey);
                add(8, spread * Lanes::all(1.0 / blur));
            }
        }
    }

    /// The first pixel.
    fn corner(&self) -> Vector2<f64> {
        Vector2::new(self.columns.start as f64, self.rows.start as f64)
    }
}

/// A point of the print, the area of the picture that it stands for, and its grey level.
#[derive(Clone, Copy)]
struct Point {
    at: Vector2<f64>,
    area: f64,
    grey: Option<f32>,
}

/// A larger print has more light: the derivative of the area by the map.
fn add_area(view: &View, greys: &[f64], columns: &mut [Vec<f32>]) {
    let Some(inverse) = view.map.try_inverse() else { return };
    let by_map = [inverse[(0, 0)], inverse[(1, 0)], inverse[(0, 1)], inverse[(1, 1)]];
    let (shape, lights) = columns.split_at_mut(SHAPE + DISC);
    for (light, &grey) in lights.iter().zip(&greys[DISC..]) {
        for (slot, by) in shape[4..8].iter_mut().zip(by_map) {
            let by = (grey * by) as f32;
            slot.iter_mut().zip(light).for_each(|(slot, light)| *slot += by * light);
        }
    }
}

/// Calls `each` for the points of disc (part 0) or a sector, in radii of the disc, with the area in
/// pixels that each stands for.
fn for_points(part: usize, view: &View, mut each: impl FnMut(Vector2<f64>, f64)) {
    // The norm is no less than the large semi-axis.
    let (large, area) = (view.map.norm(), view.map.determinant().abs());
    let count = |length: f64| ((length * large / (APART * view.blur)) as usize + 1).clamp(2, 60);
    let sector = TAU / SECTORS as f64;
    let (from, begin, whole) = match part {
        0 => (0.0, 0.0, TAU),
        _ => (2.0, (part - 1) as f64 * sector, sector),
    };
    let radii = count(1.0);
    let step = 1.0 / radii as f64;
    for i in 0..radii {
        let radius = from + (i as f64 + 0.5) * step;
        let turns = count(radius * whole);
        let turn = whole / turns as f64;
        let rotate = nalgebra::Rotation2::new(turn);
        let mut point = nalgebra::Rotation2::new(begin + 0.5 * turn) * Vector2::new(radius, 0.0);
        for _ in 0..turns {
            each(point, radius * step * turn * area);
            point = rotate * point;
        }
    }
}
