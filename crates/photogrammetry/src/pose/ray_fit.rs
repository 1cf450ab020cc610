//! Ray fit: the module's six unknowns from dots in space and the directions of their beams, the
//! distance of each dot from its beam minimised with unit weights. Uses all the information of the
//! dots, where the angles between neighbours do not.

use nalgebra::{Matrix6, SMatrix, Vector2, Vector3, Vector6};

use super::resection::{Station, resect};

/// What a ray fit gives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayFit {
    /// The module.
    pub station: Station,
    /// Root mean square distance of the dots from their beams, per axis, mm.
    pub rms_mm: f64,
    /// Cofactors of (position in mm, rotation in rad about the world axes): times the variance of
    /// a dot's coordinate (mm squared) they are the covariance, for equal uncorrelated dots.
    pub cofactors: Matrix6<f64>,
}

/// Fits the module to `dots` (world, mm) and the unit `beams` (module frame) that made them.
///
/// `None` with fewer than four dots, dots on a line, or a dot behind the module.
#[must_use]
pub fn fit_rays(dots: &[Vector3<f64>], beams: &[Vector3<f64>]) -> Option<RayFit> {
    let tangents: Vec<Vector2<f64>> =
        beams.iter().map(|b| Vector2::new(b.x / b.z, b.y / b.z)).collect();
    refine_rays(dots, beams, &resect(dots, &tangents)?)
}

/// As [`fit_rays`], from a station near by instead of from nothing.
#[must_use]
pub fn refine_rays(
    dots: &[Vector3<f64>],
    beams: &[Vector3<f64>],
    start: &Station,
) -> Option<RayFit> {
    let mut station = *start;
    let (mut cost, mut hessian) = (f64::INFINITY, Matrix6::zeros());
    // A start close by: Gauss-Newton converges in three or four steps.
    for _ in 0..20 {
        let (new_cost, h, g) = normal_equations(dots, beams, &station);
        let done = (cost - new_cost).abs() <= 1e-9 * new_cost;
        (cost, hessian) = (new_cost, h);
        if done {
            break;
        }
        station = station.moved(&h.cholesky()?.solve(&g));
    }
    let ahead = dots
        .iter()
        .zip(beams)
        .all(|(dot, beam)| (station.rotation * beam).dot(&(dot - station.centre)) > 0.0);
    if !ahead || !cost.is_finite() {
        return None;
    }
    let rms_mm = (cost / (2.0 * dots.len() as f64)).sqrt();
    Some(RayFit { station, rms_mm, cofactors: hessian.cholesky()?.inverse() })
}

fn normal_equations(
    dots: &[Vector3<f64>],
    beams: &[Vector3<f64>],
    station: &Station,
) -> (f64, Matrix6<f64>, Vector6<f64>) {
    let station_from_world = station.rotation.inverse().into_inner();
    let (mut cost, mut hessian, mut gradient) = (0.0, Matrix6::zeros(), Vector6::zeros());
    for (dot, beam) in dots.iter().zip(beams) {
        let arm = dot - station.centre;
        let across = across(beam);
        let residual = -(across * (station_from_world * arm));
        let mut j = SMatrix::<f64, 2, 6>::zeros();
        j.fixed_columns_mut::<3>(0).copy_from(&(-across * station_from_world));
        j.fixed_columns_mut::<3>(3).copy_from(&(across * station_from_world * arm.cross_matrix()));
        cost += residual.norm_squared();
        hessian += j.transpose() * j;
        gradient += j.transpose() * residual;
    }
    (cost, hessian, gradient)
}

/// Two unit vectors across a beam, as rows.
pub(super) fn across(beam: &Vector3<f64>) -> SMatrix<f64, 2, 3> {
    let u = beam.cross(&Vector3::y()).normalize();
    let v = beam.cross(&u);
    SMatrix::<f64, 2, 3>::from_rows(&[u.transpose(), v.transpose()])
}
