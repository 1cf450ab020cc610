//! The methods that find the module from dots in space: `inter-beam-angles` (position by least
//! squares on the angles between neighbouring beams, eq. 3.4, unit weights, then the rotation that
//! best turns the fan onto the dots), the same with the full covariance of the angles, and the ray
//! fit. The covariance by propagation from dots, beams and the fan's common scale.

use beampose_core::Pose;
use nalgebra::{DMatrix, Vector3};

use super::outcome::pose;
use crate::adjust::{Covariance, PointCofactor};
use crate::pattern::{Order, Pattern};
use crate::pose::{DotField, Estimator, Fan, locate};

/// Dots in space with what is needed to propagate their uncertainty.
pub(super) struct Dots<'a> {
    pub orders: Vec<Order>,
    pub places: Vec<Vector3<f64>>,
    pub cofactors: Vec<&'a PointCofactor>,
    pub covariance: &'a Covariance,
}

/// What the method gives.
pub(super) struct ByAngles {
    pub pose: Pose,
    pub sigma0: f64,
}

/// Fits the module. `scale` is the fan's relative scale with its standard uncertainty.
pub(super) fn solve(
    pattern: &Pattern,
    dots: &Dots<'_>,
    scale: (f64, f64),
    start: Vector3<f64>,
    estimator: Estimator,
) -> Result<ByAngles, String> {
    let fan = Fan { pattern, scale: scale.0, scale_sigma: scale.1 };
    let field = field(dots).ok_or("the cameras' covariance is not determined")?;
    let found = locate(&fan, &field, estimator, start).map_err(|e| e.to_string())?;
    Ok(ByAngles { pose: pose(&found.station, &found.covariance), sigma0: found.sigma0 })
}

/// The dots with their covariance as own parts and common errors of standard deviation one.
fn field(dots: &Dots<'_>) -> Option<DotField> {
    let factor = dots.covariance.common()?.clone().cholesky()?.unpack();
    let mut follows = DMatrix::<f64>::zeros(3 * dots.places.len(), factor.ncols());
    for (i, cofactor) in dots.cofactors.iter().enumerate() {
        for (unknown, along) in &cofactor.follows {
            follows.view_mut((3 * i, *unknown), (3, 1)).copy_from_slice(along);
        }
    }
    Some(DotField {
        orders: dots.orders.clone(),
        places: dots.places.clone(),
        own: dots.cofactors.iter().map(|c| c.own).collect(),
        common: follows * factor,
    })
}
