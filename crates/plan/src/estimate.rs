//! How long a plan will take, and how much disk: from what the same kinds of steps took before on
//! the same rig; where there is nothing, from what the rig says of its instruments.

use std::collections::BTreeMap;

use beampose_core::units::Second;

use crate::step::Step;

/// What steps took in earlier sessions on one rig.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct History {
    /// How many sessions it is from.
    pub sessions: usize,
    /// How long each step took that was done, s, with its label.
    pub steps: Vec<(String, f64)>,
    /// What each session took beside its steps, s a step: storing, for most of it.
    pub between: Vec<f64>,
    /// The size of each picture, bytes, with its camera's name.
    pub pictures: Vec<(String, u64)>,
}

/// How long, and how much.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// How long each step will take, in their order.
    pub each: Vec<Second>,
    /// All together.
    pub time: Second,
    /// It may be as short and as long as this: about 95 of 100 times.
    pub range: [Second; 2],
    /// Disk for pictures, bytes.
    pub bytes: f64,
    /// From how many sessions; 0: from the rig's own figures.
    pub sessions: usize,
}

/// Mean and variance of what is known of a kind of step.
#[derive(Debug, Clone, Copy, Default)]
struct Stat {
    count: f64,
    sum: f64,
    squares: f64,
}

impl Stat {
    fn add(&mut self, value: f64) {
        self.count += 1.0;
        self.sum += value;
        self.squares += value * value;
    }

    fn mean(&self) -> f64 {
        self.sum / self.count
    }

    /// Of one further value about this mean.
    fn variance(&self) -> f64 {
        let spread = (self.squares / self.count - self.mean() * self.mean()).max(0.0);
        // One value alone says nothing of its scatter: a tenth of it is taken.
        if self.count < 2.0 {
            (0.1 * self.mean()).powi(2)
        } else {
            spread * (1.0 + 1.0 / self.count)
        }
    }
}

/// Where the rig's own figures are all there is, a run takes up to half as long again.
const UNKNOWN: f64 = 0.5;

/// The estimate for steps; `expected_bytes` is what the rig says of all pictures together.
#[must_use]
pub fn estimate(steps: &[Step], expected_bytes: f64, history: &History) -> Estimate {
    let known = Known::of(history);
    let mut each = Vec::new();
    // What scatters alike in all steps of one kind adds up, what scatters by itself averages out:
    // both are counted, by kind.
    let (mut by_kind, mut unknown) = (BTreeMap::<&str, f64>::new(), 0.0);
    for step in steps {
        let expected = step.expected.0;
        match known.of_step(step) {
            Some((mean, variance)) => {
                each.push(Second(mean));
                *by_kind.entry(step.action.kind()).or_default() += variance;
            }
            None => {
                each.push(Second(expected));
                unknown += UNKNOWN * expected;
            }
        }
    }
    let between = known.between * steps.len() as f64;
    let time = each.iter().map(|t| t.0).sum::<f64>() + between;
    let sigma = by_kind.values().sum::<f64>().sqrt() + known.between_sigma * steps.len() as f64;
    Estimate {
        each,
        time: Second(time),
        range: [Second((time - 2.0 * sigma).max(0.0)), Second(time + 2.0 * sigma + unknown)],
        bytes: known.bytes(steps).unwrap_or(expected_bytes),
        sessions: history.sessions,
    }
}

/// A history, looked up by label, by action, by kind.
struct Known<'a> {
    labels: BTreeMap<&'a str, Stat>,
    actions: BTreeMap<&'a str, Stat>,
    kinds: BTreeMap<&'static str, Stat>,
    cameras: BTreeMap<&'a str, Stat>,
    between: f64,
    between_sigma: f64,
}

impl<'a> Known<'a> {
    fn of(history: &'a History) -> Self {
        let mut known = Self {
            labels: BTreeMap::new(),
            actions: BTreeMap::new(),
            kinds: BTreeMap::new(),
            cameras: BTreeMap::new(),
            between: 0.0,
            between_sigma: 0.0,
        };
        for (label, took) in &history.steps {
            known.labels.entry(label).or_default().add(*took);
            known.actions.entry(action_of(label)).or_default().add(*took);
            if let Some(kind) = alike(label) {
                known.kinds.entry(kind).or_default().add(*took);
            }
        }
        for (camera, bytes) in &history.pictures {
            known.cameras.entry(camera).or_default().add(*bytes as f64);
        }
        let mut between = Stat::default();
        history.between.iter().for_each(|each| between.add(*each));
        if between.count > 0.0 {
            known.between = between.mean().max(0.0);
            known.between_sigma = if between.count > 1.0 { between.variance().sqrt() } else { 0.0 };
        }
        known
    }

