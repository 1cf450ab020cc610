//! Capture by capture.

use std::collections::BTreeMap;

use crate::scene::Laboratory;
use beampose_photogrammetry::Order;
use beampose_photogrammetry::solve::{CaptureSolution, Method, Sighting, Subject, solve_capture};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// Both methods of a capture on what the cameras saw.
fn solve(
    laboratory: &Laboratory,
    sightings: &BTreeMap<String, Sighting>,
    wavelength_nm: Option<f64>,
) -> CaptureSolution {
    let methods = &Method::USUAL;
    let wavelength = laboratory.setup.wavelength(wavelength_nm);
    solve_capture(&laboratory.setup, sightings, &wavelength, methods, &mut || ())
}

/// NEES of the position (three coordinates) for one method's pose.
fn nees(pose: &beampose_core::Pose, truth: Vector3<f64>) -> f64 {
    let error = Vector3::from(pose.position_mm) - truth;
    let covariance = Matrix3::from_fn(|r, c| pose.covariance[r][c]);
    error.dot(&(covariance.cholesky().unwrap().solve(&error)))
}

#[test]
fn a_perfect_sighting_gives_the_true_pose() {
    let laboratory = Laboratory::exact();
    let (sightings, truth) = laboratory.capture(0, 300.0);
    let solution = solve(&laboratory, &sightings, Some(658.0));
    for result in &solution.results {
        let pose = result.pose.as_ref().unwrap();
        let error = Vector3::from(pose.position_mm) - truth.position;
        assert!(error.norm() < 1e-3, "{:?}: {error}", result.method);
        let [w, x, y, z] = pose.quaternion_wxyz;
        let q = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
        assert!(q.angle_to(&truth.rotation) < 1e-6, "{:?}", result.method);
        assert_eq!(result.beams_used, 121);
    }
}

/// The stated covariance against the scatter: mean NEES of `n` independent draws of three
/// coordinates is 3 with a standard deviation of sqrt(6 / n); four of these are allowed.
#[test]
fn the_stated_covariance_is_true() {
    let draws = 200;
    let mut sums = [0.0; 2];
    for seed in 0..draws {
        let laboratory = Laboratory::drawn(seed);
        let (sightings, truth) = laboratory.capture(seed, 100.0 * f64::from(seed as u32 % 10));
        let solution = solve(&laboratory, &sightings, Some(laboratory.read_nm()));
        for (sum, result) in sums.iter_mut().zip(&solution.results) {
            *sum += nees(result.pose.as_ref().unwrap(), truth.position);
        }
    }
    for (sum, method) in sums.iter().zip(Method::USUAL) {
        let mean = sum / draws as f64;
        let bound = 4.0 * (6.0 / draws as f64).sqrt();
        println!("{}: mean NEES {mean:.3}", method.name());
        assert!((mean - 3.0).abs() < bound, "{}: mean NEES {mean}", method.name());
    }
}

#[test]
fn hidden_dots_strays_and_a_wrong_target_are_survived() {
    let laboratory = Laboratory::drawn(5);
    let (mut sightings, truth) = laboratory.capture(5, 400.0);
    for (k, sighting) in sightings.values_mut().enumerate() {
        let mut index = 0;
        sighting.dots.retain(|_| {
            index += 1;
            (index * 7 + k) % 5 != 0
        });
        for s in 0..12 {
            let mut stray = sighting.dots[s];
            stray.point.at.x += 23.0 + 11.0 * s as f64;
            stray.point.at.y -= 31.0;
            sighting.dots.push(stray);
        }
        sighting.targets[k].point.at.x += 4.0;
    }
    let solution = solve(&laboratory, &sightings, Some(laboratory.read_nm()));
    for result in &solution.results {
        let pose = result.pose.as_ref().unwrap();
        // 99.99 % of a chi squared of three.
        assert!(nees(pose, truth.position) < 21.1, "{:?}", result.method);
        assert!(result.beams_used > 90);
    }
}

#[test]
fn what_cannot_be_solved_says_why() {
    let laboratory = Laboratory::exact();
    let (mut sightings, _) = laboratory.capture(0, 0.0);
    for sighting in sightings.values_mut() {
        sighting.dots.clear();
    }
    let solution = solve(&laboratory, &sightings, None);
    let reason = solution.results[0].pose.as_ref().unwrap_err();
    assert!(reason.contains("grid of dots"), "{reason}");
    for sighting in sightings.values_mut() {
        sighting.targets.clear();
    }
    let solution = solve(&laboratory, &sightings, None);
    let reason = solution.results[1].pose.as_ref().unwrap_err();
    assert!(reason.contains("0 of the artefact's targets found"), "{reason}");
}

#[test]
fn one_blind_camera_is_survived() {
    let laboratory = Laboratory::drawn(11);
    let (mut sightings, truth) = laboratory.capture(11, 700.0);
    sightings.remove("cam_b");
    let solution = solve(&laboratory, &sightings, Some(laboratory.read_nm()));
    for result in &solution.results {
        assert!(nees(result.pose.as_ref().unwrap(), truth.position) < 21.1);
    }
    assert!(solution.notes.iter().any(|n| n.contains("cam_b")));
}

#[test]
fn beams_are_named_as_the_module_sees_them() {
    let laboratory = Laboratory::exact();
    let (sightings, _) = laboratory.capture(0, 900.0);
    let solution = solve(&laboratory, &sightings, Some(658.0));
    let camera = &solution.cameras["cam_a"];
    let at = |m, n| {
        let named = Subject::Dot(Order { m, n });
        camera.observations.iter().find(|o| o.subject == named).unwrap().at
    };
    assert!(at(5, 0)[0] > at(-5, 0)[0] && at(0, 5)[1] > at(0, -5)[1]);
}
