//! Generalised least squares on the angles between neighbouring beams: three unknowns, weighted by
//! the full covariance of the angles.
//!
//! Neighbouring angles share dots, so they correlate, and there are more of them than their dots
//! have directions: their covariance is singular. A Cholesky factorisation with pivoting takes as
//! many angles as are independent; to first order the others follow from these, so nothing is lost.
//! Weighted so, the angles are worth what the rays are (`weighted_rays`).

use nalgebra::{DMatrix, DVector, Matrix3, MatrixXx3, Vector3};

use super::angles::{AngleObservation, angle_gradient};
use super::field::{DotField, Fan};
use super::locate::{LocateError, turn};
use crate::pattern::angle_between;

/// What the fit gives.
pub(super) struct GeneralisedFit {
    pub position: Vector3<f64>,
    /// How the position follows the residual of each angle, mm per radian.
    pub gain: Vec<Vector3<f64>>,
    pub chi2: f64,
    /// Independent angles.
    pub rank: usize,
    pub iterations: usize,
}

/// Work grows with the cube of the angles and memory with their square: 420 of a fan of 11 x 11 take
/// 8 ms, so 1640 of 21 x 21 half a second, and no fan beyond is taken. The ray fit is as good and has
/// no such bound.
const MOST_ANGLES: usize = 2000;
/// A pivot below this part of the largest variance is rounding: of 420 angles the 239 true ones end
/// above 1e-3.
const RANK: f64 = 1e-9;
/// Weights are set anew at each position found; the second change is second-order small.
const WEIGHTINGS: usize = 2;

pub(super) fn fit_generalised(
    fan: &Fan<'_>,
    field: &DotField,
    angles: &[AngleObservation],
    start: Vector3<f64>,
) -> Result<GeneralisedFit, LocateError> {
    if angles.len() > MOST_ANGLES {
        return Err(LocateError::TooManyAngles { count: angles.len(), most: MOST_ANGLES });
    }
    let indeterminate = || LocateError::Indeterminate(angles.len());
    let (mut position, mut iterations) = (start, 0);
    let mut fitted = None;
    for _ in 0..WEIGHTINGS {
        let covariance =
            angle_covariance(fan, field, angles, &position).ok_or_else(indeterminate)?;
        let factor = Factor::of(&covariance.full, RANK);
        for _ in 0..20 {
            iterations += 1;
            let (step, fit) = gauss_newton(field, angles, &covariance, &factor, &position)
                .ok_or_else(indeterminate)?;
            position += step;
            fitted = Some(GeneralisedFit { position, iterations, ..fit });
            if step.norm() < 1e-9 * (position - field.places[angles[0].a]).norm() {
                break;
            }
        }
    }
    fitted.ok_or_else(indeterminate)
}

fn gauss_newton(
    field: &DotField,
    angles: &[AngleObservation],
    covariance: &AngleCovariance,
    factor: &Factor,
    position: &Vector3<f64>,
) -> Option<(Vector3<f64>, GeneralisedFit)> {
    let rank = factor.pivots.len();
    let mut jacobian = MatrixXx3::<f64>::zeros(rank);
    let mut residuals = DVector::<f64>::zeros(rank);
    for (row, &i) in factor.pivots.iter().enumerate() {
        let o = &angles[i];
        let (a, b) = (field.places[o.a] - position, field.places[o.b] - position);
        let (angle, by_a, by_b) = angle_gradient(&a, &b);
        jacobian.row_mut(row).copy_from(&-(by_a + by_b).transpose());
        residuals[row] = o.angle + covariance.widening[i] - angle;
    }
    let jacobian = factor.lower.solve_lower_triangular(&jacobian)?;
    let residuals = factor.lower.solve_lower_triangular(&residuals)?;
    let cofactors: Matrix3<f64> = jacobian.tr_mul(&jacobian).cholesky()?.inverse();
    let step = cofactors * jacobian.tr_mul(&residuals);
    let weighted = factor.lower.tr_solve_lower_triangular(&jacobian)?;
    let mut gain = vec![Vector3::zeros(); angles.len()];
    for (row, &i) in factor.pivots.iter().enumerate() {
        gain[i] = cofactors * weighted.row(row).transpose();
    }
    let chi2 = (residuals - jacobian * step).norm_squared();
    let fit = GeneralisedFit { position: *position, gain, chi2, rank, iterations: 0 };
    Some((step, fit))
}

/// What the noise of dots and beams does to the angles.
struct AngleCovariance {
    full: DMatrix<f64>,
    /// By how much noise widens each angle on average, radians: a direction that strays by `n`
    /// across the plane of the angle adds `n^2 / (2 tan(angle))`.
    widening: Vec<f64>,
}

