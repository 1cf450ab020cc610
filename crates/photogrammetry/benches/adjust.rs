//! Bundle adjustments whose time with other solvers is known (README, "Speed").
//!
//! `cargo bench -p beampose-photogrammetry --bench adjust`

#[path = "../tests/bundles/data.rs"]
#[expect(clippy::unwrap_used, reason = "a benchmark may fail by panicking")]
mod data;

use beampose_photogrammetry::adjust::{Datum, Options, Problem, adjust};
use divan::Bencher;
use divan::black_box;

fn main() {
    divan::main();
}

fn options() -> Options {
    Options { outlier_sigmas: f64::INFINITY, ..Options::default() }
}

fn solve(bencher: Bencher<'_, '_>, problem: &Problem, options: Options) {
    // What is given back is dropped after the clock has stopped.
    bencher.with_inputs(|| problem.clone()).bench_local_values(|mut problem| {
        let solution = adjust(black_box(&mut problem), &options);
        (problem, solution)
    });
}

fn module_covariance(bencher: Bencher<'_, '_>, problem: &Problem) {
    bencher
        .with_inputs(|| {
            let mut problem = problem.clone();
            adjust(&mut problem, &options()).map(|s| s.covariance)
        })
        .bench_local_values(|covariance| covariance.map(|c| c.camera(black_box(3))));
}

#[divan::bench]
fn ba11_solve(bencher: Bencher<'_, '_>) {
    solve(bencher, &data::dots("ba11.txt"), options());
}

#[divan::bench]
fn ba11_module_covariance(bencher: Bencher<'_, '_>) {
    module_covariance(bencher, &data::dots("ba11.txt"));
}

#[divan::bench(sample_count = 30)]
fn ba81_solve(bencher: Bencher<'_, '_>) {
    solve(bencher, &data::dots("ba81.txt.gz"), options());
}

#[divan::bench(sample_count = 30)]
fn ba81_module_covariance(bencher: Bencher<'_, '_>) {
    module_covariance(bencher, &data::dots("ba81.txt.gz"));
}

#[divan::bench(sample_count = 3)]
fn bal_16_22106_solve(bencher: Bencher<'_, '_>) {
    let options = Options { datum: Datum::Damped, ..options() };
    solve(bencher, &data::in_the_large("bal-16-22106.txt.gz"), options);
}
