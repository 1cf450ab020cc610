//! What the adjustment says about itself: its datum, its covariance, its bad observations.

use beampose_photogrammetry::adjust::{
    AdjustError, CameraStation, Control, Covariance, Datum, ImageObservation, InteriorOrientation,
    Loss, ObservationId, Options, Problem, ScaleBar, adjust, test_observations, variance_component,
};
use beampose_photogrammetry::camera::Camera;
use beampose_photogrammetry::initial::{InitialError, initial_values};
use beampose_photogrammetry::pose::Station;
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Rotation3, SMatrix, Vector2, Vector3, Vector6};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const SIGMA: f64 = 0.1;

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

fn camera() -> Camera {
    let (k1, k2, p1, p2, k3) = (-0.05, 0.0, 0.0, 0.0, 0.0);
    let (fx, fy, cx, cy) = (3500.0, 3500.0, 1727.5, 1295.5);
    Camera { width: 3456, height: 2592, fx, fy, cx, cy, k1, k2, p1, p2, k3 }
}

fn look_at(centre: [f64; 3]) -> Station {
    let centre = Vector3::from(centre);
    let z = (-centre).normalize();
    let x = z.cross(&Vector3::y()).normalize();
    let frame = Matrix3::from_columns(&[x, z.cross(&x), z]);
    Station { centre, rotation: Rotation3::from_matrix_unchecked(frame) }
}

/// Sixteen points of a shallow box before four cameras, with noise of `SIGMA`; the truth as start.
fn network(seed: u64) -> Problem {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut problem =
        Problem { interiors: vec![InteriorOrientation::fixed(camera())], ..Problem::default() };
    for centre in [
        [-900.0, 300.0, 1900.0],
        [900.0, 200.0, 1900.0],
        [0.0, -800.0, 2000.0],
        [100.0, 900.0, 1800.0],
    ] {
        problem.cameras.push(CameraStation {
            station: look_at(centre),
            interior: 0,
            is_held: false,
        });
    }
    for i in 0..16 {
        let (x, y) = (f64::from(i % 4) * 150.0 - 225.0, f64::from(i / 4) * 150.0 - 225.0);
        problem.points.push(Vector3::new(x, y, if i % 3 == 0 { 80.0 } else { 0.0 }));
    }
    for camera in 0..4 {
        for point in 0..16 {
            let noise = Vector2::new(normal(&mut rng), normal(&mut rng)) * SIGMA;
            let at = problem.image_of(camera, point).unwrap() + noise;
            let information = Matrix2::identity() / (SIGMA * SIGMA);
            problem.images.push(ImageObservation { camera, point, at, information });
        }
    }
    problem
}

fn control(problem: &Problem, point: usize) -> Control {
    Control { point, at: problem.points[point], sigma: 0.01 }
}

#[track_caller]
fn refused(problem: &Problem, reason: &str) {
    let mut problem = problem.clone();
    match adjust(&mut problem, &Options::default()) {
        Err(AdjustError::Singular(said)) => assert_eq!(said, reason),
        other => panic!("{:?}", other.map(|s| s.chi2)),
    }
}

#[test]
fn what_fixes_nothing_is_named() {
    let mut problem = network(0);
    refused(
        &problem,
        "position, orientation and scale are undetermined: no control point, no held camera and no \
         scale bar",
    );
    problem.scale_bars.push(ScaleBar { ends: [0, 3], length: 450.0, sigma: 0.01 });
    refused(
        &problem,
        "position and orientation are undetermined: no control point, no held camera",
    );
    problem.scale_bars.clear();
    problem.cameras[0].is_held = true;
    refused(&problem, "scale is undetermined: no scale bar and no control");
    problem.cameras[0].is_held = false;
    problem.controls = vec![control(&problem, 0)];
    refused(&problem, "orientation and scale are undetermined: only 1 control point");
    problem.controls = [0, 1, 2].map(|p| control(&problem, p)).into();
    problem.controls[0].at.z = 0.0;
    problem.points[0].z = 0.0;
    refused(&problem, "orientation is undetermined: the control points lie on a line");
    let controls = [0, 3, 12].map(|p| control(&problem, p)).into();
    problem.controls = controls;
    adjust(&mut problem, &Options::default()).unwrap();
    // A held camera and a scale bar fix everything as well.
    problem.controls.clear();
    problem.cameras[0].is_held = true;
    problem.scale_bars.push(ScaleBar { ends: [5, 10], length: 212.132, sigma: 0.01 });
    adjust(&mut problem, &Options::default()).unwrap();
}

