//! The module by the angles between neighbouring beams, as the dissertation does it (eq. 3.1-3.4):
//! three unknowns, unit weights. Least squares by Levenberg-Marquardt.

use nalgebra::{Matrix3, Vector3};

use crate::pattern::{Order, Pattern, angle_between, neighbour_pairs};

/// A reference angle between two dots.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AngleObservation {
    /// Index of one dot.
    pub a: usize,
    /// Index of its neighbour.
    pub b: usize,
    /// The calibrated angle between their beams, radians.
    pub angle: f64,
}

/// What the fit gives.
#[derive(Debug, Clone, PartialEq)]
pub struct AngleFit {
    /// The module's position, world, mm.
    pub position: Vector3<f64>,
    /// Sum of squared residuals, radians squared (eq. 3.4).
    pub cost: f64,
    /// Inverse of the normal matrix, mm squared per radian squared.
    pub cofactors: Matrix3<f64>,
    /// Iterations taken.
    pub iterations: usize,
}

/// All neighbour angles of `pattern` whose two beams are among `orders`, at the wavelength scale
/// `scale`.
#[must_use]
pub fn neighbour_observations(
    pattern: &Pattern,
    orders: &[Order],
    scale: f64,
) -> Vec<AngleObservation> {
    let mut place = vec![None; (pattern.columns * pattern.rows) as usize];
    for (i, order) in orders.iter().enumerate() {
        if let Some(index) = pattern.index(*order) {
            place[index] = Some(i);
        }
    }
    let find = |order| pattern.index(order).and_then(|i: usize| place[i]);
    neighbour_pairs(pattern)
        .into_iter()
        .filter_map(|pair| {
            let (a, b) = (find(pair.a)?, find(pair.b)?);
            let (u, v) = (pattern.direction(pair.a, scale)?, pattern.direction(pair.b, scale)?);
            Some(AngleObservation { a, b, angle: angle_between(&u, &v) })
        })
        .collect()
}

/// The angle at the module between two arms, and its gradients by either arm (rad per mm).
#[must_use]
pub fn angle_gradient(a: &Vector3<f64>, b: &Vector3<f64>) -> (f64, Vector3<f64>, Vector3<f64>) {
    let (la, lb) = (a.norm(), b.norm());
    let (ua, ub) = (a / la, b / lb);
    let (sine, cosine) = (ua.cross(&ub).norm(), ua.dot(&ub));
    let by_a = (ua * cosine - ub) / (sine * la);
    let by_b = (ub * cosine - ua) / (sine * lb);
    (sine.atan2(cosine), by_a, by_b)
}

/// Fits the module's position to the angles between `dots` (world, mm), from `start`.
///
/// `None` when fewer than four angles are given or they do not determine a position.
#[must_use]
pub fn fit_angles(
    dots: &[Vector3<f64>],
    angles: &[AngleObservation],
    start: Vector3<f64>,
) -> Option<AngleFit> {
    if angles.len() < 4 {
        return None;
    }
    let mut position = start;
    let (mut cost, mut hessian, mut gradient) = normal_equations(dots, angles, &position);
    let (mut damping, mut iterations) = (1e-3, 0);
    while iterations < 100 && damping < 1e10 {
        iterations += 1;
        let damped = hessian + Matrix3::from_diagonal(&(hessian.diagonal() * damping));
        let step = damped.cholesky()?.solve(&gradient);
        let (new_cost, h, g) = normal_equations(dots, angles, &(position + step));
        if new_cost <= cost {
            position += step;
            let done = step.norm() < 1e-9 * (position - dots[angles[0].a]).norm();
            (cost, hessian, gradient) = (new_cost, h, g);
            damping *= 0.1;
            if done {
                break;
            }
        } else {
            damping *= 10.0;
        }
    }
    Some(AngleFit { position, cost, cofactors: hessian.cholesky()?.inverse(), iterations })
}

fn normal_equations(
    dots: &[Vector3<f64>],
    angles: &[AngleObservation],
    position: &Vector3<f64>,
) -> (f64, Matrix3<f64>, Vector3<f64>) {
    let (mut cost, mut hessian, mut gradient) = (0.0, Matrix3::zeros(), Vector3::zeros());
    for observation in angles {
        let (a, b) = (dots[observation.a] - position, dots[observation.b] - position);
        let (angle, by_a, by_b) = angle_gradient(&a, &b);
        let by_position = -(by_a + by_b);
        let residual = observation.angle - angle;
        cost += residual * residual;
        hessian += by_position * by_position.transpose();
        gradient += by_position * residual;
    }
    (cost, hessian, gradient)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradients_of_an_angle_agree_with_finite_differences() {
        let (a, b) = (Vector3::new(30.0, -50.0, 900.0), Vector3::new(80.0, -40.0, 910.0));
        let (_, by_a, by_b) = angle_gradient(&a, &b);
        for axis in 0..3 {
            let mut step = Vector3::zeros();
            step[axis] = 1e-2;
            let slope_a = (angle_between(&(a + step), &b) - angle_between(&(a - step), &b)) / 2e-2;
            let slope_b = (angle_between(&a, &(b + step)) - angle_between(&a, &(b - step))) / 2e-2;
            assert!((slope_a - by_a[axis]).abs() < 1e-9);
            assert!((slope_b - by_b[axis]).abs() < 1e-9);
        }
    }
}
