//! The normal equations, before anything is eliminated.

use nalgebra::{DMatrix, DVector, Matrix3, Vector2, Vector3};
use rayon::prelude::*;

use super::layout::{Block, Layout, PointPlace};
use super::loss::Loss;
use super::problem::Problem;
use super::rows::{Linear, Rows};
use super::structure::{Group, Row, Structure, Touch};

/// An independent pose's part: its own block, its coupling to the border, its gradient.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Pose {
    pub own: DMatrix<f64>,
    /// Border by pose.
    pub border: DMatrix<f64>,
    pub gradient: DVector<f64>,
}

/// The part of the normal equations that all points share.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Common {
    /// Lower triangle.
    pub border: DMatrix<f64>,
    pub gradient: DVector<f64>,
    /// Independent poses; `None` while nothing was added.
    pub poses: Vec<Option<Pose>>,
}

impl Common {
    pub fn zeros(layout: &Layout) -> Self {
        Self {
            border: DMatrix::zeros(layout.border, layout.border),
            gradient: DVector::zeros(layout.border),
            poses: vec![None; layout.independent.len()],
        }
    }

    pub fn pose(&mut self, index: usize, block: Block) -> &mut Pose {
        let border = self.gradient.len();
        self.poses[index].get_or_insert_with(|| Pose {
            own: DMatrix::zeros(block.len, block.len),
            border: DMatrix::zeros(border, block.len),
            gradient: DVector::zeros(block.len),
        })
    }

    /// Adds another part.
    pub fn add(&mut self, other: &Self) {
        self.border += &other.border;
        self.gradient += &other.gradient;
        for (mine, theirs) in self.poses.iter_mut().zip(&other.poses) {
            match (mine.as_mut(), theirs) {
                (Some(mine), Some(theirs)) => {
                    mine.own += &theirs.own;
                    mine.border += &theirs.border;
                    mine.gradient += &theirs.gradient;
                }
                (None, Some(_)) => mine.clone_from(theirs),
                (_, None) => {}
            }
        }
    }

    /// Adds to one element of the matrix; `a` and `b` in any order.
    fn add_at(&mut self, layout: &Layout, a: usize, b: usize, value: f64) {
        let (low, high) = (a.min(b), a.max(b));
        match (layout.independent_at(low), layout.independent_at(high)) {
            (None, None) => self.border[(high, low)] += value,
            (None, Some(pose)) => {
                let block = layout.independent[pose];
                self.pose(pose, block).border[(low, high - block.at)] += value;
            }
            (Some(pose), _) => {
                let block = layout.independent[pose];
                self.pose(pose, block).own[(high - block.at, low - block.at)] += value;
            }
        }
    }

    fn add_gradient(&mut self, layout: &Layout, at: usize, value: f64) {
        match layout.independent_at(at) {
            None => self.gradient[at] += value,
            Some(pose) => {
                let block = layout.independent[pose];
                self.pose(pose, block).gradient[at - block.at] += value;
            }
        }
    }

    /// Adds an observation of one number.
    pub fn add_scalar(&mut self, layout: &Layout, jacobian: &[(usize, f64)], observed: Scalar) {
        let weight = 1.0 / (observed.sigma * observed.sigma);
        for (i, (at, slope)) in jacobian.iter().enumerate() {
            self.add_gradient(layout, *at, weight * slope * observed.residual);
            for (other, other_slope) in &jacobian[..=i] {
                self.add_at(layout, *at, *other, weight * slope * other_slope);
            }
        }
    }
}

/// An observation of one number.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scalar {
    pub residual: f64,
    pub sigma: f64,
}

impl Scalar {
    pub fn square(self) -> f64 {
        (self.residual / self.sigma).powi(2)
    }
}

/// A point's own block.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct PointNormal {
    pub own: Matrix3<f64>,
    pub gradient: Vector3<f64>,
}

/// The points of a group.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct GroupNormal {
    pub points: Vec<PointNormal>,
    /// Per point three columns, one per coordinate, over the unknowns of its runs.
    pub coupling: Vec<f64>,
}

impl GroupNormal {
    fn reset(&mut self, points: usize, coupling: usize) {
        self.points.clear();
        self.points.resize(points, PointNormal::default());
        self.coupling.clear();
        self.coupling.resize(coupling, 0.0);
    }
}

