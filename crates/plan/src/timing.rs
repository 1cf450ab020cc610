//! How long each step is expected to take, and after what time it has failed.
//!
//! A deadline is twice the time of the slowest case, and some seconds for the line to the
//! instrument. It is not an estimate: a step that needs so long has failed.

use std::collections::BTreeMap;

use beampose_core::InstrumentName;
use beampose_core::instrument::AxisUnit;
use beampose_core::units::Second;

use crate::rig::{Instrument, Rig};
use crate::step::Action;

/// For answers, retries of a serial line, a busy machine.
const GRACE: f64 = 10.0;
/// Pictures come over slow lines.
const PICTURE_GRACE: f64 = 30.0;
/// Moves of a closing-in that goes well.
const USUAL_MOVES: f64 = 4.0;
/// Where the rig says nothing: a query and its answer.
const ANSWER: f64 = 0.1;
/// An answer of a person.
const PERSON: f64 = 60.0;
/// An operator who went home comes back.
const DAY: f64 = 86_400.0;
/// Where the rig says nothing: a picture of some megabytes over USB.
const DELIVERY: f64 = 1.0;

/// What a move needs to know of an axis, in the axis' unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct AxisFacts {
    pub from: f64,
    pub to: f64,
    speed: f64,
    settle: f64,
    unit: AxisUnit,
    by_hand: bool,
}

impl AxisFacts {
    pub(crate) const fn unit(&self) -> AxisUnit {
        self.unit
    }

    pub(crate) const fn unit_name(&self) -> &'static str {
        match self.unit {
            AxisUnit::Millimetre => "millimetres",
            AxisUnit::Degree => "degrees",
        }
    }

    pub(crate) fn reaches(&self, target: f64) -> bool {
        (self.from..=self.to).contains(&target)
    }
}

/// Knows the speeds of a rig's instruments, and where its axes stand.
pub(crate) struct Timing<'a> {
    rig: &'a Rig,
    standing: BTreeMap<InstrumentName, f64>,
}

impl<'a> Timing<'a> {
    pub(crate) const fn new(rig: &'a Rig) -> Self {
        Self { rig, standing: BTreeMap::new() }
    }

    /// The facts of an axis, if it is one.
    pub(crate) fn axis(&self, name: &InstrumentName) -> Option<AxisFacts> {
        let by_hand = self.rig.instruments.get(name)?.still_for().is_some();
        match self.rig.instruments.get(name)? {
            Instrument::LinearAxis(axis) => Some(AxisFacts {
                by_hand,
                from: axis.travel.value.from.0,
                to: axis.travel.value.to.0,
                speed: axis.speed.0,
                settle: axis.settle.0,
                unit: AxisUnit::Millimetre,
            }),
            Instrument::RotaryAxis(axis) => Some(AxisFacts {
                by_hand,
                from: axis.travel.value.from.0,
                to: axis.travel.value.to.0,
                speed: axis.speed.0,
                settle: axis.settle.0,
                unit: AxisUnit::Degree,
            }),
            _ => None,
        }
    }

    /// Expected time and deadline of a move, after which the axis stands at `target`.
    pub(crate) fn travel(
        &mut self,
        axis: &InstrumentName,
        facts: &AxisFacts,
        target: f64,
    ) -> (Second, Second) {
        // After a resume, or in `finally`, nobody knows where the axis stood: the deadline holds
        // from anywhere.
        let farthest = (target - facts.from).max(facts.to - target);
        let standing = self.standing.insert(axis.clone(), target);
        let distance = standing.map_or(farthest, |from| (target - from).abs());
        if facts.by_hand {
            return (tidy(PERSON), tidy(DAY));
        }
        let time = |distance: f64| distance / facts.speed + facts.settle;
        (tidy(time(distance)), tidy(2.0 * time(farthest) + GRACE))
    }

    /// Expected time and deadline of anything but a move.
    pub(crate) fn of(&self, action: &Action) -> (Second, Second) {
        let (expected, grace) = match action {
            Action::LaserOn { laser } => (self.emission_delay(laser), GRACE),
            Action::LaserOff { .. } | Action::Move { .. } => (ANSWER, GRACE),
            Action::Wait { duration } => (duration.0, GRACE),
            Action::Read { instruments } => {
                (instruments.iter().map(|name| self.answer(name)).sum(), GRACE)
            }
            Action::Align { axis, camera, moves, .. } => {
                let facts = self.axis(axis);
                let settle = facts.map_or(0.0, |facts| facts.settle);
                let whole_way = facts.map_or(0.0, |facts| (facts.to - facts.from) / facts.speed);
                let look = settle + ANSWER + self.picture(camera);
                // Most closings-in need four; the deadline is for all that it may take.
                let deadline = 2.0 * (f64::from(*moves) * look + whole_way) + PICTURE_GRACE;
                return (tidy(USUAL_MOVES * look), tidy(deadline));
            }
            // A person walks over and does something.
            Action::Prompt { .. } => (PERSON, DAY),
            Action::Capture { cameras, .. } => {
                let slowest = cameras.iter().map(|name| self.picture(name)).fold(0.0, f64::max);
                (slowest, PICTURE_GRACE)
            }
        };
        (tidy(expected), tidy(2.0 * expected + grace))
    }

    fn emission_delay(&self, laser: &InstrumentName) -> f64 {
        match self.rig.instruments.get(laser) {
            Some(Instrument::Laser(laser)) => laser.emission_delay.0,
            _ => 0.0,
        }
    }

    fn answer(&self, name: &InstrumentName) -> f64 {
        match self.rig.instruments.get(name) {
            Some(Instrument::Sensor(sensor)) => sensor.response.map_or(ANSWER, |time| time.0),
            _ => ANSWER,
        }
    }

    fn picture(&self, name: &InstrumentName) -> f64 {
        match self.rig.instruments.get(name) {
            Some(Instrument::Camera(camera)) => {
                camera.exposure.map_or(0.0, |t| t.0) + camera.delivery.map_or(DELIVERY, |t| t.0)
            }
            _ => DELIVERY,
        }
    }
}

/// Whole milliseconds: enough, and the same text on every machine.
fn tidy(seconds: f64) -> Second {
    Second((seconds * 1e3).round() / 1e3)
}
