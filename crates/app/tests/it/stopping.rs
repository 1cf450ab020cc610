//! Stopped in the middle, or no longer listened to.

use std::process::Stdio;
use std::time::{Duration, Instant};

use crate::lab::{Ended, Lab, SCALE, experiments, plan, signal, solutions};

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

/// A run that has taken two captures of sixty.
fn begun(lab: &Lab) -> std::process::Child {
    let full = experiments().join("plans/translation-test.yaml");
    let mut command = lab.command();
    command.arg("run").arg(full).args(["--picture-scale", SCALE, "--json", "--out", "report"]);
    let run = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    wait_for_captures(lab, 2);
    run
}

#[cfg(unix)]
#[track_caller]
fn a_signal_stops_tidily(name: &str, times: usize, reason: &str) {
    let lab = Lab::new();
    let run = begun(&lab);
    for _ in 0..times {
        signal(&run, name);
        // Two signals at the same instant are one.
        std::thread::sleep(Duration::from_millis(30));
    }
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
fn ctrl_c_three_times_aborts_with_the_laser_off_and_keeps_what_it_has() {
    a_signal_stops_tidily("INT", 3, "Ctrl-C");
}

#[cfg(unix)]
#[test]
fn sigterm_aborts_a_run_with_the_laser_off_and_keeps_what_it_has() {
    a_signal_stops_tidily("TERM", 1, "SIGTERM");
}

/// Waits until a run takes no more captures; how many it has. The event of a pause is stored with
/// the step that follows it.
fn wait_until_still(lab: &Lab) -> u64 {
    let captures = || {
        let listed = lab.beampose(&["sessions", "--json"]);
        listed.json_lines().iter().filter_map(|line| line["captures"].as_u64()).max().unwrap()
    };
    let end = Instant::now() + Duration::from_secs(60);
    let mut before = captures();
    while Instant::now() < end {
        std::thread::sleep(Duration::from_millis(1500));
        let now = captures();
        if now == before {
            return now;
        }
        before = now;
    }
    panic!("the run did not pause");
}

#[cfg(unix)]
#[test]
fn ctrl_c_once_pauses_and_a_word_from_elsewhere_lets_the_run_go_on_to_its_end() {
    let lab = Lab::new();
    let run = begun(&lab);
    signal(&run, "INT");
    let still = wait_until_still(&lab);
    assert!((2..60).contains(&still), "{still} captures");
    lab.beampose(&["tell", "latest", "go-on"]).expect_code(0);
    let ended = Ended::of(&run.wait_with_output().unwrap()).expect_code(0);
    assert!(ended.err.contains("paused, everything is safe: Ctrl-C"), "{}", ended.err);
    let last = ended.json_lines().pop().unwrap();
    assert_eq!((&last["outcome"], &last["captures"]), (&"completed".into(), &60.into()));
    // The log of the session says so too, each line with session and step.
    let log = std::fs::read_to_string(lab.path("report/run.log")).unwrap();
    let line = log.lines().find(|line| line.contains("kind=Moved")).unwrap();
    let span = format!("session{{id={}}}:step{{number=", last["session"].as_str().unwrap());
    assert!(line.contains(&span), "{line}");
    let shown = lab.beampose(&["sessions", "latest", "--json"]).expect_code(0).json();
    let events = shown["events"].as_array().unwrap();
    let at = |kind: &str| events.iter().position(|event| event["kind"] == kind).unwrap();
    assert!(at("paused") < at("continued"));
    let between: Vec<_> = events[at("paused")..].iter().map(|e| &e["kind"]).collect();
    assert!(between.contains(&&"laser_on".into()), "lit again: {between:?}");
    // Nobody runs it any more: there is nobody to tell.
    let late = lab.beampose(&["tell", "latest", "pause"]).expect_code(2);
    assert!(late.err.contains("no program runs session"), "{}", late.err);
}

#[test]
fn a_run_that_is_told_to_stop_or_to_halt_says_so_and_can_be_resumed() {
    for (word, outcome) in [("stop", "stopped"), ("halt", "halted")] {
        let lab = Lab::new();
        let run = begun(&lab);
        lab.beampose(&["tell", "latest", word]).expect_code(0);
        let ended = Ended::of(&run.wait_with_output().unwrap()).expect_code(3);
        let last = ended.json_lines().pop().unwrap();
        assert_eq!((&last["outcome"], &last["verdict"]), (&outcome.into(), &"aborted".into()));
        let resumed = lab.beampose(&["resume", "--json", "--out", "report"]).expect_code(0);
        assert_eq!(resumed.json_lines().pop().unwrap()["captures"], 60);
    }
}

/// A rig whose rail has an address is one rail, whichever file names it.
#[test]
fn two_runs_never_drive_the_same_instrument_and_a_dead_one_is_named() {
    let text = std::fs::read_to_string(crate::lab::rig()).unwrap();
    let rail = "  rail:\n    linear_axis:\n      driver: simulated\n";
    let text = crate::lab::replaced(&text, rail, &format!("{rail}      address: /dev/ttyUSB0\n"));
    let lab = Lab::new();
    lab.write_rig("mine", &text);
    lab.write_rig("theirs", &text);
    // The first is long: it is still at it when the second one comes.
    lab.write("mine.yaml", &plan(1, 900, 50));
    lab.write("theirs.yaml", &plan(1, 200, 100));
    let command = |rig: &str| {
        let mut command = lab.command();
        command.env("BEAMPOSE_LOCKS", lab.path("locks"));
        command.args([
            "run",
            rig.trim_start_matches("rigs/"),
            "--rig",
            rig,
            "--picture-scale",
            SCALE,
        ]);
        command.args(["--out", rig.trim_end_matches(".yaml"), "--db", &format!("{rig}.db")]);
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    };
    let mut mine = command("rigs/mine.yaml").spawn().unwrap();
    let locks = lab.path("locks");
    let end = Instant::now() + Duration::from_secs(60);
    while std::fs::read_dir(&locks).map_or(0, Iterator::count) == 0 && Instant::now() < end {
        std::thread::sleep(Duration::from_millis(2));
    }
    let theirs = Ended::of(&command("rigs/theirs.yaml").output().unwrap()).expect_code(2);
    let driven = format!("rail (simulated /dev/ttyUSB0) is driven by process {}", mine.id());
    assert!(theirs.err.contains(&driven), "{}", theirs.err);
    // Killed, it holds nobody up; whose it was is said.
    mine.kill().unwrap();
    mine.wait().unwrap();
    let after = Ended::of(&command("rigs/theirs.yaml").output().unwrap()).expect_code(0);
    let died = format!("rail was driven by process {}", mine.id());
    assert!(after.err.contains(&died) && after.err.contains("which died"), "{}", after.err);
}

#[test]
fn a_plan_that_asks_goes_by_a_file_of_answers() {
    let lab = Lab::new();
    let ask = "\nsteps:\n  - prompt: {name: operator, text: Who are you?, ask: {text: name}}\n  \
               - prompt: {name: warm, text: Is the laser warm?}\n  \
               - wait: 1 s\n    run_if: {answer: warm, is: no}\n";
    let text = crate::lab::replaced(&plan(1, 100, 100), "\nsteps:\n", ask);
    lab.write("asks.yaml", &text);
    let run = ["run", "asks.yaml", "--rig", &crate::lab::rig(), "--picture-scale", SCALE];
    // Nobody is there: the first question fails, and says what to do.
    let nobody = lab.beampose(&[&run[..], &["--out", "report"]].concat()).expect_code(4);
    assert!(nobody.err.contains("there is nobody to ask"), "{}", nobody.err);
    lab.write("answers.yaml", "operator: 'Jean d''Arc; DROP TABLE answers'\nwarm: true\n");
    let with = [&run[..], &["--out", "report", "--answers", "answers.yaml"]].concat();
    let notified =
        [&with[..], &["--notify", "cat >> told.jsonl"], &["--log-format", "json"]].concat();
    lab.beampose(&notified).expect_code(0);
    let told = std::fs::read_to_string(lab.path("told.jsonl")).unwrap();
    let told: Vec<serde_json::Value> =
        told.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!((&told[0]["event"], &told[1]["event"]), (&"asked".into(), &"asked".into()));
    let last = told.last().unwrap();
    assert_eq!((&last["event"], &last["outcome"]), (&"ended".into(), &"completed".into()));
    let log = std::fs::read_to_string(lab.path("report/run.log")).unwrap();
    let line: serde_json::Value = serde_json::from_str(log.lines().last().unwrap()).unwrap();
    assert!(line["fields"]["message"].is_string(), "{line}");
    let shown = lab.beampose(&["sessions", "latest", "--json"]).expect_code(0).json();
    let events = shown["events"].as_array().unwrap();
    let said: Vec<_> = events.iter().filter(|e| e["kind"] == "answered").collect();
    assert_eq!(said[0]["message"], "operator: Jean d'Arc; DROP TABLE answers (answers file)");
    assert_eq!(said[1]["message"], "warm: yes (answers file)");
    lab.with_store("beampose.db", async |store| {
        let id = store.find_session("latest").await.unwrap();
        let answers = store.answers(id).await.unwrap();
        assert_eq!(answers.len(), 2);
        assert_eq!(answers[1].1.value, "yes");
        let steps = store.steps(id).await.unwrap();
        assert_eq!(steps[2].outcome, beampose_core::StepOutcome::Skipped);
    });
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
