//! How runs end otherwise than planned: failures, deadlines, aborts, a store that fails.

use beampose_core::{EventKind, SessionOutcome, StepNumber, StepOutcome};

use super::fakes::*;
use beampose_plan::Rules;

use crate::{Bench, Control, EngineError, Nobody, Observers, RealClock, Surroundings, Wish, run};

#[test]
fn a_failing_step_runs_finally_with_the_laser_off() {
    let lab = Lab::with_fault("wavemeter", Fault::Fails);
    let steps = plan([laser_on(), read("wavemeter"), capture("p000")], [rail(0.0)]);
    let summary = lab.run(&steps).unwrap();
    assert_eq!(summary.outcome, SessionOutcome::Error);
    assert_eq!(summary.failures.len(), 1);
    assert_eq!(summary.failures[0].reason, "wavemeter: hardware fault: out of order");
    assert_eq!(lab.stored(), [1, 2, 4]);
    let lines = lab.log.lines();
    let failed = lab.log.place("wavemeter read");
    let rest = ["laser off", "stored 2", "rail to 0", "stored 4", "laser off", "closed"];
    assert_eq!(lines[failed + 1..], rest);
}

#[test]
fn finally_runs_each_step_although_one_fails() {
    let lab = Lab::with_fault("wavemeter", Fault::Fails);
    let steps = plan([wait(1.0)], [read("wavemeter"), rail(0.0), read("wavemeter"), stage(0.0)]);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Error);
    assert_eq!(lab.stored(), [1, 2, 3, 4, 5]);
}

#[test]
fn each_finally_step_has_a_deadline_of_its_own() {
    let lab = Lab::with_fault("rail", Fault::Hangs);
    let steps = plan([rail(10.0)], [rail(0.0), stage(0.0)]);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Error);
    assert_eq!(lab.stored(), [1, 2, 3]);
    assert_eq!(lab.seconds(), 60.0 + 60.0 + 3.0);
}

#[test]
fn a_hung_instrument_hits_its_deadline_and_is_named() {
    let lab = Lab::with_fault("rail", Fault::Hangs);
    assert_eq!(lab.outcome(&plan([laser_on(), rail(10.0)], [])), SessionOutcome::Error);
    let reason = "rail: no answer within 60s".to_owned();
    assert_eq!(lab.record(2).outcome, StepOutcome::Failed { reason });
    // Light goes off before the axis is stopped.
    let lines = lab.log.lines();
    let moved = lab.log.place("rail to 10");
    assert_eq!(lines[moved + 1..moved + 4], ["laser off", "rail stop", "stored 2"]);
}

#[test]
fn an_abort_in_the_middle_of_a_long_wait_ends_it_at_once() {
    let mut lab = Lab::new();
    lab.wishes = vec![(100, Wish::Abort)];
    let mut steps = plan([laser_on(), wait(5000.0), capture("p000")], [rail(0.0)]);
    steps[1].deadline = beampose_core::units::Second(6000.0);
    let summary = lab.run(&steps).unwrap();
    assert_eq!(summary.outcome, SessionOutcome::Aborted);
    assert_eq!(summary.abort_reason.as_deref(), Some("Ctrl-C"));
    assert!(summary.failures.is_empty());
    assert_eq!(lab.stored(), [1, 2, 4]);
    let reason = "interrupted: Ctrl-C".to_owned();
    assert_eq!(lab.record(2).outcome, StepOutcome::Failed { reason });
    assert_eq!(lab.record(2).finished.monotonic.as_secs(), 100);
    let asked = lab.record(2).events.into_iter().map(|event| (event.kind, event.message));
    let off = "laser off, read back as off (abort: Ctrl-C)".to_owned();
    assert_eq!(
        asked.collect::<Vec<_>>(),
        [(EventKind::AbortRequested, "Ctrl-C".to_owned()), (EventKind::LaserOff, off),]
    );
}

#[test]
fn an_abort_during_the_emission_delay_switches_off() {
    let mut lab = Lab::new();
    lab.wishes = vec![(2, Wish::Abort)];
    assert_eq!(lab.outcome(&plan([laser_on(), capture("p000")], [])), SessionOutcome::Aborted);
    assert_eq!(lab.seconds(), 2.0);
    let emit = lab.log.place("laser emit");
    assert_eq!(lab.log.lines()[emit + 1], "laser off");
}