/// The normal equations at one estimate.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Normal {
    pub common: Common,
    pub groups: Vec<GroupNormal>,
    /// The weighted sum of squares (of losses, where they are robust). Peers report half of it.
    pub chi2: f64,
}

/// Linearises everything. `None` where an observation has no image. `old` gives its memory: fresh
/// pages for every iteration cost as much as the sums.
pub(super) fn normal_equations(
    problem: &Problem,
    layout: &Layout,
    structure: &Structure,
    loss: Loss,
    old: Option<Normal>,
) -> Option<Normal> {
    let summation = Summation { problem, layout, structure, loss, rows: Rows::of(problem) };
    let mut memory = old.map_or_else(Vec::new, |old| old.groups);
    memory.resize_with(structure.groups.len(), GroupNormal::default);
    let parts: Vec<Option<(Common, GroupNormal, f64)>> = match structure.groups.as_slice() {
        [only] => memory.into_iter().map(|memory| summation.group(only, memory)).collect(),
        groups => groups
            .par_iter()
            .zip(memory)
            .map(|(group, memory)| summation.group(group, memory))
            .collect(),
    };
    let mut parts = parts.into_iter();
    let (mut common, first, mut chi2) = parts.next()??;
    let mut groups = vec![first];
    for part in parts {
        let (other, group, sum) = part?;
        common.add(&other);
        groups.push(group);
        chi2 += sum;
    }
    chi2 += summation.add_scalars(&mut common);
    Some(Normal { common, groups, chi2 })
}

struct Summation<'a> {
    problem: &'a Problem,
    layout: &'a Layout,
    structure: &'a Structure,
    loss: Loss,
    rows: Rows<'a>,
}