fn angle_covariance(
    fan: &Fan<'_>,
    field: &DotField,
    angles: &[AngleObservation],
    position: &Vector3<f64>,
) -> Option<AngleCovariance> {
    let arms: Vec<Vector3<f64>> = field.places.iter().map(|p| p - position).collect();
    // A beam's error turns the direction of its dot: it adds to the dot's own, across the beam.
    let own: Vec<Matrix3<f64>> = arms
        .iter()
        .zip(&field.own)
        .map(|(arm, own)| {
            let across = Matrix3::identity() * arm.norm_squared() - arm * arm.transpose();
            own + across * fan.beam_sigma().powi(2)
        })
        .collect();
    let by_scale = moved_by_scale(fan, field, &arms, position)?;
    let mut ends: Vec<Vec<(usize, Vector3<f64>)>> = vec![Vec::new(); arms.len()];
    let mut common = DMatrix::<f64>::zeros(angles.len(), field.common.ncols() + 1);
    let mut widening = Vec::with_capacity(angles.len());
    for (i, o) in angles.iter().enumerate() {
        let (_, by_a, by_b) = angle_gradient(&arms[o.a], &arms[o.b]);
        ends[o.a].push((i, by_a));
        ends[o.b].push((i, by_b));
        let dots = by_a.transpose() * field.follows(o.a) + by_b.transpose() * field.follows(o.b);
        common.view_mut((i, 0), (1, field.common.ncols())).copy_from(&dots);
        common[(i, field.common.ncols())] = by_a.dot(&by_scale[o.a]) + by_b.dot(&by_scale[o.b]);
        widening.push(widened(&arms, &own, o));
    }
    let mut full = &common * common.transpose();
    for (ends, own) in ends.iter().zip(&own) {
        for (i, by_i) in ends {
            let along = own * by_i;
            for (j, by_j) in ends {
                full[(*i, *j)] += along.dot(by_j);
            }
        }
    }
    Some(AngleCovariance { full, widening })
}

/// How far each dot moves when the fan's scale errs by a standard uncertainty, mm; `None` for beams
/// that the fan does not have, or dots on a line.
///
/// Angles follow it through the dots, not through the calibrated angles: the gradients at dots and
/// at beams differ by the noise, and angles that depend on each other in one way would not quite do
/// so in the other, which the weights would take for knowledge.
fn moved_by_scale(
    fan: &Fan<'_>,
    field: &DotField,
    arms: &[Vector3<f64>],
    position: &Vector3<f64>,
) -> Option<Vec<Vector3<f64>>> {
    let beams: Vec<(Vector3<f64>, Vector3<f64>)> =
        field.orders.iter().map(|o| fan.beam(*o)).collect::<Option<_>>()?;
    let directions: Vec<Vector3<f64>> = beams.iter().map(|b| b.0).collect();
    let rotation = turn(&directions, &field.places, position)?;
    let moved = |(arm, beam): (&Vector3<f64>, &(Vector3<f64>, Vector3<f64>))| {
        rotation * beam.1 * (arm.norm() * fan.scale_sigma)
    };
    Some(arms.iter().zip(&beams).map(moved).collect())
}

fn widened(arms: &[Vector3<f64>], own: &[Matrix3<f64>], o: &AngleObservation) -> f64 {
    let (a, b) = (&arms[o.a], &arms[o.b]);
    let normal = a.cross(b).normalize();
    let across = |i: usize, arm: &Vector3<f64>| {
        (normal.transpose() * own[i] * normal).x / arm.norm_squared()
    };
    (across(o.a, a) + across(o.b, b)) / (2.0 * angle_between(a, b).tan())
}

/// A Cholesky factor of the independent rows of a covariance.
struct Factor {
    /// Rows in the order in which they were taken.
    pivots: Vec<usize>,
    lower: DMatrix<f64>,
}

impl Factor {
    /// Takes row after row, that of the largest remaining variance first, until none is left above
    /// `part` of the largest of all.
    fn of(covariance: &DMatrix<f64>, part: f64) -> Self {
        let size = covariance.nrows();
        let mut left: Vec<f64> = covariance.diagonal().iter().copied().collect();
        let enough = part * left.iter().copied().fold(0.0, f64::max);
        let mut pivots = Vec::new();
        // Columns of the factor, over all rows.
        let mut columns = DMatrix::<f64>::zeros(size, size);
        while pivots.len() < size {
            let (pivot, variance) = largest(&left);
            if variance <= enough {
                break;
            }
            let rank = pivots.len();
            let (done, mut rest) = columns.columns_range_pair_mut(..rank, rank..);
            let mut column = rest.column_mut(0);
            column.copy_from(&covariance.column(pivot));
            column.gemv(-1.0, &done, &done.row(pivot).transpose(), 1.0);
            column /= variance.sqrt();
            left.iter_mut().zip(column.iter()).for_each(|(l, c)| *l -= c * c);
            left[pivot] = 0.0;
            pivots.push(pivot);
        }
        let rank = pivots.len();
        let lower =
            DMatrix::from_fn(rank, rank, |r, c| if c > r { 0.0 } else { columns[(pivots[r], c)] });
        Self { pivots, lower }
    }
}

fn largest(values: &[f64]) -> (usize, f64) {
    values.iter().copied().enumerate().fold((0, 0.0), |best, v| if v.1 > best.1 { v } else { best })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_singular_covariance_is_factored_on_its_independent_rows() {
        // The third row is the sum of the others.
        let rows = DMatrix::from_row_slice(3, 2, &[2.0, 0.0, 1.0, 1.0, 3.0, 1.0]);
        let covariance = &rows * rows.transpose();
        let factor = Factor::of(&covariance, 1e-9);
        assert_eq!(factor.pivots.len(), 2);
        let again = &factor.lower * factor.lower.transpose();
        for (r, i) in factor.pivots.iter().enumerate() {
            for (c, j) in factor.pivots.iter().enumerate() {
                assert!((again[(r, c)] - covariance[(*i, *j)]).abs() < 1e-12);
            }
        }
    }
}
