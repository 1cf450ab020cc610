//! Broken plans and rigs, each with the message that an experimenter sees.
//!
//! To add one: a file in `broken/` whose name begins with `plan-`, `rig-`, `check-` (a plan that
//! is sound but not with the default rig) or `both-` (a plan that is neither), and its snapshot.

#![expect(clippy::unwrap_used, reason = "helpers of tests stop the test")]

use std::path::{Path, PathBuf};

use beampose_plan::{
    Faults, check, check_both, read_plan, read_plan_as_it_is, read_rig, read_rig_as_it_is, source,
};

fn here() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/broken")
}

/// The files whose names begin with `kind`, sorted.
fn files(kind: &str) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<(String, Vec<u8>)> = std::fs::read_dir(here())
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .map(|path| (path.file_name().unwrap().to_str().unwrap().to_owned(), path))
        .filter(|(name, _)| name.starts_with(kind))
        .map(|(name, path)| (name, std::fs::read(path).unwrap()))
        .collect();
    files.sort();
    assert!(!files.is_empty());
    files
}

fn snapshot(name: &str, shown: &str) {
    insta::with_settings!({ omit_expression => true, prepend_module_to_snapshot => false }, {
        insta::assert_snapshot!(name.trim_end_matches(".yaml"), shown);
    });
}

#[test]
fn a_broken_plan_is_refused_with_every_fault() {
    for (name, bytes) in files("plan-") {
        snapshot(&name, &read_plan(&name, &bytes).unwrap_err().to_string());
    }
}

#[test]
fn a_broken_rig_is_refused_with_every_fault() {
    for (name, bytes) in files("rig-") {
        snapshot(&name, &read_rig(&name, &bytes).unwrap_err().to_string());
    }
}

#[test]
fn a_sound_plan_is_refused_with_a_rig_that_cannot_do_it() {
    let rig = here().join("../../../../experiments/rigs/simulated.yaml");
    let rig = read_rig("simulated.yaml", &std::fs::read(rig).unwrap()).unwrap();
    for (name, bytes) in files("check-") {
        let plan = read_plan(&name, &bytes).unwrap_or_else(|faults| panic!("{faults}"));
        let shown = match check(&plan, &rig) {
            Ok(summary) => summary.to_string(),
            Err(faults) => faults.to_string(),
        };
        snapshot(&name, &shown);
    }
}

#[test]
fn faults_of_a_plan_and_of_its_match_with_a_rig_come_together() {
    let rig = here().join("../../../../experiments/rigs/simulated.yaml");
    let rig = std::fs::read(rig).unwrap();
    for (name, bytes) in files("both-") {
        let plan = read_plan_as_it_is(&name, &bytes);
        let faults = check_both(plan, read_rig_as_it_is("simulated.yaml", &rig)).unwrap_err();
        snapshot(&name, &faults.to_string());
    }
}

#[test]
fn depth_beyond_reason_is_refused() {
    let flow = format!("steps: {}", "[".repeat(5_000));
    let block: String = (0..900).map(|depth| format!("{}a:\n", " ".repeat(depth))).collect();
    let compact = format!("steps:\n{}x", "- ".repeat(3_000));
    for (name, text) in [("flow", flow), ("block", block), ("compact", compact)] {
        let faults = read_plan("deep.yaml", text.as_bytes()).unwrap_err();
        assert_eq!(faults.len(), 1, "{faults}");
        snapshot(&format!("deep-{name}"), &faults.to_string());
    }
}

/// Test threads have stacks of 2 MiB, as have those of the runtime: an overflow aborts the test.
#[test]
fn the_depth_that_is_read_fits_the_stack() {
    for depth in 1..40 {
        for text in [
            format!("steps: {}x{}", "[".repeat(depth), "]".repeat(depth)),
            format!("steps:\n{}x", "- ".repeat(depth)),
            (0..depth).map(|depth| format!("{}a:\n", " ".repeat(depth))).collect(),
        ] {
            assert!(read_plan("deep.yaml", text.as_bytes()).is_err());
        }
    }
}

#[test]
fn size_beyond_reason_is_refused() {
    let bytes = vec![b' '; 2_000_000];
    snapshot("too-big", &read_plan("big.yaml", &bytes).unwrap_err().to_string());
}

#[test]
fn what_is_not_text_is_refused() {
    let bytes = b"version: 1\ntitle: \xff\xfe\n";
    snapshot("not-utf8", &read_plan("latin.yaml", bytes).unwrap_err().to_string());
}

#[test]
fn a_file_that_cannot_be_read_is_a_fault_like_any_other() {
    let missing = source::text("missing.yaml", std::fs::read(here().join("missing.yaml")));
    let directory = source::text("broken", std::fs::read(here()));
    let mut faults = Faults::from(missing.unwrap_err());
    faults.push(directory.unwrap_err());
    snapshot("unreadable", &faults.to_string());
}

#[test]
fn a_message_holds_nothing_that_a_terminal_would_obey() {
    let plan =
        "version: 1\ntitle: x\nexperiment: \"\\e[31m\u{7}red\"\nsteps: [laser: on] # \u{9b}\n";
    let shown = read_plan("odd.yaml", plan.as_bytes()).unwrap_err().to_string();
    assert!(shown.chars().all(|c| c == '\n' || !c.is_control()), "{shown:?}");
}
