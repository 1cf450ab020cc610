//! Every registered driver against its simulator, on TCP and on a pty.

use std::io::Write as _;

use beampose_drivers::conformance::{CHECKS, failures, untried};
use beampose_drivers::{Driver, REGISTRY};

#[test]
fn every_driver_conforms() {
    // In parallel: most of it is waiting for answers that do not come.
    let failed: Vec<String> = std::thread::scope(|scope| {
        let tried: Vec<_> = REGISTRY
            .iter()
            .map(|driver: &'static Driver| scope.spawn(move || failures(driver)))
            .collect();
        tried.into_iter().flat_map(|it| it.join().unwrap_or_default()).collect()
    });
    println!("{} drivers, {} checks", REGISTRY.len(), CHECKS.len());
    // Past the capture of the test's output: what was not tried is never passed over in silence.
    for why in REGISTRY.iter().flat_map(untried) {
        let _ = writeln!(std::io::stderr(), "not tried here: {why}");
    }
    assert!(failed.is_empty(), "\n{}", failed.join("\n"));
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
