//! What the plan says of errors, limits, conditions and people.

use async_trait::async_trait;
use beampose_core::units::Second;
use beampose_core::{EventKind, Quantity, SessionOutcome, StepOutcome};
use beampose_plan::policy::{Asks, Band, Bound, Condition, Holds, Remedy, Retry, RunIf};
use beampose_plan::{Action, OnError, Policy, Step};

use super::fakes::*;
use crate::{Operator, Question};

fn with(mut steps: Vec<Step>, number: usize, policy: Policy) -> Vec<Step> {
    steps[number - 1].policy = policy;
    steps
}

fn retries(times: u32, on_error: OnError) -> Policy {
    let retry = Some(Retry { times, backoff: Second(2.0) });
    Policy { retry, on_error, ..Policy::default() }
}

fn wavelength(above: f64, below: f64) -> Band {
    Band {
        instrument: "wavemeter".into(),
        quantity: Quantity::Wavelength,
        above: Some(above),
        below: Some(below),
    }
}

#[test]
fn a_step_is_tried_again_and_each_pause_is_twice_the_one_before() {
    let lab = Lab::with_fault("wavemeter", Fault::FailsAtFirst(2));
    let steps = with(plan([laser_on(), read("wavemeter")], []), 2, retries(2, OnError::Abort));
    assert_eq!(lab.outcome(&steps), SessionOutcome::Completed);
    let record = lab.record(2);
    assert_eq!(record.outcome, StepOutcome::Done);
    let retried: Vec<_> = record.events.iter().filter(|e| e.kind == EventKind::Retried).collect();
    assert_eq!(retried.len(), 2);
    assert!(
        retried[0].message.ends_with("wavemeter: hardware fault: out of order; try 2 of 3 in 2 s")
    );
    // 5 s of emission, 2 s and 4 s of backoff, 1 s of reading.
    assert_eq!(lab.seconds(), 12.0);
    // The light stayed on: only the session's own beginning and end switch it off.
    assert_eq!(lab.log.lines().iter().filter(|line| *line == "laser off").count(), 2);
}

#[test]
fn what_no_retry_mends_aborts_the_run() {
    let lab = Lab::with_fault("wavemeter", Fault::Fails);
    let steps =
        with(plan([read("wavemeter"), rail(1.0)], [rail(0.0)]), 1, retries(3, OnError::Abort));
    assert_eq!(lab.outcome(&steps), SessionOutcome::Error);
    assert_eq!(lab.stored(), [1, 3]);
    assert_eq!(lab.log.lines().iter().filter(|line| *line == "wavemeter read").count(), 4);
}

#[test]
fn what_helps_is_done_before_each_retry() {
    let lab = Lab::with_fault("wavemeter", Fault::FailsAtFirst(1));
    let remedies = [stage(5.0), stage(0.0)];
    let recover = remedies.map(|action| Remedy { action, deadline: Second(60.0) }).to_vec();
    let policy = Policy { recover, ..retries(1, OnError::Abort) };
    lab.outcome(&with(plan([read("wavemeter")], []), 1, policy));
    let lines = lab.log.lines();
    let first = lab.log.place("wavemeter read");
    assert_eq!(lines[first + 1..first + 4], ["stage to 5", "stage to 0", "wavemeter read"]);
}

#[test]
fn an_axis_that_failed_is_stopped_before_it_is_tried_again() {
    let lab = Lab::with_fault("rail", Fault::FailsAtFirst(1));
    assert_eq!(
        lab.outcome(&with(plan([rail(10.0)], []), 1, retries(1, OnError::Abort))),
        SessionOutcome::Completed
    );
    let first = lab.log.place("rail to 10");
    assert_eq!(lab.log.lines()[first + 1..first + 3], ["rail stop", "rail to 10"]);
}

#[test]
fn a_laser_that_failed_is_off_before_it_is_tried_again() {
    let lab = Lab::with_fault("laser", Fault::FailsAtFirst(1));
    let steps = with(plan([laser_on()], []), 1, retries(1, OnError::Abort));
    assert_eq!(lab.outcome(&steps), SessionOutcome::Completed);
    let first = lab.log.place("laser emit");
    assert_eq!(lab.log.lines()[first + 1..first + 3], ["laser off", "laser emit"]);
}

