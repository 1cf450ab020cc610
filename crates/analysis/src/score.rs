//! Poses against the truth, where a simulation or a better instrument tells it.
//!
//! NEES (normalised estimation error squared) is `e' C^-1 e`: 3 on average for a position and 6 for
//! a pose where the stated covariance is true, more where it is too small.

use std::collections::BTreeMap;

use beampose_core::{CaptureId, Pose};
use beampose_photogrammetry::Pattern;
use beampose_photogrammetry::pattern::{angle_between, neighbour_pairs};
use beampose_photogrammetry::rotation::from_wxyz;
use beampose_photogrammetry::solve::Method;
use nalgebra::{Matrix6, Vector3, Vector6};
use serde::{Deserialize, Serialize};

/// 95 % quantile of chi-squared with 3 degrees of freedom.
const CHI2_95_3: f64 = 7.815;
/// 95 % quantile of chi-squared with 6 degrees of freedom.
const CHI2_95_6: f64 = 12.592;

/// Where the module truly was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// Position in the world, millimetres.
    pub position_mm: [f64; 3],
    /// Unit quaternion (w, x, y, z) of `world_from_module`.
    pub quaternion_wxyz: [f64; 4],
}

/// A capture with its truth.
#[derive(Debug, Clone, PartialEq)]
pub struct ScoredCapture {
    /// Its name.
    pub id: CaptureId,
    /// The truth.
    pub truth: Truth,
    /// Per method a pose, or why there is none.
    pub poses: BTreeMap<Method, Result<Pose, String>>,
}

/// How far a fan's angles are from the true ones, at its reference wavelength.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FanScore {
    /// Angles between neighbours compared.
    pub angles: usize,
    /// Root mean square of their errors.
    pub rms_angle_error_deg: f64,
    /// Largest error.
    pub max_angle_error_deg: f64,
    /// Mean relative error of the angles between horizontal and vertical neighbours.
    pub mean_relative_error: f64,
}

/// Compares a fan with the true one, whose beams are those of `truth` at `1 + common` times its
/// reference wavelength. `None` where the two do not have the same beams.
#[must_use]
pub fn score_fan(found: &Pattern, truth: &Pattern, common: f64) -> Option<FanScore> {
    if [found.columns, found.rows] != [truth.columns, truth.rows] {
        return None;
    }
    // What is found may hold at another wavelength.
    let scale = (1.0 + truth.scale_at(found.reference_wavelength_nm)) * (1.0 + common) - 1.0;
    let (mut squares, mut most, mut relative) = (0.0, 0.0_f64, Vec::new());
    let pairs = neighbour_pairs(found);
    for pair in &pairs {
        let is = angle_between(&found.direction(pair.a, 0.0)?, &found.direction(pair.b, 0.0)?);
        let true_one =
            angle_between(&truth.direction(pair.a, scale)?, &truth.direction(pair.b, scale)?);
        let error = (is - true_one).to_degrees();
        squares += error * error;
        most = most.max(error.abs());
        if pair.a.m == pair.b.m || pair.a.n == pair.b.n {
            relative.push(is / true_one - 1.0);
        }
    }
    Some(FanScore {
        angles: pairs.len(),
        rms_angle_error_deg: (squares / pairs.len().max(1) as f64).sqrt(),
        max_angle_error_deg: most,
        mean_relative_error: relative.iter().sum::<f64>() / relative.len().max(1) as f64,
    })
}

/// How one method did. Every number but the counts is absent where no capture gives it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MethodScore {
    /// Captures given.
    pub captures: usize,
    /// Captures with a pose.
    pub solved: usize,
    /// Root mean square of the distance from the true position.
    pub rms_position_error_mm: Option<f64>,
    /// Root mean square per coordinate.
    pub rms_position_error_xyz_mm: Option<[f64; 3]>,
    /// Mean error per coordinate.
    pub mean_position_error_xyz_mm: Option<[f64; 3]>,
    /// Largest distance from the true position.
    pub max_position_error_mm: Option<f64>,
    /// Root mean square of the angle of rotation from the true orientation.
    pub rms_rotation_error_deg: Option<f64>,
    /// Largest such angle.
    pub max_rotation_error_deg: Option<f64>,
    /// Mean over captures of the NEES of the position: 3 where the covariances are true.
    pub nees_position_mean: Option<f64>,
    /// Mean over captures of the NEES of the pose: 6 where the covariances are true.
    pub nees_pose_mean: Option<f64>,
    /// Fraction of captures with a position NEES of at most 7.815 (chi-squared, 3, 95 %).
    pub coverage_95: Option<f64>,
    /// Fraction of captures with a pose NEES of at most 12.592 (chi-squared, 6, 95 %).
    pub coverage_95_pose: Option<f64>,
    /// Solved captures whose position covariance cannot be inverted: they have no NEES and count
    /// as not covered.
    pub without_nees: usize,
}

