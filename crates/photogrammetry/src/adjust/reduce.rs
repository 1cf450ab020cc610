//! Elimination: points first, independent poses second, the border by Cholesky.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix3, Vector3};
use rayon::prelude::*;

use super::layout::Layout;
use super::normal::{Common, GroupNormal, Normal, PointNormal};
use super::structure::{Group, Point, Structure};

/// An independent pose after its points are eliminated.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ReducedPose {
    /// Factor L of its own block, `L L^T`.
    pub factor: DMatrix<f64>,
    /// `E L^-T`: its coupling to the border (border by pose).
    pub scaled: DMatrix<f64>,
    /// `L^-1 g`.
    gradient: DVector<f64>,
}

/// The system that is left in the border.
#[derive(Debug, Clone)]
pub(super) struct Reduced {
    pub factor: Cholesky<f64, Dyn>,
    gradient: DVector<f64>,
    pub poses: Vec<ReducedPose>,
}

/// A step of all unknowns.
#[derive(Debug, Clone)]
pub(super) struct Step {
    /// Border and independent poses.
    pub common: DVector<f64>,
    /// Eliminated points, as in the structure.
    pub points: Vec<Vector3<f64>>,
    /// By how much the linear model lowers chi squared, to first order in what the damping leaves.
    pub gain: f64,
}

/// A point whose determinant is below this part of the product of its diagonal is not determined.
const FLAT: f64 = 1e-15;

/// The inverse of a point's own block. A point that is not determined has none.
#[inline]
pub(super) fn point_inverse(own: &Matrix3<f64>, damping: f64) -> Option<Matrix3<f64>> {
    let d = own.diagonal() * (1.0 + damping);
    let (xy, xz, yz) = (own[(1, 0)], own[(2, 0)], own[(2, 1)]);
    let xx = d.y * d.z - yz * yz;
    let yx = xz * yz - xy * d.z;
    let zx = xy * yz - xz * d.y;
    let determinant = d.x * xx + xy * yx + xz * zx;
    if determinant.is_nan() || determinant <= FLAT * d.product() {
        return None;
    }
    let yy = d.x * d.z - xz * xz;
    let zy = xy * xz - d.x * yz;
    let zz = d.x * d.y - xy * xy;
    Some(Matrix3::new(xx, yx, zx, yx, yy, zy, zx, zy, zz) / determinant)
}

/// Eliminates everything but the border. `None` where a block has no inverse.
pub(super) fn reduce(
    normal: &Normal,
    layout: &Layout,
    structure: &Structure,
    damping: f64,
) -> Option<Reduced> {
    let mut common = damped(&normal.common, damping);
    let parts: Vec<Option<Common>> = match (structure.groups.as_slice(), normal.groups.as_slice()) {
        ([group], [sums]) => vec![eliminate_points(layout, structure, group, sums, damping)],
        (groups, sums) => groups
            .par_iter()
            .zip(sums)
            .map(|(group, sums)| eliminate_points(layout, structure, group, sums, damping))
            .collect(),
    };
    for part in parts {
        common.add(&part?);
    }
    let Common { mut border, mut gradient, poses } = common;
    let poses: Vec<ReducedPose> =
        poses.into_iter().map(|pose| reduced_pose(pose?)).collect::<Option<_>>()?;
    eliminate_poses(&mut border, &mut gradient, &poses);
    Some(Reduced { factor: border.cholesky()?, gradient, poses })
}

fn damped(common: &Common, damping: f64) -> Common {
    let mut common = common.clone();
    for i in 0..common.border.nrows() {
        common.border[(i, i)] *= 1.0 + damping;
    }
    for pose in common.poses.iter_mut().flatten() {
        for i in 0..pose.own.nrows() {
            pose.own[(i, i)] *= 1.0 + damping;
        }
    }
    common
}