/// The points of an adjusted network less the truth, moved and turned (and scaled) onto it as well
/// as may be: what inner constraints promise.
fn free_network(seed: u64, bars: &[ScaleBar]) -> (Vec<Vector3<f64>>, Covariance, f64) {
    let mut problem = network(seed);
    problem.scale_bars = bars.to_vec();
    let truth = problem.points.clone();
    let options = Options {
        datum: Datum::InnerConstraints,
        outlier_sigmas: f64::INFINITY,
        ..Options::default()
    };
    let summary = adjust(&mut problem, &options).unwrap();
    let errors = problem.points.iter().zip(&truth).map(|(a, b)| a - b).collect();
    (errors, summary.covariance, summary.chi2 / summary.redundancy as f64)
}

#[test]
fn a_free_network_neither_moves_nor_turns_nor_grows_and_states_a_true_covariance() {
    let (errors, covariance, _) = free_network(1, &[]);
    let truth = network(1).points;
    let sum: Vector3<f64> = errors.iter().sum();
    let turn: Vector3<f64> = errors.iter().zip(&truth).map(|(e, p)| p.cross(e)).sum();
    let growth: f64 = errors.iter().zip(&truth).map(|(e, p)| p.dot(e)).sum();
    println!("sum {:.2e}, turn {:.2e}, growth {growth:.2e}", sum.norm(), turn.norm());
    assert!(sum.norm() < 1e-6 && turn.norm() < 1e-2 && growth.abs() < 1e-2);
    // Monte Carlo: the squares of 48 coordinates over 200 networks against the stated variances.
    let stated: f64 = (0..16).map(|p| covariance.point(p).unwrap().trace()).sum();
    let (mut squares, mut unit) = (0.0, 0.0);
    for seed in 0..200 {
        let (errors, _, sigma0_squared) = free_network(seed, &[]);
        squares += errors.iter().map(|e| e.norm_squared()).sum::<f64>() / 200.0;
        unit += sigma0_squared / 200.0;
    }
    // 41 degrees of freedom of the coordinates in 200 trials, unevenly weighted: about 2 %.
    assert!((squares / stated - 1.0).abs() < 0.06, "{squares} against {stated}");
    // 128 image coordinates less 24 + 48 - 7 unknowns, 200 times: 0.9 %.
    assert!((unit - 1.0).abs() < 0.03, "{unit}");
}

#[test]
fn a_scale_bar_gives_a_free_network_its_scale() {
    let bar = ScaleBar { ends: [0, 15], length: 636.396_103_067_892_8, sigma: 1e-4 };
    let (errors, covariance, _) = free_network(3, &[bar]);
    let truth = network(3).points;
    let points: Vec<_> = errors.iter().zip(&truth).map(|(e, t)| t + e).collect();
    assert!(((points[15] - points[0]).norm() - bar.length).abs() < 1e-3);
    let growth: f64 = errors.iter().zip(&truth).map(|(e, p)| p.dot(e)).sum();
    assert!(growth.abs() > 1e-2, "the scale is free: {growth}");
    // The variance of the bar's length is the bar's, whatever the points' own are.
    let way = (points[15] - points[0]).normalize();
    let at = |p: usize| covariance.point_cofactor(p).unwrap();
    let common = covariance.common().unwrap();
    let mut slopes = DVector::zeros(common.nrows());
    for (p, sign) in [(0, -1.0), (15, 1.0)] {
        for (unknown, by) in at(p).follows {
            slopes[unknown] += sign * way.dot(&Vector3::from(by));
        }
    }
    let sigma = (slopes.transpose() * common * slopes).x.sqrt();
    assert!((sigma / bar.sigma - 1.0).abs() < 0.01, "{sigma}");
}

fn anchored(seed: u64) -> Problem {
    let mut problem = network(seed);
    problem.controls = [0, 3, 12, 15, 6].map(|p| control(&problem, p)).into();
    problem
}

