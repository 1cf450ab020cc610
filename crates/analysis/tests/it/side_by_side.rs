//! Several evaluations of one session side by side.

use beampose_analysis::{Evaluation, html, json, side_by_side_csv};
use beampose_photogrammetry::solve::Method;

use crate::report::check;
use crate::synthetic::{Size, analysed, session};

/// A method's evaluation, its mean differences stretched by a scale error.
fn evaluation(processing: i64, label: &str, stretched: f64) -> Evaluation {
    let size = Size { passes: 2, stops: 4, half: 1, frame: [320, 240], failures: 0 };
    let mut all = analysed(&session(&size).captures);
    let mut result = all.methods.remove(&Method::VirtualCamera).unwrap();
    for stop in &mut result.positions {
        stop.mean_difference_mm += stretched * stop.travel_mm;
    }
    Evaluation { processing, label: label.to_owned(), method: Method::VirtualCamera, result }
}

#[test]
fn the_figures_are_those_of_the_worst_stop_and_count_what_is_within_u() {
    let good = evaluation(2, "calibrated", 0.0).figures().unwrap();
    assert_eq!(good.stops, 3, "the first stop says nothing");
    let bad = evaluation(3, "uncalibrated", 0.1).figures().unwrap();
    assert!(bad.largest_mean_difference_mm > good.largest_mean_difference_mm + 1.0, "{bad:?}");
    assert_eq!((bad.rail_mm, bad.stops_within_uncertainty), (300.0, 0));
    let mut none = evaluation(4, "nothing solved", 0.0);
    none.result.positions.clear();
    assert_eq!(none.figures(), None);
}

#[test]
fn page_json_and_csv_have_every_evaluation_and_one_alone_is_not_compared() {
    let size = Size { passes: 2, stops: 4, half: 1, frame: [320, 240], failures: 0 };
    let mut input = session(&size);
    input.side_by_side = vec![evaluation(2, "calibrated", 0.0)];
    assert!(!html(&input).contains("Side by side"));
    let odd = "data <sheet>, \"plain\"";
    input.side_by_side.push(evaluation(3, odd, 0.1));
    let page = html(&input);
    check(&page);
    assert!(page.contains("Side by side") && page.contains("data &lt;sheet&gt;"));
    let all = json(&input).unwrap()["side_by_side"].clone();
    assert_eq!((&all[0]["processing"], &all[1]["label"]), (&2.into(), &odd.into()));
    assert_eq!(all[1]["positions"].as_array().unwrap().len(), 4);
    let csv = side_by_side_csv(&input.side_by_side);
    assert_eq!(csv.lines().count(), 1 + 2 * 4);
    assert!(csv.contains("\n3,\"data <sheet>, \"\"plain\"\"\",virtual-camera,"), "{csv}");
}
