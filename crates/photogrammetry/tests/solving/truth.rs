//! Truth of the covariance: how often the stated 95 % ellipsoid holds the true pose.

use crate::scene::{Laboratory, Shot};
use beampose_photogrammetry::solve::{Method, solve_capture};
use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::iter::{IntoParallelIterator as _, ParallelIterator as _};

const POSES: u64 = 2000;
/// The 95 % points of chi squared with six and with three degrees of freedom.
const SIX: f64 = 12.592;
const THREE: f64 = 7.815;

/// Which ellipsoids of a pose hold the truth: per method of six unknowns and of the position.
fn held(seed: u64) -> [[bool; 2]; 4] {
    let laboratory = Laboratory::drawn(seed);
    let mut rng = ChaCha8Rng::seed_from_u64(!seed);
    let mut between = |low: f64, high: f64| rng.random_range(low..high);
    let shot = Shot {
        turned_deg: [between(-8.0, 8.0), between(-10.0, 25.0), between(-30.0, 30.0)],
        aim: [between(-500.0, -300.0), between(150.0, 250.0), 0.0],
        distance: between(800.0, 1800.0),
        // Half of the walls are flat, the others folded by up to 25 degrees either way.
        corner: (seed % 2 == 1).then(|| (between(-600.0, -250.0), between(-25.0, 25.0))),
    };
    let (mut sightings, truth) = laboratory.shot(seed, &shot);
    // Up to a third of the dots hidden, others in each picture.
    let hidden = between(0.0, 0.33);
    for sighting in sightings.values_mut() {
        sighting.dots.retain(|_| between(0.0, 1.0) > hidden);
    }
    let read = laboratory.setup.wavelength(Some(laboratory.read_nm()));
    let methods = &Method::OF_A_CAPTURE;
    let solution = solve_capture(&laboratory.setup, &sightings, &read, methods, &mut || ());
    [0, 1, 2, 3].map(|method| {
        let (six, three) = truth.normalised(solution.results[method].pose.as_ref().unwrap());
        [six < SIX, three < THREE]
    })
}

/// The share of 2,000 has a standard deviation of 0.49 %: asked are 93.5 to 96.5 %, three of these.
#[test]
fn the_ellipsoid_of_95_percent_holds_the_truth_in_95_percent() {
    let all: Vec<_> = (0..POSES).into_par_iter().map(held).collect();
    for (k, method) in Method::OF_A_CAPTURE.iter().enumerate() {
        for (part, name) in ["six unknowns", "position"].iter().enumerate() {
            let share = all.iter().filter(|h| h[k][part]).count() as f64 / POSES as f64;
            println!("{}, {name}: {:.2} %", method.name(), 100.0 * share);
            assert!((0.935..=0.965).contains(&share), "{}, {name}: {share}", method.name());
        }
    }
}
