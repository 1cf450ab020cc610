//! Two processings side by side.

use beampose_analysis::compare::{Side, compare};
use beampose_photogrammetry::solve::Method;

use crate::synthetic::{Size, session};

fn size() -> Size {
    Size { passes: 1, stops: 3, half: 1, frame: [64, 48], failures: 0 }
}

#[test]
fn what_is_the_same_to_the_bit_is_told_as_such() {
    let input = session(&size());
    let side = Side { captures: &input.captures, translation: input.translation.as_ref() };
    let same = compare(&side, &side);
    let poses = &same.poses[&Method::VirtualCamera];
    assert_eq!((poses.compared, poses.identical), (3, 3));
    assert_eq!((poses.only_a, poses.only_b, poses.beyond_uncertainty), (0, 0, 0));
    assert!(poses.differences.is_empty());
    assert_eq!(poses.rms_distance_mm, Some(0.0));
    let stops = &same.positions[&Method::VirtualCamera];
    assert_eq!(stops.len(), 3);
    for stop in stops {
        assert_eq!(stop.difference_mm, 0.0);
        // Both sides have the same U: together root two times that.
        let expected = stop.a_expanded_uncertainty_mm * 2_f64.sqrt();
        assert!((stop.expanded_uncertainty_mm - expected).abs() < 1e-12 * expected.max(1.0));
    }
}

#[test]
fn what_differs_is_told_with_its_uncertainty() {
    let a = session(&size());
    let mut b = a.clone();
    let of_b = |b: &mut beampose_analysis::ReportInput, i: usize| {
        let results = &mut b.captures[i].solution.as_mut().unwrap().results;
        results.iter().position(|r| r.method == Method::VirtualCamera).unwrap()
    };
    let at = of_b(&mut b, 1);
    let results = &mut b.captures[1].solution.as_mut().unwrap().results;
    let pose = results[at].pose.as_mut().unwrap();
    let u = (2.0 * pose.covariance[0][0]).sqrt();
    pose.position_mm[0] += 3.0 * u;
    let results = &mut b.captures[2].solution.as_mut().unwrap().results;
    results.retain(|r| r.method != Method::VirtualCamera);
    let [a, b] = [&a, &b].map(|s| Side { captures: &s.captures, translation: None });
    let found = compare(&a, &b);
    let poses = &found.poses[&Method::VirtualCamera];
    assert_eq!((poses.compared, poses.identical, poses.beyond_uncertainty), (2, 1, 1));
    assert_eq!((poses.only_a, poses.only_b), (1, 0));
    let largest = poses.largest().unwrap();
    assert_eq!(largest.capture, a.captures[1].id);
    // The position has some 1000 mm: its digits end at 1e-13 of that.
    assert!((largest.distance_mm - 3.0 * u).abs() < 1e-9);
    assert!((largest.standard_uncertainty_mm[0] - u).abs() < 1e-12);
    // Both quaternions are normalised on the way: the last digit may turn.
    assert!(largest.rotation_deg < 1e-12);
    assert!(found.positions.is_empty());
    // The other way round.
    assert_eq!(compare(&b, &a).poses[&Method::VirtualCamera].only_b, 1);
}

#[test]
fn captures_at_other_setpoints_are_not_compared() {
    let a = session(&size());
    let mut b = a.clone();
    for capture in &mut b.captures {
        capture.setpoints.insert("rail_mm".to_owned(), -1.0);
    }
    let [a, b] = [&a, &b].map(|s| Side { captures: &s.captures, translation: None });
    let poses = &compare(&a, &b).poses[&Method::VirtualCamera];
    assert_eq!((poses.compared, poses.only_a, poses.only_b), (0, 3, 3));
}
