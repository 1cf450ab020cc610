//! Calibrations that were repeated, and the files that they are kept in.

use beampose_photogrammetry::Camera;
use beampose_photogrammetry::calibrate::{
    Interior, Stability, StabilityError, Stated, Unknowns, compare, read_observations, read_stated,
    self_calibrate, start_camera, write_calibration,
};
use beampose_photogrammetry::camera::read_camera_info;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Stated standard deviations of f, cx, cy, pixels.
const SIGMA: [f64; 3] = [0.4, 0.3, 0.2];

/// Ten calibrations with noise as stated, each then changed by `change`.
fn ten(seed: u64, change: impl Fn(usize, &mut Camera)) -> Stability {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut deviate = || -> f64 { StandardNormal.sample(&mut random) };
    let calibrations: Vec<_> = (0..10)
        .map(|i| {
            let [f, x, y] = SIGMA.map(|sigma| sigma * deviate());
            let mut camera = Camera::without_distortion(
                [3456, 2592],
                [3529.0 + f, 3529.0 + f],
                [1740.0 + x, 1280.0 + y],
            );
            change(i, &mut camera);
            let covariance = (0..3)
                .map(|r| (0..3).map(|c| if r == c { SIGMA[r] * SIGMA[r] } else { 0.0 }).collect());
            let stated = Stated {
                parameters: vec![Interior::F, Interior::Cx, Interior::Cy],
                covariance: covariance.collect(),
            };
            (format!("calibration {i}"), camera, Some(stated))
        })
        .collect();
    compare(&calibrations).unwrap()
}

fn of(
    stability: &Stability,
    parameter: Interior,
) -> &beampose_photogrammetry::calibrate::ParameterStability {
    stability.parameters.iter().find(|p| p.parameter == parameter).unwrap()
}

/// Steps that are significant, by parameter.
fn significant(stability: &Stability) -> Vec<(Interior, usize)> {
    let steps = stability.parameters.iter().flat_map(|p| {
        let found = p.changes.iter().enumerate().filter(|(_, c)| c.is_significant);
        found.map(|(i, _)| (p.parameter, i))
    });
    steps.collect()
}

#[test]
fn a_camera_that_stays_gives_a_false_alarm_in_one_comparison_of_twenty() {
    let is_alarmed = |seed: &u64| {
        let found = ten(*seed, |_, _| ());
        let verdict = |p: &beampose_photogrammetry::calibrate::ParameterStability| {
            p.is_drifting || p.is_unstable
        };
        !significant(&found).is_empty() || found.parameters.iter().any(verdict)
    };
    let alarms = (0..200).filter(is_alarmed).count();
    // The level of 5 % is an upper bound, as the tests overlap: binomial, 10 +- 3.1 of 200, and not
    // none at all.
    assert!((1..=22).contains(&alarms), "{alarms} of 200");
}

#[test]
fn a_jump_is_found_where_it_is() {
    // 5 px are nine sigma of a difference.
    let found = ten(3, |i, camera| {
        if i >= 6 {
            camera.fx += 5.0;
            camera.fy += 5.0;
        }
    });
    assert_eq!(significant(&found), [(Interior::F, 5)]);
    assert!(of(&found, Interior::F).is_unstable && !of(&found, Interior::Cx).is_unstable);
}

#[test]
fn a_drift_is_found_though_no_single_step_is() {
    // A third of sigma a step: the slope over ten has a standard deviation of sigma / 9.1.
    let found = ten(5, |i, camera| camera.cx += 0.25 * i as f64);
    assert!(significant(&found).is_empty());
    let cx = of(&found, Interior::Cx);
    assert!(cx.is_drifting && !of(&found, Interior::Cy).is_drifting);
    assert!((cx.drift_sigma.unwrap() - SIGMA[1] / 82.5f64.sqrt()).abs() < 1e-12);
    assert!((cx.drift - 0.25).abs() < 4.0 * cx.drift_sigma.unwrap(), "{}", cx.drift);
}

#[test]
fn mean_scatter_and_range_are_those_of_the_values() {
    let calibrations: Vec<_> = [3529.0, 3531.0, 3530.0, 3534.0]
        .iter()
        .map(|fx| {
            let camera = Camera::without_distortion([10, 10], [*fx, 3500.0], [5.0, 5.0]);
            (String::new(), camera, None)
        })
        .collect();
    let found = compare(&calibrations).unwrap();
    let fx = of(&found, Interior::Fx);
    assert_eq!((fx.mean, fx.range), (3531.0, 5.0));
    // Squares 4 + 0 + 1 + 9 over three; slope (-1.5 x -2 + 0.5 x -1 + 1.5 x 3) / 5.
    assert!((fx.scatter - (14.0f64 / 3.0).sqrt()).abs() < 1e-12);
    assert!((fx.drift - 1.4).abs() < 1e-12, "{}", fx.drift);
    // Nothing is stated: nothing is significant, and no probability is made up.
    assert_eq!((fx.drift_probability, fx.changes[0].probability), (None, None));
    assert!(found.parameters.iter().all(|p| p.parameter != Interior::K1));
}

#[test]
fn calibrations_of_different_cameras_are_not_compared() {
    let camera = |width| Camera::without_distortion([width, 480], [500.0, 500.0], [320.0, 240.0]);
    let one = ("a".to_owned(), camera(640), None);
    assert_eq!(compare(std::slice::from_ref(&one)), Err(StabilityError::TooFew));
    let told = compare(&[one, ("b".to_owned(), camera(641), None)]).unwrap_err().to_string();
    assert_eq!(told, "b is for pictures of 641 x 480, a for 640 x 480: not the same camera");
}

#[test]
fn a_calibration_file_is_ros_and_says_what_it_is_worth() {
    let views = read_observations(include_str!("../data/opencv-chess-corners.csv"), 1.0).unwrap();
    let start = start_camera(&views, [640, 480]).unwrap();
    let found = self_calibrate(&views, &start, &Unknowns::default()).unwrap();
    let text = write_calibration("left", &found);
    assert_eq!(read_camera_info(&text).unwrap(), found.camera);
    let stated = read_stated(&text).unwrap().unwrap();
    for unknown in found.unknowns.iter() {
        assert_eq!(stated.standard_deviation(unknown), found.standard_deviation(unknown));
    }
    let plain = beampose_photogrammetry::camera::write_camera_info("left", &found.camera);
    assert_eq!(read_stated(&plain), Ok(None));
    let cut = text.replace("parameters: [fx, ", "parameters: [");
    assert!(read_stated(&cut).unwrap_err().contains("must be 8 x 8"));
}
