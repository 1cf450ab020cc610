//! Light goes off, or somebody is told that nobody knows.

use std::panic::{AssertUnwindSafe, catch_unwind};

use beampose_core::{EventKind, SessionOutcome, StepOutcome};

use super::fakes::*;
use crate::machine::Lasers;
use crate::safe_state::LaserGuard;

#[test]
fn every_switch_is_an_event_with_its_reason() {
    let lab = Lab::new();
    assert_eq!(lab.outcome(&plan([laser_on(), laser_off()], [])), SessionOutcome::Completed);
    let events = lab.events();
    let switches: Vec<_> = events
        .iter()
        .filter(|event| matches!(event.kind, EventKind::LaserOn | EventKind::LaserOff))
        .map(|event| event.message.as_str())
        .collect();
    assert_eq!(
        switches,
        [
            "laser off, read back as off (start of session)",
            "laser on (step 1)",
            "laser off, read back as off (step 2)",
            "laser off, read back as off (end of session)",
        ]
    );
}

#[test]
fn the_laser_is_off_before_the_first_step_and_after_the_last() {
    let lab = Lab::new();
    lab.outcome(&plan([laser_on()], []));
    assert_eq!(lab.log.lines(), ["laser off", "laser emit", "stored 1", "laser off", "closed"]);
}

/// A laser with `fault` is reported as unknown, for `doubt`, and nothing is run with it.
#[track_caller]
fn check_unknown(fault: Fault, doubt: &str) {
    let lab = Lab::with_fault("laser", fault);
    let summary = lab.run(&plan([laser_on()], [])).unwrap();
    assert_eq!((summary.outcome, summary.lasers), (SessionOutcome::Error, Lasers::Unknown));
    let events = lab.events();
    let unknown = events.iter().find(|event| event.kind == EventKind::LaserUnknown).unwrap();
    let message = format!("laser unknown, assume on: {doubt} (start of session)");
    assert_eq!(unknown.message, message);
    assert!(!lab.log.has("laser emit"));
    assert!(lab.log.has("laser off without waiting"));
    assert!(!lab.kinds().contains(&EventKind::LaserOff));
}

#[test]
fn a_laser_that_does_not_confirm_off_is_unknown_and_an_error() {
    check_unknown(Fault::OffFails, "\"off\" failed: the connection is lost: no cable");
    check_unknown(Fault::OffHangs, "it did not answer \"off\" within 5s");
    check_unknown(Fault::Unreadable, "its emission cannot be read back");
    check_unknown(Fault::StaysOn, "it reads back as on");
}

#[test]
fn a_laser_that_does_not_light_up_is_unknown_and_switched_off() {
    let lab = Lab::with_fault("laser", Fault::Hangs);
    assert_eq!(lab.outcome(&plan([laser_on()], [])), SessionOutcome::Error);
    let kinds: Vec<_> = lab.record(1).events.iter().map(|event| event.kind).rev().collect();
    let expected = [EventKind::LaserOff, EventKind::StepFailed, EventKind::LaserUnknown];
    assert_eq!(kinds[..3], expected);
    assert!(matches!(lab.record(1).outcome, StepOutcome::Failed { .. }));
}

#[test]
fn a_panic_in_an_instrument_leaves_the_laser_off() {
    let lab = Lab::with_fault("wavemeter", Fault::Panics);
    let steps = plan([laser_on(), read("wavemeter")], []);
    let ran = catch_unwind(AssertUnwindSafe(|| lab.run(&steps)));
    assert!(ran.is_err());
    assert_eq!(lab.log.lines().last().unwrap(), "laser off without waiting");
}

#[test]
fn a_run_that_is_dropped_leaves_the_laser_off() {
    let mut lab = Lab::new();
    lab.dropped_after = Some(20);
    assert!(lab.try_run(&plan([laser_on(), wait(50.0)], [])).is_none());
    assert_eq!(lab.log.lines().last().unwrap(), "laser off without waiting");
}

#[test]
fn a_laser_whose_driver_panics_while_unwinding_does_not_keep_the_next_one_on() {
    let lab = Lab::with_fault("first", Fault::LastResortPanics);
    let bench = lab.lasers(["first", "second"]);
    let unwound = catch_unwind(AssertUnwindSafe(|| {
        let _guard = LaserGuard::armed(&bench);
        panic!("a driver fails");
    }));
    assert!(unwound.is_err());
    assert!(lab.log.has("second off without waiting"));
}

#[test]
fn a_completed_run_needs_no_last_resort() {
    let lab = Lab::new();
    lab.outcome(&plan([laser_on()], [laser_off()]));
    assert!(!lab.log.has("laser off without waiting"));
}