#[test]
fn no_policy_goes_on_with_a_laser_that_may_be_on() {
    let lab = Lab::with_fault("laser", Fault::Unreadable);
    let mut steps = plan([laser_on(), rail(1.0)], []);
    steps = with(steps, 1, retries(5, OnError::Skip));
    assert_eq!(lab.outcome(&steps), SessionOutcome::Error);
    assert!(!lab.log.has("rail to 1"));
}

#[test]
fn a_step_that_is_passed_over_says_why_and_the_run_goes_on() {
    let lab = Lab::with_fault("wavemeter", Fault::Fails);
    let policy = Policy { on_error: OnError::Skip, ..Policy::default() };
    let steps = with(plan([read("wavemeter"), rail(1.0)], []), 1, policy);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Completed);
    let reason = "wavemeter: hardware fault: out of order".to_owned();
    assert_eq!(lab.record(1).outcome, StepOutcome::PassedOver { reason });
    assert_eq!(lab.stored(), [1, 2]);
}

#[test]
fn a_missing_value_is_a_fact_beside_those_that_were_read() {
    let lab = Lab::with_fault("wavemeter", Fault::Fails);
    let both = Action::Read { instruments: vec!["wavemeter".into(), "thermometer".into()] };
    let policy = Policy { on_error: OnError::RecordMissing, ..Policy::default() };
    assert_eq!(lab.outcome(&with(plan([both], []), 1, policy)), SessionOutcome::Completed);
    let record = lab.record(1);
    assert_eq!(record.outcome, StepOutcome::Done);
    assert_eq!(record.readings.len(), 1);
    let missing: Vec<_> =
        record.missing.iter().map(|m| (m.instrument.as_str(), m.reason.as_str())).collect();
    assert_eq!(missing, [("wavemeter", "hardware fault: out of order")]);
}

#[test]
fn an_instrument_that_hangs_leaves_the_others_their_time() {
    let lab = Lab::with_fault("wavemeter", Fault::Hangs);
    let both = Action::Read { instruments: vec!["wavemeter".into(), "thermometer".into()] };
    let policy = Policy { on_error: OnError::RecordMissing, ..Policy::default() };
    lab.outcome(&with(plan([both], []), 1, policy));
    assert_eq!(lab.record(1).readings.len(), 1);
    assert_eq!(lab.record(1).missing[0].reason, "no answer within 30s");
}

#[test]
fn a_camera_may_be_missing_in_a_capture() {
    let lab = Lab::with_fault("cam_b", Fault::Fails);
    let policy = Policy { on_error: OnError::RecordMissing, ..Policy::default() };
    let steps = with(plan([capture("p000")], []), 1, policy);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Completed);
    let record = lab.record(1);
    assert_eq!(record.capture.unwrap().pictures.len(), 1);
    assert_eq!(record.missing[0].instrument.as_str(), "cam_b");
}

#[test]
fn a_capture_whose_triggers_were_too_far_apart_is_taken_again() {
    let lab = Lab::with_fault("cam_b", Fault::TriggersLate(2));
    assert_eq!(lab.outcome(&plan([capture("p000")], [])), SessionOutcome::Completed);
    let record = lab.record(1);
    let again: Vec<_> = record.events.iter().filter(|e| e.kind == EventKind::Retried).collect();
    assert_eq!(again.len(), 2);
    let message = "p000: triggers went out 80ms apart, more than 50ms: taken again";
    assert_eq!(again[0].message, message);
    let pictures = record.capture.unwrap().pictures;
    assert_eq!(pictures[0].requested, pictures[1].requested);
}

#[test]
fn cameras_that_are_never_together_fail_the_step() {
    let lab = Lab::with_fault("cam_b", Fault::TriggersLate(9));
    assert_eq!(lab.outcome(&plan([capture("p000")], [])), SessionOutcome::Error);
    let reason = "the cameras were triggered 80ms apart, more than 50ms, 3 times".to_owned();
    assert_eq!(lab.record(1).outcome, StepOutcome::Failed { reason });
}

#[test]
fn cameras_that_were_armed_for_nothing_are_disarmed_last() {
    let lab = Lab::with_fault("cam_b", Fault::Hangs);
    lab.outcome(&plan([laser_on(), capture("p000")], []));
    let lines = lab.log.lines();
    let triggered = lab.log.place("cam_b trigger");
    assert_eq!(lines[triggered + 1..triggered + 4], ["laser off", "cam_b disarm", "stored 2"]);
}

