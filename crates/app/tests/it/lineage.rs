//! From a pose back to the raw session that its fan was calibrated in: recorded calibrations, and who
//! used them.

use serde_json::Value;

use crate::lab::{Ended, Lab, SCALE, experiments, replaced};

/// A calibration on the goniometer, its fan exported, and a translation test of two stops with it.
fn lab() -> (Lab, Value, Value) {
    let lab = crate::beam_angles::lab(&crate::beam_angles::plan(2), |rig| rig);
    let calibrated = lab.beampose(&crate::beam_angles::RUN).expect_code(0).json();
    lab.beampose(&["calibrations", "export", "latest", "rigs/monday.yaml"]).expect_code(0);
    let rig = std::fs::read_to_string(experiments().join("rigs/simulated.yaml")).unwrap();
    lab.write_rig("measuring", &replaced(&rig, "simulated/pattern.yaml", "monday.yaml"));
    lab.write("translation.yaml", &crate::lab::plan(1, 100, 100));
    let run = ["run", "translation.yaml", "--rig", "rigs/measuring.yaml", "--picture-scale", SCALE];
    // Of so few pairs the fan is not good enough for the plan's limits; that is not asked here.
    let ended = lab.beampose(&[&run[..], &["--json", "--out", "measured"]].concat());
    assert!([0, 1].contains(&ended.code), "{}", ended.err);
    (lab, calibrated, ended.json())
}

fn report(lab: &Lab, session: &Value) -> Value {
    Ended::json(&lab.beampose(&["report", session.as_str().unwrap(), "--json"]))
}

/// What a report says of the pattern.
fn pattern(report: &Value) -> &Value {
    report["inputs"].as_array().unwrap().iter().find(|i| i["camera"].is_null()).unwrap()
}

#[test]
fn a_pose_leads_back_to_the_session_that_its_fan_was_calibrated_in() {
    let (lab, calibrated, measured) = lab();
    let (source, id) = (&calibrated["session"], &measured["session"]);
    // What was recorded is the file of the calibration's report, byte for byte.
    let of_report = std::fs::read(lab.path("report/fan.yaml")).unwrap();
    assert_eq!(std::fs::read(lab.path("rigs/monday.yaml")).unwrap(), of_report);
    let hash = blake3::hash(&of_report).to_hex().to_string();
    assert_eq!(calibrated["calibration"], hash);
    // The report of the poses names it, whatever its file is called.
    let shown = report(&lab, id);
    let used = pattern(&shown);
    assert_eq!((&used["file"], &used["blake3"]), (&"monday.yaml".into(), &hash.clone().into()));
    let made_from = &used["calibration"]["made_from"][0];
    assert_eq!((&made_from["session"], &made_from["state"]), (source, &"stored".into()));
    assert_eq!(shown["inputs"].as_array().unwrap().len(), 4, "the pattern and three cameras");
    let page = std::fs::read_to_string(lab.path("measured/report.html")).unwrap();
    assert!(page.contains(source.as_str().unwrap()) && page.contains("rotation stage"));
    // Told another fan, another processing has another origin; the run's own stays as it was.
    let other = ["solve", "latest", "--with-pattern", "rigs/simulated/pattern.yaml"];
    lab.beampose(&other).expect_code(0);
    let shown = report(&lab, id);
    assert_eq!(pattern(&shown)["file"], "pattern.yaml");
    assert!(pattern(&shown)["calibration"].is_null(), "{}", shown["inputs"]);
    let again = ["solve", "latest", "--with-pattern", "report/fan.yaml"];
    lab.beampose(&again).expect_code(0);
    assert_eq!(pattern(&report(&lab, id))["blake3"], hash);
}

#[test]
fn what_is_recorded_is_listed_shown_verified_and_outlives_its_session() {
    let (lab, calibrated, measured) = lab();
    let (source, id) = (&calibrated["session"], &measured["session"]);
    let source = source.as_str().unwrap();
    let hash = calibrated["calibration"].as_str().unwrap();
    let listed = lab.beampose(&["calibrations", "--json"]).expect_code(0).json();
    assert_eq!((&listed["blake3"], &listed["kind"]), (&hash.into(), &"pattern".into()));
    let shown = lab.beampose(&["calibrations", "show", &hash[..8], "--json"]).expect_code(0).json();
    let parameters = shown["parameters"].as_array().unwrap();
    assert_eq!(parameters[0]["name"], "pitch_mm");
    let (u, variance) = (parameters[0]["u"].as_f64(), shown["covariance"][0][0].as_f64());
    assert!((u.unwrap().powi(2) / variance.unwrap() - 1.0).abs() < 1e-9, "{shown}");
    assert_eq!(shown["made_from"][1]["kind"], "file");
    let said = lab.beampose(&["calibrations", "show", "latest"]).expect_code(0).out;
    assert!(said.contains(&format!("from session {source} (")) && said.contains("pitch_mm"));
    // It is known where the session of the poses goes.
    let there = "elsewhere.db";
    lab.beampose(&["sessions", "export", id.as_str().unwrap(), "poses.bps"]).expect_code(0);
    lab.beampose(&["sessions", "import", "poses.bps", "--db", there]).expect_code(0);
    let listed = lab.beampose(&["calibrations", "--json", "--db", there]).expect_code(0).json();
    assert_eq!(listed["blake3"], hash);
    assert_eq!(listed["made_from"][0]["state"], "not in this database");
    // And stays when the session that it was made from goes.
    lab.beampose(&["sessions", "delete", source, "--yes"]).expect_code(0);
    let used = pattern(&report(&lab, id))["calibration"].clone();
    assert_eq!(used["made_from"][0]["session"], source);
    assert!(used["made_from"][0]["state"].as_str().unwrap().starts_with("deleted "), "{used}");
    assert!(lab.beampose(&["calibrations"]).expect_code(0).out.contains("(deleted "));
    lab.beampose(&["sessions", "verify", "--all"]).expect_code(0);
    lab.beampose(&["calibrations", "show", "zz"]).expect_code(2);
    let refused = lab.beampose(&["calibrations", "export", "latest", "rigs/monday.yaml"]);
    assert!(refused.expect_code(2).err.contains("is there already"));
}
