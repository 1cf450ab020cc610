//! What a sound plan means.

#![expect(clippy::panic, reason = "helpers of tests stop the test")]

use beampose_plan::{Action, OnError, Plan, Rig, Section, Step, expand, read_plan, read_rig};

const RIG: &str = include_str!("../../../experiments/rigs/simulated.yaml");

fn plan(steps: &str) -> Plan {
    let text = format!("version: 1\ntitle: x\nexperiment: acquisition\n{steps}");
    read_plan("plan.yaml", text.as_bytes()).unwrap_or_else(|faults| panic!("{faults}"))
}

fn rig(changed: impl Fn(&str) -> String) -> Rig {
    read_rig("rig.yaml", changed(RIG).as_bytes()).unwrap_or_else(|faults| panic!("{faults}"))
}

fn steps(text: &str) -> Vec<Step> {
    expand(&plan(text), &rig(str::to_owned)).unwrap_or_else(|faults| panic!("{faults}"))
}

fn targets(steps: &[Step]) -> Vec<f64> {
    let target = |step: &Step| match step.action {
        Action::Move { target, .. } => Some(target),
        _ => None,
    };
    steps.iter().filter_map(target).collect()
}

#[test]
fn a_sweep_in_tenths_has_no_rounding_dust() {
    let steps = steps(
        "steps: [sweep: {axis: rail, from: 0 mm, to: 1 mm, step: 0.1 mm, steps: [wait: 1 s]}]",
    );
    assert_eq!(targets(&steps), [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]);
}

#[test]
fn a_sweep_can_go_down_and_can_have_one_stop() {
    let down =
        "steps: [sweep: {axis: rail, from: 20 cm, to: 0 mm, step: -100 mm, steps: [wait: 1 s]}]";
    assert_eq!(targets(&steps(down)), [200.0, 100.0, 0.0]);
    let one = "steps: [sweep: {axis: rail, from: 5 mm, to: 5 mm, step: 1 mm, steps: [wait: 1 s]}]";
    assert_eq!(targets(&steps(one)), [5.0]);
}

#[test]
fn a_sweep_over_values_keeps_their_order() {
    let steps =
        steps("steps: [sweep: {axis: rail, values: [0.9 m, 0 mm, 300 mm], steps: [wait: 1 s]}]");
    assert_eq!(targets(&steps), [900.0, 0.0, 300.0]);
    assert_eq!(steps[1].context["rail_mm"], 900.0);
}

#[test]
fn parameters_stand_for_numbers_and_quantities() {
    let steps = steps(
        "parameters: {pause: 2 s, n: 3}\nsteps: [repeat: {times: $n, as: turn, steps: [wait: $pause]}]",
    );
    let turns: Vec<f64> = steps.iter().map(|step| step.context["turn"]).collect();
    assert_eq!(turns, [1.0, 2.0, 3.0]);
    assert!(steps.iter().all(|step| step.expected.0 == 2.0));
}

#[test]
fn a_loop_leaves_nothing_in_the_context_of_what_follows() {
    let steps = steps(
        "steps: [repeat: {times: 1, as: turn, steps: [wait: 1 s]}, wait: 1 s]\nfinally: [laser: off]",
    );
    assert_eq!(steps[0].context.len(), 1);
    assert!(steps[1].context.is_empty());
    let sections: Vec<Section> = steps.iter().map(|step| step.section).collect();
    assert_eq!(sections, [Section::Main, Section::Main, Section::Finally]);
    assert_eq!(steps[2].number.0, 3);
}

#[test]
fn a_move_takes_as_long_as_its_way_and_may_take_twice_the_longest() {
    let steps = steps("steps: [move: {rail: 0 mm}, move: {rail: 500 mm}]");
    // 500 mm at 50 mm/s and half a second to settle; from 1050 mm: 11 s and half a second, 550 mm
    // from the far end.
    assert_eq!(steps[1].expected.0, 10.5);
    assert_eq!(steps[1].deadline.0, 2.0 * 11.5 + 10.0);
}

#[test]
fn with_two_lasers_a_plan_must_say_which() {
    let two = |text: &str| {
        let second =
            "  laser_b:\n    laser: {driver: simulated, emission_delay: 1 s}\n  wavemeter:";
        text.replacen("  wavemeter:", second, 1)
    };
    let faults = expand(&plan("steps: [laser: on]"), &rig(two)).unwrap_err().to_string();
    assert!(faults.contains("which laser? The rig has `laser`, `laser_b`"), "{faults}");
    let named = expand(&plan("steps: [laser: {laser_b: on}]"), &rig(two)).unwrap();
    assert_eq!(named[0].action, Action::LaserOn { laser: "laser_b".into() });
}

