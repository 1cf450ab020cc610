//! The module from 121 dots in space, by each estimator: the case of Table 6.1 (equal angles of
//! 2.9 degrees, plane at 2 m, dots uncertain by 0.1 mm), 420 angles or 242 distances, from a start
//! 60 mm off. `cargo bench -p beampose-photogrammetry --bench angles`; peers on the same problem:
//! `python benches/peers/angles.py`.

#![expect(clippy::expect_used, reason = "a benchmark that cannot be set up stops")]

use beampose_photogrammetry::pose::{
    DotField, Estimator, Fan, SimplexOptions, fit_angles, locate, neighbour_observations,
};
use beampose_photogrammetry::{Pattern, PatternUncertainty};
use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const START: Vector3<f64> = Vector3::new(30.0, -30.0, 40.0);

fn main() {
    divan::main();
}

fn scene(size: u32, view_deg: f64) -> (Pattern, DotField) {
    let u = PatternUncertainty { angle_deg: 0.0013, common_relative: 0.0 };
    let step = view_deg.to_radians() / f64::from(size - 1);
    let pattern = Pattern::equal_angle(size, step, u);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut noise = || -> f64 { StandardNormal.sample(&mut rng) };
    let mut dot = |d: Vector3<f64>| d * (2000.0 / d.z) + Vector3::from_fn(|_, _| 0.1 * noise());
    let beams = pattern.beams(0.0);
    let places = beams.iter().map(|b| dot(b.direction)).collect();
    let field = DotField::uniform(beams.iter().map(|b| b.order).collect(), places, 0.1);
    (pattern, field)
}

/// Position alone, unit weights, Levenberg-Marquardt: what the peers do.
#[divan::bench(args = [11, 81])]
fn angles_position_alone(bencher: divan::Bencher, size: u32) {
    let (pattern, field) = scene(size, if size == 11 { 29.0 } else { 35.0 });
    let angles = neighbour_observations(&pattern, &field.orders, 0.0);
    bencher.bench(|| fit_angles(&field.places, &angles, START).expect("the dots fix a position"));
}

/// The same by the dissertation's simplex, covariance included.
#[divan::bench]
fn angles_by_simplex(bencher: divan::Bencher) {
    by(bencher, 11, Estimator::AnglesSimplex(SimplexOptions::default()));
}

/// Position, rotation and covariance.
#[divan::bench]
fn angles_with_covariance(bencher: divan::Bencher) {
    by(bencher, 11, Estimator::Angles);
}

#[divan::bench]
fn angles_generalised(bencher: divan::Bencher) {
    by(bencher, 11, Estimator::AnglesGeneralised);
}

#[divan::bench(args = [11, 81])]
fn rays(bencher: divan::Bencher, size: u32) {
    by(bencher, size, Estimator::Rays);
}

fn by(bencher: divan::Bencher, size: u32, estimator: Estimator) {
    let (pattern, field) = scene(size, if size == 11 { 29.0 } else { 35.0 });
    let fan = Fan { pattern: &pattern, scale: 0.0, scale_sigma: 1e-4 };
    bencher.bench(|| locate(&fan, &field, estimator, START).expect("the dots fix a pose"));
}
