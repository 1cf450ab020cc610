//! The pixels around a disc's edge, and the normal equations of the edge over them.
//!
//! Model and derivatives are computed for a block of pixels at a time, in single precision (its
//! rounding is a ten-thousandth of the noise); sums over blocks are double.

use nalgebra::{Matrix2, SMatrix, Vector2};

use super::edge_fit::{Model, Normal, PARAMETERS, Vector, half_band};
use super::ellipse::Ellipse;
use crate::detect::lanes::{self, LANES};
use crate::image::GrayImage;

/// Pixels that are computed together: their columns stay in the nearest cache.
const BLOCK: usize = 256;

/// The edge of an ellipse, and enough of disc and quiet zone for their levels.
pub(super) struct Band {
    /// Where the pixels' places count from, pixels.
    pub(super) origin: Vector2<f64>,
    /// Columns to the right and rows down from there, and grey level of each pixel, row by row;
    /// filled up with zeros to whole lanes.
    pub(super) pixels: [Vec<f32>; 3],
    /// Number of pixels.
    pub(super) count: usize,
}

/// Sums of the normal equations.
pub(super) struct Sums {
    pub(super) normal: Normal,
    pub(super) right: Vector,
    /// Number of pixels.
    pub(super) count: f64,
    /// Sum of the squared residuals.
    pub(super) squares: f64,
}

/// Sums that are made side by side, so that one does not wait for its own last addition.
const TOGETHER: usize = 4;

/// Sums of products of all pairs of columns, lower triangle.
type Products = SMatrix<f64, { PARAMETERS + 1 }, { PARAMETERS + 1 }>;

/// Derivatives by the parameters, then the residual, pixel by pixel.
type Columns = [[f32; BLOCK]; PARAMETERS + 1];

impl Band {
    /// The pixels around an ellipse.
    pub(super) fn around(image: &GrayImage, ellipse: &Ellipse) -> Self {
        let half = half_band(ellipse);
        let inverse = ellipse.shape.try_inverse().unwrap_or_else(Matrix2::zeros);
        let reach = Vector2::new(inverse[(0, 0)].sqrt(), inverse[(1, 1)].sqrt()) * (1.0 + half);
        let range = |centre: f64, reach: f64, size: usize| {
            let first = (centre - reach).ceil().max(0.0) as usize;
            first..((centre + reach).floor().max(-1.0) + 1.0).min(size as f64) as usize
        };
        let squares = (1.0 - half).powi(2)..(1.0 + half).powi(2);
        let (columns, rows) = (
            range(ellipse.centre.x, reach.x, image.width),
            range(ellipse.centre.y, reach.y, image.height),
        );
        let origin = ellipse.centre.map(f64::round);
        let room = (columns.len() * rows.len()).next_multiple_of(LANES);
        let mut pixels = [const { Vec::new() }; 3];
        pixels.iter_mut().for_each(|column| column.reserve(room));
        for y in rows {
            for (x, &grey) in columns.clone().zip(&image.row(y)[columns.clone()]) {
                let at = Vector2::new(x as f64, y as f64);
                if squares.contains(&ellipse.square_radius(&at)) {
                    let place = at - origin;
                    let values = [place.x as f32, place.y as f32, f32::from(grey)];
                    pixels.iter_mut().zip(values).for_each(|(column, value)| column.push(value));
                }
            }
        }
        let count = pixels[0].len();
        let padded = count.next_multiple_of(LANES);
        pixels.iter_mut().for_each(|column| column.resize(padded, 0.0));
        Self { origin, pixels, count }
    }

    /// The normal equations at a model; `None` where there are too few pixels.
    pub(super) fn sums(&self, model: &Model) -> Option<Sums> {
        let mut all = Products::zeros();
        self.for_blocks(model, |columns, length| add_products(columns, length, &mut all));
        self.sums_of(&all)
    }

    /// Likewise, and the sum of the outer products of the derivatives, each times its squared
    /// residual.
    pub(super) fn sums_and_scatter(&self, model: &Model) -> Option<(Sums, Normal)> {
        let (mut all, mut scatter) = (Products::zeros(), Normal::zeros());
        self.for_blocks(model, |columns, length| {
            add_products(columns, length, &mut all);
            let (derivatives, residual) = columns.split_at_mut(PARAMETERS);
            for column in derivatives.iter_mut() {
                column.iter_mut().zip(&residual[0]).for_each(|(d, e)| *d *= e);
            }
            add_products(derivatives, length, &mut scatter);
        });
        let scatter = Normal::from_fn(|i, j| scatter[(i.max(j), i.min(j))]);
        Some((self.sums_of(&all)?, scatter))
    }

    fn sums_of(&self, all: &Products) -> Option<Sums> {
        let normal = Normal::from_fn(|i, j| all[(i.max(j), i.min(j))]);
        let right = Vector::from_fn(|i, _| all[(PARAMETERS, i)]);
        let (count, squares) = (self.count as f64, all[(PARAMETERS, PARAMETERS)]);
        (count > 3.0 * PARAMETERS as f64).then_some(Sums { normal, right, count, squares })
    }

