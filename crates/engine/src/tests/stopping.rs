//! The ways to stop, each with its outcome, and a store that does not take what it is given.

use std::thread::JoinHandle;
use std::time::Duration;

use beampose_core::{EventKind, SessionOutcome, StepOutcome};
use beampose_plan::{OnError, Policy};

use super::fakes::*;
use crate::{Control, EngineError, Wish};

/// Somebody who decides, a little after a wish was heard of. A virtual clock stands still while
/// somebody decides, so this takes a thread of its own.
pub(super) fn decide(
    lab: &Lab,
    decision: impl FnOnce(&Control) + Send + 'static,
) -> JoinHandle<()> {
    let control = lab.control.clone();
    std::thread::spawn(move || {
        while control.wish().is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
        std::thread::sleep(Duration::from_millis(30));
        decision(&control);
    })
}

#[test]
fn a_pause_comes_at_the_next_checkpoint_and_the_laser_is_on_again_after_it() {
    let mut lab = Lab::new();
    // Asked for within the wait, which is not broken off.
    lab.wishes = vec![(8, Wish::Pause)];
    let operator = decide(&lab, |control| control.go_on());
    let steps = plan([laser_on(), wait(10.0), rail(1.0), capture("p000")], []);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Completed);
    operator.join().unwrap();
    let lines = lab.log.lines();
    let waited = lab.log.place("stored 2");
    assert_eq!(lines[waited + 1..waited + 4], ["laser off", "laser emit", "rail to 1"]);
    let kinds: Vec<EventKind> = lab.record(3).events.iter().map(|event| event.kind).collect();
    assert_eq!(
        kinds,
        [
            EventKind::AbortRequested,
            EventKind::LaserOff,
            EventKind::Paused,
            EventKind::Continued,
            EventKind::LaserOn,
            EventKind::Resumed,
            // The wait after the laser was switched on is waited again.
            EventKind::Resumed,
            EventKind::Moved
        ]
    );
}

#[test]
fn pause_now_breaks_a_wait_off_and_waits_it_anew() {
    let mut lab = Lab::new();
    lab.wishes = vec![(20, Wish::PauseNow)];
    let operator = decide(&lab, |control| control.go_on());
    let mut steps = plan([wait(50.0), rail(1.0)], []);
    steps[0].deadline = beampose_core::units::Second(100.0);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Completed);
    operator.join().unwrap();
    assert_eq!(lab.stored(), [1, 2]);
    assert_eq!(lab.record(1).outcome, StepOutcome::Done);
    assert_eq!(lab.record(1).finished.monotonic.as_secs(), 70);
}

#[test]
fn each_way_to_stop_has_its_own_outcome() {
    for (wish, outcome, stored) in [
        (Wish::Stop, SessionOutcome::Stopped, vec![1, 2, 4]),
        (Wish::Abort, SessionOutcome::Aborted, vec![1, 2, 4]),
        (Wish::Halt, SessionOutcome::Halted, vec![1, 2]),
    ] {
        let mut lab = Lab::new();
        lab.wishes = vec![(20, wish)];
        let steps = plan([laser_on(), wait(50.0), rail(1.0)], [rail(0.0)]);
        assert_eq!(lab.outcome(&steps), outcome);
        assert_eq!(lab.stored(), stored, "{wish:?}");
        assert_eq!(lab.run_ended_dark(), Some(true), "{wish:?}");
    }
}

#[test]
fn a_stop_finishes_the_capture_under_way() {
    let mut lab = Lab::new();
    lab.wishes = vec![(1, Wish::Stop)];
    let steps = plan([capture("p000"), capture("p001")], [rail(0.0)]);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Stopped);
    assert_eq!(lab.stored(), [1, 3]);
    assert_eq!(lab.record(1).outcome, StepOutcome::Done);
}

#[test]
fn a_halt_breaks_finally_off() {
    let mut lab = Lab::new();
    lab.wishes = vec![(10, Wish::Halt)];
    let steps = plan([rail(1.0)], [wait(30.0), rail(0.0)]);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Halted);
    assert!(!lab.log.has("rail to 0"));
    assert_eq!(lab.seconds(), 10.0);
}

#[test]
fn a_pause_is_ended_by_a_stop_as_well() {
    let mut lab = Lab::new();
    lab.wishes = vec![(1, Wish::Pause)];
    let operator = decide(&lab, |control| control.request(Wish::Stop, "operator"));
    let steps = plan([rail(1.0), rail(2.0)], [rail(0.0)]);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Stopped);
    operator.join().unwrap();
    assert_eq!(lab.stored(), [1, 3]);
}

#[test]
fn a_step_that_pauses_on_an_error_is_tried_again_when_the_run_goes_on() {
    let lab = Lab::with_fault("wavemeter", Fault::FailsAtFirst(1));
    let operator = decide(&lab, |control| control.go_on());
    let mut steps = plan([laser_on(), read("wavemeter")], []);
    steps[1].policy = Policy { on_error: OnError::Pause, ..Policy::default() };
    assert_eq!(lab.outcome(&steps), SessionOutcome::Completed);
    operator.join().unwrap();
    let record = lab.record(2);
    assert_eq!(record.outcome, StepOutcome::Done);
    let failed = record.events.iter().find(|event| event.kind == EventKind::StepFailed).unwrap();
    assert_eq!(
        failed.message,
        "step 2, pass 2, read wavemeter: wavemeter: hardware fault: out of order"
    );
    let lines = lab.log.lines();
    let read = lab.log.place("wavemeter read");
    assert_eq!(lines[read + 1..read + 4], ["laser off", "laser emit", "wavemeter read"]);
}

#[test]
fn a_store_that_works_again_gets_what_it_did_not_take_and_the_run_goes_on() {
    let mut lab = Lab::new();
    lab.sink.fails_at = Some(2);
    lab.sink.recovers_after = Some(4);
    lab.store_patience = Duration::from_secs(600);
    let steps = plan([laser_on(), capture("p000"), capture("p001")], [rail(0.0)]);
    let summary = lab.run(&steps).unwrap();
    assert_eq!(summary.outcome, SessionOutcome::Completed);
    assert_eq!((summary.captures, summary.unstored.len()), (2, 0));
    assert_eq!(lab.stored(), [1, 2, 3, 4]);
    assert_eq!(lab.record(2).capture.unwrap().pictures.len(), 2);
    let told: Vec<_> =
        lab.record(2).events.into_iter().filter(|e| e.kind == EventKind::StoreFailed).collect();
    assert_eq!(told.len(), 1);
    // Dark while it waits, lit again before the next capture.
    let (first, next) = (lab.log.place("stored 2"), lab.log.place("stored 3"));
    let between: Vec<_> =
        lab.log.lines()[first..next].iter().filter(|l| l.starts_with("laser")).cloned().collect();
    assert_eq!(between, ["laser off", "laser emit"]);
}

#[test]
fn what_the_store_never_took_is_handed_back() {
    let mut lab = Lab::new();
    lab.sink.fails_at = Some(1);
    lab.store_patience = Duration::from_secs(600);
    let error = lab.run(&plan([capture("p000"), rail(1.0)], [rail(0.0)])).unwrap_err();
    let EngineError::NotStored { summary, .. } = error else { panic!("{error}") };
    assert_eq!(summary.unstored.len(), 1);
    assert_eq!(summary.unstored[0].capture.as_ref().unwrap().pictures.len(), 2);
    assert!((600.0..700.0).contains(&lab.seconds()), "{}", lab.seconds());
    assert!(!lab.log.has("rail to 1"));
    assert!(lab.log.has("rail to 0"));
}
