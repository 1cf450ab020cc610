//! A whole session in one adjustment, against the truth of a drawn laboratory.

use crate::scene::{Laboratory, Truth};
use beampose_photogrammetry::solve::{
    CaptureSolution, Method, SolvedCapture, solve_capture, solve_session,
};
use nalgebra::{Matrix3, Vector3};

/// Two passes of ten stops over 0.9 m.
fn session(seed: u64) -> (Laboratory, Vec<CaptureSolution>, Vec<Truth>) {
    let laboratory = Laboratory::drawn(seed);
    let (mut solutions, mut truths) = (Vec::new(), Vec::new());
    for k in 0..20_u64 {
        let (sightings, truth) = laboratory.capture(1000 * seed + k, 100.0 * (k % 10) as f64);
        let read = Some(laboratory.read_nm());
        let methods = [Method::VirtualCamera];
        solutions.push(solve_capture(&laboratory.setup, &sightings, read, &methods, &mut || ()));
        truths.push(truth);
    }
    (laboratory, solutions, truths)
}

fn position(pose: &beampose_core::Pose) -> Vector3<f64> {
    Vector3::from(pose.position_mm)
}

/// Errors of the distances from the first stop of each pass: by itself, and stated standard
/// uncertainties.
struct Distances {
    alone: Vec<f64>,
    together: Vec<f64>,
    stated: Vec<f64>,
}

fn distances(seed: u64) -> Distances {
    let (laboratory, solutions, truths) = session(seed);
    let captures: Vec<SolvedCapture<'_>> = solutions
        .iter()
        .map(|solution| SolvedCapture { solution, wavelength_nm: Some(laboratory.read_nm()) })
        .collect();
    let joint = solve_session(&laboratory.setup, &captures).unwrap();
    assert!((joint.sigma0 - 1.0).abs() < 0.1, "sigma0 {}", joint.sigma0);
    let mut found = Distances { alone: Vec::new(), together: Vec::new(), stated: Vec::new() };
    for k in (0..20).filter(|k| k % 10 != 0) {
        let start = k / 10 * 10;
        let truth = (truths[k].position - truths[start].position).norm();
        let single = |i: usize| position(solutions[i].results[0].pose.as_ref().unwrap());
        found.alone.push((single(k) - single(start)).norm() - truth);
        let pose = |i: usize| position(joint.poses[i].as_ref().unwrap());
        let way = pose(k) - pose(start);
        found.together.push(way.norm() - truth);
        let block = |a, b| -> Matrix3<f64> {
            joint.between(a, b).unwrap().fixed_view::<3, 3>(0, 0).into_owned()
        };
        let covariance = block(k, k) + block(start, start) - block(k, start) - block(start, k);
        let along = way.normalize();
        found.stated.push((along.transpose() * covariance * along).x.sqrt());
    }
    found
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

#[test]
fn distances_of_a_session_adjusted_together_are_better_and_their_uncertainty_is_true() {
    let (mut alone, mut together, mut normalised) = (Vec::new(), Vec::new(), Vec::new());
    for seed in 0..10 {
        let d = distances(seed);
        let worst = d.together.iter().fold(0.0_f64, |w, e| w.max(e.abs()));
        println!(
            "seed {seed}: alone {:.4} mm, together {:.4} mm, worst {worst:.4} mm, stated {:.4}",
            rms(&d.alone),
            rms(&d.together),
            rms(&d.stated)
        );
        normalised.extend(d.together.iter().zip(&d.stated).map(|(e, u)| e / u));
        alone.extend(d.alone);
        together.extend(d.together);
    }
    println!(
        "rms alone {:.4} mm, together {:.4} mm, normalised {:.3}",
        rms(&alone),
        rms(&together),
        rms(&normalised)
    );
    assert!(rms(&together) < rms(&alone));
    // Distances of a seed share its scale: ten seeds are about ten independent values, whose rms is
    // 1 with a standard deviation of 0.22; three of these are allowed.
    assert!((0.34..1.66).contains(&rms(&normalised)), "{}", rms(&normalised));
}
