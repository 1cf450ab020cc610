//! What holds beside the steps: what becomes of an error, which readings are accepted, whether a
//! step runs at all, and the conditions without which a run waits. Plain data; the engine obeys.

use std::fmt;

use beampose_core::units::Second;
use beampose_core::{InstrumentName, Quantity};
use serde::{Deserialize, Serialize};

use crate::step::Action;

/// What holds for one step.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Policy {
    /// How often the step is tried again after an error.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub retry: Option<Retry>,
    /// What becomes of an error that no retry mended.
    #[serde(skip_serializing_if = "OnError::is_abort")]
    pub on_error: OnError,
    /// What is done before each retry.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub recover: Vec<Remedy>,
    /// Limits of what the step reads: outside, the verdict is fail.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub accept: Vec<Band>,
    /// Without all of these the step is skipped.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub run_if: Vec<RunIf>,
    /// The blocks around it that have a time of their own, outermost first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub within: Vec<Bound>,
}

impl Policy {
    /// Whether nothing but the usual holds.
    #[must_use]
    pub fn is_usual(&self) -> bool {
        *self == Self::default()
    }
}

/// Trying again.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Retry {
    /// How often, beside the first time.
    pub times: u32,
    /// How long to wait before the first retry; each further one waits twice as long.
    pub backoff: Second,
}

/// What becomes of an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OnError {
    /// Everything is made safe, and `finally` runs.
    #[default]
    Abort,
    /// The step is passed over.
    Skip,
    /// The run pauses; when it goes on, the step is tried again.
    Pause,
    /// What the step did acquire is kept, and what it did not is recorded as missing.
    RecordMissing,
}

impl OnError {
    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands a reference over")]
    fn is_abort(&self) -> bool {
        *self == Self::Abort
    }
}

/// One thing that is done before a retry.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Remedy {
    /// What.
    pub action: Action,
    /// After so long it has failed.
    pub deadline: Second,
}

/// A block with a time of its own.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Bound {
    /// Which block: counted as they are entered.
    pub block: u32,
    /// How long after its first step began its last may end.
    pub timeout: Second,
}

/// Limits of a reading.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Band {
    /// Whose.
    pub instrument: InstrumentName,
    /// What it reads, hence the unit of the limits.
    pub quantity: Quantity,
    /// The lower limit.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub above: Option<f64>,
    /// The upper limit.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub below: Option<f64>,
}

impl Band {
    /// Whether a value is within; a limit itself is.
    #[must_use]
    pub fn holds(&self, value: f64) -> bool {
        value.is_finite()
            && self.above.is_none_or(|limit| value >= limit)
            && self.below.is_none_or(|limit| value <= limit)
    }
}

/// `wavemeter between 657.9 and 658.1 nm`.
impl fmt::Display for Band {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (name, unit) = (self.instrument.as_str(), self.quantity.suffix());
        match (self.above, self.below) {
            (Some(low), Some(high)) => write!(f, "{name} between {low} and {high} {unit}"),
            (Some(low), None) => write!(f, "{name} above {low} {unit}"),
            (None, Some(high)) => write!(f, "{name} below {high} {unit}"),
            (None, None) => f.write_str(name),
        }
    }
}

/// Whether a step runs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RunIf {
    /// The operator answered so.
    Answer {
        /// The name of the prompt.
        name: String,
        /// The answer.
        is: String,
    },
    /// The last reading is within limits; without one the step is skipped.
    Reading(Band),
}

impl fmt::Display for RunIf {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Answer { name, is } => write!(f, "the answer to {name} is {is}"),
            Self::Reading(band) => band.fmt(f),
        }
    }
}

/// What must hold before each main step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Condition {
    /// What.
    pub what: Holds,
    /// How long it must have held before the run goes on.
    pub hold_for: Second,
    /// How long to wait beyond that: for what depends on it to settle.
    pub settle: Second,
    /// How often it is looked at.
    pub every: Second,
    /// After so long the run gives up.
    pub give_up: Second,
}

/// What a condition is of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Holds {
    /// A reading is within limits. A wavelength is not asked for while all lasers are off.
    Reading(Band),
    /// The contact that lets a laser emit is closed. While it is open everything is made safe.
    Interlock {
        /// Which laser's.
        laser: InstrumentName,
    },
    /// There is room for what is acquired.
    DiskFree {
        /// At least so much, bytes.
        bytes: f64,
    },
}

