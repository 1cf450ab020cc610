//! The pages of calibrations: well-formed, self-contained, and saying what was found.

use beampose_analysis::{
    CalibrationReport, InputFile, LeftOut, calibration_html, calibration_json, stability_html,
    stability_json,
};
use beampose_photogrammetry::calibrate::{
    Coverage, SelfCalibration, Stated, compare, read_observations, self_calibrate, start_camera,
};

use crate::report::check;

const CORNERS: &str = include_str!("../../../photogrammetry/tests/data/opencv-chess-corners.csv");

fn calibrated(estimate: &str) -> SelfCalibration {
    let views = read_observations(CORNERS, 30.0).unwrap();
    let start = start_camera(&views, [640, 480]).unwrap();
    self_calibrate(&views, &start, &estimate.parse().unwrap()).unwrap()
}

#[test]
fn the_page_of_a_calibration_shows_numbers_residuals_and_what_was_left_out() {
    let found = calibrated("fx,fy,cx,cy,k1,k2");
    let coverage = Coverage::of(&found.camera, &found.views);
    let left_out =
        [LeftOut { name: "left10.jpg".to_owned(), reason: "no grid <of> dots".to_owned() }];
    let inputs = [InputFile { name: "corners.csv".to_owned(), blake3: "ab12".to_owned() }];
    let report = CalibrationReport {
        name: "left".to_owned(),
        found: &found,
        coverage: &coverage,
        left_out: &left_out,
        inputs: &inputs,
        options: "--estimate fx".to_owned(),
        software: "beampose 0".to_owned(),
    };
    let page = calibration_html(&report);
    check(&page);
    assert!(page.contains("Held: p1 = 0, p2 = 0, k3 = 0."));
    assert!(page.contains("left10.jpg: no grid &lt;of&gt; dots") && page.contains("ab12"));
    // An arrow for each of the points, and a symbol for each in both plots.
    assert_eq!(page.matches("class=\"arrow\"").count(), 702);
    assert_eq!(page.matches("<circle").count(), 3 * 702);
    let json = calibration_json(&report);
    assert_eq!(json["correlations"][0][0], 1.0);
    assert_eq!(json["parameters"].as_array().unwrap().len(), 6);
    let counts = json["coverage"]["counts"].as_array().unwrap().iter();
    let cells = counts.flat_map(|row| row.as_array().unwrap());
    assert_eq!(cells.map(|n| n.as_u64().unwrap()).sum::<u64>(), 702);
}

#[test]
fn the_page_of_repeated_calibrations_marks_the_change() {
    let found = calibrated("f,cx,cy,k1");
    let covariance: Vec<Vec<f64>> =
        found.covariance.row_iter().map(|row| row.iter().copied().collect()).collect();
    let parameters = found.unknowns.iter().collect();
    let stated = Stated { parameters, covariance };
    let mut all: Vec<_> =
        (0..4).map(|i| (format!("day {i}"), found.camera, Some(stated.clone()))).collect();
    // Twenty pixels, with a stated one: after the third.
    all[3].1.cx += 20.0;
    let stability = compare(&all).unwrap();
    let page = stability_html(&stability);
    check(&page);
    assert_eq!(page.matches("class=\"high\"").count(), 1);
    assert!(page.contains("changes from one calibration to the next"));
    assert_eq!(stability_json(&stability)["parameters"][1]["changes"][2]["difference"], 20.0);
    // Nothing stated: nothing marked.
    all.iter_mut().for_each(|one| one.2 = None);
    let page = stability_html(&compare(&all).unwrap());
    check(&page);
    assert!(!page.contains("class=\"high\"") && page.contains("no stated uncertainty"));
}