#[test]
fn the_bad_observation_is_named() {
    // A gross error of 25 sigma drags its neighbours along; Baarda's test still points at it.
    let (mut right, mut more) = (0, 0);
    for seed in 0..40 {
        let mut problem = anchored(seed);
        let bad = (seed as usize * 7) % problem.images.len();
        problem.images[bad].at += Vector2::new(0.6, -0.6) * (25.0 * SIGMA / 0.85);
        let options = Options { outlier_sigmas: f64::INFINITY, ..Options::default() };
        let summary = adjust(&mut problem, &options).unwrap();
        let tested = test_observations(&problem, &summary.covariance, 0.0);
        let worst = tested.iter().max_by(|a, b| a.statistic.total_cmp(&b.statistic)).unwrap();
        right += usize::from(worst.observation == ObservationId::Image(bad));
        // And left out by itself where that is asked.
        let mut problem = anchored(seed);
        problem.images[bad].at += Vector2::new(0.6, -0.6) * (25.0 * SIGMA / 0.85);
        let summary = adjust(&mut problem, &Options::default()).unwrap();
        assert!(summary.outlier_images.contains(&bad), "seed {seed}");
        more += summary.outlier_images.len() - 1;
    }
    assert_eq!(right, 40);
    // One good observation in 25,000 is beyond the limit: of these 2,560 one in ten tests.
    assert!(more <= 1, "{more} good ones left out");
}

#[test]
fn a_wrong_control_point_is_named() {
    let mut problem = anchored(5);
    problem.controls[2].at.x += 1.0;
    let options = Options { outlier_sigmas: f64::INFINITY, ..Options::default() };
    let summary = adjust(&mut problem, &options).unwrap();
    let tested = test_observations(&problem, &summary.covariance, 0.0);
    let worst = tested.iter().max_by(|a, b| a.statistic.total_cmp(&b.statistic)).unwrap();
    assert_eq!(worst.observation, ObservationId::Control(2));
}

#[test]
fn redundancies_add_up_and_variance_components_are_true() {
    let (mut first, mut second) = (0.0, 0.0);
    for seed in 0..60 {
        let mut problem = anchored(seed);
        // The first camera is stated twice as good as it is.
        for o in problem.images.iter_mut().filter(|o| o.camera == 0) {
            o.information *= 4.0;
        }
        let options = Options { outlier_sigmas: f64::INFINITY, ..Options::default() };
        let summary = adjust(&mut problem, &options).unwrap();
        let tested = test_observations(&problem, &summary.covariance, 0.0);
        let sum: f64 = tested.iter().map(|t| t.redundancy).sum();
        assert!((sum - summary.redundancy as f64).abs() < 1e-6, "{sum}");
        let is_first = |o: &ObservationId| matches!(o, ObservationId::Image(i) if *i < 16);
        let of = |first: bool| tested.iter().filter(move |t| is_first(&t.observation) == first);
        first += variance_component(of(true), 5.0).unwrap() / 60.0;
        second += variance_component(of(false), 5.0).unwrap() / 60.0;
    }
    // About 10 redundant coordinates of the first camera in 60 trials: 6 %. Its residuals take in
    // the noise of the others, so that the component is below 4.
    assert!((2.0..4.3).contains(&first), "{first}");
    assert!((0.7..1.3).contains(&second), "{second}");
}

#[test]
fn a_robust_loss_bears_what_least_squares_does_not() {
    let error = |loss: Loss| {
        let mut problem = anchored(9);
        let truth = problem.points.clone();
        for i in [3, 21, 40, 55] {
            problem.images[i].at += Vector2::new(9.0, -7.0);
        }
        let options = Options { loss, outlier_sigmas: f64::INFINITY, ..Options::default() };
        adjust(&mut problem, &options).unwrap();
        let errors = problem.points.iter().zip(&truth).map(|(a, b)| (a - b).norm_squared());
        (errors.sum::<f64>() / 16.0).sqrt()
    };
    let (squares, huber, cauchy) =
        (error(Loss::Squares), error(Loss::Huber(1.5)), error(Loss::Cauchy(2.0)));
    println!("squares {squares:.3}, Huber {huber:.3}, Cauchy {cauchy:.3} mm");
    assert!(huber < squares / 3.0 && cauchy < huber);
}

