//! The walls between crates, as the manifests and the code show them.

use std::collections::{BTreeMap, BTreeSet};

use beampose_tests::{Source, code, files, line_at, none, program, words};

/// Which room may use which. The app and the tests may use all.
const EDGES: &[(&str, &[&str])] = &[
    ("beampose-core", &[]),
    ("beampose-plan", &["beampose-core"]),
    ("beampose-store", &["beampose-core"]),
    ("beampose-photogrammetry", &["beampose-core"]),
    ("beampose-drivers", &["beampose-core"]),
    ("beampose-engine", &["beampose-core", "beampose-plan"]),
    ("beampose-virtual-lab", &["beampose-core", "beampose-photogrammetry"]),
    ("beampose-analysis", &["beampose-core", "beampose-photogrammetry"]),
    (
        "beampose-exchange",
        &["beampose-core", "beampose-photogrammetry", "beampose-plan", "beampose-store"],
    ),
];

/// Crates above all rooms: nobody uses them.
const TOP: &[&str] = &["beampose", "beampose-tests"];

/// Workspaces of their own: what they need is no need of the program.
const ELSEWHERE: &[&str] = &["fuzz/Cargo.toml", "drivers/peers/zproto/Cargo.toml"];

/// One dependency of one package, whatever its kind and target.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Edge {
    from: String,
    to: String,
}

/// Every manifest of the workspace as Cargo itself understands it: renames, target tables, dev and
/// build dependencies included.
fn packages() -> BTreeMap<String, Vec<Edge>> {
    let out = std::process::Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--offline", "--format-version", "1"])
        .current_dir(beampose_tests::root())
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let metadata: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let edges = |package: &serde_json::Value, from: &str| {
        let to = package["dependencies"].as_array().unwrap().iter();
        to.map(|d| Edge { from: from.to_owned(), to: d["name"].as_str().unwrap().to_owned() })
            .collect()
    };
    let packages = metadata["packages"].as_array().unwrap().iter();
    packages
        .map(|package| {
            let name = package["name"].as_str().unwrap();
            (name.to_owned(), edges(package, name))
        })
        .collect()
}

fn is_allowed(edge: &Edge) -> bool {
    let ours = edge.to == "beampose" || edge.to.starts_with("beampose-");
    if !ours {
        return true;
    }
    let of = EDGES.iter().find(|(room, _)| *room == edge.from);
    match of {
        Some((_, allowed)) => allowed.contains(&edge.to.as_str()),
        None => TOP.contains(&edge.from.as_str()) && !TOP.contains(&edge.to.as_str()),
    }
}

#[test]
fn the_rooms_are_those_of_the_design() {
    let designed: BTreeSet<&str> =
        EDGES.iter().map(|(room, _)| *room).chain(TOP.iter().copied()).collect();
    let packages = packages();
    let found: BTreeSet<&str> = packages.keys().map(String::as_str).collect();
    assert_eq!(found, designed);
    // A manifest that is no member would be read by nobody.
    let manifests = files(&["Cargo.toml"]).into_iter();
    let manifests =
        manifests.filter(|manifest| !ELSEWHERE.contains(&manifest.path.as_str())).count();
    assert_eq!(manifests, found.len() + 1, "one for each package, and the workspace's");
}

#[test]
fn a_room_uses_only_the_rooms_below_it() {
    let packages = packages();
    let edges = packages.values().flatten();
    let wrong: Vec<String> = edges
        .filter(|edge| !is_allowed(edge))
        .map(|edge| format!("{} must not use {}", edge.from, edge.to))
        .collect();
    none(&wrong);
}

#[test]
fn an_edge_that_leads_up_or_sideways_is_found() {
    let edge = |from: &str, to: &str| Edge { from: from.to_owned(), to: to.to_owned() };
    for (from, to) in [
        ("beampose-photogrammetry", "beampose-virtual-lab"),
        ("beampose-photogrammetry", "beampose-store"),
        ("beampose-analysis", "beampose-store"),
        ("beampose-engine", "beampose-drivers"),
        ("beampose-core", "beampose-plan"),
        ("beampose-plan", "beampose"),
        ("beampose", "beampose-tests"),
        ("beampose-new-room", "beampose-core"),
    ] {
        assert!(!is_allowed(&edge(from, to)), "{from} -> {to}");
    }
    assert!(is_allowed(&edge("beampose-engine", "beampose-plan")));
    assert!(is_allowed(&edge("beampose", "beampose-drivers")));
}

#[test]
fn only_the_store_knows_sql() {
    let packages = packages();
    let edges = packages.values().flatten();
    let users: BTreeSet<&str> = edges
        .filter(|edge| ["sqlx", "sqlite", "diesel"].iter().any(|sql| edge.to.contains(sql)))
        .map(|edge| edge.from.as_str())
        .collect();
    // The tests measure a bare transaction beside one of ours.
    assert_eq!(users, BTreeSet::from(["beampose-store", "beampose-tests"]));
}

/// The crates that only some files may name.
const NAMED_ONLY_IN: &[(&str, &[&str])] = &[
    (
        "beampose_drivers",
        &[
            "crates/app/src/wiring/faults.rs",
            "crates/app/src/wiring/mod.rs",
            "crates/app/src/wiring/parts.rs",
            "crates/app/src/wiring/probe.rs",
            "crates/app/src/wiring/wires.rs",
        ],
    ),
    (
        "beampose_virtual_lab",
        &[
            "crates/app/src/wiring/mod.rs",
            "crates/app/src/wiring/faults.rs",
            "crates/app/src/wiring/parts.rs",
            "crates/app/src/wiring/person.rs",
            "crates/app/src/wiring/wires.rs",
            "crates/app/src/wiring/world.rs",
            "crates/app/src/truth.rs",
        ],
    ),
];

fn naming_offences(source: &Source) -> Vec<String> {
    let code = code(&source.text);
    words(&code)
        .filter(|(_, word)| {
            let rule = NAMED_ONLY_IN.iter().find(|(name, _)| name == word);
            rule.is_some_and(|(_, files)| !files.contains(&source.path.as_str()))
        })
        .map(|(at, word)| format!("{}:{}: names {word}", source.path, line_at(&code, at).0))
        .collect()
}

#[test]
fn only_the_wiring_sees_concrete_instruments() {
    let program = program();
    none(&program.iter().flat_map(naming_offences).collect::<Vec<_>>());
    let text = "use beampose_drivers::known;".to_owned();
    let planted = Source { path: "crates/app/src/pipeline.rs".to_owned(), text };
    assert_eq!(naming_offences(&planted).len(), 1);
}
