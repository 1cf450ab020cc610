//! The method `inter-beam-angles`: position by least squares on the angles between neighbouring
//! beams (eq. 3.4, unit weights), then the rotation that best turns the fan onto the dots; the
//! covariance by propagation from dots, beams and the fan's common scale.

use beampose_core::Pose;
use nalgebra::{DMatrix, Matrix3, Matrix6, Rotation3, SMatrix, UnitQuaternion, Vector3};

use crate::adjust::{Covariance, PointCofactor};
use crate::pattern::{Order, Pattern};
use crate::pose::{AngleFit, AngleObservation, angle_gradient, fit_angles, neighbour_observations};
use crate::rotation::wxyz;

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

/// The sensitivity of a pose (position, rotation about the world axes) to a dot or a beam.
type Sensitivity = SMatrix<f64, 6, 3>;

/// Fits the module. `scale` is the fan's relative scale with its standard uncertainty.
pub(super) fn solve(
    pattern: &Pattern,
    dots: &Dots<'_>,
    scale: (f64, f64),
    start: Vector3<f64>,
) -> Result<ByAngles, String> {
    let angles = neighbour_observations(pattern, &dots.orders, scale.0);
    let fit = fit_angles(&dots.places, &angles, start)
        .ok_or_else(|| format!("{} neighbour angles do not fix a position", angles.len()))?;
    let beams: Vec<Vector3<f64>> =
        dots.orders.iter().filter_map(|o| pattern.direction(*o, scale.0)).collect();
    if beams.len() != dots.orders.len() {
        return Err("a dot's beam does not leave the grating at this wavelength".to_owned());
    }
    let rotation = turn(&beams, &dots.places, &fit.position).ok_or("the dots are on a line")?;
    let sensitivity = sensitivities(&fit, &angles, dots, &beams, &rotation)
        .ok_or("the dots do not fix a rotation")?;
    let sigma = pattern.u.angle_deg.to_radians();
    let covariance = propagate(pattern, dots, &sensitivity, sigma, scale);
    let pose = Pose {
        position_mm: fit.position.into(),
        quaternion_wxyz: wxyz(&UnitQuaternion::from_rotation_matrix(&rotation)),
        covariance: std::array::from_fn(|r| std::array::from_fn(|c| covariance[(r, c)])),
    };
    Ok(ByAngles { pose, sigma0: sigma0(&fit, &angles, dots, &beams, sigma) })
}

/// The rotation `world_from_module` that turns the beams onto the directions of the dots (Kabsch).
fn turn(
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

/// How the pose follows each dot (mm) and each beam (rad).
struct Sensitivities {
    dots: Vec<Sensitivity>,
    beams: Vec<Sensitivity>,
}

fn sensitivities(
    fit: &AngleFit,
    angles: &[AngleObservation],
    dots: &Dots<'_>,
    beams: &[Vector3<f64>],
    rotation: &Rotation3<f64>,
) -> Option<Sensitivities> {
    let n = dots.places.len();
    let mut position_by_dot = vec![Matrix3::<f64>::zeros(); n];
    let mut position_by_beam = vec![Matrix3::<f64>::zeros(); n];
    for o in angles {
        let (a, b) = (dots.places[o.a] - fit.position, dots.places[o.b] - fit.position);
        let (_, by_a, by_b) = angle_gradient(&a, &b);
        let gain = fit.cofactors * -(by_a + by_b);
        position_by_dot[o.a] -= gain * by_a.transpose();
        position_by_dot[o.b] -= gain * by_b.transpose();
        let (_, by_a, by_b) = angle_gradient(&beams[o.a], &beams[o.b]);
        position_by_beam[o.a] += gain * by_a.transpose();
        position_by_beam[o.b] += gain * by_b.transpose();
    }
    // Rotation: minimise sum |u_i - R d_i|^2; normal matrix sum (I - u u^T).
    let directions: Vec<(Vector3<f64>, f64)> = dots
        .places
        .iter()
        .map(|p| p - fit.position)
        .map(|arm| (arm.normalize(), arm.norm()))
        .collect();
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
    let dots = (0..n).map(|i| stack(position_by_dot[i], by_arm[i])).collect();
    let beams = (0..n)
        .map(|i| {
            let turn = -(inverse * directions[i].0.cross_matrix() * rotation.matrix());
            stack(position_by_beam[i], turn)
        })
        .collect();
    Some(Sensitivities { dots, beams })
}

fn propagate(
    pattern: &Pattern,
    dots: &Dots<'_>,
    sensitivity: &Sensitivities,
    sigma: f64,
    scale: (f64, f64),
) -> Matrix6<f64> {
    let mut covariance = Matrix6::zeros();
    let size = dots.covariance.common().map_or(0, DMatrix::nrows);
    let mut by_common = DMatrix::<f64>::zeros(6, size);
    let mut by_scale = SMatrix::<f64, 6, 1>::zeros();
    for (i, cofactor) in dots.cofactors.iter().enumerate() {
        let s = &sensitivity.dots[i];
        covariance += s * cofactor.own * s.transpose();
        for (unknown, follows) in &cofactor.follows {
            let column = s * Vector3::from(*follows);
            for row in 0..6 {
                by_common[(row, *unknown)] += column[row];
            }
        }
        let s = &sensitivity.beams[i];
        if let Some((direction, slope)) = beam_and_slope(pattern, dots.orders[i], scale.0) {
            let across = Matrix3::identity() - direction * direction.transpose();
            covariance += s * across * s.transpose() * (sigma * sigma);
            by_scale += s * slope;
        }
    }
    if let Some(common) = dots.covariance.common() {
        let product = &by_common * common * by_common.transpose();
        covariance += Matrix6::from_fn(|r, c| product[(r, c)]);
    }
    covariance += by_scale * by_scale.transpose() * (scale.1 * scale.1);
    (covariance + covariance.transpose()) / 2.0
}

/// A beam's direction and its derivative by the fan's relative scale.
fn beam_and_slope(
    pattern: &Pattern,
    order: Order,
    scale: f64,
) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let d = pattern.direction(order, scale)?;
    let s = 1.0 + scale;
    let slope = Vector3::new(d.x / s, d.y / s, -(d.x * d.x + d.y * d.y) / (s * d.z));
    Some((d, slope))
}

/// Residuals against what dots and beams let expect.
fn sigma0(
    fit: &AngleFit,
    angles: &[AngleObservation],
    dots: &Dots<'_>,
    beams: &[Vector3<f64>],
    sigma: f64,
) -> f64 {
    let expected: f64 = angles
        .iter()
        .map(|o| {
            let (a, b) = (dots.places[o.a] - fit.position, dots.places[o.b] - fit.position);
            let (_, by_a, by_b) = angle_gradient(&a, &b);
            let of_dots = (by_a.transpose() * dots.cofactors[o.a].own * by_a).x
                + (by_b.transpose() * dots.cofactors[o.b].own * by_b).x;
            let (_, by_a, by_b) = angle_gradient(&beams[o.a], &beams[o.b]);
            of_dots + sigma * sigma * (by_a.norm_squared() + by_b.norm_squared())
        })
        .sum();
    // Three unknowns take their share of the sum.
    let share = 1.0 - 3.0 / angles.len() as f64;
    (fit.cost / (expected * share.max(f64::MIN_POSITIVE))).sqrt()
}
