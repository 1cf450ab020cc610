//! What the calibration states of itself, on points that are made with known noise.

use beampose_photogrammetry::Camera;
use beampose_photogrammetry::calibrate::{
    CalibrationError, SelfCalibration, Sheet, SheetPoint, Unknowns, View, self_calibrate,
    self_calibrate_robustly, start_camera,
};
use beampose_photogrammetry::pose::Station;
use nalgebra::{DVector, Vector2, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

use crate::draw::{look_at, twelve_stations};

const CAMERA: Camera = Camera {
    k1: -0.11,
    k2: 0.06,
    p1: 3e-4,
    p2: -2e-4,
    k3: 0.01,
    ..Camera::without_distortion([3456, 2592], [3529.0, 3527.0], [1740.0, 1280.0])
};
const SIGMA: f64 = 0.05;

fn sheet() -> Sheet {
    Sheet { rows: 9, columns: 9, pitch_mm: 100.0, dot_diameter_mm: 20.0, control_marks: Vec::new() }
}

fn views(stations: &[Station], seed: u64) -> Vec<View> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let normal = Normal::new(0.0, SIGMA).unwrap();
    let sheet = sheet();
    let dots = || (0..sheet.rows).flat_map(|r| (0..sheet.columns).map(move |c| (c, r)));
    let mut view = |(i, station): (usize, &Station)| {
        let seen = dots().filter_map(|(column, row)| {
            let on_sheet = sheet.dot(column, row);
            let at = CAMERA.project(&station.station_point(&on_sheet.push(0.0)))?;
            let error = Vector2::new(normal.sample(&mut random), normal.sample(&mut random));
            Some(SheetPoint { on_sheet, pixel: at + error, radius_mm: 0.0 })
        });
        View { name: format!("view {i}"), points: seen.collect() }
    };
    stations.iter().enumerate().map(&mut view).collect()
}

fn start(views: &[View]) -> Result<Camera, CalibrationError> {
    start_camera(views, [CAMERA.width, CAMERA.height])
}

fn square_error(found: &SelfCalibration) -> f64 {
    let errors = found.unknowns.iter().map(|u| u.of(&found.camera) - u.of(&CAMERA));
    let errors = DVector::from_iterator(found.unknowns.len(), errors);
    errors.dot(&found.covariance.clone().cholesky().unwrap().solve(&errors))
}

#[test]
fn the_stated_covariance_is_true() {
    const RUNS: u64 = 100;
    let stations = twelve_stations(&sheet(), 1500.0);
    let (mut parameters, mut poses) = (0.0, 0.0);
    for seed in 0..RUNS {
        let views = views(&stations, seed);
        let found = self_calibrate(&views, &start(&views).unwrap(), &Unknowns::default()).unwrap();
        parameters += square_error(&found) / RUNS as f64;
        let solved = &found.views[3];
        let shift = solved.station.centre - stations[3].centre;
        let turn = (solved.station.rotation * stations[3].rotation.inverse()).scaled_axis();
        let error = nalgebra::Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z);
        poses += error.dot(&(solved.covariance.try_inverse().unwrap() * error)) / RUNS as f64;
    }
    // Chi-square of n: the mean of 100 has the standard deviation sqrt(2 n / 100); four of them.
    assert!((parameters - 9.0).abs() < 4.0 * (18.0 / RUNS as f64).sqrt(), "{parameters}");
    assert!((poses - 6.0).abs() < 4.0 * (12.0 / RUNS as f64).sqrt(), "{poses}");
}

#[test]
fn a_sheet_that_always_faces_the_camera_leaves_the_focal_length_open() {
    let middle = Vector2::new(400.0, 400.0);
    let stations: Vec<Station> = [1200.0, 1500.0, 1800.0]
        .map(|z| look_at(Vector3::new(400.0, 400.0, -z), middle, 0.0))
        .to_vec();
    let views = views(&stations, 1);
    assert_eq!(start(&views), Err(CalibrationError::NoPerspective));
}

#[test]
fn what_the_pictures_do_not_determine_is_named() {
    // One picture: fx, fy, cx, cy and the pose have more unknowns than a homography has numbers.
    let stations = [look_at(Vector3::new(900.0, 500.0, -1300.0), Vector2::new(400.0, 400.0), 5.0)];
    let mut views = views(&stations, 1);
    for point in &mut views[0].points {
        point.pixel = CAMERA_WITHOUT_DISTORTION
            .project(&stations[0].station_point(&point.on_sheet.push(0.0)))
            .unwrap();
    }
    let found = self_calibrate(&views, &CAMERA_WITHOUT_DISTORTION, &"fx,fy,cx,cy".parse().unwrap());
    assert!(matches!(found, Err(CalibrationError::Undetermined { .. })), "{found:?}");
    views[0].points.truncate(5);
    let few = self_calibrate(&views, &CAMERA, &Unknowns::default()).unwrap_err();
    assert_eq!(few.to_string(), "view 0: 5 points, at least 6 are needed");
    let none = self_calibrate(&[], &CAMERA, &Unknowns::default()).unwrap_err();
    assert_eq!(none, CalibrationError::NoViews);
}

const CAMERA_WITHOUT_DISTORTION: Camera =
    Camera { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0, ..CAMERA };

#[test]
fn a_gross_error_is_named_and_left_out() {
    let stations = twelve_stations(&sheet(), 1500.0);
    let mut views = views(&stations, 4);
    let clean = self_calibrate(&views, &start(&views).unwrap(), &Unknowns::default()).unwrap();
    // 3 px are sixty sigma.
    views[7].points[40].pixel.x += 3.0;
    let on_sheet = views[7].points[40].on_sheet;
    let limit = 6.0;
    let found =
        self_calibrate_robustly(&views, &start(&views).unwrap(), &Unknowns::default(), limit)
            .unwrap();
    assert_eq!(found.rejected.len(), 1);
    assert_eq!((found.rejected[0].view.as_str(), found.rejected[0].on_sheet), ("view 7", on_sheet));
    assert!(found.rejected[0].standardised > limit);
    // One point of a thousand less: sigma stays but for a part of a thousand.
    assert!((found.sigma0_px / clean.sigma0_px - 1.0).abs() < 0.01);
}

#[test]
fn no_error_at_all_gives_the_camera_itself() {
    let stations = twelve_stations(&sheet(), 1500.0);
    let mut views = views(&stations, 1);
    for (view, station) in views.iter_mut().zip(&stations) {
        for point in &mut view.points {
            point.pixel =
                CAMERA.project(&station.station_point(&point.on_sheet.push(0.0))).unwrap();
        }
    }
    let found = self_calibrate(&views, &start(&views).unwrap(), &Unknowns::default()).unwrap();
    // The adjustment ends when a step would gain less than 1e-12 square pixels in all.
    assert!(found.rms_px < 1e-6 / (found.points() as f64).sqrt(), "{}", found.rms_px);
    for unknown in found.unknowns.iter() {
        let off = unknown.of(&found.camera) - unknown.of(&CAMERA);
        assert!(off.abs() < 1e-6 * unknown.of(&CAMERA).abs().max(0.1), "{unknown}: {off}");
    }
}
