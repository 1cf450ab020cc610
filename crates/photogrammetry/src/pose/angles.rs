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

/// The angles as computed from a position, and what eq. 3.4 makes of them.
///
/// Each dot is an end of up to eight angles: lengths and unit vectors are taken once.
pub(super) struct Arms<'a> {
    dots: &'a [Vector3<f64>],
    angles: &'a [AngleObservation],
    /// Unit vector to each dot and the inverse of its length, at the last position asked for.
    units: Vec<(Vector3<f64>, f64)>,
}

impl<'a> Arms<'a> {
    pub fn new(dots: &'a [Vector3<f64>], angles: &'a [AngleObservation]) -> Self {
        Self { dots, angles, units: Vec::with_capacity(dots.len()) }
    }

    fn stand_at(&mut self, position: &Vector3<f64>) {
        self.units.clear();
        self.units.extend(self.dots.iter().map(|dot| {
            let arm = dot - position;
            let inverse = 1.0 / arm.norm();
            (arm * inverse, inverse)
        }));
    }

    /// Sum of squared residuals (eq. 3.4), radians squared.
    pub fn cost(&mut self, position: &Vector3<f64>) -> f64 {
        self.stand_at(position);
        let square = |o: &AngleObservation| {
            let residual = o.angle - angle_between(&self.units[o.a].0, &self.units[o.b].0);
            residual * residual
        };
        self.angles.iter().map(square).sum()
    }

    /// Cost, normal matrix and right side for a step of the position.
    pub fn normal_equations(
        &mut self,
        position: &Vector3<f64>,
    ) -> (f64, Matrix3<f64>, Vector3<f64>) {
        self.stand_at(position);
        let (mut cost, mut hessian, mut gradient) = (0.0, Matrix3::zeros(), Vector3::zeros());
        for observation in self.angles {
            let ((ua, ia), (ub, ib)) = (self.units[observation.a], self.units[observation.b]);
            let (sine, cosine) = (ua.cross(&ub).norm(), ua.dot(&ub));
            // Minus the sum of both gradients of `angle_gradient`.
            let by_position = (ub * (ia - ib * cosine) + ua * (ib - ia * cosine)) * (1.0 / sine);
            let residual = observation.angle - sine.atan2(cosine);
            cost += residual * residual;
            // The upper triangle alone, mirrored below: half the work of the outer product.
            for column in 0..3 {
                for row in 0..=column {
                    hessian[(row, column)] += by_position[row] * by_position[column];
                }
            }
            gradient += by_position * residual;
        }
        hessian.fill_lower_triangle_with_upper_triangle();
        (cost, hessian, gradient)
    }
}

/// A step of this part of the module's distance ends the fit: what Gauss-Newton leaves after it is
/// smaller by the ratio of residuals to angles, a thousandth or less.
const CONVERGED: f64 = 1e-9;

/// Fits the module's position to the angles between `dots` (world, mm), from `start`, by
/// Levenberg-Marquardt.
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
    let mut arms = Arms::new(dots, angles);
    let mut position = start;
    let (mut cost, mut hessian, mut gradient) = arms.normal_equations(&position);
    let (mut damping, mut iterations) = (1e-6, 0);
    while iterations < 100 && damping < 1e10 {
        iterations += 1;
        let damped = hessian + Matrix3::from_diagonal(&(hessian.diagonal() * damping));
        let step = damped.cholesky()?.solve(&gradient);
        let (new_cost, h, g) = arms.normal_equations(&(position + step));
        let done = step.norm() < CONVERGED * (position - dots[angles[0].a]).norm();
        if new_cost <= cost {
            position += step;
            (cost, hessian, gradient) = (new_cost, h, g);
            damping = (damping * 0.1).max(1e-14);
        } else {
            damping *= 10.0;
        }
        // At the minimum rounding decides whether a step lowers the cost.
        if done {
            break;
        }
    }
    Some(AngleFit { position, cost, cofactors: hessian.cholesky()?.inverse(), iterations })
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

    #[test]
    fn normal_equations_are_made_of_the_gradients() {
        let dots =
            [Vector3::new(30.0, -50.0, 900.0), Vector3::new(80.0, -40.0, 910.0), Vector3::z()];
        let angles =
            [(0, 1, 0.05), (1, 2, 0.1)].map(|(a, b, angle)| AngleObservation { a, b, angle });
        let position = Vector3::new(3.0, -2.0, -500.0);
        let (mut hessian, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
        for o in &angles {
            let (angle, by_a, by_b) =
                angle_gradient(&(dots[o.a] - position), &(dots[o.b] - position));
            let by_position = -(by_a + by_b);
            hessian += by_position * by_position.transpose();
            gradient += by_position * (o.angle - angle);
        }
        let (_, h, g) = Arms::new(&dots, &angles).normal_equations(&position);
        assert!((h - hessian).norm() < 1e-12 * hessian.norm());
        assert!((g - gradient).norm() < 1e-12 * gradient.norm());
    }
}
