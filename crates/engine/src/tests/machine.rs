//! The rules of a run, each as a conversation with the machine.

use beampose_core::SessionOutcome;
use beampose_plan::Section;

use crate::control::Wish;
use crate::machine::{Command, Input, Lasers, Machine};
use Command::{AwaitOperator, Close, Offer, Prepare, Restore, Run, Secure, Store};
use Input::{
    Begin, Continued, PreparationFailed, Prepared, Secured, StepDone, StepFailed, StepInterrupted,
    StoreFailed, Stored, Wished,
};
use SessionOutcome::{Aborted, Completed, Error, Halted, Stopped};
use Wish::{Abort, Halt, Pause, PauseNow, Stop};

const OFF: Input = Secured(Lasers::Off);
const UNKNOWN: Input = Secured(Lasers::Unknown);

/// Two main steps (0, 1) and two `finally` steps (2, 3).
#[track_caller]
fn check(conversation: &[(Input, Command)]) {
    let [main, finally] = [Section::Main, Section::Finally];
    let mut machine = Machine::new(&[main, main, finally, finally]);
    for (i, (input, command)) in conversation.iter().enumerate() {
        assert_eq!(machine.next(*input), *command, "line {i}: {input:?}");
    }
}

#[test]
fn steps_run_in_order_and_are_stored_one_by_one() {
    check(&[
        (Begin, Prepare),
        (Prepared, Run { step: 0 }),
        (StepDone, Store),
        (Stored, Run { step: 1 }),
        (StepDone, Store),
        (Stored, Run { step: 2 }),
        (StepDone, Store),
        (Stored, Run { step: 3 }),
        (StepDone, Store),
        (Stored, Secure),
        (OFF, Close(Completed)),
    ]);
}

#[test]
fn a_failed_step_is_made_safe_then_stored_then_finally_runs() {
    check(&[
        (Begin, Prepare),
        (Prepared, Run { step: 0 }),
        (StepFailed, Secure),
        (OFF, Store),
        (Stored, Run { step: 2 }),
        (StepDone, Store),
        (Stored, Run { step: 3 }),
        (StepDone, Store),
        (Stored, Secure),
        (OFF, Close(Error)),
    ]);
}

#[test]
fn every_finally_step_runs_although_one_fails() {
    check(&[
        (Begin, Prepare),
        (Prepared, Run { step: 0 }),
        (StepFailed, Secure),
        (OFF, Store),
        (Stored, Run { step: 2 }),
        (StepFailed, Secure),
        (OFF, Store),
        (Stored, Run { step: 3 }),
        (StepFailed, Secure),
        (OFF, Store),
        (Stored, Secure),
        (OFF, Close(Error)),
    ]);
}

#[test]
fn an_abort_between_steps_goes_to_finally() {
    check(&[
        (Begin, Prepare),
        (Prepared, Run { step: 0 }),
        (StepDone, Store),
        (Stored, Run { step: 1 }),
        (Wished(Abort), Secure),
        (OFF, Run { step: 2 }),
        (StepDone, Store),
        (Stored, Run { step: 3 }),
        (StepDone, Store),
        (Stored, Secure),
        (OFF, Close(Aborted)),
    ]);
}

#[test]
fn an_abort_within_a_step_keeps_what_it_acquired() {
    check(&[
        (Begin, Prepare),
        (Prepared, Run { step: 0 }),
        (StepInterrupted(Abort), Secure),
        (OFF, Store),
        (Stored, Run { step: 2 }),
    ]);
}

#[test]
fn an_abort_in_finally_skips_nothing_and_changes_no_outcome() {
    check(&[
        (Begin, Prepare),
        (Prepared, Run { step: 0 }),
        (StepDone, Store),
        (Stored, Run { step: 1 }),
        (StepDone, Store),
        (Stored, Run { step: 2 }),
        (Wished(Abort), Run { step: 2 }),
        (StepDone, Store),
        (Stored, Run { step: 3 }),
        (StepDone, Store),
        (Stored, Secure),
        (OFF, Close(Completed)),
    ]);
}

#[test]
fn what_cannot_be_stored_is_offered_again_with_everything_safe() {
    check(&[
        (Begin, Prepare),
        (Prepared, Run { step: 0 }),
        (StepDone, Store),
        (StoreFailed, Secure),
        (OFF, Offer),
        (Stored, Restore),
        (Prepared, Run { step: 1 }),
        (StepDone, Store),
        (StoreFailed, Secure),
        (OFF, Offer),
        // `finally` relies on nothing.
        (Stored, Run { step: 2 }),
    ]);
}