/// What the points of a group take from the rest.
fn eliminate_points(
    layout: &Layout,
    structure: &Structure,
    group: &Group,
    sums: &GroupNormal,
    damping: f64,
) -> Option<Common> {
    let mut common = Common::zeros(layout);
    let mut scaled = Vec::new();
    for (point, own) in structure.points[group.points.clone()].iter().zip(&sums.points) {
        let inverse = point_inverse(&own.own, damping)?;
        let coupling = &sums.coupling[point.coupling..][..3 * point.width];
        scale(coupling, point.width, &inverse, &mut scaled);
        take_away(&mut common, layout, structure, point, coupling, &scaled, &own.gradient);
    }
    Some(common)
}

/// `-W V^-1`, in three columns like W.
fn scale(coupling: &[f64], width: usize, inverse: &Matrix3<f64>, scaled: &mut Vec<f64>) {
    scaled.clear();
    let (x, rest) = coupling.split_at(width);
    let (y, z) = rest.split_at(width);
    for column in 0..3 {
        let v = [inverse[(0, column)], inverse[(1, column)], inverse[(2, column)]];
        scaled.extend(x.iter().zip(y).zip(z).map(|((x, y), z)| -(x * v[0] + y * v[1] + z * v[2])));
    }
}

fn take_away(
    common: &mut Common,
    layout: &Layout,
    structure: &Structure,
    point: &Point,
    coupling: &[f64],
    scaled: &[f64],
    gradient: &Vector3<f64>,
) {
    let width = point.width;
    let (x, y, z) = (&scaled[..width], &scaled[width..2 * width], &scaled[2 * width..]);
    let runs = &structure.runs[point.runs.clone()];
    let (border, own) = runs.split_at(runs.len() - usize::from(point.independent.is_some()));
    let (columns, rows) = (Columns { scaled, width }, common.border.nrows());
    for (i, run) in border.iter().enumerate() {
        for row in run.row..run.row + run.len {
            let at = run.at + row - run.row;
            common.gradient[at] += x[row] * gradient.x + y[row] * gradient.y + z[row] * gradient.z;
        }
        // Two columns at a time: half the loads. The one element that this puts above the diagonal
        // is never read.
        for k in (0..run.len).step_by(2) {
            let start = (run.at + k) * rows;
            let both = &mut common.border.as_mut_slice()[start..];
            let row = run.row + k;
            let first = weights(coupling, width, row);
            let (column, next) = both.split_at_mut(rows);
            let second = (k + 1 < run.len).then(|| weights(coupling, width, row + 1));
            for other in &border[i..] {
                let from = if other.at == run.at { k } else { 0 };
                let range = other.at + from..other.at + other.len;
                let row = other.row + from;
                match second {
                    Some(second) => columns.add_two(
                        &mut column[range.clone()],
                        &mut next[range],
                        row,
                        [first, second],
                    ),
                    None => columns.add(&mut column[range], row, first),
                }
            }
        }
    }
    let (Some(index), Some(run)) = (point.independent, own.first()) else { return };
    let pose = common.pose(index, layout.independent[index]);
    for k in 0..run.len {
        let row = run.row + k;
        let w = weights(coupling, width, row);
        pose.gradient[k] += x[row] * gradient.x + y[row] * gradient.y + z[row] * gradient.z;
        let column = pose.border.column_mut(k).data.into_slice_mut();
        for other in border {
            columns.add(&mut column[other.at..other.at + other.len], other.row, w);
        }
        let column = pose.own.column_mut(k).data.into_slice_mut();
        columns.add(&mut column[k..run.len], row, w);
    }
}

/// A row of the coupling.
#[inline]
fn weights(coupling: &[f64], width: usize, row: usize) -> [f64; 3] {
    [coupling[row], coupling[width + row], coupling[2 * width + row]]
}

/// The three columns of `-W V^-1`.
#[derive(Clone, Copy)]
struct Columns<'a> {
    scaled: &'a [f64],
    width: usize,
}

