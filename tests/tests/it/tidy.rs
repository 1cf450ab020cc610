//! What every file must be.

use beampose_tests::{Source, code, files, line_at, none, program};

/// Lines of a Rust file, comments and tests included.
const LONGEST_FILE: usize = 600;

/// Text files of the project. Snapshots keep what they are given.
const TEXT: &[&str] =
    &[".rs", ".toml", ".yaml", ".yml", ".sql", ".md", ".json", ".sh", ".snap", ".csv"];

fn rust() -> Vec<Source> {
    files(&[".rs"])
}

/// Where `needle` stands in `text`.
fn found(source: &Source, text: &str, needle: &str) -> Vec<String> {
    let hits = text.match_indices(needle);
    hits.map(|(at, _)| format!("{}:{}: {needle}", source.path, line_at(text, at).0)).collect()
}

#[test]
fn nothing_is_left_undone_silenced_or_skipped() {
    let needles = ["#[allow(", "#![allow(", "todo!", "unimplemented!", "#[ignore", "dbg!"];
    let mut offences = Vec::new();
    for source in rust() {
        let code = code(&source.text);
        offences.extend(needles.iter().flat_map(|needle| found(&source, &code, needle)));
    }
    none(&offences);
}

#[test]
fn the_program_does_not_unwrap() {
    let mut offences = Vec::new();
    for source in program() {
        let code = code(&source.text);
        for needle in [".unwrap()", ".expect(", ".unwrap_err()", "panic!(", "unreachable!("] {
            offences.extend(found(&source, &code, needle));
        }
    }
    none(&offences);
}

#[test]
fn every_module_says_what_it_is_for() {
    let silent = program().into_iter().filter(|s| !s.text.starts_with("//! "));
    none(&silent.map(|s| s.path).collect::<Vec<_>>());
}

#[test]
fn no_file_is_longer_than_can_be_read_at_once() {
    let long = |s: &Source| s.text.lines().count() > LONGEST_FILE;
    let told = |s: Source| format!("{}: {} lines", s.path, s.text.lines().count());
    none(&rust().into_iter().filter(long).map(told).collect::<Vec<_>>());
}

#[test]
fn no_file_knows_the_machine_it_was_written_on() {
    // In pieces, so that this file does not hold what it looks for.
    let needles = ["home", "root", "work", "Users", "mnt"].map(|folder| format!("/{folder}/"));
    let mut offences = Vec::new();
    for source in files(TEXT) {
        offences.extend(needles.iter().flat_map(|needle| absolute(&source, needle)));
    }
    none(&offences);
}

/// Where `needle` begins a path: not within one, as in `a/b/c`, nor in an address.
fn absolute(source: &Source, needle: &str) -> Vec<String> {
    let begins = |at: &usize| {
        let before = source.text[..*at].chars().next_back();
        !before.is_some_and(|c| c.is_alphanumeric() || "._-/".contains(c))
    };
    let hits = source.text.match_indices(needle).map(|(at, _)| at).filter(begins);
    hits.map(|at| format!("{}:{}: {needle}", source.path, line_at(&source.text, at).0)).collect()
}

#[test]
fn a_path_of_a_machine_is_told_from_a_part_of_a_path() {
    let source = |text: String| Source { path: "x".to_owned(), text };
    let needle = format!("/{}/", "home");
    assert_eq!(absolute(&source(format!("see {needle}x")), &needle).len(), 1);
    assert_eq!(absolute(&source(format!("\"{needle}x\"")), &needle).len(), 1);
    assert!(absolute(&source(format!("https://example.org{needle}x")), &needle).is_empty());
}

#[test]
fn no_line_ends_in_space_and_every_file_in_a_line_feed() {
    let mut offences = Vec::new();
    for source in files(TEXT) {
        // What is printed is kept as it is, broken input as it is broken.
        if source.path.ends_with(".snap") || source.path.contains("/broken/") {
            continue;
        }
        let lines = source.text.split('\n').enumerate();
        let wrong = lines.filter(|(_, line)| line.ends_with([' ', '\t', '\r']));
        offences.extend(wrong.map(|(n, _)| format!("{}:{}: ends in space", source.path, n + 1)));
        if !source.text.is_empty()
            && (!source.text.ends_with('\n') || source.text.ends_with("\n\n"))
        {
            offences.push(format!("{}: does not end in one line feed", source.path));
        }
    }
    none(&offences);
}
