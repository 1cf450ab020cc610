//! Input at fault: one clear message, an exit code, no panic, nothing done.

use crate::lab::{Lab, experiments, plan, replaced, rig};

/// One case: what is typed, and what came of it, with paths redacted.
fn told(lab: &Lab, typed: &str) -> String {
    let rig = rig();
    let arguments: Vec<&str> =
        typed.split_whitespace().map(|word| if word == "RIG" { &rig } else { word }).collect();
    let ended = lab.beampose(&arguments);
    assert!(ended.code != 0 && ended.out.is_empty(), "{typed}: {ended:?}");
    let redacted = ended
        .err
        .replace(&experiments().display().to_string(), "EXPERIMENTS")
        .replace(&lab.path("").display().to_string(), "LAB/");
    assert!(redacted.trim_end().lines().count() < 60, "{typed}: {redacted}");
    format!("$ beampose {typed}\n{redacted}exit code {}\n", ended.code)
}

/// Writes the default rig, changed, as `rig.yaml` into a folder of its own, with its calibrations.
fn with_rig(lab: &Lab, folder: &str, change: impl Fn(&str) -> String) {
    let text = std::fs::read_to_string(rig()).unwrap();
    lab.write(&format!("{folder}/rig.yaml"), &change(&text));
    for entry in std::fs::read_dir(experiments().join("rigs/simulated")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        lab.write(&format!("{folder}/simulated/{name}"), &text);
    }
}

#[test]
fn a_broken_input_gets_one_clear_message() {
    let lab = Lab::new();
    let good = plan(1, 100, 100);
    lab.write("good.yaml", &good);
    lab.write("misspelt.yaml", &replaced(&good, "finally:", "finaly:"));
    lab.write("far.yaml", &replaced(&good, "to: 100 mm", "to: 2 m"));
    with_rig(&lab, "hardware", |text| {
        let text = replaced(text, "clock: virtual", "clock: real");
        replaced(&text, "laser: {driver: simulated,", "laser: {driver: gphot,")
    });
    with_rig(&lab, "cut", |text| replaced(text, "simulated/cam_b.yaml", "simulated/cam_d.yaml"));
    with_rig(&lab, "broken", str::to_owned);
    lab.write("broken/simulated/cam_b.yaml", "image_width: many\n");
    lab.write("text.db", "not a database\n");
    lab.write("folder/kept", "");
    let cases = [
        "run",
        "rnu good.yaml",
        "run missing.yaml",
        "run folder",
        "run good.yaml",
        "run good.yaml --rig missing.yaml",
        "run good.yaml --rig folder",
        "run misspelt.yaml --rig RIG",
        "run far.yaml --rig RIG",
        "run good.yaml --rig hardware/rig.yaml",
        "run good.yaml --rig cut/rig.yaml",
        "run good.yaml --rig broken/rig.yaml",
        "run good.yaml --rig RIG --picture-scale 3",
        "run good.yaml --rig RIG --seed -1",
        "run good.yaml --rig RIG --db folder",
        "run good.yaml --rig RIG --db text.db",
        "run good.yaml --rig RIG --db nowhere/beampose.db",
        "check misspelt.yaml --rig RIG",
        "sessions",
        "sessions --db folder",
        "report latest --db missing.db",
        "solve latest --method virtual-camra",
    ];
    let all: Vec<String> = cases.iter().map(|typed| told(&lab, typed)).collect();
    insta::with_settings!({ omit_expression => true, prepend_module_to_snapshot => false }, {
        insta::assert_snapshot!("bad_input", all.join("\n"));
    });
    let mut left: Vec<_> =
        std::fs::read_dir(lab.path("")).unwrap().map(|e| e.unwrap().file_name()).collect();
    left.sort();
    let written = [
        "broken",
        "cut",
        "far.yaml",
        "folder",
        "good.yaml",
        "hardware",
        "misspelt.yaml",
        "text.db",
    ];
    assert_eq!(left, written, "nothing is made of a broken input");
}

#[test]
fn check_finds_what_run_would_refuse() {
    let lab = Lab::new();
    lab.write("plan.yaml", &plan(1, 100, 100));
    with_rig(&lab, "rig", |text| {
        let text = replaced(text, "clock: virtual", "clock: real");
        replaced(&text, "laser: {driver: simulated,", "laser: {driver: gphot,")
    });
    let run = lab.beampose(&["run", "plan.yaml", "--rig", "rig/rig.yaml"]).expect_code(2);
    let check = lab.beampose(&["check", "plan.yaml", "--rig", "rig/rig.yaml"]).expect_code(2);
    assert_eq!(run.err, check.err);
    assert!(run.err.contains("gphot"), "{}", run.err);
}

#[test]
fn a_session_that_is_not_there_gets_those_that_are() {
    let lab = Lab::new();
    lab.run(&plan(1, 100, 100), &[]).expect_code(0);
    let id = lab.beampose(&["sessions", "--json"]).json()["session"].as_str().unwrap().to_owned();
    for command in ["sessions", "solve", "report", "score"] {
        let ended = lab.beampose(&[command, "ffff"]).expect_code(2);
        assert!(ended.err.starts_with("beampose: there is no session \"ffff\""), "{}", ended.err);
        assert!(ended.err.contains(&id), "{}", ended.err);
        assert_eq!(ended.out, "");
    }
    // A unique beginning is enough.
    assert_eq!(lab.beampose(&["sessions", &id[..8]]).code, 0);
}