#[test]
fn a_reading_outside_its_limits_is_kept_and_told() {
    let lab = Lab::new();
    let policy = Policy { accept: vec![wavelength(657.0, 658.0)], ..Policy::default() };
    let steps = with(plan([read("wavemeter")], []), 1, policy);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Completed);
    let record = lab.record(1);
    assert_eq!(record.readings.len(), 1);
    let told = record.events.iter().find(|e| e.kind == EventKind::OutOfLimits).unwrap();
    let message = "wavemeter read 658.02 nm; accepted is wavemeter between 657 and 658 nm (step 1)";
    assert_eq!(told.message, message);
}

#[test]
fn a_step_runs_only_if_the_last_reading_is_so() {
    let lab = Lab::new();
    let only = |band| Policy { run_if: vec![RunIf::Reading(band)], ..Policy::default() };
    let steps = plan([read("wavemeter"), rail(1.0), rail(2.0)], []);
    let steps = with(steps, 2, only(wavelength(658.0, 659.0)));
    let steps = with(steps, 3, only(wavelength(650.0, 651.0)));
    assert_eq!(lab.outcome(&steps), SessionOutcome::Completed);
    assert!(lab.log.has("rail to 1") && !lab.log.has("rail to 2"));
    assert_eq!(lab.record(3).outcome, StepOutcome::Skipped);
}

#[test]
fn a_block_that_takes_too_long_fails_at_the_step_in_which_its_time_ends() {
    let lab = Lab::new();
    let block =
        Policy { within: vec![Bound { block: 1, timeout: Second(50.0) }], ..Policy::default() };
    let mut steps = plan([wait(30.0), wait(30.0), rail(1.0)], []);
    for step in &mut steps {
        step.policy = block.clone();
    }
    assert_eq!(lab.outcome(&steps), SessionOutcome::Error);
    assert_eq!(lab.record(2).finished.monotonic.as_secs(), 50);
    assert!(!lab.log.has("rail to 1"));
}

fn condition(what: Holds) -> Condition {
    Condition {
        what,
        hold_for: Second(5.0),
        settle: Second(7.0),
        every: Second(2.0),
        give_up: Second(300.0),
    }
}

#[test]
fn a_run_waits_until_a_condition_holds_long_enough_and_what_relies_on_it_settled() {
    let mut lab = Lab::with_fault("wavemeter", Fault::ReadsHigh(10, 40));
    lab.rules.conditions = vec![condition(Holds::Reading(wavelength(657.5, 658.5)))];
    let steps = plan([laser_on(), wait(10.0), rail(1.0), rail(2.0)], []);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Completed);
    let record = lab.record(3);
    let kinds: Vec<EventKind> = record.events.iter().map(|event| event.kind).collect();
    assert_eq!(kinds, [EventKind::Suspended, EventKind::Released, EventKind::Moved]);
    let why = "waiting for wavemeter between 657.5 and 658.5 nm: wavemeter reads 659.02 nm";
    assert_eq!(record.events[0].message, why);
    let released = record.events[1].at.monotonic.as_secs();
    assert!((40 + 5 + 7..40 + 5 + 7 + 8).contains(&released), "{released}");
    assert!(
        !lab.log.lines()[lab.log.place("laser emit")..].iter().take(20).any(|l| l == "laser off")
    );
}

#[test]
fn a_wavelength_is_not_asked_for_in_the_dark() {
    let mut lab = Lab::with_fault("wavemeter", Fault::ReadsHigh(0, 1_000_000));
    lab.rules.conditions = vec![condition(Holds::Reading(wavelength(657.5, 658.5)))];
    assert_eq!(lab.outcome(&plan([rail(1.0)], [])), SessionOutcome::Completed);
}

#[test]
fn a_condition_that_never_holds_is_given_up_and_finally_runs() {
    let mut lab = Lab::with_fault("wavemeter", Fault::ReadsHigh(0, 1_000_000));
    lab.rules.conditions = vec![condition(Holds::Reading(wavelength(657.5, 658.5)))];
    let steps = plan([laser_on(), capture("p000")], [rail(0.0)]);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Error);
    let reason = "a condition did not hold within 300s: wavemeter reads 659.02 nm".to_owned();
    assert_eq!(lab.record(2).outcome, StepOutcome::Failed { reason });
    assert_eq!(lab.stored(), [1, 2, 3]);
}

