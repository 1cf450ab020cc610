//! Plans of a few steps, and the session that they make.

use std::collections::BTreeMap;
use std::time::Duration;

use beampose_core::instrument::AxisUnit;
use beampose_core::units::Second;
use beampose_core::{SessionHeader, SessionId, Stamp, StepNumber};
use beampose_plan::{Action, Policy, Section, Step};

pub fn header(steps: &[Step]) -> SessionHeader {
    SessionHeader {
        id: SessionId::fresh(),
        title: "test".to_owned(),
        experiment: "translation".to_owned(),
        plan_text: String::new(),
        rig_text: String::new(),
        measurement_json: "{}".to_owned(),
        files: Vec::new(),
        plan_hash: String::new(),
        origin_json: None,
        software: "test".to_owned(),
        seed: Some(1),
        steps: u32::try_from(steps.len()).unwrap(),
        opened: Stamp { monotonic: Duration::ZERO, utc: jiff::Timestamp::UNIX_EPOCH },
    }
}

/// Main steps, then `finally` steps, numbered from 1, each with a deadline of a minute.
pub fn plan(
    main: impl IntoIterator<Item = Action>,
    finally: impl IntoIterator<Item = Action>,
) -> Vec<Step> {
    let main = main.into_iter().map(|action| (Section::Main, action));
    let finally = finally.into_iter().map(|action| (Section::Finally, action));
    (1..)
        .zip(main.chain(finally))
        .map(|(number, (section, action))| Step {
            number: StepNumber(number),
            section,
            context: BTreeMap::from([("pass".to_owned(), 2.0)]),
            action,
            deadline: Second(60.0),
            expected: Second(1.0),
            policy: Policy::default(),
        })
        .collect()
}

pub fn laser_on() -> Action {
    Action::LaserOn { laser: "laser".into() }
}

pub fn laser_off() -> Action {
    Action::LaserOff { laser: "laser".into() }
}

pub fn wait(seconds: f64) -> Action {
    Action::Wait { duration: Second(seconds) }
}

pub fn rail(target: f64) -> Action {
    Action::Move { axis: "rail".into(), target, unit: AxisUnit::Millimetre }
}

pub fn stage(target: f64) -> Action {
    Action::Move { axis: "stage".into(), target, unit: AxisUnit::Degree }
}

pub fn read(name: &str) -> Action {
    Action::Read { instruments: vec![name.into()] }
}

pub fn capture(id: &str) -> Action {
    Action::Capture { id: id.into(), cameras: vec!["cam_b".into(), "cam_a".into()] }
}
