//! Adjustments against what other solvers find on the same data.

#![expect(clippy::unwrap_used, clippy::panic, reason = "helpers of tests stop the test")]

mod data;
mod network;

use beampose_photogrammetry::adjust::{Datum, Options, Problem, adjust};

/// Half the sum of squares at the minimum, as peers report it.
#[track_caller]
fn check(mut problem: Problem, options: &Options, expected: f64, relative: f64) {
    let summary = adjust(&mut problem, options).unwrap();
    let cost = summary.chi2 / 2.0;
    println!(
        "{} iterations, cost {:.6} to {cost:.9}",
        summary.iterations,
        summary.initial_chi2 / 2.0
    );
    assert!((cost / expected - 1.0).abs() < relative, "{cost} against {expected}");
}

fn keep_all() -> Options {
    Options { outlier_sigmas: f64::INFINITY, ..Options::default() }
}

#[test]
fn eleven_by_eleven_dots_end_where_every_peer_ends() {
    check(data::dots("ba11.txt"), &keep_all(), 2.801_117, 5e-7 / 2.8);
}

#[test]
fn eighty_one_by_eighty_one_dots_end_where_every_peer_ends() {
    check(data::dots("ba81.txt.gz"), &keep_all(), 163.031_046, 5e-7 / 163.0);
}

#[test]
fn a_network_in_the_large_ends_where_ceres_ends() {
    // Nothing but points and cameras: nothing fixes place, orientation and scale. Each damped step
    // leaves them where they are.
    let options = Options { datum: Datum::Damped, ..keep_all() };
    check(data::in_the_large("bal-16-22106.txt.gz"), &options, 18_033.903_5, 1e-5);
}
