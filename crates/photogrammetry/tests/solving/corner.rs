//! Beams named where growing a grid is not enough: a wall corner, most of the pattern damaged.

use std::collections::BTreeMap;

use crate::scene::{Laboratory, Shot};
use beampose_photogrammetry::detect::Dot;
use beampose_photogrammetry::solve::{Method, Sighting, solve_capture};
use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::iter::{IntoParallelIterator as _, ParallelIterator as _};

/// Cameras that see both walls of a corner at x = -600 mm.
const ROUND_A_CORNER: [(&str, [f64; 3]); 4] = [
    ("cam_a", [-350.0, 800.0, 2000.0]),
    ("cam_b", [900.0, 600.0, 1900.0]),
    ("cam_c", [100.0, -650.0, 2100.0]),
    ("cam_d", [1300.0, 100.0, 1500.0]),
];

/// How the dots are hidden.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Hidden {
    /// The same beams in all pictures: something stands before the module.
    Beams,
    /// Other dots in each picture: something stands before each camera.
    Dots,
}

/// What a seed came to.
#[derive(Debug, Clone, PartialEq)]
enum Outcome {
    /// Normalised squared error of each method's pose, six unknowns.
    Solved(Vec<f64>),
    Refused(String),
}

#[derive(Debug, Clone, Copy)]
struct Case {
    cameras: usize,
    hidden: Hidden,
    /// Bend of the second wall, degrees.
    bend: f64,
}

fn damage(sightings: &mut BTreeMap<String, Sighting>, hidden: Hidden, seed: u64) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let beams: Vec<bool> = (0..121).map(|_| rng.random_bool(0.6)).collect();
    let blind = rng.random_range(0..sightings.len());
    for (k, sighting) in sightings.values_mut().enumerate() {
        let mut index = 0;
        sighting.dots.retain(|_| {
            index += 1;
            match hidden {
                Hidden::Beams => beams[index - 1],
                Hidden::Dots => rng.random_bool(0.6),
            }
        });
        add_strays(&mut sighting.dots, 20, &mut rng);
        if k == blind {
            *sighting = Sighting::default();
        }
    }
}

/// Spots anywhere among the dots, some as bright as the zero order.
fn add_strays(dots: &mut Vec<Dot>, count: usize, rng: &mut ChaCha8Rng) {
    let bound = |axis: usize| {
        let values = || dots.iter().map(|d| d.point.at[axis]);
        values().fold(f64::MAX, f64::min)..values().fold(f64::MIN, f64::max)
    };
    let (across, down) = (bound(0), bound(1));
    for _ in 0..count {
        let mut stray = dots[0];
        stray.point.at.x = rng.random_range(across.clone());
        stray.point.at.y = rng.random_range(down.clone());
        stray.amplitude = rng.random_range(60.0..400.0);
        dots.insert(rng.random_range(0..dots.len()), stray);
    }
}

fn outcome(case: Case, seed: u64) -> Outcome {
    let laboratory = Laboratory::drawn_with(seed, &ROUND_A_CORNER[..case.cameras]);
    let mut rng = ChaCha8Rng::seed_from_u64(!seed);
    let mut between = |low: f64, high: f64| rng.random_range(low..high);
    let shot = Shot {
        turned_deg: [between(-6.0, 6.0), between(5.0, 30.0), between(-30.0, 30.0)],
        aim: [between(-650.0, -500.0), between(150.0, 250.0), 0.0],
        distance: between(900.0, 1500.0),
        corner: Some((-600.0, case.bend)),
    };
    let (mut sightings, truth) = laboratory.shot(seed, &shot);
    damage(&mut sightings, case.hidden, seed);
    let read = laboratory.setup.wavelength(Some(laboratory.read_nm()));
    let methods = &Method::USUAL;
    let solution = solve_capture(&laboratory.setup, &sightings, &read, methods, &mut || ());
    let poses: Result<Vec<f64>, String> =
        solution.results.iter().map(|r| Ok(truth.normalised(&r.pose.clone()?).0)).collect();
    poses.map_or_else(Outcome::Refused, Outcome::Solved)
}

/// The first seed. Seeds below 100 served to develop the identification, which solves all of them
/// where beams are hidden: what it is worth shows on seeds that nobody looked at.
const UNSEEN: u64 = 50_000;