#[test]
fn the_covariance_of_camera_and_point_is_true() {
    let (mut nees_camera, mut nees_point) = (0.0, 0.0);
    let trials = 300;
    for seed in 0..trials {
        let mut problem = anchored(seed);
        let truth = problem.clone();
        let mut rng = ChaCha8Rng::seed_from_u64(1_000_000 + seed);
        for control in &mut problem.controls {
            control.at += Vector3::from_fn(|_, _| normal(&mut rng)) * control.sigma;
        }
        let summary =
            adjust(&mut problem, &Options { outlier_sigmas: f64::INFINITY, ..Options::default() })
                .unwrap();
        let (found, known) = (&problem.cameras[1].station, &truth.cameras[1].station);
        let turn = (found.rotation * known.rotation.inverse()).scaled_axis();
        let shift = found.centre - known.centre;
        let error = Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z);
        let covariance = summary.covariance.camera(1).unwrap();
        nees_camera += nees(&covariance, &error) / trials as f64;
        let error = problem.points[5] - truth.points[5];
        nees_point += nees(&summary.covariance.point(5).unwrap(), &error) / trials as f64;
    }
    // Means of 300 chi squared values with 6 and 3 degrees of freedom: 0.20 and 0.14.
    assert!((nees_camera - 6.0).abs() < 0.7, "{nees_camera}");
    assert!((nees_point - 3.0).abs() < 0.5, "{nees_point}");
}

fn nees<const N: usize>(covariance: &SMatrix<f64, N, N>, error: &SMatrix<f64, N, 1>) -> f64 {
    let covariance = DMatrix::from_fn(N, N, |r, c| covariance[(r, c)]);
    let error = DVector::from_fn(N, |r, _| error[r]);
    error.dot(&covariance.cholesky().unwrap().solve(&error))
}

/// A problem whose start values are all forgotten.
fn forgotten(mut problem: Problem) -> Problem {
    let nowhere = Station { centre: Vector3::zeros(), rotation: Rotation3::identity() };
    problem.cameras.iter_mut().for_each(|c| c.station = nowhere);
    for (i, point) in problem.points.iter_mut().enumerate() {
        if !problem.held_points.contains(&i) {
            *point = Vector3::zeros();
        }
    }
    problem
}

#[track_caller]
fn ends_alike(problem: Problem, options: &Options) {
    let mut from_nothing = forgotten(problem.clone());
    initial_values(&mut from_nothing).unwrap();
    let mut from_truth = problem;
    let expected = adjust(&mut from_truth, options).unwrap().chi2;
    let found = adjust(&mut from_nothing, options).unwrap().chi2;
    assert!((found / expected - 1.0).abs() < 1e-6, "{found} against {expected}");
}

#[test]
fn a_network_is_found_from_nothing() {
    let keep = Options { outlier_sigmas: f64::INFINITY, ..Options::default() };
    let free = Options { datum: Datum::InnerConstraints, ..keep };
    for seed in 0..10 {
        // On known points; with known points that no camera is resected on; free; flat and free.
        ends_alike(anchored(seed), &keep);
        let mut few = network(seed);
        few.controls = [0, 3, 12].map(|p| control(&few, p)).into();
        ends_alike(few, &keep);
        ends_alike(network(seed), &free);
    }
    ends_alike(super::data::dots("ba11.txt"), &keep);
}

#[test]
fn a_flat_network_is_found_from_nothing() {
    let free = Options {
        datum: Datum::InnerConstraints,
        outlier_sigmas: f64::INFINITY,
        ..Options::default()
    };
    for seed in 0..10 {
        let mut flat = network(seed);
        flat.points.iter_mut().for_each(|p| p.z = 0.0);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        for i in 0..flat.images.len() {
            let o = flat.images[i];
            let noise = Vector2::new(normal(&mut rng), normal(&mut rng)) * SIGMA;
            flat.images[i].at = flat.image_of(o.camera, o.point).unwrap() + noise;
        }
        ends_alike(flat, &free);
    }
}

#[test]
fn a_network_that_does_not_hang_together_is_refused() {
    let mut problem = network(0);
    problem.images.retain(|o| o.camera != 3 || o.point < 3);
    let before = problem.clone();
    assert_eq!(initial_values(&mut problem), Err(InitialError::Unconnected(vec![3])));
    assert_eq!(problem, before);
    problem.images.retain(|o| o.camera == 0);
    assert_eq!(initial_values(&mut problem), Err(InitialError::NothingToStartFrom));
}
