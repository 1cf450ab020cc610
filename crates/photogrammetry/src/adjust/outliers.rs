//! Data snooping and variance components: which observation does not fit, and how true the stated
//! noise of a kind of observation is.
//!
//! A residual is tested against its own standard deviation, not against that of the observation:
//! `w = v / sqrt(Q_vv)` (Baarda 1968), of an image point in two dimensions.

use nalgebra::{Matrix2, Vector2};

use super::covariance::Covariance;
use super::problem::Problem;
use super::reduce::point_inverse;
use super::rows::{Linear, Rows};
use super::structure::{Observed, Row};

/// An observation of an adjustment, by its index in the problem.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum ObservationId {
    /// In `images`.
    Image(usize),
    /// In `beams`.
    Beam(usize),
    /// In `controls`.
    Control(usize),
}

impl From<Observed> for ObservationId {
    fn from(observed: Observed) -> Self {
        match observed {
            Observed::Image(i) => Self::Image(i),
            Observed::Beam(i) => Self::Beam(i),
        }
    }
}

/// How an observation fits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tested {
    /// Which.
    pub observation: ObservationId,
    /// Length of its residual in standard deviations of the residual; 0 where nothing checks the
    /// observation.
    pub statistic: f64,
    /// Its part in the redundancy: 0 (nothing checks it) to 2, of a control to 3.
    pub redundancy: f64,
    /// Weighted square of its residual.
    pub square: f64,
}

/// Below this part of an observation's variance its residual says nothing about it.
const UNCHECKED: f64 = 0.02;

/// Tests those observations of an adjusted problem whose residual is longer than `from` of their
/// own standard deviations (0: all), in their order: images and beams by point, then controls.
///
/// Empty where the adjustment has no covariance.
#[must_use]
pub fn test_observations(problem: &Problem, covariance: &Covariance, from: f64) -> Vec<Tested> {
    if covariance.common().is_none() {
        return Vec::new();
    }
    let rows = Rows::of(problem);
    let mut found = Vec::new();
    let structure = &covariance.structure;
    for (place, point) in structure.points.iter().enumerate() {
        for row in &structure.rows[point.rows.clone()] {
            found.extend(test_row(&rows, covariance, row, Some(place), from));
        }
    }
    let direct = structure.groups.iter().map(|g| g.direct.start).min().unwrap_or(0);
    for row in &structure.rows[direct..] {
        found.extend(test_row(&rows, covariance, row, None, from));
    }
    let controls = structure.controls.iter().chain(&structure.border_controls);
    found.extend(controls.filter_map(|i| test_control(problem, covariance, *i, from)));
    found
}

fn test_row(
    rows: &Rows<'_>,
    covariance: &Covariance,
    row: &Row,
    point: Option<usize>,
    from: f64,
) -> Option<Tested> {
    let mut linear = Linear::new();
    rows.linear(row.observed, &mut linear)?;
    let square = linear.square();
    if square < from * from {
        return None;
    }
    let predicted = predicted(covariance, row, &linear, point)?;
    let root = linear.information.cholesky()?.l();
    let residual = root.transpose() * linear.residual;
    let checked = Matrix2::identity() - root.transpose() * predicted * root;
    let eigen = checked.symmetric_eigen();
    let mut statistic = 0.0;
    for (value, axis) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if *value > UNCHECKED {
            statistic += axis.dot(&residual).powi(2) / value;
        }
    }
    let observation = row.observed.into();
    let redundancy = eigen.eigenvalues.sum();
    Some(Tested { observation, statistic: statistic.sqrt(), redundancy, square })
}

/// Covariance of the computed value.
fn predicted(
    covariance: &Covariance,
    row: &Row,
    linear: &Linear,
    point: Option<usize>,
) -> Option<Matrix2<f64>> {
    let mut slopes: Vec<(usize, Vector2<f64>)> = Vec::new();
    let mut own = Matrix2::zeros();
    let column = |c: usize| -> Vector2<f64> { linear.by_rest.column(c).into() };
    match point {
        None => {
            for touch in row.touches() {
                slopes.extend((0..touch.len).map(|k| (touch.at + k, column(touch.column + k))));
            }
        }
        Some(place) => {
            let structure = &covariance.structure;
            let plan = &structure.points[place];
            let group = structure.group_of(place);
            let sums = &covariance.normal.groups[group];
            let block = sums.points[place - structure.groups[group].points.start].own;
            let inverse = point_inverse(&block, 0.0)?;
            let by_point = linear.by_point * inverse;
            own = by_point * linear.by_point.transpose();
            let coupling = &sums.coupling[plan.coupling..][..3 * plan.width];
            for run in &structure.runs[plan.runs.clone()] {
                for k in 0..run.len {
                    let w = [0, 1, 2].map(|axis| coupling[axis * plan.width + run.row + k]);
                    slopes.push((run.at + k, -(by_point * nalgebra::Vector3::from(w))));
                }
            }
            for touch in row.touches() {
                for k in 0..touch.len {
                    slopes[touch.row + k].1 += column(touch.column + k);
                }
            }
        }
    }
    Some(own + spread(covariance, &slopes)?)
}

/// `E C E^T`.
fn spread(covariance: &Covariance, slopes: &[(usize, Vector2<f64>)]) -> Option<Matrix2<f64>> {
    let common = covariance.common()?;
    let mut sum = Matrix2::zeros();
    for (i, a) in slopes {
        let column = common.column(*i);
        let mut along = Vector2::zeros();
        for (j, b) in slopes {
            along += b * column[*j];
        }
        sum += a * along.transpose();
    }
    Some(sum)
}

fn test_control(
    problem: &Problem,
    covariance: &Covariance,
    index: usize,
    from: f64,
) -> Option<Tested> {
    let control = &problem.controls[index];
    let place = control.at * (1.0 + problem.artefact_scale);
    let residual = place - problem.points[control.point];
    let square = residual.norm_squared() / control.sigma.powi(2);
    if square < from * from {
        return None;
    }
    let cofactor = covariance.point_cofactor(control.point)?;
    let common = covariance.common()?;
    let (mut statistic, mut redundancy) = (0.0_f64, 0.0);
    for axis in 0..3 {
        let mut slopes: Vec<(usize, f64)> =
            cofactor.follows.iter().map(|(at, by)| (*at, by[axis])).collect();
        slopes.extend(covariance.layout.artefact_scale.map(|at| (at, -control.at[axis])));
        let shared: f64 = slopes
            .iter()
            .map(|(i, a)| slopes.iter().map(|(j, b)| a * b * common[(*i, *j)]).sum::<f64>())
            .sum();
        let checked = 1.0 - (cofactor.own[(axis, axis)] + shared) / control.sigma.powi(2);
        redundancy += checked;
        if checked > UNCHECKED {
            statistic = statistic.max(residual[axis].abs() / (control.sigma * checked.sqrt()));
        }
    }
    let observation = ObservationId::Control(index);
    Some(Tested { observation, statistic, redundancy, square })
}

/// The variance component of a group of observations: weighted squares of the residuals over the
/// group's redundancy, 1 when the stated noise is true (Foerstner 1979). `None` where the group has
/// less redundancy than `least`.
#[must_use]
pub fn variance_component<'a>(tested: impl Iterator<Item = &'a Tested>, least: f64) -> Option<f64> {
    let (mut squares, mut redundancy) = (0.0, 0.0);
    for one in tested {
        squares += one.square;
        redundancy += one.redundancy;
    }
    (redundancy >= least).then(|| squares / redundancy)
}