/// No seed is wrong, and no more than `may_refuse` are refused: 99.99 % of a chi squared of six lie
/// below 27.9, and of a few hundred values none is expected beyond.
#[track_caller]
fn solved(case: Case, seeds: u64, may_refuse: usize) {
    let outcomes: Vec<Outcome> =
        (0..seeds).into_par_iter().map(|s| outcome(case, UNSEEN + s)).collect();
    let mut sums = [0.0; 2];
    let (mut refused, mut wrong) = (Vec::new(), Vec::new());
    for (seed, outcome) in outcomes.iter().enumerate() {
        match outcome {
            Outcome::Solved(nees) if nees.iter().all(|n| *n < 27.9) => {
                sums.iter_mut().zip(nees).for_each(|(sum, n)| *sum += n);
            }
            Outcome::Solved(nees) => wrong.push((seed, nees.clone())),
            Outcome::Refused(reason) => refused.push((seed, reason.clone())),
        }
    }
    let solved = seeds as usize - refused.len() - wrong.len();
    let mean = sums.map(|s| s / solved.max(1) as f64);
    println!("{case:?}: {solved} of {seeds} solved, mean normalised squared errors {mean:.2?}");
    println!("  refused {refused:?}\n  wrong {wrong:.1?}");
    assert!(wrong.is_empty(), "{case:?}: wrong poses {wrong:?}");
    assert!(refused.len() <= may_refuse, "{case:?}: refused {refused:?}");
}

// Of 200 unseen seeds each, refused were: four cameras 1, three cameras 7, outer corner 4; other dots
// hidden in each picture: four cameras 0, three cameras 11, a bend of 40 degrees 3. None was wrong.
// One in twenty may be refused here, one in ten where two pictures lack different dots.

#[test]
fn a_corner_with_hidden_beams_and_strays_is_solved_by_three_of_four_cameras() {
    solved(Case { cameras: 4, hidden: Hidden::Beams, bend: 90.0 }, 100, 5);
}

#[test]
fn a_corner_with_hidden_beams_and_strays_is_solved_by_two_of_three_cameras() {
    solved(Case { cameras: 3, hidden: Hidden::Beams, bend: 90.0 }, 100, 5);
}

#[test]
fn an_outer_corner_is_solved() {
    solved(Case { cameras: 3, hidden: Hidden::Beams, bend: -40.0 }, 100, 5);
}

/// Two pictures that each lack other four tenths have 44 of 121 beams in common, among 40 strays:
/// now and then one is refused for want of a patch of grid in both. What is asked of them is that
/// none is wrong without a word, and that nine in ten are solved.
#[test]
fn other_dots_hidden_in_each_picture_give_no_wrong_pose() {
    solved(Case { cameras: 4, hidden: Hidden::Dots, bend: 90.0 }, 100, 5);
    solved(Case { cameras: 3, hidden: Hidden::Dots, bend: 90.0 }, 100, 10);
    solved(Case { cameras: 3, hidden: Hidden::Dots, bend: 40.0 }, 100, 10);
}

/// Straight before the wall an even fan shifted by an order fits as well from a step aside, once so
/// much of its rim is hidden that its radial term does not show: the brighter zero order decides,
/// and without one nothing does.
#[test]
fn a_hidden_rim_straight_before_the_wall_is_decided_by_the_zero_order_alone() {
    let mut laboratory = Laboratory::drawn(4);
    let shot = Shot { turned_deg: [0.0; 3], ..Shot::on_rail(300.0) };
    let (mut sightings, truth) = laboratory.shot(4, &shot);
    for sighting in sightings.values_mut() {
        let mut index = 0;
        sighting.dots.retain(|_| {
            index += 1;
            let (column, row) = ((index - 1) % 11, (index - 1) / 11);
            (3..8).contains(&column) && (3..8).contains(&row)
        });
    }
    let read = laboratory.setup.wavelength(Some(laboratory.read_nm()));
    let methods = &Method::USUAL;
    let solution = solve_capture(&laboratory.setup, &sightings, &read, methods, &mut || ());
    for result in &solution.results {
        // 99.99 % of a chi squared of six.
        assert!(truth.normalised(result.pose.as_ref().unwrap()).0 < 27.9, "{:?}", result.method);
    }
    laboratory.setup.pattern.zero_order_relative_intensity = None;
    let solution = solve_capture(&laboratory.setup, &sightings, &read, methods, &mut || ());
    let reason = solution.results[0].pose.as_ref().unwrap_err();
    assert!(reason.contains("ambiguous"), "{reason}");
}
