//! Mode hops: steps in the wavelength that no drift explains.
//!
//! At every boundary between two readings a line with a step is fitted to the readings around it.
//! A course that bends evenly gives no step (the bend is even about the boundary, a step is odd),
//! so warming up is no hop.

use nalgebra::{Matrix3, Vector3};

use super::series::Series;

/// Readings on each side of a boundary.
const SIDE: usize = 15;
/// With fewer on a side, a step cannot be told from noise.
const LEAST: usize = 4;
/// A step of this many standard uncertainties is a hop. Chance alone gives as much with a probability
/// of 4e-8 at one boundary, 4e-5 in a thousand readings.
const SIGNIFICANT: f64 = 5.5;
/// Across an interval so many times longer than those around it, a hop cannot be told from drift.
const GAP: f64 = 20.0;
/// More hops than this are no hops but another kind of course.
const MOST: usize = 100;

/// A step after reading `after`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Step {
    /// The last reading before it.
    pub after: usize,
    /// By how much the wavelength is longer behind it, nm.
    pub by_nm: f64,
    /// Standard uncertainty of that, nm.
    pub u_nm: f64,
}

impl Step {
    fn significance(&self) -> f64 {
        (self.by_nm / self.u_nm).abs()
    }
}

/// All hops in order of time. `noise` is the standard deviation of a reading, nm.
pub(super) fn find(series: &Series, noise: f64) -> Vec<Step> {
    let mut left = series.clone();
    let mut found: Vec<Step> = Vec::new();
    while found.len() < MOST {
        let steps = (0..left.len()).filter_map(|i| step(&left, i, noise));
        let Some(best) = steps.max_by(|a, b| a.significance().total_cmp(&b.significance())) else {
            break;
        };
        if best.significance() < SIGNIFICANT {
            break;
        }
        // The largest is taken out, then what is left is looked at: its neighbours share its readings.
        left.value.iter_mut().skip(best.after + 1).for_each(|y| *y -= best.by_nm);
        match found.iter_mut().find(|step| step.after == best.after) {
            Some(same) => same.by_nm += best.by_nm,
            None => found.push(best),
        }
    }
    found.sort_by_key(|step| step.after);
    found
}

/// The step behind reading `i`, if enough readings are around.
fn step(series: &Series, i: usize, noise: f64) -> Option<Step> {
    let n = series.len();
    let (from, to) = ((i + 1).saturating_sub(SIDE), (i + 1 + SIDE).min(n));
    if i + 1 - from < LEAST || to.saturating_sub(i + 1) < LEAST {
        return None;
    }
    let (t, y) = (&series.at_s[from..to], &series.value[from..to]);
    let (first, last) = (t.first()?, t.last()?);
    let usual = (last - first) / (t.len() - 1) as f64;
    let across = series.at_s[i + 1] - series.at_s[i];
    if usual <= 0.0 || across > GAP * (usual - across / (t.len() - 1) as f64).max(1e-9) {
        return None;
    }
    let middle = series.at_s[i];
    let row = |k: usize| {
        let behind = if from + k > i { 1.0 } else { 0.0 };
        Vector3::new(1.0, (t[k] - middle) / (last - first), behind)
    };
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (k, y) in y.iter().enumerate() {
        let row = row(k);
        normal += row * row.transpose();
        right += row * (y - y_of(series, i));
    }
    let inverse = normal.try_inverse()?;
    let fit = inverse * right;
    let squares: f64 =
        y.iter().enumerate().map(|(k, y)| (y - y_of(series, i) - row(k).dot(&fit)).powi(2)).sum();
    let scatter = (squares / (t.len() - 3) as f64).sqrt();
    // Where readings scatter more than usual, a step must be larger to be one.
    let u_nm = noise.max(scatter).max(f64::MIN_POSITIVE) * inverse[(2, 2)].sqrt();
    Some(Step { after: i, by_nm: fit[2], u_nm })
}

/// A value near all those around `i`: sums of small numbers keep their digits.
fn y_of(series: &Series, i: usize) -> f64 {
    series.value[i]
}

/// The number of hops before each reading: the mode that it is in.
pub(super) fn modes(n: usize, hops: &[Step]) -> Vec<usize> {
    (0..n).map(|i| hops.iter().filter(|hop| hop.after < i).count()).collect()
}
