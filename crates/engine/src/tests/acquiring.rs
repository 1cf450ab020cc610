//! What steps acquire, and in which order it is stored.

use beampose_core::instrument::AxisUnit;
use beampose_core::{EventKind, SessionOutcome, StepOutcome};
use beampose_plan::Action;

use super::fakes::*;
use crate::EngineError;

#[test]
fn each_step_is_stored_before_the_next_begins() {
    let lab = Lab::new();
    let steps = plan([rail(10.0), read("wavemeter"), capture("p000")], [rail(0.0)]);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Completed);
    let lines: Vec<_> = lab.log.lines().into_iter().filter(|it| !it.starts_with("laser")).collect();
    assert_eq!(
        lines,
        [
            "rail to 10",
            "stored 1",
            "wavemeter read",
            "stored 2",
            "cam_a arm",
            "cam_b arm",
            "cam_a trigger",
            "cam_b trigger",
            "stored 3",
            "rail to 0",
            "stored 4",
            "closed",
        ]
    );
}

#[test]
fn setpoints_and_readings_land_in_the_capture() {
    let lab = Lab::new();
    let steps = plan(
        [rail(10.0), stage(30.0), read("wavemeter"), read("thermometer"), capture("p000")],
        [],
    );
    lab.outcome(&steps);
    let capture = lab.record(5).capture.unwrap();
    let setpoints: Vec<_> = capture.setpoints.iter().map(|(k, v)| (k.as_str(), *v)).collect();
    assert_eq!(setpoints, [("pass", 2.0), ("rail_mm", 10.0), ("stage_deg", 30.0)]);
    let readings: Vec<_> = capture.readings.iter().map(|(k, v)| (k.as_str(), *v)).collect();
    assert_eq!(
        readings,
        [
            ("rail_mm", 10.25),
            ("stage_deg", 30.25),
            ("temperature_degc", 21.5),
            ("thermometer_degc", 21.5),
            ("wavelength_nm", 658.02),
            ("wavemeter_nm", 658.02),
        ]
    );
    let cameras: Vec<_> = capture.pictures.iter().map(|it| it.camera.as_str()).collect();
    assert_eq!(cameras, ["cam_a", "cam_b"]);
    assert_eq!(capture.pictures[0].bytes, b"cam_a");
}

#[test]
fn what_sensors_read_before_a_move_is_not_of_the_next_capture() {
    let lab = Lab::new();
    lab.outcome(&plan([read("wavemeter"), rail(10.0), capture("p000")], []));
    let readings = lab.record(3).capture.unwrap().readings;
    assert_eq!(readings.keys().collect::<Vec<_>>(), ["rail_mm"]);
}

#[test]
fn a_move_reads_the_encoder() {
    let lab = Lab::new();
    lab.outcome(&plan([rail(10.0)], []));
    let (name, reading) = lab.record(1).readings[0].clone();
    assert_eq!((name.as_str(), reading.value), ("rail", 10.25));
    assert_eq!(reading.at.monotonic.as_secs(), 3);
}

#[test]
fn cameras_are_triggered_together() {
    let lab = Lab::new();
    lab.outcome(&plan([capture("p000")], []));
    let pictures = lab.record(1).capture.unwrap().pictures;
    assert_eq!(pictures[0].requested, pictures[1].requested);
    assert_eq!(lab.seconds(), 2.0);
}

#[test]
fn pictures_of_the_other_cameras_are_kept_when_one_hangs() {
    let lab = Lab::with_fault("cam_b", Fault::Hangs);
    assert_eq!(lab.outcome(&plan([capture("p000")], [])), SessionOutcome::Error);
    let record = lab.record(1);
    assert_eq!(record.capture.unwrap().pictures.len(), 1);
    let reason = "cam_b: no answer within 60s".to_owned();
    assert_eq!(record.outcome, StepOutcome::Failed { reason });
}

#[test]
fn a_reading_that_is_no_number_fails_its_step() {
    let lab = Lab::with_fault("wavemeter", Fault::ReadsNan);
    assert_eq!(lab.outcome(&plan([read("wavemeter")], [])), SessionOutcome::Error);
    let reason = "wavemeter: it read NaN, which is no number".to_owned();
    assert_eq!(lab.record(1).outcome, StepOutcome::Failed { reason });
}

#[test]
fn a_move_in_the_wrong_unit_is_not_begun() {
    let lab = Lab::new();
    let wrong = Action::Move { axis: "rail".into(), target: 90.0, unit: AxisUnit::Degree };
    assert_eq!(lab.outcome(&plan([wrong], [])), SessionOutcome::Error);
    assert!(!lab.log.has("rail to 90"));
}

#[test]
fn all_instruments_are_identified_before_the_first_step() {
    let lab = Lab::new();
    lab.outcome(&plan([wait(1.0)], []));
    let events = lab.record(1).events;
    let named: Vec<_> = events
        .iter()
        .filter(|event| event.kind == EventKind::Identified)
        .map(|event| event.message.as_str())
        .collect();
    assert_eq!(
        named,
        [
            "cam_a: fake cam_a, simulated",
            "cam_b: fake cam_b, simulated",
            "laser: fake laser, simulated",
            "rail: fake rail, simulated",
            "stage: fake stage, simulated",
            "thermometer: fake thermometer, simulated",
            "wavemeter: fake wavemeter, simulated",
        ]
    );
}

#[test]
fn an_instrument_that_does_not_say_who_it_is_ends_the_run_before_the_first_step() {
    let lab = Lab::with_fault("cam_b", Fault::Nameless);
    assert_eq!(lab.outcome(&plan([rail(10.0)], [rail(0.0)])), SessionOutcome::Error);
    assert_eq!(lab.stored(), [2]);
}

#[test]
fn a_plan_for_another_bench_is_refused_before_anything_is_done() {
    let lab = Lab::new();
    let error = lab.run(&plan([wait(1.0), read("barometer")], [])).unwrap_err();
    assert!(matches!(error, EngineError::NoInstrument { .. }));
    let text = "there is no sensor or axis barometer on the bench; \
                there is rail, stage, thermometer, wavemeter";
    assert_eq!(error.to_string(), text);
    assert!(lab.log.lines().is_empty());
}