impl Summation<'_> {
    fn group(&self, group: &Group, mut normal: GroupNormal) -> Option<(Common, GroupNormal, f64)> {
        let mut common = Common::zeros(self.layout);
        let points = &self.structure.points[group.points.clone()];
        normal.reset(points.len(), group.coupling);
        let mut linear = Linear::new();
        let mut chi2 = 0.0;
        for (point, own) in points.iter().zip(&mut normal.points) {
            let coupling = &mut normal.coupling[point.coupling..][..3 * point.width];
            for row in &self.structure.rows[point.rows.clone()] {
                self.weigh(row, &mut linear, &mut chi2)?;
                let weighted = linear.information * linear.by_point;
                own.own += linear.by_point.transpose() * weighted;
                own.gradient += weighted.transpose() * linear.residual;
                couple(coupling, point.width, row, &linear, &weighted);
                self.add_row(&mut common, row, &linear);
            }
            for control in &self.structure.controls[point.controls.clone()] {
                chi2 += self.control(&mut common, own, coupling, point.width, *control);
            }
        }
        for row in &self.structure.rows[group.direct.clone()] {
            self.weigh(row, &mut linear, &mut chi2)?;
            self.add_row(&mut common, row, &linear);
        }
        Some((common, normal, chi2))
    }

    /// An observation with its weight under the loss.
    #[inline]
    fn weigh(&self, row: &Row, linear: &mut Linear, chi2: &mut f64) -> Option<()> {
        self.rows.linear(row.observed, linear)?;
        let (loss, slope) = self.loss.at(linear.square());
        *chi2 += loss;
        if slope < 1.0 {
            linear.information *= slope;
        }
        Some(())
    }

    /// Adds an observation to what all points share.
    #[inline]
    fn add_row(&self, common: &mut Common, row: &Row, linear: &Linear) {
        let touches = row.touches();
        for (i, a) in touches.iter().enumerate() {
            if a.at >= self.layout.border {
                self.add_independent(common, a, linear);
                continue;
            }
            for k in 0..a.len {
                let weighted = linear.information * linear.by_rest.column(a.column + k);
                common.gradient[a.at + k] += weighted.dot(&linear.residual);
                let column = common.border.column_mut(a.at + k).data.into_slice_mut();
                // The upper triangle of a run with itself is never read, but six at a time is quick.
                add_products(&mut column[a.at..a.at + a.len], linear, a.column, &weighted);
                for b in touches[i + 1..].iter().filter(|b| b.at < self.layout.border) {
                    add_products(&mut column[b.at..b.at + b.len], linear, b.column, &weighted);
                }
            }
            if let Some(b) = touches[i + 1..].iter().find(|b| b.at >= self.layout.border) {
                self.add_cross(common, a, b, linear);
            }
        }
    }

    /// Adds to the coupling of a run of the border with an independent pose.
    fn add_cross(&self, common: &mut Common, border: &Touch, own: &Touch, linear: &Linear) {
        let Some(index) = self.layout.independent_at(own.at) else { return };
        let pose = common.pose(index, self.layout.independent[index]);
        for k in 0..own.len {
            let weighted = linear.information * linear.by_rest.column(own.column + k);
            let column = pose.border.column_mut(k).data.into_slice_mut();
            let target = &mut column[border.at..border.at + border.len];
            add_products(target, linear, border.column, &weighted);
        }
    }

    fn add_independent(&self, common: &mut Common, touch: &Touch, linear: &Linear) {
        let Some(index) = self.layout.independent_at(touch.at) else { return };
        let pose = common.pose(index, self.layout.independent[index]);
        for a in 0..touch.len {
            let weighted = linear.information * linear.by_rest.column(touch.column + a);
            pose.gradient[a] += weighted.dot(&linear.residual);
            for b in a..touch.len {
                pose.own[(b, a)] += weighted.dot(&linear.by_rest.column(touch.column + b));
            }
        }
    }

    fn control(
        &self,
        common: &mut Common,
        own: &mut PointNormal,
        coupling: &mut [f64],
        width: usize,
        index: usize,
    ) -> f64 {
        let control = &self.problem.controls[index];
        let weight = 1.0 / (control.sigma * control.sigma);
        let residual =
            control.at * (1.0 + self.problem.artefact_scale) - self.problem.points[control.point];
        own.own += Matrix3::identity() * weight;
        own.gradient += residual * weight;
        if let Some(at) = self.layout.artefact_scale {
            // The scale moves the known side: its Jacobian on the computed one is minus the place.
            common.border[(at, at)] += weight * control.at.norm_squared();
            common.gradient[at] -= weight * control.at.dot(&residual);
            let runs = &self.structure.runs[self.runs_of(control.point)];
            let row = runs.iter().find(|r| (r.at..r.at + r.len).contains(&at));
            if let Some(row) = row.map(|r| r.row + at - r.at) {
                for axis in 0..3 {
                    coupling[axis * width + row] -= weight * control.at[axis];
                }
            }
        }
        weight * residual.norm_squared()
    }

    fn runs_of(&self, point: usize) -> std::ops::Range<usize> {
        self.structure.place[point].map_or(0..0, |i| self.structure.points[i].runs.clone())
    }

    /// Priors, scale bars and controls of points in the border; their part of the sum.
    fn add_scalars(&self, common: &mut Common) -> f64 {
        scalars(self.problem, self.layout, self.structure)
            .iter()
            .map(|(jacobian, observed)| {
                common.add_scalar(self.layout, jacobian, *observed);
                observed.square()
            })
            .sum()
    }
}

/// Adds the products of some columns of the Jacobian with one that is weighted.
#[inline]
fn add_products(target: &mut [f64], linear: &Linear, column: usize, weighted: &Vector2<f64>) {
    #[inline]
    fn sum(target: &mut [f64], columns: &[f64], weighted: &Vector2<f64>) {
        for (t, j) in target.iter_mut().zip(columns.chunks_exact(2)) {
            *t += weighted.x * j[0] + weighted.y * j[1];
        }
    }
    let columns = &linear.by_rest.as_slice()[2 * column..2 * (column + target.len())];
    // Poses are by far the most: a length that the compiler knows is unrolled.
    match (<&mut [f64; 6]>::try_from(&mut *target), <&[f64; 12]>::try_from(columns)) {
        (Ok(target), Ok(columns)) => sum(target, columns, weighted),
        _ => sum(target, columns, weighted),
    }
}

