//! Which wavelength each capture is corrected to, whence, and what that is worth.

use std::collections::BTreeSet;

use serde_json::Value;

use crate::lab::{Ended, Lab, SCALE, experiments, replaced, solutions};

/// The rig whose laser warms up, in a minute instead of eight, its thermometer on the diode without
/// or with a law.
fn drifting_rig(law: bool) -> String {
    let path = experiments().join("rigs/simulated-drifting.yaml");
    let text = std::fs::read_to_string(path).unwrap();
    let text = replaced(&text, "time_constant: 3.5 min", "time_constant: 0.5 min");
    if !law {
        return text;
    }
    let lines = "  pattern: simulated/pattern.yaml\n  wavelength_from_temperature: {of: \
        diode_thermometer, at: 24 degC, wavelength: 658.0 nm, wavelength_u: 0.01 nm, per_degree: 0.3 \
        nm, per_degree_u: 0.001 nm}\n";
    replaced(&text, "  pattern: simulated/pattern.yaml\n", lines)
}

/// Two passes of four stops, beginning as the laser is switched on.
fn plan() -> String {
    let path = experiments().join("plans/translation-test-drifting.yaml");
    let text = std::fs::read_to_string(path).unwrap();
    let text = replaced(&text, "rig: ../rigs/simulated-drifting.yaml\n", "");
    let text = replaced(&text, "passes: 6", "passes: 2");
    replaced(&text, "step: 100 mm", "step: 300 mm")
}

/// The same, the wavelength read before each pass and after the last, not at the stops.
fn sparse_plan() -> String {
    let text = replaced(&plan(), "read: [rail, wavemeter, ", "read: [rail, ");
    let sweep = "        - sweep:\n";
    let text = replaced(&text, sweep, &format!("        - read: [wavemeter]\n{sweep}"));
    replaced(&text, "finally:\n", "  - read: [wavemeter]\n\nfinally:\n")
}

fn ran(plan: &str, law: bool) -> Lab {
    let lab = Lab::new();
    lab.write_rig("drifting", &drifting_rig(law));
    lab.write("plan.yaml", plan);
    let run = ["run", "plan.yaml", "--rig", "rigs/drifting.yaml", "--picture-scale", SCALE];
    // With few readings of a fast drift the plan's limits may be missed.
    let ended = lab.beampose(&[&run[..], &["--json", "--out", "report"]].concat());
    assert_eq!(ended.json()["captures"], 8, "{}", ended.err);
    lab
}

fn solve(lab: &Lab, more: &[&str]) -> Ended {
    lab.beampose(&[&["solve", "latest", "--json"], more].concat()).expect_code(0)
}

/// The sources of a method's wavelengths in a processing, as the report of it counts them.
fn sources(lab: &Lab, processing: u32, method: &str) -> Value {
    let word = format!("latest@{processing}");
    lab.beampose(&["report", &word, "--json"]).json()["wavelength_sources"][method].clone()
}

/// The largest mean difference of an evaluation, by amount, mm.
#[track_caller]
fn largest(report: &Value, processing: i64, method: &str) -> f64 {
    let all = report["side_by_side"].as_array().unwrap();
    let found = all.iter().find(|e| e["processing"] == processing && e["method"] == method);
    let found = found.unwrap_or_else(|| panic!("no {method} of {processing} in {all:#?}"));
    found["figures"]["largest_mean_difference_mm"].as_f64().unwrap().abs()
}

#[test]
fn calibration_correction_and_adjustment_each_gain_and_the_report_has_them_side_by_side() {
    let lab = ran(&plan(), false);
    let read = lab.beampose(&["report", "latest", "--json"]).json();
    assert!(read.get("side_by_side").is_none(), "there is one way of evaluating it so far");
    let file = experiments().join("rigs/simulated/uncalibrated.yaml").display().to_string();
    solve(&lab, &["--with-pattern", &file, "--wavelength", "nominal"]);
    solve(&lab, &["--wavelength", "nominal"]);
    // The same again is not shown twice.
    solve(&lab, &["--wavelength", "nominal"]);
    let report = lab.beampose(&["report", "latest@2", "--json", "--out", "report"]).json();
    let methods = |processing: i64| -> Vec<&str> {
        let all = report["side_by_side"].as_array().unwrap();
        let of = all.iter().filter(|e| e["processing"] == processing);
        of.map(|e| e["method"].as_str().unwrap()).collect()
    };
    assert_eq!(methods(2), ["inter-beam-angles", "virtual-camera", "session-adjustment"]);
    assert_eq!([1, 5].map(|n| methods(n).len()), [0, 0], "shown once");
    for method in ["inter-beam-angles", "virtual-camera"] {
        let [nominal, corrected] = [4, 2].map(|n| largest(&report, n, method));
        assert!(corrected < 0.5 * nominal, "{method}: {corrected} of {nominal}");
    }
    // The angles take a fan as they are told; the virtual camera knows what the sheet is worth.
    let [uncalibrated, nominal] = [3, 4].map(|n| largest(&report, n, "inter-beam-angles"));
    assert!(uncalibrated > 1.0 && nominal < 0.75 * uncalibrated, "{nominal} of {uncalibrated}");
    let together = largest(&report, 2, "session-adjustment");
    assert!(together < 0.1, "{together}");
    assert_eq!(sources(&lab, 2, "virtual-camera"), serde_json::json!({ "read": 8 }));
    assert_eq!(sources(&lab, 4, "virtual-camera"), serde_json::json!({ "nominal": 8 }));
    let page = std::fs::read_to_string(lab.path("report/report.html")).unwrap();
    for said in ["Side by side", "no radial term; wavelength: nominal", "read at the capture"] {
        assert!(page.contains(said), "{said}");
    }
    let csv = std::fs::read_to_string(lab.path("report/side_by_side.csv")).unwrap();
    assert_eq!(csv.lines().count(), 1 + 7 * 4, "{csv}");

    let named = ["report", "latest", "--json", "--compare", "3=data sheet", "2"];
    let named = lab.beampose(&named).json();
    let labels: BTreeSet<&str> = named["side_by_side"]
        .as_array()
        .unwrap()
        .iter()
        .map(|e| e["label"].as_str().unwrap())
        .collect();
    assert_eq!(labels, BTreeSet::from(["data sheet", "inputs of the run; wavelength: read"]));
    let none = lab.beampose(&["report", "latest", "--json", "--compare", "9"]);
    assert!(none.code != 0 && none.err.contains("there is no processing 9"), "{}", none.err);
}

