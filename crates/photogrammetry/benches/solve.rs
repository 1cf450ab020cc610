//! From sightings to poses: one capture, and sixty in one adjustment.
//!
//! `cargo bench -p beampose-photogrammetry --bench solve`

#[path = "../tests/solving/scene.rs"]
#[expect(dead_code, clippy::unwrap_used, reason = "the tests use more of it, and may panic")]
mod scene;

use beampose_photogrammetry::solve::{
    CaptureSolution, Method, SolvedCapture, solve_capture, solve_session,
};
use divan::{Bencher, black_box};
use scene::Laboratory;

fn main() {
    divan::main();
}

fn capture(laboratory: &Laboratory, k: u64, methods: &[Method]) -> CaptureSolution {
    let (sightings, _) = laboratory.capture(k, 90.0 * (k % 10) as f64);
    let read = laboratory.setup.wavelength(Some(laboratory.read_nm()));
    solve_capture(&laboratory.setup, &sightings, &read, methods, &mut || ())
}

#[divan::bench]
fn one_capture_virtual_camera(bencher: Bencher<'_, '_>) {
    let laboratory = Laboratory::drawn(1);
    let (sightings, _) = laboratory.capture(1, 400.0);
    let read = laboratory.setup.wavelength(Some(laboratory.read_nm()));
    bencher.bench_local(|| {
        let methods = [Method::VirtualCamera];
        solve_capture(black_box(&laboratory.setup), &sightings, &read, &methods, &mut || ())
    });
}

#[divan::bench]
fn one_capture_inter_beam_angles(bencher: Bencher<'_, '_>) {
    let laboratory = Laboratory::drawn(1);
    let (sightings, _) = laboratory.capture(1, 400.0);
    let read = laboratory.setup.wavelength(Some(laboratory.read_nm()));
    bencher.bench_local(|| {
        let methods = [Method::InterBeamAngles];
        solve_capture(black_box(&laboratory.setup), &sightings, &read, &methods, &mut || ())
    });
}

#[divan::bench(sample_count = 10)]
fn session_of_sixty_captures(bencher: Bencher<'_, '_>) {
    let laboratory = Laboratory::drawn(1);
    let solutions: Vec<CaptureSolution> =
        (0..60).map(|k| capture(&laboratory, k, &[Method::VirtualCamera])).collect();
    let captures: Vec<SolvedCapture<'_>> = solutions
        .iter()
        .map(|solution| SolvedCapture {
            solution,
            wavelength: laboratory.setup.wavelength(Some(laboratory.read_nm())),
        })
        .collect();
    bencher.bench_local(|| {
        let solution = solve_session(black_box(&laboratory.setup), &captures);
        solution.map(|s| s.poses.len())
    });
}