#[test]
fn while_an_interlock_is_open_nothing_is_lit() {
    let mut lab = Lab::with_fault("laser", Fault::InterlockOpen(0, 60));
    lab.rules.conditions = vec![condition(Holds::Interlock { laser: "laser".into() })];
    let steps = plan([laser_on(), capture("p000")], []);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Completed);
    let lit = lab.log.place("laser emit");
    // At the start, when the run begins to wait, and when it goes on.
    assert_eq!(lab.log.lines()[..lit], ["laser off", "laser off", "laser off"]);
    assert!(lab.record(1).started.monotonic.as_secs() >= 60);
}

#[test]
fn a_stage_that_is_moved_by_hand_is_done_when_it_stands_there() {
    let lab = Lab::with_fault("rail", Fault::ByHand);
    let mut steps = plan([rail(10.0)], []);
    steps[0].deadline = Second(600.0);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Completed);
    assert!((60.0..64.0).contains(&lab.seconds()), "{}", lab.seconds());
    let asked = lab.record(1).events.into_iter().find(|e| e.kind == EventKind::Asked).unwrap();
    assert_eq!(asked.message, "rail: move to 10 mm by hand, within 0.05 mm");
}

#[test]
fn a_stage_that_nobody_moves_fails_at_its_deadline() {
    let lab = Lab::with_fault("rail", Fault::ByHand);
    assert_eq!(lab.outcome(&plan([rail(90.0)], [])), SessionOutcome::Error);
    assert_eq!(lab.seconds(), 60.0);
}

/// Gives these answers, one after another.
struct Answers(std::sync::Mutex<Vec<&'static str>>, bool);

#[async_trait]
impl Operator for Answers {
    async fn answer(&self, _: &Question) -> Option<(String, String)> {
        let mut left = self.0.lock().unwrap();
        (!left.is_empty()).then(|| (left.remove(0).to_owned(), "terminal".to_owned()))
    }

    fn is_person(&self) -> bool {
        self.1
    }
}

fn ask(default: Option<&str>) -> Action {
    Action::Prompt {
        name: "fixture".to_owned(),
        text: "Roll the module".to_owned(),
        asks: Asks::Choice(vec!["flat".to_owned(), "rolled".to_owned()]),
        default: default.map(str::to_owned),
    }
}

#[test]
fn a_person_is_asked_until_the_answer_is_one_and_steps_go_by_it() {
    let mut lab = Lab::new();
    lab.operator = Box::new(Answers(vec!["what?", "ROLLED"].into(), true));
    let steps = plan([ask(None), rail(1.0), rail(2.0)], []);
    let is = |is: &str| RunIf::Answer { name: "fixture".to_owned(), is: is.to_owned() };
    let steps = with(steps, 2, Policy { run_if: vec![is("rolled")], ..Policy::default() });
    let steps = with(steps, 3, Policy { run_if: vec![is("flat")], ..Policy::default() });
    assert_eq!(lab.outcome(&steps), SessionOutcome::Completed);
    let answer = lab.record(1).answer.unwrap();
    assert_eq!((answer.value.as_str(), answer.by.as_str()), ("rolled", "terminal"));
    assert!(lab.log.has("rail to 1") && !lab.log.has("rail to 2"));
}

#[test]
fn where_nobody_answers_the_default_stands_in_or_the_step_fails() {
    let lab = Lab::new();
    assert_eq!(lab.outcome(&plan([ask(Some("flat"))], [])), SessionOutcome::Completed);
    assert_eq!(lab.record(1).answer.unwrap().by, "default");
    let lab = Lab::new();
    assert_eq!(lab.outcome(&plan([ask(None)], [])), SessionOutcome::Error);
    let StepOutcome::Failed { reason } = lab.record(1).outcome else { panic!("it failed") };
    assert!(reason.contains("there is nobody to ask"), "{reason}");
}

#[test]
fn a_file_with_a_wrong_answer_is_not_asked_for_ever() {
    let mut lab = Lab::new();
    lab.operator = Box::new(Answers(vec!["what?"; 1000].into(), false));
    assert_eq!(lab.outcome(&plan([ask(None)], [])), SessionOutcome::Error);
    let StepOutcome::Failed { reason } = lab.record(1).outcome else { panic!("it failed") };
    assert_eq!(reason, "fixture: expected one of flat, rolled, found \"what?\" in the answers");
}
