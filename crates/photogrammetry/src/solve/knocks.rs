//! Cameras that were knocked during a session.

use std::collections::BTreeMap;

use nalgebra::{Matrix2, Vector2};

use super::types::{CameraSolution, Observation, Subject};

/// The captures from which on a camera stands unmoved, the first included.
///
/// What stands still has the same image in every picture: the targets of a capture are compared
/// with their mean over the captures before. A knock moves them all, an outlier one.
pub(super) fn unmoved_from(solutions: &[Option<&CameraSolution>]) -> Vec<usize> {
    let mut starts = vec![0];
    let mut means: BTreeMap<u16, (Vector2<f64>, f64)> = BTreeMap::new();
    for (capture, solution) in solutions.iter().enumerate() {
        let targets: Vec<(u16, &Observation)> =
            solution.iter().flat_map(|s| &s.observations).filter_map(target_of).collect();
        let mut distances: Vec<f64> = targets
            .iter()
            .filter_map(|(code, o)| {
                let (mean, count) = means.get(code)?;
                let covariance = Matrix2::from_fn(|r, c| o.covariance[r][c]) * (1.0 + 1.0 / count);
                let way = Vector2::from(o.at) - mean;
                Some((way.transpose() * covariance.try_inverse()? * way).x)
            })
            .collect();
        distances.sort_by(f64::total_cmp);
        if distances.len() >= FEWEST_TARGETS && distances[distances.len() / 2] > KNOCKED {
            starts.push(capture);
            means.clear();
        }
        for (code, o) in targets {
            let (mean, count) = means.entry(code).or_insert((Vector2::zeros(), 0.0));
            *count += 1.0;
            *mean += (Vector2::from(o.at) - *mean) / *count;
        }
    }
    starts
}

/// Fewer targets than this do not tell a knock from outliers.
const FEWEST_TARGETS: usize = 4;
/// The median target of a camera that stands still is 1.4 away (squared, in standard deviations);
/// this is eight standard deviations of that median from it.
const KNOCKED: f64 = 5.0;

fn target_of(observation: &Observation) -> Option<(u16, &Observation)> {
    match observation.subject {
        Subject::Target(code) if observation.used => Some((code, observation)),
        _ => None,
    }
}
