//! What the simulation knows must not reach what solves or reports.
//!
//! The rooms that solve cannot depend on the store or on the virtual lab (`layering`), so only the
//! app could carry the truth to them. Here each file of the program is searched for every word by
//! which the truth can be had. That solving gives the same without any truth in the database, a
//! test of the app shows by doing it.

use beampose_tests::{Source, code, files, line_at, none, program, words};

/// Files that are about the truth.
const AT_HOME: &[&str] = &[
    "crates/virtual_lab/",
    "crates/store/src/truth.rs",
    "crates/app/src/truth.rs",
    "crates/app/src/cli/score.rs",
    "crates/analysis/src/score.rs",
];

/// The only other lines that may name it: they declare the modules and start the recorder.
const LINES: &[(&str, &str)] = &[
    ("crates/store/src/lib.rs", "pub mod truth;"),
    ("crates/analysis/src/lib.rs", "pub use score::{MethodScore, ScoredCapture, Truth, score};"),
    (
        "crates/store/src/gaps.rs",
        "crate::truth::forget_capture(transaction, session, &capture).await?;",
    ),
    ("crates/app/src/main.rs", "mod truth;"),
    ("crates/app/src/conduct.rs", "use crate::truth;"),
    (
        "crates/app/src/conduct.rs",
        "tokio::spawn(async move { truth::record(&store, session, &world, to_note).await })",
    ),
];

/// The files of the app that may hold the simulated world, and what they may ask of it: nothing
/// that was drawn.
const HOLDS_THE_WORLD: &[&str] = &[
    "crates/app/src/wiring/mod.rs",
    "crates/app/src/wiring/parts.rs",
    "crates/app/src/wiring/person.rs",
    "crates/app/src/wiring/wires.rs",
    "crates/app/src/truth.rs",
    "crates/app/src/conduct.rs",
];
/// `roll_module` is what a person does to the world.
const MAY_ASK: &[&str] = &["calibrations", "clone", "as_ref", "ok_or_else", "roll_module"];

/// `truth`, `truths`, `truth_at`, `TruePose`, `true_parameters` and their like.
fn is_of_truth(word: &str) -> bool {
    let lower = word.to_lowercase();
    lower.contains("truth")
        || lower.starts_with("true_")
        || word.strip_prefix("True").is_some_and(|rest| rest.starts_with(char::is_uppercase))
}

fn offences(source: &Source) -> Vec<String> {
    let path = source.path.as_str();
    let code = code(&source.text);
    let at_home = AT_HOME.iter().any(|home| path.starts_with(home));
    let in_app = path.starts_with("crates/app/");
    let mut found = Vec::new();
    for (at, word) in words(&code) {
        let (number, line) = line_at(&code, at);
        let mut tell = |what: &str| found.push(format!("{path}:{number}: {what}: {line}"));
        if is_of_truth(word) && !at_home && !LINES.contains(&(path, line)) {
            tell("names the truth");
        }
        if word == "world" && in_app {
            if !HOLDS_THE_WORLD.contains(&path) {
                tell("holds the simulated world");
            } else if !at_home && asked(&code[at..]).is_some_and(|m| !MAY_ASK.contains(&m)) {
                tell("asks the simulated world");
            }
        }
    }
    // Within strings: SQL.
    if source.text.contains("simulation_truth") && path != "crates/store/src/truth.rs" {
        found.push(format!("{path}: names the tables of the truth"));
    }
    found
}

/// In `world.method(..)` or `world.field` what is asked for.
fn asked(code: &str) -> Option<&str> {
    let rest = code.strip_prefix("world")?.trim_start().strip_prefix('.')?;
    words(rest).next().map(|(_, word)| word)
}

#[test]
fn only_the_recorder_and_the_score_touch_the_truth() {
    none(&program().iter().flat_map(offences).collect::<Vec<_>>());
}

#[test]
fn every_exception_is_in_use() {
    let program = program();
    for (path, line) in LINES {
        let source = program.iter().find(|s| s.path == *path).unwrap();
        assert!(source.text.lines().any(|l| l.trim() == *line), "{path}: {line}");
    }
    for home in AT_HOME {
        assert!(program.iter().any(|s| s.path.starts_with(home)), "{home}");
    }
}

#[test]
fn the_recorder_writes_and_cannot_be_asked() {
    let program = program();
    let recorder = program.iter().find(|s| s.path == "crates/app/src/truth.rs").unwrap();
    let code = code(&recorder.text);
    assert_eq!(words(&code).filter(|(_, word)| *word == "pub").count(), 1, "one function");
    assert!(code.contains("pub async fn record(") && code.contains("-> Result<(), StoreError>"));
    for reader in ["truth::captures", "truth::parameters"] {
        assert!(!code.contains(reader), "{reader}");
    }
}

#[test]
fn no_view_or_trigger_shows_the_truth_under_another_name() {
    let tables = files(&[".sql"]);
    let naming: Vec<&str> = tables
        .iter()
        .flat_map(|file| file.text.lines())
        .filter(|line| line.contains("truth") && !line.trim_start().starts_with("--"))
        .map(str::trim)
        .collect();
    let column = "truth_json    TEXT NOT NULL CHECK (json_valid(truth_json))";
    assert_eq!(
        naming,
        [
            "CREATE TABLE simulation_truth (",
            &format!("{column},"),
            "CREATE TABLE simulation_truth_parameters (",
            column,
        ]
    );
}

#[test]
fn a_reader_of_the_truth_is_found_wherever_it_is_planted() {
    for (path, text) in [
        ("crates/app/src/pipeline.rs", "let t = beampose_store::truth::captures(&s, id).await?;"),
        ("crates/app/src/session_report.rs", "use beampose_store::{Store, truth as known};"),
        ("crates/app/src/session_report.rs", "use crate::truth::*;"),
        ("crates/app/src/cli/solve.rs", "let world = laboratory.world.clone();"),
        (
            "crates/app/src/conduct.rs",
            "let pose = laboratory.world.as_ref().map(|w| w.truth_at(t));",
        ),
        ("crates/app/src/conduct.rs", "let dots = world.dots(&state);"),
        ("crates/app/src/wiring/mod.rs", "let setup = world\n    .true_parameters();"),
        ("crates/store/src/sessions.rs", "let sql = \"SELECT * FROM simulation_truth\";"),
        ("crates/store/src/lib.rs", "pub use truth::captures as hidden;"),
        ("crates/photogrammetry/src/solve/capture.rs", "fn solve(truth: &Pose) {}"),
    ] {
        let planted = Source { path: path.to_owned(), text: text.to_owned() };
        assert!(!offences(&planted).is_empty(), "{path}: {text}");
    }
}
