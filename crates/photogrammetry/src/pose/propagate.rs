//! The covariance of a pose whose position follows linearly from the residuals of angles, and whose
//! rotation best turns the fan onto the dots: propagated from dots, beams and the fan's scale.

use nalgebra::{DMatrix, Matrix3, Matrix6, Rotation3, SMatrix, Vector3, Vector6};

use super::angles::{AngleFit, AngleObservation, angle_gradient};
use super::field::{DotField, Fan};

/// A position from angles.
pub(super) struct PositionFit {
    pub position: Vector3<f64>,
    /// How the position follows the residual (reference minus computed) of each angle, mm/rad.
    pub gain: Vec<Vector3<f64>>,
    pub sigma0: f64,
    pub iterations: usize,
}

/// The sensitivity of a pose (position, rotation about the world axes) to a dot (mm) or to a beam
/// (rad).
type Sensitivity = SMatrix<f64, 6, 3>;

struct Sensitivities {
    dots: Vec<Sensitivity>,
    beams: Vec<Sensitivity>,
}

/// The covariance of the pose. `None` where the dots do not fix a rotation.
pub(super) fn propagate(
    fan: &Fan<'_>,
    field: &DotField,
    angles: &[AngleObservation],
    fit: &PositionFit,
    rotation: &Rotation3<f64>,
) -> Option<Matrix6<f64>> {
    let beams: Vec<(Vector3<f64>, Vector3<f64>)> =
        field.orders.iter().map(|o| fan.beam(*o)).collect::<Option<_>>()?;
    let sensitivity = sensitivities(field, angles, fit, &beams, rotation)?;
    let mut covariance = Matrix6::zeros();
    let mut by_common = DMatrix::<f64>::zeros(6, field.common.ncols());
    let mut by_scale = Vector6::zeros();
    for (i, (direction, slope)) in beams.iter().enumerate() {
        let s = &sensitivity.dots[i];
        covariance += s * field.own[i] * s.transpose();
        by_common += s * field.follows(i);
        let s = &sensitivity.beams[i];
        let across = Matrix3::identity() - direction * direction.transpose();
        covariance += s * across * s.transpose() * fan.beam_sigma().powi(2);
        by_scale += s * slope;
    }
    let common = &by_common * by_common.transpose();
    covariance += Matrix6::from_fn(|r, c| common[(r, c)]);
    covariance += by_scale * by_scale.transpose() * fan.scale_sigma.powi(2);
    Some((covariance + covariance.transpose()) / 2.0)
}

fn sensitivities(
    field: &DotField,
    angles: &[AngleObservation],
    fit: &PositionFit,
    beams: &[(Vector3<f64>, Vector3<f64>)],
    rotation: &Rotation3<f64>,
) -> Option<Sensitivities> {
    let n = field.places.len();
    let arms: Vec<Vector3<f64>> = field.places.iter().map(|p| p - fit.position).collect();
    let mut position_by_dot = vec![Matrix3::<f64>::zeros(); n];
    let mut position_by_beam = vec![Matrix3::<f64>::zeros(); n];
    for (o, gain) in angles.iter().zip(&fit.gain) {
        let (_, by_a, by_b) = angle_gradient(&arms[o.a], &arms[o.b]);
        position_by_dot[o.a] -= gain * by_a.transpose();
        position_by_dot[o.b] -= gain * by_b.transpose();
        let (_, by_a, by_b) = angle_gradient(&beams[o.a].0, &beams[o.b].0);
        position_by_beam[o.a] += gain * by_a.transpose();
        position_by_beam[o.b] += gain * by_b.transpose();
    }
    // Rotation: minimise sum |u_i - R d_i|^2; normal matrix sum (I - u u^T).
    let directions: Vec<(Vector3<f64>, f64)> =
        arms.iter().map(|arm| (arm.normalize(), arm.norm())).collect();
    let normal: Matrix3<f64> =
        directions.iter().map(|(u, _)| Matrix3::identity() - u * u.transpose()).sum();
    let inverse = normal.try_inverse()?;
    let by_arm: Vec<Matrix3<f64>> =
        directions.iter().map(|(u, l)| inverse * u.cross_matrix() / *l).collect();
    let by_all_arms: Matrix3<f64> = by_arm.iter().sum();
    let stack = |position: Matrix3<f64>, turn: Matrix3<f64>| {
        let mut s = Sensitivity::zeros();
        s.fixed_rows_mut::<3>(0).copy_from(&position);
        s.fixed_rows_mut::<3>(3).copy_from(&(turn - by_all_arms * position));
        s
    };
    let by_beam = |i: usize| -(inverse * directions[i].0.cross_matrix() * rotation.matrix());
    Some(Sensitivities {
        dots: (0..n).map(|i| stack(position_by_dot[i], by_arm[i])).collect(),
        beams: (0..n).map(|i| stack(position_by_beam[i], by_beam(i))).collect(),
    })
}

/// Residuals of a fit with unit weights against what dots and beams let expect.
pub(super) fn unit_sigma0(
    fan: &Fan<'_>,
    field: &DotField,
    angles: &[AngleObservation],
    fit: &AngleFit,
) -> f64 {
    let expected: f64 = angles
        .iter()
        .map(|o| {
            let (a, b) = (field.places[o.a] - fit.position, field.places[o.b] - fit.position);
            let (_, by_a, by_b) = angle_gradient(&a, &b);
            let of_dots = (by_a.transpose() * field.own[o.a] * by_a).x
                + (by_b.transpose() * field.own[o.b] * by_b).x;
            // On the unit sphere both gradients of an angle are one long.
            of_dots + 2.0 * fan.beam_sigma().powi(2)
        })
        .sum();
    // Three unknowns take their share of the sum.
    let share = 1.0 - 3.0 / angles.len() as f64;
    (fit.cost / (expected * share.max(f64::MIN_POSITIVE))).sqrt()
}
