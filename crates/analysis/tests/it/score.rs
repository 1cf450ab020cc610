//! Scores of known errors, and the consistency of NEES with drawn samples.

use std::collections::BTreeMap;

use beampose_analysis::{MethodScore, ScoredCapture, Truth, score};
use beampose_core::{CaptureId, Pose};
use beampose_photogrammetry::rotation::{from_omega_phi_kappa, wxyz};
use beampose_photogrammetry::solve::Method;
use nalgebra::{Matrix6, UnitQuaternion, Vector3, Vector6};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

const METHOD: Method = Method::InterBeamAngles;

/// A capture whose pose is off by `error` (position, then rotation vector about the world axes).
fn off_by(error: Vector6<f64>, covariance: &Matrix6<f64>) -> ScoredCapture {
    let q = from_omega_phi_kappa([0.1, -0.2, 0.3]);
    let truth = Truth { position_mm: [10.0, 20.0, 900.0], quaternion_wxyz: wxyz(&q) };
    let turned = UnitQuaternion::from_scaled_axis(Vector3::new(error[3], error[4], error[5])) * q;
    let pose = Pose {
        position_mm: [10.0 + error[0], 20.0 + error[1], 900.0 + error[2]],
        quaternion_wxyz: wxyz(&turned),
        covariance: std::array::from_fn(|i| std::array::from_fn(|j| covariance[(i, j)])),
    };
    ScoredCapture { id: "p0".into(), truth, poses: BTreeMap::from([(METHOD, Ok(pose))]) }
}

fn failed() -> ScoredCapture {
    let mut capture = off_by(Vector6::zeros(), &Matrix6::identity());
    capture.id = CaptureId("p1".to_owned());
    capture.poses.insert(METHOD, Err("too few dots".to_owned()));
    capture
}

#[track_caller]
fn close(got: Option<f64>, expect: f64) {
    let got = got.unwrap();
    assert!((got - expect).abs() < 1e-6, "{got} is not {expect}");
}

#[test]
fn known_errors_give_known_scores() {
    let sigma = Vector6::new(1.0, 2.0, 2.0, 0.01, 0.01, 0.01);
    let covariance = Matrix6::from_diagonal(&sigma.component_mul(&sigma));
    let degree = 1.0_f64.to_radians();
    let small = off_by(Vector6::new(3.0, 0.0, 4.0, 0.0, 0.0, degree), &covariance);
    let none = off_by(Vector6::zeros(), &covariance);
    let s = score(&[small, none, failed()]).remove(&METHOD).unwrap();
    assert_eq!((s.captures, s.solved, s.without_nees), (3, 2, 0));
    close(s.rms_position_error_mm, (25.0 / 2.0_f64).sqrt());
    close(s.max_position_error_mm, 5.0);
    close(s.rms_rotation_error_deg, (1.0 / 2.0_f64).sqrt());
    close(s.max_rotation_error_deg, 1.0);
    close(s.nees_position_mean, (9.0 + 4.0) / 2.0);
    close(s.nees_pose_mean, (13.0 + (degree / 0.01).powi(2)) / 2.0);
    close(s.coverage_95, 0.5);
    close(s.mean_position_error_xyz_mm.map(|m| m[2]), 2.0);
}

#[test]
fn a_covariance_of_zero_has_no_nees_and_covers_nothing() {
    let s = score(&[off_by(Vector6::repeat(1e-3), &Matrix6::zeros())]).remove(&METHOD).unwrap();
    assert_eq!((s.nees_position_mean, s.coverage_95, s.without_nees), (None, Some(0.0), 1));
}

#[test]
fn without_a_pose_there_is_no_number() {
    let s = score(&[failed()]).remove(&METHOD).unwrap();
    assert_eq!(s, MethodScore { captures: 1, ..MethodScore::default() });
    assert!(score(&[]).is_empty());
}

#[test]
fn nees_of_samples_of_the_stated_covariance_is_three_and_six() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
    let root = Matrix6::from_fn(|i, j| {
        let unit = if i < 3 { 0.3 } else { 0.001 };
        unit * (if i == j { 1.0 } else { 0.0 } + 0.3 * normal())
    });
    let covariance = root * root.transpose();
    let n = 4000;
    let captures: Vec<ScoredCapture> =
        (0..n).map(|_| off_by(root * Vector6::from_fn(|_, _| normal()), &covariance)).collect();
    let s = score(&captures).remove(&METHOD).unwrap();
    // The mean of n chi-squared numbers has the standard deviation sqrt(2 k / n); 4 of those.
    let bound = |k: f64| 4.0 * (2.0 * k / f64::from(n)).sqrt();
    assert!((s.nees_position_mean.unwrap() - 3.0).abs() < bound(3.0), "{s:?}");
    assert!((s.nees_pose_mean.unwrap() - 6.0).abs() < bound(6.0), "{s:?}");
    let four_sigma = 4.0 * (0.95 * 0.05 / f64::from(n)).sqrt();
    assert!((s.coverage_95.unwrap() - 0.95).abs() < four_sigma, "{s:?}");
    assert!((s.coverage_95_pose.unwrap() - 0.95).abs() < four_sigma, "{s:?}");
}
