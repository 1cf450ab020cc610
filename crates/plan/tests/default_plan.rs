//! The plan and the rig that the program comes with.

#![expect(clippy::unwrap_used, clippy::panic, reason = "helpers of tests stop the test")]

use std::path::Path;

use beampose_plan::{Plan, Rig, Rules, check, plan_hash, read_plan, read_rig};

fn experiments() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../experiments")
}

fn plan() -> Plan {
    let bytes = std::fs::read(experiments().join("plans/translation-test.yaml")).unwrap();
    read_plan("plans/translation-test.yaml", &bytes).unwrap_or_else(|faults| panic!("{faults}"))
}

fn rig() -> Rig {
    let bytes = std::fs::read(experiments().join("rigs/simulated.yaml")).unwrap();
    read_rig("rigs/simulated.yaml", &bytes).unwrap_or_else(|faults| panic!("{faults}"))
}

#[test]
fn the_translation_test_expands_to_six_passes_of_ten_stops() {
    let summary = check(&plan(), &rig()).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!((summary.captures, summary.pictures), (60, 180));
    let list = summary.step_list();
    let lines: Vec<&str> = list.lines().collect();
    let shortened = [&lines[..9], &["..."], &lines[lines.len() - 8..]].concat().join("\n");
    insta::assert_snapshot!(format!("{shortened}\n\n{summary}"));
}

#[test]
fn each_capture_says_where_it_was_taken() {
    let steps = beampose_plan::expand(&plan(), &rig()).unwrap();
    let last = steps.iter().rfind(|step| step.action.kind() == "capture").unwrap();
    insta::assert_json_snapshot!(last);
}

#[test]
fn every_plan_that_comes_with_the_program_is_sound() {
    let mut count = 0;
    for entry in std::fs::read_dir(experiments().join("plans")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        let plan = read_plan(&name, &std::fs::read(&path).unwrap());
        let plan = plan.unwrap_or_else(|faults| panic!("{faults}"));
        // Each with the rig that it names.
        let rig = experiments().join("plans").join(&plan.rig.as_ref().unwrap().value);
        let rig = read_rig("rig", &std::fs::read(rig).unwrap());
        let rig = rig.unwrap_or_else(|faults| panic!("{faults}"));
        let summary = check(&plan, &rig).unwrap_or_else(|faults| panic!("{faults}"));
        assert!(!summary.steps.is_empty());
        count += 1;
    }
    assert!(count >= 2);
}

#[test]
fn deadlines_leave_room_for_the_slowest_case() {
    let steps = beampose_plan::expand(&plan(), &rig()).unwrap();
    for step in &steps {
        assert!(step.deadline.0 >= 2.0 * step.expected.0 + 10.0, "{step}");
    }
}

#[test]
fn the_hash_depends_on_every_step_and_on_the_rules() {
    let mut steps = beampose_plan::expand(&plan(), &rig()).unwrap();
    let usual = Rules::default();
    let whole = plan_hash(&steps, &usual);
    assert_eq!(whole, plan_hash(&steps.clone(), &usual));
    let stricter = Rules { max_skew: beampose_core::units::Second(0.01), ..usual.clone() };
    assert_ne!(whole, plan_hash(&steps, &stricter));
    steps.pop();
    assert_ne!(whole, plan_hash(&steps, &usual));
}

#[test]
fn every_fault_of_a_driver_name_is_found() {
    let mut rig = rig();
    if let Some(beampose_plan::Instrument::Camera(camera)) =
        rig.instruments.get_mut(&"cam_a".into())
    {
        camera.driver.value = "gphot".to_owned();
    }
    let faults =
        rig.unknown_drivers(|kind| if kind == "camera" { vec!["gphoto2"] } else { vec![] });
    insta::assert_snapshot!(faults);
}

/// One sector misread must not make one code of another.
#[test]
fn the_codes_of_the_default_rig_are_far_from_each_other() {
    let rig = rig();
    let world = rig.simulation.as_ref().unwrap();
    let artefact =
        rig.measurement.artefact.as_ref().unwrap().targets.value.iter().map(|t| t.value.code.value);
    let tie = world.tie_targets.iter().flatten().map(|t| t.value.code.value);
    let codes: Vec<u16> = artefact.chain(tie).collect();
    assert_eq!(codes.len(), 18);
    let turned = |code: u16, by: u32| (code << by | code >> (12 - by)) & 0xfff;
    for (i, a) in codes.iter().enumerate() {
        for b in &codes[..i] {
            let nearest = (0..12).map(|by| (a ^ turned(*b, by)).count_ones()).min().unwrap();
            assert!(nearest >= 2, "{a} and {b}");
        }
        assert!((1..12).all(|by| turned(*a, by) != *a), "{a} looks the same when turned");
    }
}
