//! Every registered driver against its simulator, on TCP and on a pty.
#![expect(clippy::unwrap_used, reason = "helpers of tests stop the test")]

use std::io::Write as _;

use beampose_drivers::conformance::{failures, untried};
use beampose_drivers::{REGISTRY, Value};

/// All drivers of these kinds, together.
#[track_caller]
fn check(kinds: &[&str]) {
    let drivers = || REGISTRY.iter().filter(|driver| kinds.contains(&driver.kind));
    assert!(drivers().count() > 0, "{kinds:?}");
    let failed: Vec<String> = std::thread::scope(|scope| {
        let tried: Vec<_> = drivers().map(|driver| scope.spawn(|| failures(driver))).collect();
        tried.into_iter().flat_map(|it| it.join().unwrap()).collect()
    });
    // Past the capture of the test's output: what was not tried is never passed over in silence.
    for why in drivers().flat_map(untried) {
        let _ = writeln!(std::io::stderr(), "not tried here: {why}");
    }
    assert!(failed.is_empty(), "\n{}", failed.join("\n"));
}

#[test]
fn every_axis_conforms() {
    check(&["linear_axis", "rotary_axis"]);
}

#[test]
fn every_laser_conforms() {
    check(&["laser"]);
}

#[test]
fn every_sensor_conforms() {
    check(&["sensor"]);
}

#[test]
fn every_camera_conforms() {
    check(&["camera"]);
}

#[test]
fn every_kind_is_tried() {
    let tried = ["linear_axis", "rotary_axis", "laser", "sensor", "camera"];
    assert!(REGISTRY.iter().all(|driver| tried.contains(&driver.kind)));
}

#[test]
fn names_are_unique_and_options_documented() {
    for (i, driver) in REGISTRY.iter().enumerate() {
        assert!(
            REGISTRY[..i].iter().all(|it| (it.kind, it.name) != (driver.kind, driver.name)),
            "{} {} twice",
            driver.kind,
            driver.name
        );
        assert!(!driver.verified.is_empty() && !driver.instruments.is_empty(), "{}", driver.name);
        assert!(driver.options.iter().all(|spec| !spec.about.is_empty()), "{}", driver.name);
    }
}

/// Every driver with its options and who has judged it, as `docs/instruments.md` shows them.
fn page() -> String {
    let mut text = "# Instruments

Every driver, its options in a rig file, and who has judged it so far. A simulator that a foreign client
took for the instrument judges the driver in turn; the two share no parser. No driver has met its
instrument yet. Written from the registry by the test `conformance` (`BEAMPOSE_UPDATE_DOCS=1`).

"
    .to_owned();
    for driver in REGISTRY {
        text.push_str(&format!(
            "## `{}`, {}\n\n{}.\n\nJudged: {}.\n\n",
            driver.name,
            driver.kind.replace('_', " "),
            driver.instruments,
            driver.verified
        ));
        if driver.options.is_empty() {
            continue;
        }
        text.push_str("| option | what it is | without it |\n|---|---|---|\n");
        for option in driver.options {
            let word = |value: Value| match value {
                Value::Number(number) => number.to_string(),
                Value::Text("") => "nothing".to_owned(),
                Value::Text(text) => text.escape_default().to_string(),
                Value::Switch(it) => it.to_string(),
            };
            let default = option.default.map_or("must be there".to_owned(), word);
            let about = option.about.replace('|', "\\|");
            text.push_str(&format!("| `{}` | {about} | {default} |\n", option.name));
        }
        text.push('\n');
    }
    format!("{}\n", text.trim_end())
}

#[test]
fn the_page_of_instruments_is_that_of_the_registry() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/instruments.md");
    if std::env::var_os("BEAMPOSE_UPDATE_DOCS").is_some() {
        std::fs::write(path, page()).unwrap();
    }
    let documented = std::fs::read_to_string(path).unwrap_or_default();
    for (line, (is, says)) in page().lines().zip(documented.lines()).enumerate() {
        assert_eq!(is, says, "line {} of docs/instruments.md", line + 1);
    }
    assert_eq!(page().lines().count(), documented.lines().count());
}