#[test]
fn what_is_given_up_ends_the_run_with_an_error() {
    check(&[
        (Begin, Prepare),
        (Prepared, Run { step: 0 }),
        (StepDone, Store),
        (StoreFailed, Secure),
        (OFF, Offer),
        (StoreFailed, Run { step: 2 }),
        (StepDone, Store),
        (StoreFailed, Secure),
        (OFF, Offer),
        (StoreFailed, Run { step: 3 }),
        (StepDone, Store),
        (Stored, Secure),
        (OFF, Close(Error)),
    ]);
}

#[test]
fn a_pause_is_safe_and_goes_on_with_the_step_that_it_came_before() {
    check(&[
        (Begin, Prepare),
        (Prepared, Run { step: 0 }),
        (StepDone, Store),
        (Stored, Run { step: 1 }),
        (Wished(Pause), Secure),
        (OFF, AwaitOperator),
        (Continued, Restore),
        (Prepared, Run { step: 1 }),
        (StepDone, Store),
    ]);
}

#[test]
fn a_pause_within_a_step_does_that_step_anew() {
    check(&[
        (Begin, Prepare),
        (Prepared, Run { step: 0 }),
        (StepInterrupted(PauseNow), Secure),
        (OFF, AwaitOperator),
        (Continued, Restore),
        (Prepared, Run { step: 0 }),
    ]);
}

#[test]
fn what_cannot_be_re_established_is_an_error() {
    check(&[
        (Begin, Prepare),
        (Prepared, Run { step: 0 }),
        (Wished(Pause), Secure),
        (OFF, AwaitOperator),
        (Continued, Restore),
        (PreparationFailed, Secure),
        (OFF, Run { step: 2 }),
    ]);
}

#[test]
fn each_way_to_stop_ends_a_pause_in_its_own_way() {
    for (wish, next) in [
        (Stop, Run { step: 2 }),
        (Abort, Run { step: 2 }),
        // Safe already: once more for the end.
        (Halt, Secure),
    ] {
        check(&[
            (Begin, Prepare),
            (Prepared, Run { step: 0 }),
            (Wished(Pause), Secure),
            (OFF, AwaitOperator),
            (Wished(wish), next),
        ]);
    }
}

#[test]
fn a_stop_runs_finally_and_says_so() {
    check(&[
        (Begin, Prepare),
        (Prepared, Run { step: 0 }),
        (Wished(Stop), Run { step: 2 }),
        (StepDone, Store),
        (Stored, Run { step: 3 }),
        (StepDone, Store),
        (Stored, Secure),
        (OFF, Close(Stopped)),
    ]);
}

#[test]
fn a_halt_makes_safe_and_does_nothing_else() {
    check(&[
        (Begin, Prepare),
        (Prepared, Run { step: 0 }),
        (Wished(Halt), Secure),
        (OFF, Secure),
        (OFF, Close(Halted)),
    ]);
    // Within a step, and within `finally`.
    check(&[
        (Begin, Prepare),
        (Prepared, Run { step: 0 }),
        (StepInterrupted(Halt), Secure),
        (OFF, Store),
        (Stored, Secure),
        (OFF, Close(Halted)),
    ]);
    check(&[
        (Begin, Prepare),
        (Prepared, Run { step: 0 }),
        (Wished(Stop), Run { step: 2 }),
        (Wished(Halt), Secure),
        (OFF, Secure),
        (OFF, Close(Halted)),
    ]);
}

#[test]
fn a_failed_preparation_runs_finally_alone() {
    check(&[(Begin, Prepare), (PreparationFailed, Secure), (OFF, Run { step: 2 })]);
}

#[test]
fn an_error_outranks_an_abort_and_an_unknown_laser_is_an_error() {
    check(&[
        (Begin, Prepare),
        (Prepared, Run { step: 0 }),
        (Wished(Abort), Secure),
        (UNKNOWN, Run { step: 2 }),
        (StepDone, Store),
        (Stored, Run { step: 3 }),
        (StepDone, Store),
        (Stored, Secure),
        (OFF, Close(Error)),
    ]);
}

#[test]
fn an_input_out_of_turn_makes_everything_safe_and_closes() {
    check(&[(Begin, Prepare), (Stored, Secure), (OFF, Close(Error))]);
}

#[test]
fn a_resumed_run_skips_what_is_done_and_runs_all_of_finally() {
    let [main, finally] = [Section::Main, Section::Finally];
    let mut machine = Machine::resuming(&[main, main, finally], |i| i != 1);
    assert_eq!(machine.next(Begin), Prepare);
    assert_eq!(machine.next(Prepared), Run { step: 1 });
    assert_eq!(machine.next(StepDone), Store);
    assert_eq!(machine.next(Stored), Run { step: 2 });
}

#[test]
fn a_run_without_steps_is_still_made_safe() {
    let mut machine = Machine::new(&[]);
    assert_eq!(machine.next(Begin), Prepare);
    assert_eq!(machine.next(Prepared), Secure);
    assert_eq!(machine.next(OFF), Close(Completed));
}