#[test]
fn an_abort_during_a_move_switches_off_then_stops_the_axis() {
    let mut lab = Lab::new();
    lab.wishes = vec![(1, Wish::Abort)];
    assert_eq!(lab.outcome(&plan([rail(10.0)], [])), SessionOutcome::Aborted);
    let moved = lab.log.place("rail to 10");
    assert_eq!(lab.log.lines()[moved + 1..moved + 3], ["laser off", "rail stop"]);
}

#[test]
fn an_abort_during_a_capture_keeps_the_capture() {
    let mut lab = Lab::new();
    lab.wishes = vec![(1, Wish::Abort)];
    let steps = plan([capture("p000"), capture("p001")], []);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Aborted);
    assert_eq!(lab.stored(), [1]);
    assert_eq!(lab.record(1).outcome, StepOutcome::Done);
}

#[test]
fn an_abort_before_the_start_runs_no_main_step() {
    let lab = Lab::new();
    lab.control.request(Wish::Abort, "supervisor");
    assert_eq!(lab.outcome(&plan([rail(10.0)], [rail(0.0)])), SessionOutcome::Aborted);
    assert_eq!(lab.stored(), [2]);
}

#[test]
fn finally_is_not_cut_short_by_an_abort() {
    let mut lab = Lab::new();
    lab.wishes = vec![(5, Wish::Abort)];
    let steps = plan([wait(1.0)], [wait(30.0), rail(0.0)]);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Completed);
    assert_eq!(lab.seconds(), 34.0);
}

#[test]
fn a_store_that_fails_switches_the_laser_off_and_ends_the_session() {
    let mut lab = Lab::new();
    lab.sink.fails_at = Some(2);
    let steps = plan([laser_on(), capture("p000"), capture("p001")], [rail(0.0)]);
    let error = lab.run(&steps).unwrap_err();
    let EngineError::NotStored { steps, summary, source } = error else { panic!("{error}") };
    assert_eq!(steps, [StepNumber(2)]);
    assert_eq!(source.reason, "disk full");
    assert_eq!(summary.outcome, SessionOutcome::Error);
    assert_eq!(summary.captures, 0);
    let stored = lab.log.place("stored 2");
    let rest = ["laser off", "rail to 0", "stored 4", "laser off", "closed"];
    assert_eq!(lab.log.lines()[stored + 1..], rest);
    let told = lab.events().iter().any(|event| event.message.contains("disk full"));
    assert!(told, "the journal tells of it");
}

#[test]
fn a_session_that_cannot_be_opened_touches_nothing_but_the_lasers() {
    let mut lab = Lab::new();
    lab.sink.fails_at = Some(0);
    let error = lab.run(&plan([rail(10.0)], [rail(0.0)])).unwrap_err();
    assert!(matches!(error, EngineError::NotOpened(_)));
    assert_eq!(lab.log.lines(), ["laser off without waiting"]);
}

#[test]
fn a_session_that_cannot_be_closed_is_an_error_with_the_summary() {
    let mut lab = Lab::new();
    lab.sink.fails_at = Some(u32::MAX);
    let error = lab.run(&plan([rail(10.0)], [])).unwrap_err();
    let EngineError::NotClosed { summary, .. } = error else { panic!("{error}") };
    assert_eq!(summary.steps_done, 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_abort_from_another_thread_ends_a_wait_in_real_time() {
    let (bench, sink, observers) = (Bench::default(), Memory::default(), Observers::none());
    let (clock, control, rules) = (RealClock::start(), Control::new(), Rules::default());
    let around = Surroundings {
        bench: &bench,
        sink: &sink,
        observers: &observers,
        clock: &clock,
        control: &control,
        operator: &Nobody,
        rules: &rules,
        store_patience: std::time::Duration::ZERO,
    };
    let elsewhere = control.clone();
    std::thread::spawn(move || {
        std::thread::sleep(std::time::Duration::from_millis(50));
        elsewhere.request(Wish::Abort, "Ctrl-C");
    });
    let steps = plan([wait(50.0)], []);
    let summary = run(&steps, &header(&steps), &around).await.unwrap();
    assert_eq!(summary.outcome, SessionOutcome::Aborted);
    assert!(summary.closed.monotonic.as_secs() < 50);
}