impl fmt::Display for Holds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Reading(band) => band.fmt(f),
            Self::Interlock { laser } => write!(f, "interlock of {laser} closed"),
            Self::DiskFree { bytes } => write!(f, "at least {:.0} MB of disk free", bytes / 1e6),
        }
    }
}

/// Cameras are triggered together when their triggers went out within this time: that of the
/// dissertation's set-up.
pub const MAX_SKEW: Second = Second(0.05);

/// What holds for a whole run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rules {
    /// What must hold before each main step, in the order of the plan.
    pub conditions: Vec<Condition>,
    /// How far apart the triggers of one capture may be.
    pub max_skew: Second,
}

impl Default for Rules {
    fn default() -> Self {
        Self { conditions: Vec::new(), max_skew: MAX_SKEW }
    }
}

/// What an operator is asked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Asks {
    /// Any text.
    Text,
    /// A number, between limits if there are any.
    Number {
        /// The lower limit.
        from: Option<f64>,
        /// The upper limit.
        to: Option<f64>,
    },
    /// One of these.
    Choice(Vec<String>),
    /// Whether something is so: `yes` or `no`.
    Confirm,
}

impl Asks {
    /// The answer as it is kept, or what would be one.
    ///
    /// # Errors
    /// What is expected, for people.
    pub fn accept(&self, given: &str) -> Result<String, String> {
        let given = given.trim();
        match self {
            Self::Text if given.is_empty() => Err("some text".to_owned()),
            Self::Text => Ok(given.to_owned()),
            Self::Number { from, to } => number(given, *from, *to),
            Self::Choice(choices) => choices
                .iter()
                .find(|choice| choice.eq_ignore_ascii_case(given))
                .cloned()
                .ok_or_else(|| format!("one of {}", choices.join(", "))),
            Self::Confirm => match given.to_ascii_lowercase().as_str() {
                "y" | "yes" | "true" => Ok("yes".to_owned()),
                "n" | "no" | "false" => Ok("no".to_owned()),
                _ => Err("yes or no".to_owned()),
            },
        }
    }
}

fn number(given: &str, from: Option<f64>, to: Option<f64>) -> Result<String, String> {
    let (low, high) = (from.unwrap_or(f64::NEG_INFINITY), to.unwrap_or(f64::INFINITY));
    match given.parse::<f64>() {
        Ok(number) if number.is_finite() && (low..=high).contains(&number) => {
            Ok(number.to_string())
        }
        Ok(number) if number.is_finite() => Err(format!("a number from {low} to {high}")),
        _ => Err("a number".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_is_kept_in_one_form_or_refused_with_what_would_be_one() {
        let number = Asks::Number { from: Some(0.0), to: Some(10.0) };
        assert_eq!(number.accept(" 2.50 "), Ok("2.5".to_owned()));
        assert_eq!(number.accept("11"), Err("a number from 0 to 10".to_owned()));
        assert_eq!(number.accept("nan"), Err("a number".to_owned()));
        let choice = Asks::Choice(vec!["Left".to_owned(), "Right".to_owned()]);
        assert_eq!(choice.accept("left"), Ok("Left".to_owned()));
        assert_eq!(choice.accept("up"), Err("one of Left, Right".to_owned()));
        assert_eq!(Asks::Confirm.accept("Y"), Ok("yes".to_owned()));
        assert_eq!(Asks::Confirm.accept(""), Err("yes or no".to_owned()));
        assert_eq!(Asks::Text.accept("  "), Err("some text".to_owned()));
    }

    #[test]
    fn a_limit_is_within_and_what_is_no_number_is_not() {
        let band = Band {
            instrument: "wavemeter".into(),
            quantity: Quantity::Wavelength,
            above: Some(657.0),
            below: Some(659.0),
        };
        assert!(band.holds(657.0) && band.holds(659.0));
        assert!(!band.holds(656.999) && !band.holds(659.001) && !band.holds(f64::NAN));
        assert_eq!(band.to_string(), "wavemeter between 657 and 659 nm");
    }
}
