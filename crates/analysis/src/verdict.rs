//! What is decided from a result, and by which rule.

use std::collections::BTreeMap;

use beampose_core::SessionOutcome;
use beampose_core::units::Millimetre;
use beampose_photogrammetry::solve::Method;
use serde::{Deserialize, Serialize};

/// The outcome of an experiment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Every limit is kept.
    Pass,
    /// A limit is broken.
    Fail,
    /// Nothing to decide on, no limit to decide by, or a limit within the uncertainty.
    Inconclusive,
    /// The session was stopped before its end.
    Aborted,
    /// The session ended by an error.
    Error,
}

impl Verdict {
    /// The word in the store and in JSON.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Fail => "fail",
            Self::Inconclusive => "inconclusive",
            Self::Aborted => "aborted",
            Self::Error => "error",
        }
    }

    /// The verdict on a session: what the analysis says, unless the session did not complete.
    #[must_use]
    pub const fn of_session(outcome: SessionOutcome, analysis: Self) -> Self {
        match outcome {
            SessionOutcome::Completed => analysis,
            SessionOutcome::Stopped | SessionOutcome::Aborted | SessionOutcome::Halted => {
                Self::Aborted
            }
            SessionOutcome::Error => Self::Error,
        }
    }

    /// The more serious of two verdicts of an analysis: fail before inconclusive before pass.
    #[must_use]
    pub const fn worse(self, other: Self) -> Self {
        if self.rank() >= other.rank() { self } else { other }
    }

    const fn rank(self) -> u8 {
        match self {
            Self::Pass => 0,
            Self::Inconclusive => 1,
            Self::Fail => 2,
            Self::Aborted => 3,
            Self::Error => 4,
        }
    }
}

/// How a value with an uncertainty is held against a limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Decision {
    /// The value alone decides: pass where |value| <= limit.
    #[default]
    Simple,
    /// ISO 14253-1: pass where |value| + U <= limit, fail where |value| - U > limit, inconclusive
    /// between.
    GuardBand,
}

impl Decision {
    /// Holds `|value|` with expanded uncertainty `expanded` against `limit`, all in one unit.
    #[must_use]
    pub fn judge(self, value: f64, expanded: f64, limit: f64) -> Verdict {
        let guard = match self {
            Self::Simple => 0.0,
            Self::GuardBand => expanded,
        };
        if value.abs() + guard <= limit {
            Verdict::Pass
        } else if value.abs() - guard > limit {
            Verdict::Fail
        } else {
            Verdict::Inconclusive
        }
    }
}

/// What the plan asks of the result. An absent limit is not judged.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Limits {
    /// Largest mean difference from the rail, by amount, at any stop, for each method judged.
    pub max_abs_difference: BTreeMap<Method, Millimetre>,
    /// Smallest fraction of captures (0 to 1) in which every method gives a pose.
    pub min_solved_fraction: Option<f64>,
    /// How a value near a limit is judged.
    pub decision: Decision,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_guard_band_leaves_a_value_near_the_limit_open() {
        let cases = [
            (0.30, 0.10, Verdict::Pass, Verdict::Pass),
            (-0.45, 0.10, Verdict::Pass, Verdict::Inconclusive),
            (0.55, 0.10, Verdict::Fail, Verdict::Inconclusive),
            (-0.70, 0.10, Verdict::Fail, Verdict::Fail),
            (0.50, 0.00, Verdict::Pass, Verdict::Pass),
        ];
        for (value, expanded, simple, guarded) in cases {
            assert_eq!(Decision::Simple.judge(value, expanded, 0.5), simple, "{value}");
            assert_eq!(Decision::GuardBand.judge(value, expanded, 0.5), guarded, "{value}");
        }
    }

    #[test]
    fn a_value_that_is_no_number_never_passes() {
        assert_eq!(Decision::Simple.judge(f64::NAN, 0.0, 0.5), Verdict::Inconclusive);
    }

    #[test]
    fn an_aborted_session_does_not_pass() {
        assert_eq!(Verdict::of_session(SessionOutcome::Aborted, Verdict::Pass), Verdict::Aborted);
    }
}