/// Adds an observation to its point's coupling.
#[inline]
fn couple(
    coupling: &mut [f64],
    width: usize,
    row: &Row,
    linear: &Linear,
    weighted_point: &nalgebra::Matrix2x3<f64>,
) {
    #[inline]
    fn sum(target: &mut [f64], columns: &[f64], w: [f64; 2]) {
        for (t, j) in target.iter_mut().zip(columns.chunks_exact(2)) {
            *t += j[0] * w[0] + j[1] * w[1];
        }
    }
    for touch in row.touches() {
        let columns = &linear.by_rest.as_slice()[2 * touch.column..2 * (touch.column + touch.len)];
        for axis in 0..3 {
            let w = [weighted_point[(0, axis)], weighted_point[(1, axis)]];
            let target = &mut coupling[axis * width + touch.row..][..touch.len];
            match (<&mut [f64; 6]>::try_from(&mut *target), <&[f64; 12]>::try_from(columns)) {
                (Ok(target), Ok(columns)) => sum(target, columns, w),
                _ => sum(target, columns, w),
            }
        }
    }
}

/// The Jacobian of an observation of one number: (unknown, slope of the computed value).
pub(super) type Slopes = Vec<(usize, f64)>;

/// All observations of single numbers.
pub(super) fn scalars(
    problem: &Problem,
    layout: &Layout,
    structure: &Structure,
) -> Vec<(Slopes, Scalar)> {
    let mut all = Vec::new();
    for (interior, block) in problem.interiors.iter().zip(&layout.interiors) {
        for (i, unknown) in interior.unknowns.iter().enumerate().take(block.len) {
            if let Some(prior) = unknown.prior {
                let residual = prior.value - unknown.parameter.of(&interior.camera);
                all.push((vec![(block.at + i, 1.0)], Scalar { residual, sigma: prior.sigma }));
            }
        }
    }
    for (module, block) in problem.modules.iter().zip(&layout.modules) {
        let (known, sigma) = module.scale_prior;
        if block.len == 7 {
            let residual = known - module.scale;
            all.push((vec![(block.at + 6, 1.0)], Scalar { residual, sigma }));
        }
    }
    let mut known_zero = |at: Option<usize>, value: f64, sigma: f64| {
        all.extend(at.map(|at| (vec![(at, 1.0)], Scalar { residual: -value, sigma })));
    };
    known_zero(layout.artefact_scale, problem.artefact_scale, problem.artefact_scale_sigma);
    known_zero(layout.fan_scale, problem.fan.scale, problem.fan.scale_sigma);
    for (i, error) in problem.fan.beams.iter().enumerate() {
        // Direction cosines of beams far off the axis move a little less than the angle; 3 % at 15
        // degrees are nothing for a prior.
        known_zero(Some(layout.fan_beams + 2 * i), error.x, problem.fan.beam_sigma);
        known_zero(Some(layout.fan_beams + 2 * i + 1), error.y, problem.fan.beam_sigma);
    }
    all.extend(problem.scale_bars.iter().filter_map(|bar| scale_bar(problem, layout, bar)));
    for &index in &structure.border_controls {
        border_control(problem, layout, index, &mut all);
    }
    all
}

/// A measured distance. `None` where its ends fall together.
fn scale_bar(
    problem: &Problem,
    layout: &Layout,
    bar: &super::problem::ScaleBar,
) -> Option<(Slopes, Scalar)> {
    let way = problem.points[bar.ends[1]] - problem.points[bar.ends[0]];
    let along = way.try_normalize(1e-12)?;
    let mut jacobian = Slopes::new();
    for (end, sign) in bar.ends.iter().zip([-1.0, 1.0]) {
        if let PointPlace::Border(at) = layout.points[*end] {
            jacobian.extend((0..3).map(|axis| (at + axis, sign * along[axis])));
        }
    }
    Some((jacobian, Scalar { residual: bar.length - way.norm(), sigma: bar.sigma }))
}

fn border_control(
    problem: &Problem,
    layout: &Layout,
    index: usize,
    all: &mut Vec<(Slopes, Scalar)>,
) {
    let control = &problem.controls[index];
    let PointPlace::Border(at) = layout.points[control.point] else { return };
    let place = control.at * (1.0 + problem.artefact_scale);
    for axis in 0..3 {
        let mut jacobian = vec![(at + axis, 1.0)];
        jacobian.extend(layout.artefact_scale.map(|scale| (scale, -control.at[axis])));
        let residual = place[axis] - problem.points[control.point][axis];
        all.push((jacobian, Scalar { residual, sigma: control.sigma }));
    }
}