/// One capture's error, position then rotation vector (rad, about the world axes).
struct Sample {
    error: Vector6<f64>,
    nees_position: Option<f64>,
    nees_pose: Option<f64>,
}

/// Scores every method that occurs in `captures`.
#[must_use]
pub fn score(captures: &[ScoredCapture]) -> BTreeMap<Method, MethodScore> {
    let mut samples: BTreeMap<Method, Vec<Sample>> = BTreeMap::new();
    for capture in captures {
        for (method, pose) in &capture.poses {
            let of_method = samples.entry(*method).or_default();
            if let Ok(pose) = pose {
                of_method.push(sample(pose, &capture.truth));
            }
        }
    }
    samples.into_iter().map(|(method, s)| (method, summarise(captures.len(), &s))).collect()
}

fn sample(pose: &Pose, truth: &Truth) -> Sample {
    let shift = Vector3::from(pose.position_mm) - Vector3::from(truth.position_mm);
    let turn = from_wxyz(pose.quaternion_wxyz) * from_wxyz(truth.quaternion_wxyz).inverse();
    let turn = turn.scaled_axis();
    let error = Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z);
    let covariance = Matrix6::from_fn(|i, j| pose.covariance[i][j]);
    let position = covariance.fixed_view::<3, 3>(0, 0).into_owned();
    Sample {
        error,
        nees_position: position.cholesky().map(|c| shift.dot(&c.solve(&shift))),
        nees_pose: covariance.cholesky().map(|c| error.dot(&c.solve(&error))),
    }
}

fn summarise(captures: usize, samples: &[Sample]) -> MethodScore {
    let n = samples.len();
    let shifts: Vec<f64> = samples.iter().map(|s| s.error.fixed_rows::<3>(0).norm()).collect();
    let turns: Vec<f64> =
        samples.iter().map(|s| s.error.fixed_rows::<3>(3).norm().to_degrees()).collect();
    let per_axis = |f: &dyn Fn(&[f64]) -> Option<f64>| -> Option<[f64; 3]> {
        let of = |i: usize| f(&samples.iter().map(|s| s.error[i]).collect::<Vec<_>>());
        Some([of(0)?, of(1)?, of(2)?])
    };
    let position: Vec<f64> = samples.iter().filter_map(|s| s.nees_position).collect();
    let pose: Vec<f64> = samples.iter().filter_map(|s| s.nees_pose).collect();
    MethodScore {
        captures,
        solved: n,
        rms_position_error_mm: rms(&shifts),
        rms_position_error_xyz_mm: per_axis(&rms),
        mean_position_error_xyz_mm: per_axis(&mean),
        max_position_error_mm: largest(&shifts),
        rms_rotation_error_deg: rms(&turns),
        max_rotation_error_deg: largest(&turns),
        nees_position_mean: mean(&position),
        nees_pose_mean: mean(&pose),
        coverage_95: fraction(&position, CHI2_95_3, n),
        coverage_95_pose: fraction(&pose, CHI2_95_6, n),
        without_nees: n - position.len(),
    }
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

fn rms(values: &[f64]) -> Option<f64> {
    mean(&values.iter().map(|v| v * v).collect::<Vec<_>>()).map(f64::sqrt)
}

fn largest(values: &[f64]) -> Option<f64> {
    values.iter().copied().reduce(f64::max)
}

fn fraction(values: &[f64], limit: f64, of: usize) -> Option<f64> {
    (of > 0).then(|| values.iter().filter(|v| **v <= limit).count() as f64 / of as f64)
}