#[test]
fn where_the_wavelength_was_not_read_at_a_capture_it_is_held_interpolated_or_estimated() {
    let lab = ran(&sparse_plan(), false);
    let live = lab.beampose(&["report", "latest@1", "--json"]).json();
    assert_eq!(live["wavelength_sources"]["virtual-camera"], serde_json::json!({ "held": 8 }));
    // The session was over when all of it was adjusted.
    let all = serde_json::json!({ "interpolated": 8 });
    assert_eq!(sources(&lab, 2, "session-adjustment"), all);
    let best = solutions(&solve(&lab, &[]));
    for line in &best {
        assert_eq!(line["wavelength_source"], "interpolated", "{line}");
        assert!(line["wavelength_u_nm"].as_f64().unwrap() > 0.01, "{line}");
        assert!(line["wavelength_age_s"].as_f64().unwrap() > 1.0, "{line}");
    }
    let live = solutions(&solve(&lab, &["--wavelength", "live"]));
    for line in &live {
        assert_eq!(line["wavelength_source"], "held", "{line}");
        // Some seconds old: the meter alone has 0.01 nm.
        assert!(line["wavelength_u_nm"].as_f64().unwrap() > 0.02, "{line}");
    }
    let same = lab.beampose(&["sessions", "compare", "latest@1", "@4", "--json"]).json();
    assert_eq!(same["poses"]["virtual-camera"]["identical"], 8, "the bits of the run itself");
    let read = solutions(&solve(&lab, &["--wavelength", "read"]));
    assert!(read.iter().all(|line| line["wavelength_source"] == "estimated"));
    // Each has its poses, and none has changed another's.
    assert_eq!(solutions(&solve(&lab, &[])), best);
    let stored = lab.with_store("beampose.db", async |store| {
        let id = store.find_session("latest").await.unwrap();
        let third = &store.processings(id).await.unwrap()[2];
        store.poses(third.id).await.unwrap()
    });
    assert!(stored.iter().all(|row| row.wavelength_source.as_deref() == Some("interpolated")));
    lab.beampose(&["sessions", "verify"]).expect_code(0);
    let wrong = lab.beampose(&["solve", "latest", "--wavelength", "guessed"]).expect_code(2);
    assert!(wrong.err.contains("expected one of best, live, read"), "{}", wrong.err);
}

#[test]
fn a_thermometer_on_the_diode_tells_the_wavelength_where_the_rig_has_its_law() {
    let lab = ran(&sparse_plan(), true);
    let shown = lab.beampose(&["sessions", "show", "latest", "--json"]).json();
    let readings = &shown["captures"][0]["readings"];
    assert!(readings["diode_thermometer_degc"].as_f64() > readings["thermometer_degc"].as_f64());
    assert!(readings.get("temperature_degc").is_none(), "it would be one of two: {readings}");
    // Live and afterwards: the diode's temperature was read at each capture.
    assert_eq!(sources(&lab, 1, "virtual-camera"), serde_json::json!({ "from_temperature": 8 }));
    let lines = solutions(&solve(&lab, &["--wavelength", "temperature"]));
    for line in &lines {
        assert_eq!(line["wavelength_source"], "from_temperature");
        assert_eq!(line["wavelength_age_s"], Value::Null);
        // Thermometer 0.02 K, the law's point 0.01 nm.
        let u = line["wavelength_u_nm"].as_f64().unwrap();
        assert!((0.0116..0.0125).contains(&u), "{line}");
    }
    let report = lab.beampose(&["report", "latest@2", "--json"]).json();
    let methods = report["methods"].as_object().unwrap();
    for method in ["virtual-camera", "session-adjustment"] {
        let largest = methods[method]["max_abs_difference_mm"].as_f64().unwrap();
        assert!(largest < 0.15, "{method}: {largest}");
    }
}