    /// Calls `each` for every block with its length, a multiple of [`LANES`]; beyond the last pixel
    /// all columns are zero up to there.
    fn for_blocks(&self, model: &Model, mut each: impl FnMut(&mut Columns, usize)) {
        let edge = Edge::new(model, &self.origin);
        let mut columns: Columns = [[0.0; BLOCK]; PARAMETERS + 1];
        let [x, y, grey] = &self.pixels;
        let blocks = x.chunks(BLOCK).zip(y.chunks(BLOCK)).zip(grey.chunks(BLOCK));
        for (index, ((x, y), grey)) in blocks.enumerate() {
            edge.fill(x, y, grey, &mut columns);
            let count = self.count - index * BLOCK;
            for column in columns.iter_mut().filter(|_| count < x.len()) {
                column[count..x.len()].fill(0.0);
            }
            each(&mut columns, x.len());
        }
    }
}

/// Adds the sums of products of each column with itself and those before it.
fn add_products<const N: usize>(
    columns: &[[f32; BLOCK]],
    length: usize,
    all: &mut SMatrix<f64, N, N>,
) {
    for i in 0..N {
        for first in (0..=i).step_by(TOGETHER) {
            let others = std::array::from_fn(|k| &columns[(first + k).min(i)][..length]);
            let sums: [f32; TOGETHER] = lanes::dots(&columns[i][..length], others);
            for (j, sum) in (first..=i).zip(sums) {
                all[(i, j)] += f64::from(sum);
            }
        }
    }
}

/// The model in single precision.
struct Edge {
    centre: [f32; 2],
    shape: [f32; 3],
    ground: f32,
    difference: f32,
    slope: [f32; 2],
    blur: f32,
}

impl Edge {
    fn new(model: &Model, origin: &Vector2<f64>) -> Self {
        let centre = model.ellipse.centre - origin;
        let (shape, levels) = (&model.ellipse.shape, &model.levels);
        Self {
            centre: [centre.x as f32, centre.y as f32],
            shape: [shape[(0, 0)] as f32, shape[(0, 1)] as f32, shape[(1, 1)] as f32],
            ground: levels.ground as f32,
            difference: (levels.disc - levels.ground) as f32,
            slope: [levels.slope.x as f32, levels.slope.y as f32],
            blur: model.blur as f32,
        }
    }

    /// Derivatives and residuals of a block.
    fn fill(&self, x: &[f32], y: &[f32], grey: &[f32], columns: &mut Columns) {
        let [xx, xy, yy] = self.shape;
        let peak = 1.0 / (std::f32::consts::TAU.sqrt() * self.blur);
        let length = x.len().min(BLOCK).min(y.len()).min(grey.len());
        let (x, y, grey) = (&x[..length], &y[..length], &grey[..length]);
        for i in 0..length {
            let (u, v) = (x[i] - self.centre[0], y[i] - self.centre[1]);
            let (gx, gy) = (xx * u + xy * v, xy * u + yy * v);
            let radius = (u * gx + v * gy).max(1e-6).sqrt();
            let steepness = (gx * gx + gy * gy).max(1e-12).sqrt() / radius;
            let t = (radius - 1.0) / (steepness * self.blur);
            let bell = lanes::exp(-0.5 * t * t);
            let part = upper_tail(t, bell);
            let density = bell * peak * self.difference;
            let light = 1.0 + self.slope[0] * u + self.slope[1] * v;
            let plain = self.ground + self.difference * part;
            // By the radius, over the radius; the change of the steepness is of second order.
            let by_radius = -density * light / (steepness * radius);
            columns[0][i] = -gx * by_radius;
            columns[1][i] = -gy * by_radius;
            columns[2][i] = 0.5 * by_radius * u * u;
            columns[3][i] = by_radius * u * v;
            columns[4][i] = 0.5 * by_radius * v * v;
            columns[5][i] = light * part;
            columns[6][i] = light * (1.0 - part);
            columns[7][i] = density * t * light;
            columns[8][i] = plain * u;
            columns[9][i] = plain * v;
            columns[10][i] = grey[i] - light * plain;
        }
    }
}

/// Part of a normal distribution above t, error below 3e-7 (Abramowitz and Stegun 7.1.26, and
/// rounding); `bell` is `exp(-t^2 / 2)`.
#[inline]
fn upper_tail(t: f32, bell: f32) -> f32 {
    let z = t.abs() * std::f32::consts::FRAC_1_SQRT_2;
    let r = 1.0 / (1.0 + 0.327_591_1 * z);
    let series = (1.061_405_4 * r - 1.453_152) * r + 1.421_413_7;
    let polynomial = ((series * r - 0.284_496_74) * r + 0.254_829_6) * r;
    let tail = 0.5 * polynomial * bell;
    if t >= 0.0 { tail } else { 1.0 - tail }
}
