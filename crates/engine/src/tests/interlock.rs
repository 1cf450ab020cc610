//! A contact that opens while a laser is on: light goes out within a step, and stays out.

use std::time::Duration;

use beampose_core::units::Second;
use beampose_core::{EventKind, SessionOutcome, StepOutcome, StepRecord};
use beampose_plan::policy::{Condition, Holds, Retry};
use beampose_plan::{Action, OnError, Policy};

use super::fakes::*;
use super::stopping::decide;

const WHY: &str = "laser: its interlock was open while it was on";

/// Open from ten seconds on, which is in the middle of a step: light came after five.
fn opening(until: u64) -> Lab {
    Lab::with_fault("laser", Fault::InterlockOpen(10, until))
}

/// When it was found, in seconds.
fn found(lab: &Lab) -> f64 {
    let events = lab.events();
    let tripped = events.iter().find(|it| it.kind == EventKind::InterlockTripped).unwrap();
    assert_eq!(tripped.message, WHY);
    tripped.at.monotonic.as_secs_f64()
}

/// The step after `laser_on` is broken off and light is out within half a second of ten.
#[track_caller]
fn check_broken_off(action: Action, before: &[Action]) {
    let lab = opening(1000);
    let first = [laser_on()].into_iter().chain(before.iter().cloned());
    let steps = plan(first.chain([action, rail(2.0)]), [rail(0.0)]);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Error);
    let number = before.len() as u32 + 2;
    let broken = lab.record(number);
    assert_eq!(broken.outcome, StepOutcome::Failed { reason: WHY.to_owned() });
    assert!((10.0..10.5).contains(&found(&lab)), "{}", found(&lab));
    assert!(broken.finished.monotonic < Duration::from_millis(10_500));
    let out = lab.log.place("laser off without waiting");
    assert!(out < lab.log.place(&format!("stored {number}")));
    // `finally` runs, the next step does not, and nothing lights it again.
    assert_eq!(lab.stored(), (1..=number).chain([number + 2]).collect::<Vec<_>>());
    assert_eq!(lab.log.lines().iter().filter(|line| *line == "laser emit").count(), 1);
}

#[test]
fn light_goes_out_within_a_wait_a_move_a_reading_and_a_capture() {
    check_broken_off(wait(50.0), &[]);
    check_broken_off(rail(1.0), &[wait(4.0)]);
    check_broken_off(read("wavemeter"), &[wait(4.5)]);
    check_broken_off(capture("p000"), &[wait(4.0)]);
}

#[test]
fn an_axis_is_stopped_and_cameras_are_disarmed_behind_it() {
    let lab = opening(1000);
    lab.outcome(&plan([laser_on(), wait(4.0), rail(1.0)], []));
    assert!(lab.log.place("laser off without waiting") < lab.log.place("rail stop"));
}

#[test]
fn neither_a_retry_nor_passing_over_brings_light_back() {
    for on_error in [OnError::Abort, OnError::Skip, OnError::RecordMissing] {
        let lab = opening(12);
        let mut steps = plan([laser_on(), wait(50.0), capture("p000")], []);
        let retry = Some(Retry { times: 5, backoff: Second(5.0) });
        steps[1].policy = Policy { retry, on_error, ..Policy::default() };
        assert_eq!(lab.outcome(&steps), SessionOutcome::Error);
        assert!(!lab.log.has("cam_a arm"), "{on_error:?}");
        assert_eq!(lab.run_ended_dark(), Some(true));
    }
}

#[test]
fn where_the_plan_waits_for_the_contact_the_step_is_done_anew() {
    let mut lab = opening(60);
    lab.rules.conditions = vec![Condition {
        what: Holds::Interlock { laser: "laser".into() },
        hold_for: Second(3.0),
        settle: Second(2.0),
        // Not looked at again of itself.
        every: Second(3600.0),
        give_up: Second(600.0),
    }];
    let mut steps = plan([laser_on(), wait(50.0), capture("p000")], []);
    steps[1].deadline = Second(100.0);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Completed);
    assert!((10.0..10.5).contains(&found(&lab)));
    let done = lab.record(2);
    // Closed at 60, held for 3, lit in 5, settled in 2, waited 50.
    assert_eq!(done.finished.monotonic.as_secs(), 120);
    let kinds: Vec<_> = done.events.iter().map(|event| event.kind).collect();
    let place = |kind| kinds.iter().position(|it| *it == kind).unwrap();
    assert!(place(EventKind::InterlockTripped) < place(EventKind::Suspended));
    assert!(place(EventKind::Suspended) < place(EventKind::LaserOn));
    assert!(place(EventKind::LaserOn) < place(EventKind::Released));
}

