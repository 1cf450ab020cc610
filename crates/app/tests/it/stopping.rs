//! Stopped in the middle, or no longer listened to.

use std::process::Stdio;
use std::time::{Duration, Instant};

use crate::lab::{Ended, Lab, SCALE, experiments, plan, solutions};

/// Waits until a session in the database has `wanted` captures. The database is there from the
/// first step on, and a reader beside the run is welcome.
fn wait_for_captures(lab: &Lab, wanted: u64) {
    let end = Instant::now() + Duration::from_secs(60);
    while Instant::now() < end {
        let listed = lab.beampose(&["sessions", "--json"]);
        let enough = |line: &serde_json::Value| line["captures"].as_u64() >= Some(wanted);
        if listed.code == 0 && listed.json_lines().iter().any(enough) {
            return;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    panic!("no {wanted} captures within a minute");
}

#[cfg(unix)]
#[track_caller]
fn a_signal_stops_tidily(signal: &str, reason: &str) {
    let lab = Lab::new();
    let full = experiments().join("plans/translation-test.yaml");
    let mut command = lab.command();
    command.arg("run").arg(full).args(["--picture-scale", SCALE, "--json", "--out", "report"]);
    let run = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    wait_for_captures(&lab, 2);
    let kill = format!("kill -{signal} {}", run.id());
    assert!(std::process::Command::new("sh").args(["-c", &kill]).status().unwrap().success());
    let ended = Ended::of(&run.wait_with_output().unwrap()).expect_code(3);
    let last = ended.json_lines().pop().unwrap();
    assert_eq!((&last["outcome"], &last["verdict"]), (&"aborted".into(), &"aborted".into()));

    let shown = lab.beampose(&["sessions", "latest", "--json"]).expect_code(0).json();
    assert_eq!((&shown["session"], &shown["outcome"]), (&last["session"], &"aborted".into()));
    let captures = shown["captures"].as_array().unwrap().len();
    assert!((2..60).contains(&captures), "{captures} captures");
    let events = shown["events"].as_array().unwrap();
    let at = |kind: &str| events.iter().rposition(|event| event["kind"] == kind).unwrap();
    assert!(at("laser_off") > at("laser_on") && at("laser_off") > at("abort_requested"));
    assert!(events.iter().all(|event| event["kind"] != "laser_unknown"));
    assert!(events[at("abort_requested")]["message"].as_str().unwrap().contains(reason));

    let sound = lab.beampose(&["sessions", "latest", "--verify"]).expect_code(0).out;
    assert!(sound.starts_with(&format!("{} pictures", 3 * captures)), "{sound}");
    let again = solutions(&lab.beampose(&["solve", "latest", "--json"]).expect_code(0));
    assert_eq!(again.len(), 2 * captures);
    assert!(again.iter().all(|pose| pose["status"] == "solved"));
    let report = lab.beampose(&["report", "latest", "--json"]).expect_code(3).json();
    assert_eq!((&report["verdict"], &report["solved"]), (&"aborted".into(), &captures.into()));
    assert!(lab.path("report/report.html").is_file());
}

#[cfg(unix)]
#[test]
fn ctrl_c_stops_a_run_with_the_laser_off_and_keeps_what_it_has() {
    a_signal_stops_tidily("INT", "Ctrl-C");
}

#[cfg(unix)]
#[test]
fn sigterm_stops_a_run_with_the_laser_off_and_keeps_what_it_has() {
    a_signal_stops_tidily("TERM", "SIGTERM");
}

#[test]
fn a_reader_that_goes_away_is_no_error() {
    let lab = Lab::new();
    lab.run(&plan(1, 100, 100), &[]).expect_code(0);
    let full = experiments().join("plans/translation-test.yaml").display().to_string();
    for arguments in [
        &["check", &full][..],
        &["sessions"],
        &["sessions", "--json"],
        &["sessions", "latest"],
        &["sessions", "latest", "--verify"],
        &["solve", "latest", "--json"],
        &["report", "latest", "--json"],
        &["score", "latest"],
        &["--help"],
    ] {
        let mut command = lab.command();
        command.args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut program = command.spawn().unwrap();
        // Nobody reads: the first line that is printed meets a closed pipe.
        drop(program.stdout.take());
        let ended = Ended::of(&program.wait_with_output().unwrap());
        assert_eq!((ended.code, ended.err.as_str()), (0, ""), "{arguments:?}");
    }
}

/// `/dev/full` takes nothing, as a full disk does.
#[cfg(target_os = "linux")]
#[test]
fn output_that_cannot_be_written_is_an_error() {
    let lab = Lab::new();
    let full = experiments().join("plans/translation-test.yaml");
    let mut command = lab.command();
    command.arg("check").arg(full).arg("--json");
    command.stdout(std::fs::File::create("/dev/full").unwrap()).stderr(Stdio::piped());
    let ended = Ended::of(&command.spawn().unwrap().wait_with_output().unwrap());
    assert_eq!(ended.code, 4, "{}", ended.err);
    assert_ne!(ended.err, "");
}