    /// What the same step took, else the same action elsewhere in a plan, else the same kind.
    fn of_step(&self, step: &Step) -> Option<(f64, f64)> {
        let (label, action) = (step.to_string(), step.action.to_string());
        let found = self.labels.get(label.as_str()).or_else(|| self.actions.get(action.as_str()));
        let found = found.or_else(|| self.kinds.get(alike(&action)?));
        found.map(|stat| (stat.mean(), stat.variance()))
    }

    fn bytes(&self, steps: &[Step]) -> Option<f64> {
        let mut bytes = 0.0;
        for step in steps {
            for camera in crate::check::cameras_of(step).unwrap_or_default() {
                bytes += self.cameras.get(camera.as_str())?.mean();
            }
        }
        Some(bytes)
    }
}

/// A label without the loops around it: `pass 2, rail_mm 300, wait 1 s` is `wait 1 s`.
fn action_of(label: &str) -> &str {
    const VERBS: [&str; 7] =
        ["wait ", "move ", "read ", "capture ", "align ", "ask for ", "laser "];
    let starts = label.match_indices(", ").map(|(at, _)| at + 2).chain([0]);
    let is_action = |at: &usize| VERBS.iter().any(|verb| label[*at..].starts_with(verb));
    starts.filter(is_action).min().map_or(label, |at| &label[at..])
}

/// The kind of a step whose time does not depend on what exactly it does; a wait takes what it
/// says, and a move depends on the way.
fn alike(label: &str) -> Option<&'static str> {
    let action = action_of(label);
    ["capture ", "align ", "ask for "].into_iter().find(|verb| action.starts_with(verb))
}

#[cfg(test)]
mod tests {
    use beampose_core::{CaptureId, StepNumber};

    use super::*;
    use crate::policy::Policy;
    use crate::step::{Action, Section};

    fn step(number: u32, pass: f64, action: Action, expected: f64) -> Step {
        Step {
            number: StepNumber(number),
            section: Section::Main,
            context: BTreeMap::from([("pass".to_owned(), pass)]),
            action,
            deadline: Second(100.0),
            expected: Second(expected),
            policy: Policy::default(),
        }
    }

    fn capture(id: &str) -> Action {
        Action::Capture { id: CaptureId(id.to_owned()), cameras: vec!["cam_a".into()] }
    }

    fn wait(seconds: f64) -> Action {
        Action::Wait { duration: Second(seconds) }
    }

    #[test]
    fn without_a_history_the_rig_is_believed_and_the_range_is_wide() {
        let steps = [step(1, 1.0, wait(10.0), 10.0), step(2, 1.0, capture("p000"), 2.0)];
        let found = estimate(&steps, 3e6, &History::default());
        assert_eq!((found.time, found.bytes, found.sessions), (Second(12.0), 3e6, 0));
        assert_eq!(found.range, [Second(12.0), Second(18.0)]);
    }

    #[test]
    fn the_same_step_counts_more_than_the_same_action_than_the_same_kind() {
        let history = History {
            sessions: 1,
            steps: vec![
                ("pass 1, capture p000 with cam_a".to_owned(), 3.0),
                ("pass 1, capture p001 with cam_a".to_owned(), 5.0),
                ("pass 1, wait 10 s".to_owned(), 10.5),
            ],
            between: vec![0.25],
            pictures: vec![("cam_a".to_owned(), 1000), ("cam_a".to_owned(), 2000)],
        };
        let steps = [
            step(1, 1.0, capture("p000"), 2.0), // this very step: 3 s
            step(2, 2.0, wait(10.0), 10.0),     // the same wait in another pass: 10.5 s
            step(3, 7.0, capture("p009"), 2.0), // a capture as others: 4 s
            step(4, 7.0, wait(20.0), 20.0),     // nobody knows: as the rig says
        ];
        let found = estimate(&steps, 0.0, &history);
        let each: Vec<f64> = found.each.iter().map(|time| time.0).collect();
        assert_eq!(each, [3.0, 10.5, 4.0, 20.0]);
        assert_eq!((found.time.0, found.bytes), (38.5, 3000.0));
        assert!(found.range[0].0 < 38.5 && found.range[1].0 > 48.5, "{:?}", found.range);
    }

    #[test]
    fn a_label_is_an_action_behind_its_loops() {
        assert_eq!(action_of("pass 2, rail_mm 300, read a, b"), "read a, b");
        assert_eq!(action_of("wait 1 s"), "wait 1 s");
        assert_eq!(action_of("laser on"), "laser on");
    }
}
