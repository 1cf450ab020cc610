//! Captures without a pose are data with a reason, never a crash.

use crate::lab::{Lab, plan, replaced, solutions};

/// The short plan with the laser never lit.
fn dark() -> String {
    replaced(&plan(1, 100, 100), "  - laser: on\n", "")
}

#[test]
fn a_laser_that_never_lights_gives_captures_with_a_reason() {
    let lab = Lab::new();
    let ended = lab.run(&replaced(&dark(), "rail, wavemeter,", "rail,"), &[]).expect_code(1);
    assert!(ended.err.contains("warning: a capture while the laser is off"), "{}", ended.err);
    assert_eq!(ended.json()["verdict"], "fail");
    let poses = solutions(&lab.beampose(&["solve", "latest", "--json"]).expect_code(0));
    assert_eq!(poses.len(), 4);
    for pose in &poses {
        let reason = pose["status"].as_str().unwrap();
        assert!(reason.starts_with("fewer than two cameras see a grid of dots"), "{reason}");
        assert!(pose.get("position_mm").is_none() && pose.get("covariance").is_none());
    }
    let report = lab.beampose(&["report", "latest", "--json"]).expect_code(1).json();
    assert_eq!((&report["captures"], &report["solved"]), (&2.into(), &0.into()));
    let html = std::fs::read_to_string(lab.path("report/report.html")).unwrap();
    assert!(html.contains("fewer than two cameras see a grid of dots"));
    let score = lab.beampose(&["score", "latest", "--json"]).expect_code(0).json();
    assert_eq!(score["methods"]["virtual-camera"]["solved"], 0);
    assert!(score["methods"]["virtual-camera"]["nees_position_mean"].is_null());
}

#[test]
fn an_instrument_that_refuses_ends_the_session_with_its_words() {
    let lab = Lab::new();
    let ended = lab.run(&dark(), &[]).expect_code(4);
    assert!(ended.err.contains("wavemeter: refused: no light to measure"), "{}", ended.err);
    assert_eq!((&ended.json()["outcome"], &ended.json()["captures"]), (&"error".into(), &0.into()));
    let shown = lab.beampose(&["sessions", "latest", "--json"]).expect_code(0).json();
    let journal = shown["events"].to_string();
    assert!(journal.contains("no light to measure") && !journal.contains("laser_unknown"));
}