#[test]
fn a_rotary_axis_counts_in_degrees() {
    let stage = |text: &str| {
        let stage = "  stage:\n    rotary_axis: {driver: simulated, travel: {from: -180 deg, \
                     to: 180 deg}, speed: 10 deg/s, settle: 0.2 s}\n  wavemeter:";
        text.replacen("  wavemeter:", stage, 1)
    };
    let sweep = "steps: [sweep: {axis: stage, values: [-60 deg, 60 deg], steps: [wait: 1 s]}]";
    let steps = expand(&plan(sweep), &rig(stage)).unwrap();
    assert_eq!(steps[0].context["stage_deg"], -60.0);
    assert_eq!(steps[2].to_string(), "stage_deg 60, move stage to 60 deg");
    let faults = expand(&plan("steps: [move: {stage: 10 mm}]"), &rig(stage)).unwrap_err();
    assert!(faults.to_string().contains("`stage` counts in degrees, found `10 mm`"), "{faults}");
}

#[test]
fn a_byte_order_mark_and_line_ends_of_other_systems_are_read() {
    let text =
        "\u{feff}version: 1\r\ntitle: x\r\nexperiment: acquisition\r\nsteps:\r\n  - wait: 1 s\r\n";
    assert!(read_plan("plan.yaml", text.as_bytes()).is_ok());
    let faults = read_plan("p", text.replace("wait", "wiat").as_bytes()).unwrap_err().to_string();
    assert!(faults.starts_with("p:5:5: unknown key `wiat`\n 5 |   - wiat: 1 s\n"), "{faults}");
}

#[test]
fn an_alias_within_reason_is_read() {
    let text = "parameters: {pause: &p 2 s, again: *p}\nsteps: [wait: $pause, wait: $again]";
    assert_eq!(steps(text).len(), 2);
}

#[test]
fn thousands_of_faults_are_told_as_a_hundred() {
    let text = format!("steps: [{}]", "1,".repeat(20_000));
    let faults = read_plan("p", text.as_bytes()).unwrap_err();
    assert!(faults.to_string().ends_with("100 faults or more"));
}

const POLICIES: &str = "
on_error: {retry: {times: 2, backoff: 2 s}}
timeout: 1 h
max_skew: 20 ms
conditions:
  - reading: {instrument: wavemeter, above: 657.9 nm, below: 658.1 nm}
    for: 10 s
    give_up: 10 min
  - disk_free: 1 GB
    every: 1 min
    give_up: 1 h
steps:
  - prompt: {name: fixture, text: Roll the module, ask: {choice: [up, rolled]}, default: up}
  - laser: on
  - block:
      - read: [wavemeter, thermometer]
        accept: [{instrument: thermometer, below: 30 degC}]
        timeout: 5 s
      - capture: {cameras: all}
        on_error: record_missing
        run_if: {answer: fixture, is: ROLLED}
      - wait: 1 s
    on_error: {retry: {times: 1, then: skip}}
    recover: [{laser: off}, {wait: 5 s}, {laser: on}]
    timeout: 2 min
finally: [laser: off]
";

#[test]
fn what_a_step_says_outranks_its_block_which_outranks_the_plan() {
    let steps = steps(POLICIES);
    let retry = |i: usize| steps[i].policy.retry.map(|retry| (retry.times, retry.backoff.0));
    let on_error = |i: usize| steps[i].policy.on_error;
    assert_eq!((retry(1), on_error(1)), (Some((2, 2.0)), OnError::Abort));
    assert_eq!((retry(2), on_error(2)), (Some((1, 1.0)), OnError::Skip));
    assert_eq!((retry(3), on_error(3)), (None, OnError::RecordMissing));
    let remedies: Vec<String> =
        steps[2].policy.recover.iter().map(|remedy| remedy.action.to_string()).collect();
    assert_eq!(remedies, ["laser off", "wait 5 s", "laser on"]);
    // Without a retry there is nothing to recover for.
    assert!(steps[3].policy.recover.is_empty());
    // The plan's own time, then the block's.
    let timeouts = |i: usize| -> Vec<(u32, f64)> {
        steps[i].policy.within.iter().map(|bound| (bound.block, bound.timeout.0)).collect()
    };
    assert_eq!(timeouts(1), [(1, 3600.0)]);
    assert_eq!(timeouts(4), [(1, 3600.0), (2, 120.0)]);
    assert_eq!(steps[2].deadline.0, 5.0);
    assert!(steps[5].policy.is_usual(), "`finally` has its own");
}

#[test]
fn what_holds_for_the_whole_plan_comes_with_its_steps() {
    let summary = beampose_plan::check(&plan(POLICIES), &rig(str::to_owned));
    let rules = summary.unwrap_or_else(|faults| panic!("{faults}")).rules;
    assert_eq!(rules.max_skew.0, 0.02);
    let whats: Vec<String> = rules.conditions.iter().map(|c| c.what.to_string()).collect();
    let expected = ["wavemeter between 657.9 and 658.1 nm", "at least 1000 MB of disk free"];
    assert_eq!(whats, expected);
    assert_eq!((rules.conditions[0].hold_for.0, rules.conditions[0].every.0), (10.0, 10.0));
    assert_eq!(rules.conditions[1].every.0, 60.0);
}

#[test]
fn an_answer_decides_in_the_form_of_the_choice() {
    let steps = steps(POLICIES);
    let run_if: Vec<String> = steps[3].policy.run_if.iter().map(ToString::to_string).collect();
    assert_eq!(run_if, ["the answer to fixture is rolled"]);
    assert_eq!(steps[0].to_string(), "ask for fixture");
}
