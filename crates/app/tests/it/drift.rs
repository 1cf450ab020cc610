//! A wavelength drift from plan to report, on a diode that hops, shortened in time.

use serde_json::Value;

use crate::lab::{Lab, experiments, replaced};

/// The shipped plan with fewer readings: 60 every second, 300 every ten seconds.
fn short_plan() -> String {
    let text = std::fs::read_to_string(experiments().join("plans/wavelength-drift.yaml")).unwrap();
    let text = replaced(&text, "rig: ../rigs/simulated.yaml\n", "");
    let text = replaced(&text, "fast_readings: 360", "fast_readings: 60");
    let text = replaced(&text, "slow_readings: 600", "slow_readings: 300");
    replaced(&text, "measurement: 30 min", "measurement: 10 min")
}

/// The default rig whose diode warms up faster, with these hops, if any.
fn rig(hops: &str) -> String {
    let text = std::fs::read_to_string(crate::lab::rig()).unwrap();
    let text = replaced(&text, "time_constant: 25 min", "time_constant: 8 min");
    if hops.is_empty() {
        return text;
    }
    let beam = "    beam: {diameter";
    replaced(&text, beam, &format!("    mode_hops: [{hops}]\n{beam}"))
}

fn lab(hops: &str) -> Lab {
    let lab = Lab::new();
    lab.write("plan.yaml", &short_plan());
    lab.write_rig("diode", &rig(hops));
    lab
}

const RUN: [&str; 7] =
    ["run", "plan.yaml", "--rig", "rigs/diode.yaml", "--json", "--out", "report"];

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("no number: {value}"))
}

#[test]
fn a_drift_is_analysed_reported_and_kept() {
    let lab = lab("{at: 30 min, by: 0.05 nm}");
    // One hop is more than the plan allows: its verdict is fail.
    let ended = lab.beampose(&RUN).expect_code(1);
    assert_eq!(ended.json()["verdict"], "fail");
    let report = lab.beampose(&["report", "latest", "--json"]).expect_code(1).json();
    assert_eq!(report["experiment"], "wavelength-drift");
    assert_eq!((&report["captures"], &report["readings"]), (&0.into(), &360.into()));
    let hops = report["hops"].as_array().unwrap();
    assert_eq!(hops.len(), 1, "{hops:?}");
    // Light comes 3 s after the command; then a reading every ten seconds.
    assert!((number(&hops[0]["at_s"]) - 1797.0).abs() <= 10.0, "{hops:?}");
    let coefficient = &report["temperature"];
    let error = number(&coefficient["coefficient_nm_per_degc"]) - 0.3;
    let u = number(&coefficient["standard_uncertainty_nm_per_degc"]);
    assert!(u < 0.002 && error.abs() < 4.0 * u, "{coefficient}");
    // What it prints for the rig, a rig takes.
    let lines = report["rig_lines"].as_str().unwrap();
    let pasted = format!("measurement:\n{lines}");
    lab.write_rig("pasted", &replaced(&rig(""), "measurement:\n", &pasted));
    lab.beampose(&["check", "plan.yaml", "--rig", "rigs/pasted.yaml"]).expect_code(0);
    let page = std::fs::read_to_string(lab.path("report/report.html")).unwrap();
    assert!(page.contains(lines), "{lines}");
    for said in ["Wavelength from a cold start", "Mode hops", "Allan deviation", "settled"] {
        assert!(page.contains(said), "{said}");
    }
    assert!(!page.contains("NaN") && !page.contains("<script"));
    let csv = std::fs::read_to_string(lab.path("report/wavelength.csv")).unwrap();
    assert_eq!(csv.lines().count(), 1 + 360);
    assert_eq!(csv.lines().filter(|line| line.ends_with(",hop")).count(), 1);
    // What the store has of it is what the list and a later report say.
    let listed = lab.beampose(&["sessions", "--json"]).expect_code(0).json();
    assert_eq!(listed["verdict"], "fail");
    let kept = std::fs::read_to_string(lab.path("report/report.json")).unwrap();
    assert_eq!(serde_json::from_str::<Value>(&kept).unwrap(), report);
    let steps = lab.beampose(&["sessions", "latest", "--json"]).expect_code(0).json();
    let last = steps["steps"].as_array().unwrap().last().unwrap().clone();
    assert_eq!(last["label"], "laser off");
}

#[test]
fn an_interrupted_drift_goes_on_and_says_what_it_is_worth() {
    let lab = lab("");
    // The wavelength meter goes silent for good in the middle: the run ends by an error.
    let broken = "  picture:\n    scale: 1\n";
    let silent = "  faults: [{of: wavemeter, fault: no_answer, at_step: 301}]\n";
    let text = replaced(&rig(""), broken, &format!("{silent}{broken}"));
    lab.write("rigs/diode.yaml", &text);
    lab.beampose(&RUN).expect_code(4);
    let report = lab.beampose(&["report", "latest", "--json"]).json();
    assert_eq!(report["verdict"], "error");
    // The same rig, repaired.
    lab.write("rigs/diode.yaml", &rig(""));
    let resumed = ["resume", "latest", "--accept-changes", "--json", "--out", "report"];
    let ended = lab.beampose(&resumed);
    assert!(ended.code == 0 || ended.code == 1, "{} {}", ended.code, ended.err);
    let report = lab.beampose(&["report", "latest", "--json"]).json();
    assert!(
        report["verdict"] == "pass"
            || report["verdict"] == "fail"
            || report["verdict"] == "inconclusive"
    );
    // The diode cooled down in between: readings before and after are of two warm-ups.
    let notes = report["notes"].as_array().unwrap();
    assert!(
        notes.iter().any(|n| n.as_str().unwrap().contains("longest of 2 stretches")),
        "{notes:?}"
    );
    assert_eq!(report["hops"].as_array().unwrap().len(), 0, "a cold start is no hop");
}

#[test]
fn the_same_drift_gives_the_same_bits() {
    let (first, second) = (lab("{at: 25 degC, by: -0.05 nm}"), lab("{at: 25 degC, by: -0.05 nm}"));
    for lab in [&first, &second] {
        lab.beampose(&RUN).expect_code(1);
    }
    let csv = |lab: &Lab| std::fs::read_to_string(lab.path("report/wavelength.csv")).unwrap();
    assert_eq!(csv(&first), csv(&second));
}
