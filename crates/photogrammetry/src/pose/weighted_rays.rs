//! Ray fit with weights: the module's six unknowns from the distances of the dots from their beams,
//! each weighted by what dot and beam are worth, what they follow in common included. It takes all
//! the information that the dots have, so nothing unbiased is better (Cramer and Rao).

use nalgebra::{
    Cholesky, DMatrix, DVector, Matrix2, Matrix3, Matrix6, MatrixXx6, SMatrix, Vector3, Vector6,
};

use super::field::{DotField, Fan};
use super::ray_fit::across;
use super::resection::Station;

/// What the fit gives.
#[derive(Debug, Clone, PartialEq)]
pub struct WeightedRayFit {
    /// The module.
    pub station: Station,
    /// Covariance of (position in mm, rotation in rad about the world axes).
    pub covariance: Matrix6<f64>,
    /// Weighted sum of squares; its expectation is the redundancy.
    pub chi2: f64,
    /// Observations minus unknowns.
    pub redundancy: usize,
    /// Steps tried.
    pub iterations: usize,
}

/// Weights follow from distances and directions, which the start knows to a percent: set once more
/// after the first fit they are right to the size of the residuals.
const WEIGHTINGS: usize = 2;

/// Fits the module to the dots of `field` by Levenberg-Marquardt from `start`. `None` where the
/// dots do not fix six unknowns, or a beam is unknown to the fan.
#[must_use]
pub fn fit_weighted_rays(
    fan: &Fan<'_>,
    field: &DotField,
    start: Station,
) -> Option<WeightedRayFit> {
    let beams: Vec<(Vector3<f64>, Vector3<f64>)> =
        field.orders.iter().map(|o| fan.beam(*o)).collect::<Option<_>>()?;
    let redundancy = (2 * beams.len()).checked_sub(6)?;
    let (mut station, mut iterations) = (start, 0);
    let mut fitted = None;
    for _ in 0..WEIGHTINGS {
        let weights = Weights::at(fan, field, &beams, &station)?;
        let fit = iterate(&weights, field, &beams, &mut station)?;
        iterations += fit.1;
        fitted = Some(fit.0);
    }
    let fit = fitted?;
    let covariance = fit.hessian.cholesky()?.inverse();
    Some(WeightedRayFit { station, covariance, chi2: fit.chi2, redundancy, iterations })
}

/// How residuals are weighted: each dot's by its own covariance, then all by what they share.
/// With own parts whitened and common parts B the covariance is `I + B B^T`, its inverse
/// `I - Q^T Q` (Woodbury).
struct Weights {
    own: Vec<Matrix2<f64>>,
    /// `None` where nothing is common.
    shared: Option<DMatrix<f64>>,
}

impl Weights {
    fn at(
        fan: &Fan<'_>,
        field: &DotField,
        beams: &[(Vector3<f64>, Vector3<f64>)],
        station: &Station,
    ) -> Option<Self> {
        let station_from_world = station.rotation.inverse().into_inner();
        let dots = field.common.ncols();
        let columns = dots + usize::from(fan.scale_sigma > 0.0);
        let mut own = Vec::with_capacity(beams.len());
        let mut common = DMatrix::<f64>::zeros(2 * beams.len(), columns);
        for (i, (beam, slope)) in beams.iter().enumerate() {
            let distance = (field.places[i] - station.centre).norm();
            let across = across(beam);
            let by_dot = across * station_from_world;
            let of_beam = (fan.beam_sigma() * distance).powi(2);
            let covariance =
                by_dot * field.own[i] * by_dot.transpose() + Matrix2::identity() * of_beam;
            // The inverse of the Cholesky factor makes a residual one of unit covariance.
            let whiten = covariance.cholesky()?.l().try_inverse()?;
            let mut rows = common.rows_mut(2 * i, 2);
            rows.columns_mut(0, dots).copy_from(&(whiten * by_dot * field.follows(i)));
            if columns > dots {
                rows.column_mut(dots)
                    .copy_from(&(whiten * across * slope * (distance * fan.scale_sigma)));
            }
            own.push(whiten);
        }
        Some(Self { own, shared: shared(&common) })
    }
}

/// The Q of common parts B: `Q^T Q = B (I + B^T B)^-1 B^T`.
fn shared(common: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let size = common.ncols();
    if size == 0 {
        return None;
    }
    let inner = DMatrix::identity(size, size) + common.tr_mul(common);
    Cholesky::new(inner)?.l().solve_lower_triangular(&common.transpose())
}

struct Normal {
    chi2: f64,
    hessian: Matrix6<f64>,
    gradient: Vector6<f64>,
}

fn iterate(
    weights: &Weights,
    field: &DotField,
    beams: &[(Vector3<f64>, Vector3<f64>)],
    station: &mut Station,
) -> Option<(Normal, usize)> {
    let mut normal = normal_equations(weights, field, beams, station);
    let (mut damping, mut iterations) = (1e-6, 0);
    while iterations < 60 && damping < 1e10 {
        iterations += 1;
        let diagonal = Matrix6::from_diagonal(&(normal.hessian.diagonal() * damping));
        let step = (normal.hessian + diagonal).cholesky()?.solve(&normal.gradient);
        // What the linear model promises to win: at the minimum nothing.
        let gain = normal.gradient.dot(&step);
        let candidate = station.moved(&step);
        let next = normal_equations(weights, field, beams, &candidate);
        if next.chi2 <= normal.chi2 {
            (*station, normal) = (candidate, next);
            damping = (damping * 0.1).max(1e-14);
        } else {
            damping *= 10.0;
        }
        if gain <= 1e-12 * normal.chi2.max(1e-6) {
            break;
        }
    }
    Some((normal, iterations))
}

fn normal_equations(
    weights: &Weights,
    field: &DotField,
    beams: &[(Vector3<f64>, Vector3<f64>)],
    station: &Station,
) -> Normal {
    let station_from_world = station.rotation.inverse().into_inner();
    let count = 2 * beams.len();
    let mut jacobian = MatrixXx6::<f64>::zeros(count);
    let mut residuals = DVector::<f64>::zeros(count);
    for (i, (beam, _)) in beams.iter().enumerate() {
        let arm = field.places[i] - station.centre;
        let by_arm: SMatrix<f64, 2, 3> = weights.own[i] * across(beam) * station_from_world;
        let turn: Matrix3<f64> = arm.cross_matrix();
        residuals.fixed_rows_mut::<2>(2 * i).copy_from(&-(by_arm * arm));
        jacobian.fixed_view_mut::<2, 3>(2 * i, 0).copy_from(&-by_arm);
        jacobian.fixed_view_mut::<2, 3>(2 * i, 3).copy_from(&(by_arm * turn));
    }
    let mut normal = Normal {
        chi2: residuals.norm_squared(),
        hessian: jacobian.tr_mul(&jacobian),
        gradient: jacobian.tr_mul(&residuals),
    };
    if let Some(shared) = &weights.shared {
        let (j, r) = (shared * jacobian, shared * residuals);
        normal.chi2 -= r.norm_squared();
        normal.hessian -= j.tr_mul(&j);
        normal.gradient -= j.tr_mul(&r);
    }
    normal
}
