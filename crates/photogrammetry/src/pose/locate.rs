//! The module from dots in space, by any of four estimators, with the covariance of the pose.

use nalgebra::{Matrix3, Matrix6, Rotation3, Vector3};

use super::angles::{
    AngleFit, AngleObservation, Arms, angle_gradient, fit_angles, neighbour_observations,
};
use super::field::{DotField, Fan};
use super::generalised::fit_generalised;
use super::propagate::{PositionFit, propagate, unit_sigma0};
use super::resection::Station;
use super::simplex::{self, SimplexOptions};
use super::weighted_rays::fit_weighted_rays;

/// How the module is found from dots in space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Estimator {
    /// Angles between neighbours with unit weights (eq. 3.4), by Nelder and Mead's simplex, as the
    /// dissertation did it.
    AnglesSimplex(SimplexOptions),
    /// The same sum of squares by Levenberg-Marquardt: the same position, many times faster.
    Angles,
    /// The same angles weighted by their full covariance.
    AnglesGeneralised,
    /// Six unknowns from the distances of the dots from their beams, weighted.
    Rays,
}

/// Where the module is.
#[derive(Debug, Clone, PartialEq)]
pub struct Located {
    /// The module.
    pub station: Station,
    /// Covariance of (position in mm, rotation in rad about the world axes).
    pub covariance: Matrix6<f64>,
    /// Root of the a posteriori variance of unit weight: near 1 when the stated noise is true.
    pub sigma0: f64,
    /// Steps; evaluations for the simplex.
    pub iterations: usize,
}

/// Why the module was not found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum LocateError {
    /// More dots or a better spread are needed.
    #[error("{0} observations do not fix a position")]
    Indeterminate(usize),
    /// A rotation needs dots that are not on a line.
    #[error("the dots do not fix a rotation")]
    OnALine,
    /// A dot is said to be of a beam that there is not.
    #[error("a dot's beam does not leave the grating at this wavelength")]
    NoBeam,
    /// The simplex did not settle.
    #[error("the simplex did not settle within {0} evaluations")]
    NotSettled(usize),
    /// The estimator's work and memory would grow out of bounds.
    #[error("{count} angles are too many for full weights, which take {most} at most")]
    TooManyAngles {
        /// Angles given.
        count: usize,
        /// Angles that are taken.
        most: usize,
    },
}

/// Finds the module from `field` by `estimator`, from `start` (world, mm).
///
/// # Errors
/// [`LocateError`].
pub fn locate(
    fan: &Fan<'_>,
    field: &DotField,
    estimator: Estimator,
    start: Vector3<f64>,
) -> Result<Located, LocateError> {
    let beams: Vec<Vector3<f64>> = field
        .orders
        .iter()
        .map(|o| fan.beam(*o).map(|b| b.0))
        .collect::<Option<_>>()
        .ok_or(LocateError::NoBeam)?;
    if let Estimator::Rays = estimator {
        return by_rays(fan, field, &beams, start);
    }
    let angles = neighbour_observations(fan.pattern, &field.orders, fan.scale);
    let fit = by_angles(fan, field, &angles, estimator, start)?;
    let rotation = turn(&beams, &field.places, &fit.position).ok_or(LocateError::OnALine)?;
    let covariance = propagate(fan, field, &angles, &fit, &rotation).ok_or(LocateError::OnALine)?;
    let station = Station { centre: fit.position, rotation };
    Ok(Located { station, covariance, sigma0: fit.sigma0, iterations: fit.iterations })
}

/// The position from angles, by any estimator that takes them.
fn by_angles(
    fan: &Fan<'_>,
    field: &DotField,
    angles: &[AngleObservation],
    estimator: Estimator,
    start: Vector3<f64>,
) -> Result<PositionFit, LocateError> {
    let indeterminate = LocateError::Indeterminate(angles.len());
    Ok(match estimator {
        Estimator::AnglesGeneralised => {
            let fit = fit_generalised(fan, field, angles, start)?;
            let redundancy = fit.rank.saturating_sub(3).max(1);
            let sigma0 = (fit.chi2 / redundancy as f64).sqrt();
            PositionFit {
                position: fit.position,
                gain: fit.gain,
                sigma0,
                iterations: fit.iterations,
            }
        }
        Estimator::AnglesSimplex(options) => {
            let mut arms = Arms::new(&field.places, angles);
            let (at, evaluations) = simplex::minimise(|p| arms.cost(p), start, &options)
                .ok_or(LocateError::NotSettled(options.max_evaluations))?;
            let (cost, hessian, _) = arms.normal_equations(&at);
            let cofactors = hessian.cholesky().ok_or(indeterminate)?.inverse();
            let fit = AngleFit { position: at, cost, cofactors, iterations: evaluations };
            unit_weights(fan, field, angles, &fit)
        }
        Estimator::Angles | Estimator::Rays => {
            let fit = fit_angles(&field.places, angles, start).ok_or(indeterminate)?;
            unit_weights(fan, field, angles, &fit)
        }
    })
}

fn unit_weights(
    fan: &Fan<'_>,
    field: &DotField,
    angles: &[AngleObservation],
    fit: &AngleFit,
) -> PositionFit {
    let gain = angles
        .iter()
        .map(|o| {
            let arm = |i: usize| field.places[i] - fit.position;
            let (_, by_a, by_b) = angle_gradient(&arm(o.a), &arm(o.b));
            fit.cofactors * -(by_a + by_b)
        })
        .collect();
    let sigma0 = unit_sigma0(fan, field, angles, fit);
    PositionFit { position: fit.position, gain, sigma0, iterations: fit.iterations }
}

fn by_rays(
    fan: &Fan<'_>,
    field: &DotField,
    beams: &[Vector3<f64>],
    start: Vector3<f64>,
) -> Result<Located, LocateError> {
    let rotation = turn(beams, &field.places, &start).ok_or(LocateError::OnALine)?;
    let fit = fit_weighted_rays(fan, field, Station { centre: start, rotation })
        .ok_or(LocateError::Indeterminate(2 * field.places.len()))?;
    Ok(Located {
        station: fit.station,
        covariance: fit.covariance,
        sigma0: (fit.chi2 / fit.redundancy.max(1) as f64).sqrt(),
        iterations: fit.iterations,
    })
}

/// The rotation `world_from_module` that turns the beams onto the directions of the dots (Kabsch).
pub(super) fn turn(
    beams: &[Vector3<f64>],
    places: &[Vector3<f64>],
    position: &Vector3<f64>,
) -> Option<Rotation3<f64>> {
    let scatter: Matrix3<f64> = beams
        .iter()
        .zip(places)
        .map(|(beam, place)| (place - position).normalize() * beam.transpose())
        .sum();
    let svd = scatter.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let sign = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant().signum()));
    Some(Rotation3::from_matrix_unchecked(u * sign * v_t))
}
