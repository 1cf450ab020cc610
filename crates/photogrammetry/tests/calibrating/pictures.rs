//! Pictures of a sheet, drawn through a known camera.

use beampose_photogrammetry::calibrate::{
    ControlMark, Coverage, SelfCalibration, Sheet, Unknowns, View, find_sheet, self_calibrate,
    start_camera,
};
use beampose_photogrammetry::{Camera, GrayImage};
use nalgebra::{DVector, Vector2, Vector3};

use crate::draw::{Lens, look_at, twelve_stations};

const CAMERA: Camera = Camera {
    k1: -0.12,
    k2: 0.05,
    p1: 8e-4,
    p2: -5e-4,
    ..Camera::without_distortion([640, 480], [610.0, 607.5], [325.4, 236.2])
};

/// Chi-square of eight degrees of freedom exceeds this once in a thousand.
const RARE: f64 = 26.1;

fn plain(columns: u32, rows: u32) -> Sheet {
    Sheet { rows, columns, pitch_mm: 25.0, dot_diameter_mm: 12.0, control_marks: Vec::new() }
}

fn marked() -> Sheet {
    let mark = |code, x: u32, y: u32| {
        let (x_mm, y_mm) = (25.0 * f64::from(x), 25.0 * f64::from(y));
        ControlMark { code, x_mm, y_mm, radius_mm: 3.2 }
    };
    Sheet { control_marks: vec![mark(45, 2, 2), mark(75, 6, 3)], ..plain(9, 9) }
}

fn unknowns() -> Unknowns {
    "fx,fy,cx,cy,k1,k2,p1,p2".parse().unwrap()
}

fn calibrated(views: &[View]) -> SelfCalibration {
    let start = start_camera(views, [CAMERA.width, CAMERA.height]).unwrap();
    self_calibrate(views, &start, &unknowns()).unwrap()
}

/// The squared distance from the truth in units of the stated covariance.
fn square_error(found: &SelfCalibration) -> f64 {
    let errors = found.unknowns.iter().map(|u| u.of(&found.camera) - u.of(&CAMERA));
    let errors = DVector::from_iterator(found.unknowns.len(), errors);
    let solved = found.covariance.clone().cholesky().unwrap().solve(&errors);
    errors.dot(&solved)
}

#[test]
fn a_camera_is_found_again_from_twelve_pictures_of_a_plain_sheet() {
    let (lens, sheet) = (Lens::new(CAMERA), plain(12, 12));
    let stations = twelve_stations(&sheet, 430.0);
    let views: Vec<View> = stations
        .iter()
        .enumerate()
        .map(|(i, station)| {
            let picture = lens.photograph(&sheet, &[], station, 2.0, i as u64);
            find_sheet(&format!("{i}"), &picture, &sheet).unwrap()
        })
        .collect();
    let found = calibrated(&views);
    assert!(found.points() > 12 * 110, "{} of 1728 dots", found.points());
    assert!(square_error(&found) < RARE, "{} {:?}", square_error(&found), found.camera);
    // Noise of 2 at a contrast of 160 gives a few hundredths of a pixel a coordinate.
    assert!(found.sigma0_px < 0.05, "{}", found.sigma0_px);
    let coverage = Coverage::of(&found.camera, &found.views);
    assert!(coverage.covered > 0.8 && coverage.reach > 0.8, "{coverage:?}");

    // The same without the radius of the dots: their eccentricity goes into the camera.
    let mut as_points = views;
    as_points.iter_mut().flat_map(|v| &mut v.points).for_each(|p| p.radius_mm = 0.0);
    let biased = square_error(&calibrated(&as_points));
    assert!(biased > RARE, "{biased}");
}

#[test]
fn control_marks_name_every_dot_at_any_roll() {
    let (lens, sheet) = (Lens::new(CAMERA), marked());
    for (i, roll) in [0.0, 50.0, 90.0, 135.0, 180.0, 270.0, 310.0].into_iter().enumerate() {
        let station = look_at(Vector3::new(160.0, 40.0, -330.0), Vector2::new(95.0, 105.0), roll);
        let picture = lens.photograph(&sheet, &[], &station, 2.0, i as u64);
        let view = find_sheet("marked", &picture, &sheet).unwrap();
        assert!(view.points.len() > 70, "roll {roll}: {} dots", view.points.len());
        for point in &view.points {
            let seen = CAMERA.project(&station.station_point(&point.on_sheet.push(0.0))).unwrap();
            // A dot is 25 px from the next; the eccentricity is below half a pixel.
            let off = (seen - point.pixel).norm();
            assert!(off < 0.5, "roll {roll}, {:?}: {off} px", point.on_sheet);
        }
    }
}

#[test]
fn a_sheet_whose_marks_are_hidden_is_refused_and_one_half_outside_is_not() {
    let (lens, sheet) = (Lens::new(CAMERA), marked());
    let hidden = Sheet { control_marks: Vec::new(), ..sheet.clone() };
    let station = look_at(Vector3::new(160.0, 40.0, -330.0), Vector2::new(95.0, 105.0), 10.0);
    let picture = lens.photograph(&hidden, &[], &station, 2.0, 1);
    let told = find_sheet("hidden", &picture, &sheet).unwrap_err();
    assert!(told.starts_with("no control mark is where the sheet has it"), "{told}");

    let aside = look_at(Vector3::new(60.0, 20.0, -300.0), Vector2::new(10.0, 70.0), 10.0);
    let picture = lens.photograph(&sheet, &[], &aside, 2.0, 1);
    let view = find_sheet("aside", &picture, &sheet).unwrap();
    assert!((30..80).contains(&view.points.len()), "{} dots", view.points.len());
    for point in &view.points {
        let seen = CAMERA.project(&aside.station_point(&point.on_sheet.push(0.0))).unwrap();
        assert!((seen - point.pixel).norm() < 0.5, "{:?}", point.on_sheet);
    }
}

#[test]
fn strays_beside_the_sheet_are_left_out() {
    let (lens, sheet) = (Lens::new(CAMERA), plain(10, 8));
    let strays = [
        // Where an eleventh column would be, but half a step off; and a speck among the dots.
        (Vector2::new(251.0, 112.0), 6.0),
        (Vector2::new(87.5, 87.5), 3.0),
        (Vector2::new(-23.0, 25.0), 3.0),
    ];
    let station = look_at(Vector3::new(200.0, 90.0, -360.0), Vector2::new(112.0, 88.0), 4.0);
    let picture = lens.photograph(&sheet, &strays, &station, 2.0, 3);
    let view = find_sheet("strays", &picture, &sheet).unwrap();
    assert_eq!(view.points.len(), 80);
    for point in &view.points {
        let seen = CAMERA.project(&station.station_point(&point.on_sheet.push(0.0))).unwrap();
        assert!((seen - point.pixel).norm() < 0.5, "{:?}", point.on_sheet);
    }
}

#[test]
fn a_picture_without_a_sheet_says_so() {
    for (width, height) in [(0, 0), (1, 1), (64, 48)] {
        let blank = GrayImage { width, height, data: vec![128; width * height] };
        let told = find_sheet("blank", &blank, &plain(10, 8)).unwrap_err();
        assert_eq!(told, "no grid of dots: 0 discs found, 0 of them in a grid");
    }
}
