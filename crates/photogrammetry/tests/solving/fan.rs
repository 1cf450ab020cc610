//! The fan from a session's photographs, against the one that was drawn.

use beampose_photogrammetry::calibrate::pattern::{FanPrior, SessionFan, calibrate_from_session};
use beampose_photogrammetry::pattern::{angle_between, neighbour_pairs};
use beampose_photogrammetry::solve::{CaptureSolution, Method, SolvedCapture, solve_capture};
use nalgebra::Vector3;

use crate::scene::Laboratory;

/// Six passes of ten stops, and captures with the module turned before them.
fn six_passes(laboratory: &Laboratory, seed: u64, turns_deg: &[f64]) -> Vec<CaptureSolution> {
    let read = Some(laboratory.read_nm());
    let solve = |sightings: &_| {
        let methods = [Method::VirtualCamera];
        solve_capture(&laboratory.setup, sightings, read, &methods, &mut || ())
    };
    let turned = turns_deg.iter().enumerate().map(|(k, turn)| {
        solve(&laboratory.capture_turned(1000 * seed + 700 + k as u64, 450.0, *turn).0)
    });
    let stops =
        (0..60).map(|k| solve(&laboratory.capture(1000 * seed + k, 100.0 * (k % 10) as f64).0));
    turned.chain(stops).collect()
}

fn calibrate(
    laboratory: &Laboratory,
    solutions: &[CaptureSolution],
    prior: FanPrior,
) -> SessionFan {
    let wavelength_nm = Some(laboratory.read_nm());
    let captures: Vec<SolvedCapture<'_>> =
        solutions.iter().map(|solution| SolvedCapture { solution, wavelength_nm }).collect();
    calibrate_from_session(&laboratory.setup, &captures, prior).unwrap()
}

/// Errors of the angles at the reference wavelength: radians, over the stated standard uncertainty.
fn errors(laboratory: &Laboratory, found: &SessionFan) -> Vec<(f64, f64)> {
    let truth = laboratory.true_directions();
    let at = |order| -> Vector3<f64> { truth[found.pattern.index(order).unwrap()] };
    let pairs = neighbour_pairs(&found.pattern);
    assert_eq!(pairs.len(), found.angles.len());
    found
        .angles
        .iter()
        .map(|a| a.angle - angle_between(&at(a.pair.a), &at(a.pair.b)))
        .zip(&found.angles)
        .map(|(error, a)| (error, error / a.u))
        .collect()
}

fn say(what: &str, laboratory: &Laboratory, found: &SessionFan) -> (f64, f64) {
    let errors = errors(laboratory, found);
    let rms = |of: &dyn Fn(&(f64, f64)) -> f64| {
        (errors.iter().map(|e| of(e).powi(2)).sum::<f64>() / errors.len() as f64).sqrt()
    };
    let most = errors.iter().map(|e| e.0.abs()).fold(0.0, f64::max).to_degrees();
    let u = found.angles.iter().map(|a| a.u).fold(0.0, f64::max).to_degrees();
    let single = found.angles.iter().map(|a| a.u_random).fold(0.0, f64::max).to_degrees();
    println!(
        "{what}: worst {most:.5} deg, rms {:.5}, normalised {:.3}; u up to {u:.5}, without scale {single:.5}; \
         scale {:.6} u {:.6} told {:.3}; sigma0 {:.3}",
        rms(&|e| e.0).to_degrees(),
        rms(&|e| e.1),
        found.scale,
        found.scale_u,
        found.scale_told,
        found.sigma0
    );
    (most, rms(&|e| e.1))
}

#[test]
fn a_fan_known_by_its_data_sheet_is_calibrated_by_one_session() {
    let nominal = FanPrior::nominal();
    for seed in 0..4 {
        let laboratory = Laboratory::drawn(seed);
        let plain = six_passes(&laboratory, seed, &[]);
        say("plain, nominal", &laboratory, &calibrate(&laboratory, &plain, nominal));
        let prior = FanPrior { scale: 1e-4, ..nominal };
        say("plain, pitch known", &laboratory, &calibrate(&laboratory, &plain, prior));
        let prior = FanPrior { scale: 1e-4, beam: 0.0013f64.to_radians() };
        say("plain, calibrated", &laboratory, &calibrate(&laboratory, &plain, prior));
        let turned = six_passes(&laboratory, seed, &[-25.0, -12.0, 12.0, 25.0]);
        say("turned, nominal", &laboratory, &calibrate(&laboratory, &turned, nominal));
    }
}
