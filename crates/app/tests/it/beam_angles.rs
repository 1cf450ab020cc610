//! Beam angles on the simulated goniometer: closing in, interrupted, aborted, and what comes of it.

use std::process::Stdio;
use std::time::Duration;

use serde_json::Value;

use crate::lab::{Ended, Lab, experiments, replaced, signal};

/// The shipped plan with so many repetitions of pairs next to the middle.
pub fn plan(times: u32) -> String {
    let path = experiments().join("plans/beam-angle-calibration.yaml");
    let text = std::fs::read_to_string(path).unwrap();
    let text = replaced(&text, "rig: ../rigs/simulated-goniometer.yaml\n", "");
    let text = replaced(&text, "times: 5", &format!("times: {times}"));
    let text = replaced(&text, "uncertainty: 0.002 deg", "uncertainty: 0.02 deg");
    let is_far = |line: &&str| line.contains("-4") || line.contains("4]") || line.contains("3]]");
    let near: Vec<&str> = text.lines().filter(|line| !is_far(line)).collect();
    near.join("\n")
}

/// A folder with a goniometer and a plan.
pub fn lab(plan: &str, change: impl Fn(String) -> String) -> Lab {
    lab_on("simulated-goniometer", plan, change)
}

fn lab_on(rig: &str, plan: &str, change: impl Fn(String) -> String) -> Lab {
    let lab = Lab::new();
    let text = std::fs::read_to_string(experiments().join(format!("rigs/{rig}.yaml")));
    lab.write_rig("goniometer", &change(text.unwrap()));
    lab.write("plan.yaml", plan);
    lab
}

pub const RUN: [&str; 7] =
    ["run", "plan.yaml", "--rig", "rigs/goniometer.yaml", "--json", "--out", "report"];

fn report(lab: &Lab) -> Value {
    lab.beampose(&["report", "latest", "--json"]).expect_code(0).json()
}

/// Steps, moves and readings of all closings-in.
fn looks(lab: &Lab) -> Vec<(u32, f64, f64, Option<[f64; 2]>)> {
    lab.with_store("beampose.db", async |store| {
        let id = store.find_session("latest").await.unwrap();
        let looks = store.looks(id).await.unwrap();
        looks.into_iter().map(|(step, l)| (step.0, l.commanded, l.read, l.dot_px)).collect()
    })
}

/// No drift and no wander: what is measured at one time is measured at any.
fn steady(text: String) -> String {
    let text = replaced(&text, "rise: 1.02 K", "rise: 0 K");
    let text = replaced(&text, "drift_per_hour: 0.2 K", "drift_per_hour: 0 K");
    replaced(&text, "wander: 0.0016 deg", "wander: 0 deg")
}

#[test]
fn a_calibration_gives_the_fan_and_what_it_was_made_from() {
    let lab = lab(&plan(2), |rig| rig);
    lab.beampose(&RUN).expect_code(0);
    let fan = report(&lab)["fan"].clone();
    let pitch = &fan["fit"]["parameters"][0];
    assert_eq!(pitch["name"], "pitch_mm");
    let (value, u) = (pitch["value"].as_f64().unwrap(), pitch["u"].as_f64().unwrap());
    assert!((value - 52.22).abs() < 3.0 * u && u < 0.1, "{value} {u}");
    // The same again from the table of what was measured.
    let again = lab.beampose(&["calibrate", "pattern", "report/measured.csv", "--json"]);
    let again = again.expect_code(0).json();
    assert_eq!(again["means"].as_array().unwrap().len(), fan["means"].as_array().unwrap().len());
    // And a rig takes it.
    let text = std::fs::read_to_string(experiments().join("rigs/simulated.yaml")).unwrap();
    let text = replaced(&text, "pattern: simulated/pattern.yaml", "pattern: fan.yaml");
    lab.write_rig("calibrated", &text);
    std::fs::copy(lab.path("report/fan.yaml"), lab.path("rigs/fan.yaml")).unwrap();
    lab.write("translation.yaml", &crate::lab::plan(1, 100, 100));
    lab.beampose(&["check", "translation.yaml", "--rig", "rigs/calibrated.yaml"]).expect_code(0);
}

