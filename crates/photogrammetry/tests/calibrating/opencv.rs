//! OpenCV's figures for its own chessboard, digit by digit.

use beampose_photogrammetry::calibrate::{
    Interior, SelfCalibration, Unknowns, View, read_observations, self_calibrate, start_camera,
};

/// The corners as OpenCV takes them: in single precision.
fn corners() -> Vec<View> {
    let text = include_str!("../data/opencv-chess-corners.csv");
    let mut views = read_observations(text, 1.0).unwrap();
    let points = views.iter_mut().flat_map(|v| &mut v.points);
    points.for_each(|p| p.pixel = p.pixel.map(|v| f64::from(v as f32)));
    views
}

fn calibrated() -> SelfCalibration {
    let views = corners();
    let start = start_camera(&views, [640, 480]).unwrap();
    self_calibrate(&views, &start, &Unknowns::default()).unwrap()
}

/// OpenCV 5.0.0, `calibrateCameraExtended` with 500 iterations: value and standard deviation.
const OPENCV: [(Interior, f64, f64); 9] = [
    (Interior::Fx, 536.073_453_136, 0.928_004_050),
    (Interior::Fy, 536.016_362_742, 0.971_962_924),
    (Interior::Cx, 342.370_468_272, 0.971_542_955),
    (Interior::Cy, 235.536_870_641, 1.070_605_604),
    (Interior::K1, -0.265_090_395, 0.011_639_974),
    (Interior::K2, -0.046_742_201, 0.090_838_210),
    (Interior::P1, 0.001_833_016, 0.000_235_304),
    (Interior::P2, -0.000_314_692, 0.000_297_895),
    (Interior::K3, 0.252_312_210, 0.197_518_451),
];

#[test]
fn every_parameter_and_standard_deviation_is_opencvs() {
    let found = calibrated();
    assert!((found.rms_px - 0.408_694_765_887).abs() < 1e-9, "{}", found.rms_px);
    for (parameter, value, sigma) in OPENCV {
        let here = parameter.of(&found.camera);
        // Both stop at the minimum to rounding; a hundred thousandth of sigma is what is left of it.
        assert!((here - value).abs() < 1e-5 * sigma, "{parameter}: {here}, OpenCV {value}");
        let stated = found.standard_deviation(parameter).unwrap();
        assert!((stated / sigma - 1.0).abs() < 1e-5, "{parameter}: {stated}, OpenCV {sigma}");
    }
}

#[test]
fn what_is_held_stays_and_one_focal_length_serves_both_axes() {
    let views = corners();
    let start = start_camera(&views, [640, 480]).unwrap();
    let found = self_calibrate(&views, &start, &"f,cx,cy,k1,k2".parse().unwrap()).unwrap();
    let camera = &found.camera;
    assert_eq!(camera.fx, camera.fy);
    assert_eq!((camera.p1, camera.p2, camera.k3), (0.0, 0.0, 0.0));
    assert_eq!(found.standard_deviation(Interior::K3), None);
    // OpenCV with the same held (FIX_ASPECT_RATIO, ZERO_TANGENT_DIST, FIX_K3).
    assert!((found.rms_px - 0.418_572_888_152).abs() < 1e-9, "{}", found.rms_px);
    assert!((camera.fx - 536.271_355_073).abs() < 1e-4, "{}", camera.fx);
}