impl Columns<'_> {
    /// The three columns from a row on.
    #[inline]
    fn from(&self, row: usize, n: usize) -> [&[f64]; 3] {
        [0, 1, 2].map(|axis| &self.scaled[axis * self.width + row..][..n])
    }

    /// Adds the product with one row of the coupling to a column.
    #[inline]
    fn add(&self, target: &mut [f64], row: usize, w: [f64; 3]) {
        let [x, y, z] = self.from(row, target.len());
        for (((t, x), y), z) in target.iter_mut().zip(x).zip(y).zip(z) {
            *t += x * w[0] + y * w[1] + z * w[2];
        }
    }

    /// The same with two rows, to two columns.
    #[inline]
    fn add_two(&self, a: &mut [f64], b: &mut [f64], row: usize, w: [[f64; 3]; 2]) {
        let [x, y, z] = self.from(row, a.len());
        for ((((a, b), x), y), z) in a.iter_mut().zip(b).zip(x).zip(y).zip(z) {
            *a += x * w[0][0] + y * w[0][1] + z * w[0][2];
            *b += x * w[1][0] + y * w[1][1] + z * w[1][2];
        }
    }
}

fn reduced_pose(pose: super::normal::Pose) -> Option<ReducedPose> {
    let factor = pose.own.cholesky()?.unpack();
    // E L^-T: solve L X^T = E^T.
    let scaled = factor.solve_lower_triangular(&pose.border.transpose())?.transpose();
    let gradient = factor.solve_lower_triangular(&pose.gradient)?;
    Some(ReducedPose { factor, scaled, gradient })
}

fn eliminate_poses(border: &mut DMatrix<f64>, gradient: &mut DVector<f64>, poses: &[ReducedPose]) {
    let columns: usize = poses.iter().map(|p| p.scaled.ncols()).sum();
    if columns == 0 {
        return;
    }
    let mut all = DMatrix::zeros(border.nrows(), columns);
    let mut at = 0;
    for pose in poses {
        let n = pose.scaled.ncols();
        all.columns_mut(at, n).copy_from(&pose.scaled);
        at += n;
        gradient.gemv(-1.0, &pose.scaled, &pose.gradient, 1.0);
    }
    border.gemm(-1.0, &all, &all.transpose(), 1.0);
}

impl Reduced {
    /// The step of the border and the independent poses.
    pub fn solve(&self, layout: &Layout) -> DVector<f64> {
        let mut step = DVector::zeros(layout.size);
        let border = self.factor.solve(&self.gradient);
        for (pose, block) in self.poses.iter().zip(&layout.independent) {
            let right = &pose.gradient - pose.scaled.tr_mul(&border);
            let own = pose.factor.tr_solve_lower_triangular(&right).unwrap_or(right);
            step.rows_mut(block.at, block.len).copy_from(&own);
        }
        step.rows_mut(0, layout.border).copy_from(&border);
        step
    }
}

/// The whole damped step. `None` where a block has no inverse.
pub(super) fn damped_step(
    normal: &Normal,
    layout: &Layout,
    structure: &Structure,
    damping: f64,
) -> Option<Step> {
    let common = reduce(normal, layout, structure, damping)?.solve(layout);
    let mut gain = normal.common.gradient.dot(&common.rows(0, layout.border));
    for (pose, block) in normal.common.poses.iter().zip(&layout.independent) {
        gain += pose.as_ref().map_or(0.0, |p| p.gradient.dot(&common.rows(block.at, block.len)));
    }
    let mut points = Vec::with_capacity(structure.points.len());
    for (group, sums) in structure.groups.iter().zip(&normal.groups) {
        for (point, own) in structure.points[group.points.clone()].iter().zip(&sums.points) {
            let coupling = &sums.coupling[point.coupling..][..3 * point.width];
            let shift = back_substitute(structure, point, own, coupling, &common, damping)?;
            gain += own.gradient.dot(&shift);
            points.push(shift);
        }
    }
    Some(Step { common, points, gain })
}

fn back_substitute(
    structure: &Structure,
    point: &Point,
    own: &PointNormal,
    coupling: &[f64],
    step: &DVector<f64>,
    damping: f64,
) -> Option<Vector3<f64>> {
    let mut right = own.gradient;
    for run in &structure.runs[point.runs.clone()] {
        let step = &step.as_slice()[run.at..run.at + run.len];
        for axis in 0..3 {
            let column = &coupling[axis * point.width + run.row..][..run.len];
            right[axis] -= column.iter().zip(step).map(|(w, s)| w * s).sum::<f64>();
        }
    }
    Some(point_inverse(&own.own, damping)? * right)
}
