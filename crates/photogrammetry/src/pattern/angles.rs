//! Angles between neighbouring beams: the dissertation's reference angles (eq. 3.2, 3.3).

use nalgebra::Vector3;

use super::{Order, Pattern};

/// A pair of neighbouring beams.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AnglePair {
    /// One beam.
    pub a: Order,
    /// Its neighbour.
    pub b: Order,
}

/// The angle between two vectors, radians: `atan2`, since `acos` loses half the digits here.
#[must_use]
pub fn angle_between(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    a.cross(b).norm().atan2(a.dot(b))
}

/// All horizontal, vertical and diagonal neighbours, in that order, row by row.
#[must_use]
pub fn neighbour_pairs(pattern: &Pattern) -> Vec<AnglePair> {
    let steps = [(1, 0), (0, 1), (1, 1), (1, -1)];
    steps
        .iter()
        .flat_map(|&(dm, dn)| {
            pattern.orders().filter_map(move |a| {
                let b = Order { m: a.m + dm, n: a.n + dn };
                pattern.contains(b).then_some(AnglePair { a, b })
            })
        })
        .collect()
}
