//! What must be true again before a session goes on, from the steps that are done.

use std::collections::{BTreeMap, BTreeSet};

use beampose_core::{InstrumentName, Reading, StepNumber};
use beampose_plan::{Action, Section, Step};

/// What an earlier run of a session did.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Earlier {
    /// Main steps that are done: they are not run again.
    pub done: BTreeSet<StepNumber>,
    /// Main steps that were skipped or passed over: nor are they.
    pub passed: BTreeSet<StepNumber>,
    /// What they read.
    pub readings: BTreeMap<StepNumber, Vec<(InstrumentName, Reading)>>,
    /// What the operator answered, by the prompts' names.
    pub answers: BTreeMap<String, String>,
}

impl Earlier {
    /// Whether a step need not be done again.
    #[must_use]
    pub fn is_behind(&self, step: StepNumber) -> bool {
        self.done.contains(&step) || self.passed.contains(&step)
    }
}

/// What later steps rely on, as steps that repeat earlier ones: axes where they were last told to
/// be (in the order of their last moves), lasers on if they were and settled as long as the plan
/// let them settle, and the wait that followed the last move.
///
/// Empty where no main step is left.
#[must_use]
pub fn restoration(steps: &[Step], done: &BTreeSet<StepNumber>) -> Vec<Step> {
    let main = steps.iter().filter(|step| step.section == Section::Main);
    let (done, left): (Vec<&Step>, Vec<&Step>) = main.partition(|step| done.contains(&step.number));
    if left.is_empty() {
        return Vec::new();
    }
    let mut moves: Vec<usize> = Vec::new();
    let mut lit: Vec<usize> = Vec::new();
    for (i, step) in done.iter().enumerate() {
        match &step.action {
            Action::Move { axis, .. } => {
                moves.retain(
                    |&m| !matches!(&done[m].action, Action::Move { axis: a, .. } if a == axis),
                );
                moves.push(i);
            }
            Action::LaserOn { laser } | Action::LaserOff { laser } => {
                lit.retain(
                    |&l| !matches!(&done[l].action, Action::LaserOn { laser: a } if a == laser),
                );
                if matches!(step.action, Action::LaserOn { .. }) {
                    lit.push(i);
                }
            }
            _ => {}
        }
    }
    // Dark while axes move, as in the plan's own beginning.
    let last_move = moves.last().copied();
    let settling = lit.iter().copied().chain(last_move).flat_map(|i| waits_after(&done, i));
    let waits: BTreeSet<usize> = settling.collect();
    moves.into_iter().chain(lit).chain(waits).map(|i| done[i].clone()).collect()
}

/// The waits that follow a step directly.
fn waits_after(steps: &[&Step], at: usize) -> impl Iterator<Item = usize> {
    let is_wait = |step: &&Step| matches!(step.action, Action::Wait { .. });
    let count = steps[at + 1..].iter().take_while(|step| is_wait(step)).count();
    at + 1..at + 1 + count
}

#[cfg(test)]
mod tests {
    use beampose_core::instrument::AxisUnit;
    use beampose_core::units::Second;

    use super::*;
    use crate::tests::fakes::plan;

    fn moved(axis: &str, target: f64) -> Action {
        Action::Move { axis: axis.into(), target, unit: AxisUnit::Millimetre }
    }

    fn wait(seconds: f64) -> Action {
        Action::Wait { duration: Second(seconds) }
    }

    /// The numbers of the steps that are repeated when the first `done` steps are done.
    #[track_caller]
    fn check(main: Vec<Action>, done: u32, expected: &[u32]) {
        let steps = plan(main, [moved("rail", 0.0)]);
        let done = (1..=done).map(StepNumber).collect();
        let found: Vec<u32> = restoration(&steps, &done).iter().map(|s| s.number.0).collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn axes_stand_again_before_the_laser_is_on_and_settled() {
        let (on, off) =
            (Action::LaserOn { laser: "laser".into() }, Action::LaserOff { laser: "laser".into() });
        let main = || {
            vec![
                moved("rail", 0.0),
                on.clone(),
                wait(1800.0),
                moved("stage", 3.0),
                moved("rail", 100.0),
                wait(2.0),
                off.clone(),
                moved("rail", 200.0),
            ]
        };
        // Nothing done, nothing to restore; then with the laser on, its wait, and the last moves.
        check(main(), 0, &[]);
        check(main(), 1, &[1]);
        check(main(), 2, &[1, 2]);
        check(main(), 3, &[1, 2, 3]);
        check(main(), 5, &[4, 5, 2, 3]);
        check(main(), 6, &[4, 5, 2, 3, 6]);
        check(main(), 7, &[4, 5, 6]);
        // All main steps done: only `finally` is left, and needs nothing.
        check(main(), 8, &[]);
    }
}