#[test]
fn a_contact_that_opens_again_and_again_ends_the_run() {
    let mut lab = Lab::with_fault("laser", Fault::InterlockFlutters);
    lab.rules.conditions = vec![Condition {
        what: Holds::Interlock { laser: "laser".into() },
        hold_for: Second(0.0),
        settle: Second(0.0),
        every: Second(3600.0),
        give_up: Second(600.0),
    }];
    assert_eq!(lab.outcome(&plan([laser_on(), wait(50.0)], [])), SessionOutcome::Error);
    // At first, three times within the step.
    assert_eq!(lab.log.lines().iter().filter(|line| *line == "laser emit").count(), 4);
}

#[test]
fn where_the_step_pauses_on_errors_a_person_lets_light_come_back() {
    let lab = opening(12);
    let operator = decide(&lab, |control| control.go_on());
    let mut steps = plan([laser_on(), wait(20.0), capture("p000")], []);
    steps[1].policy = Policy { on_error: OnError::Pause, ..Policy::default() };
    assert_eq!(lab.outcome(&steps), SessionOutcome::Completed);
    operator.join().unwrap();
    let kinds: Vec<_> = lab.record(2).events.iter().map(|event| event.kind).collect();
    let place = |kind| kinds.iter().position(|it| *it == kind).unwrap();
    assert!(place(EventKind::InterlockTripped) < place(EventKind::Paused));
    assert!(place(EventKind::Continued) < place(EventKind::LaserOn));
}

#[test]
fn in_finally_the_step_fails_and_the_others_run() {
    let lab = opening(1000);
    let steps = plan([], [laser_on(), wait(50.0), laser_off(), rail(0.0)]);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Error);
    assert_eq!(lab.stored(), [1, 2, 3, 4]);
    assert_eq!(lab.record(3).outcome, StepOutcome::Done);
}

#[test]
fn it_is_looked_at_twice_a_second_while_light_is_on_and_not_before_or_after() {
    let lab = Lab::new();
    lab.outcome(&plan([wait(30.0), laser_on(), wait(50.0), laser_off(), wait(30.0)], []));
    let looks = lab.looks.load(std::sync::atomic::Ordering::Relaxed);
    assert!((100..140).contains(&looks), "{looks}");
}

#[test]
fn a_contact_that_does_not_answer_counts_as_open() {
    let lab = Lab::with_fault("laser", Fault::ContactHangs);
    assert_eq!(lab.outcome(&plan([laser_on(), wait(50.0)], [])), SessionOutcome::Error);
    let reason = "laser: its interlock did not answer within 2s while it was on".to_owned();
    assert_eq!(lab.record(2).outcome, StepOutcome::Failed { reason });
    assert!(lab.seconds() < 8.0, "{}", lab.seconds());
}

#[test]
fn looking_changes_nothing_that_is_stored() {
    let records = |fault: Fault| -> Vec<StepRecord> {
        let lab = Lab::with_fault("laser", fault);
        let acquires = [rail(1.5), read("wavemeter"), capture("p000"), wait(7.3)];
        let main = [laser_on()].into_iter().chain(acquires).chain([laser_off(), stage(3.0)]);
        assert_eq!(lab.outcome(&plan(main, [rail(0.0)])), SessionOutcome::Completed);
        let watched = lab.looks.load(std::sync::atomic::Ordering::Relaxed) > 0;
        assert_eq!(watched, fault == Fault::None);
        let mut records = lab.sink.records.lock().unwrap().clone();
        // It says the session's number.
        records[0].events.remove(0);
        records
    };
    assert_eq!(records(Fault::None), records(Fault::NoContact));
}
