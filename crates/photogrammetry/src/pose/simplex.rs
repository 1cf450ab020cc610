//! The simplex method of Nelder and Mead (1965), in three dimensions: what the dissertation
//! minimises eq. 3.4 with. Kept for comparison; it is slow and knows no uncertainty.

use nalgebra::Vector3;

/// When to stop, and where to begin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimplexOptions {
    /// Length of the first simplex' edges, mm.
    pub size: f64,
    /// Ends when no corner is farther from the best than this, mm, and ...
    pub tolerance: f64,
    /// ... no corner's value differs from the best by more than this part of it.
    pub relative_spread: f64,
    /// Most evaluations of the function.
    pub max_evaluations: usize,
}

impl Default for SimplexOptions {
    /// Steps of a decimetre, as one guesses a position in a room; a micrometre at the end, a
    /// hundredth of what dots of 0.1 mm let expect at best.
    fn default() -> Self {
        Self { size: 100.0, tolerance: 1e-3, relative_spread: 1e-9, max_evaluations: 2000 }
    }
}

/// The best corner, and the evaluations that it took. `None` when `max_evaluations` did not do.
pub(super) fn minimise(
    mut value: impl FnMut(&Vector3<f64>) -> f64,
    start: Vector3<f64>,
    options: &SimplexOptions,
) -> Option<(Vector3<f64>, usize)> {
    let mut corners: Vec<Corner> = std::iter::once(Vector3::zeros())
        .chain((0..3).map(|axis| Vector3::ith(axis, options.size)))
        .map(|offset| Corner::at(start + offset, &mut value))
        .collect();
    let mut evaluations = corners.len();
    while evaluations < options.max_evaluations {
        corners.sort_by(|a, b| a.value.total_cmp(&b.value));
        if settled(&corners, options) {
            return Some((corners[0].at, evaluations));
        }
        evaluations += improve(&mut corners, &mut value);
    }
    None
}

/// Radians squared: the rounding of some hundred angles. Exact dots leave a sum of squares of zero,
/// of which no part is small enough.
const NOTHING: f64 = 1e-24;

#[derive(Debug, Clone, Copy)]
struct Corner {
    at: Vector3<f64>,
    value: f64,
}

impl Corner {
    fn at(at: Vector3<f64>, value: &mut impl FnMut(&Vector3<f64>) -> f64) -> Self {
        Self { at, value: value(&at) }
    }
}

fn settled(corners: &[Corner], options: &SimplexOptions) -> bool {
    let best = corners[0];
    corners.iter().all(|c| {
        (c.at - best.at).norm() <= options.tolerance
            && c.value - best.value <= options.relative_spread * best.value.abs() + NOTHING
    })
}

/// One step of the method on corners sorted from best to worst: reflection (1), expansion (2),
/// contraction (1/2) or shrinking (1/2). Returns the evaluations it took.
fn improve(corners: &mut [Corner], value: &mut impl FnMut(&Vector3<f64>) -> f64) -> usize {
    let (best, second_worst, worst) = (corners[0], corners[2], corners[3]);
    let middle = (corners[0].at + corners[1].at + corners[2].at) / 3.0;
    let mut beyond = |way: f64| Corner::at(middle + (middle - worst.at) * way, &mut *value);
    let reflected = beyond(1.0);
    if reflected.value < best.value {
        let expanded = beyond(2.0);
        corners[3] = if expanded.value < reflected.value { expanded } else { reflected };
        return 2;
    }
    if reflected.value < second_worst.value {
        corners[3] = reflected;
        return 1;
    }
    let contracted = beyond(if reflected.value < worst.value { 0.5 } else { -0.5 });
    if contracted.value < worst.value.min(reflected.value) {
        corners[3] = contracted;
        return 2;
    }
    for corner in &mut corners[1..] {
        *corner = Corner::at((corner.at + best.at) / 2.0, value);
    }
    5
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A valley as narrow as eq. 3.4 has one: sideways a hundred times steeper than along.
    fn valley(p: &Vector3<f64>) -> f64 {
        (p.x - 40.0).powi(2) + 1e-4 * (p.y + 700.0).powi(2) + (p.z - 0.3 * p.y).powi(2) + 1.0
    }

    #[test]
    fn the_bottom_of_a_narrow_valley_is_found() {
        let options = SimplexOptions { tolerance: 1e-6, ..SimplexOptions::default() };
        let (found, _) = minimise(valley, Vector3::zeros(), &options).unwrap();
        // A spread of 1e-9 of the value 1 in the flat direction: 1e-4 y^2 = 1e-9, y = 3e-3.
        assert!((found - Vector3::new(40.0, -700.0, -210.0)).norm() < 1e-2, "{found}");
    }

    #[test]
    fn too_few_evaluations_give_nothing() {
        let options = SimplexOptions { max_evaluations: 20, ..SimplexOptions::default() };
        assert_eq!(minimise(valley, Vector3::zeros(), &options), None);
    }
}