/// Two calibrations of one module: the same fan within two standard uncertainties of their difference.
/// What is drawn of the stage along the world's axes acts otherwise where the beam goes another way.
#[test]
fn folded_into_a_small_room_the_path_gives_the_same_fan() {
    let fan = |rig: &str| {
        let lab = lab_on(rig, &plan(2), |rig| rig);
        lab.beampose(&RUN).expect_code(0);
        report(&lab)["fan"].clone()
    };
    let (straight, folded) = (fan("simulated-goniometer"), fan("simulated-goniometer-folded"));
    for i in 0..2 {
        let [(a, u), (b, v)] = [&straight, &folded].map(|fan| {
            let parameter = &fan["fit"]["parameters"][i];
            (parameter["value"].as_f64().unwrap(), parameter["u"].as_f64().unwrap())
        });
        assert!((a - b).abs() < 2.0 * u.hypot(v), "{a} {b} {u} {v}");
    }
    let angle = |fan: &Value, i: usize, key: &str| fan["angles"][i][key].as_f64().unwrap();
    for i in 0..420 {
        let off = angle(&folded, i, "angle_deg") - angle(&straight, i, "angle_deg");
        let u = angle(&straight, i, "u_deg").hypot(angle(&folded, i, "u_deg"));
        assert!(off.abs() < 2.0 * u, "{i}: {off} {u}");
    }
    // It is another path all the same: the camera's noise falls otherwise.
    assert_ne!(straight["means"], folded["means"]);
}

#[test]
fn killed_while_it_closes_in_it_goes_on_and_reads_what_it_would_have_read() {
    let plan = plan(2);
    let whole = lab(&plan, steady);
    whole.beampose(&RUN).expect_code(0);
    let expected = looks(&whole);
    let mut met = 0;
    for tried in 0..20 {
        let lab = lab(&plan, steady);
        let mut command = lab.command();
        command.args(RUN).stdout(Stdio::null()).stderr(Stdio::null());
        let mut run = command.spawn().unwrap();
        std::thread::sleep(Duration::from_millis(150 + 60 * tried));
        let ran = run.try_wait().unwrap().is_some();
        run.kill().unwrap();
        run.wait().unwrap();
        if ran || !lab.path("beampose.db").exists() {
            continue;
        }
        let resumed = lab.beampose(&["resume", "--json", "--out", "report"]);
        if resumed.code == 2 {
            continue;
        }
        resumed.expect_code(0);
        assert_eq!(looks(&lab), expected);
        lab.beampose(&["sessions", "verify"]).expect_code(0);
        met += 1;
        if met == 3 {
            return;
        }
    }
    assert!(met > 0, "no kill met it at work");
}

#[cfg(unix)]
#[test]
fn aborted_while_it_closes_in_the_laser_is_off() {
    let lab = lab(&plan(5), |rig| rig);
    let mut command = lab.command();
    command.args(RUN).stdout(Stdio::piped()).stderr(Stdio::piped());
    let run = command.spawn().unwrap();
    let has_looked = || {
        lab.path("beampose.db").exists() && {
            let listed = lab.beampose(&["sessions", "--json"]);
            listed.code == 0
                && listed.json_lines().iter().any(|s| s["captures"].as_u64() >= Some(1))
        }
    };
    while !has_looked() {
        std::thread::sleep(Duration::from_millis(10));
    }
    signal(&run, "TERM");
    let ended = Ended::of(&run.wait_with_output().unwrap());
    assert_eq!(ended.code, 3, "{}", ended.err);
    let shown = lab.beampose(&["sessions", "latest", "--json"]).expect_code(0).json();
    let events = shown["events"].as_array().unwrap();
    let at = |kind: &str| events.iter().rposition(|event| event["kind"] == kind).unwrap();
    assert!(at("laser_off") > at("laser_on"));
}

#[test]
fn lost_motion_and_an_overshoot_are_survived_and_a_dark_picture_says_why_not() {
    let play = |rig: String| {
        let sigma = "positioning: 0.0001 deg";
        let rig = replaced(&rig, sigma, &format!("{sigma}\n      lost_motion: 0.01 deg"));
        let fault = "  faults:\n    - {of: turntable, fault: overshoot, at_step: 5, times: 1}\n";
        replaced(&rig, "  picture:\n    scale: 1\n", &format!("{fault}  picture:\n    scale: 1\n"))
    };
    let lab_ = lab(&plan(2), play);
    lab_.beampose(&RUN).expect_code(0);
    let looks = looks(&lab_);
    let most = looks.chunk_by(|a, b| a.0 == b.0).map(<[_]>::len).max().unwrap();
    assert!(most <= 12, "{most} moves");

    let dark = |rig: String| {
        let fault = "  faults:\n    - {of: far_cam, fault: black_frame, at_step: 5}\n";
        replaced(&rig, "  picture:\n    scale: 1\n", &format!("{fault}  picture:\n    scale: 1\n"))
    };
    let lab_ = lab(&plan(2), dark);
    let ended = lab_.beampose(&RUN);
    assert_ne!(ended.code, 0);
    assert!(ended.err.contains("the picture has no spot at all"), "{}", ended.err);
}
