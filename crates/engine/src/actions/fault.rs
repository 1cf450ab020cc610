//! Why a step failed.

use std::time::Duration;

use beampose_core::instrument::AxisUnit;
use beampose_core::{InstrumentError, InstrumentName, Missing};

use crate::EngineError;
use crate::interlock::Trip;

/// Why a step failed, in the words of its record.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Fault {
    #[error("{name}: {source}")]
    Instrument { name: InstrumentName, source: InstrumentError },
    #[error("{name}: it read {value}, which is no number")]
    NotANumber { name: InstrumentName, value: f64 },
    #[error("{name}: the plan counts in {planned:?}, the axis in {found:?}")]
    WrongUnit { name: InstrumentName, planned: AxisUnit, found: AxisUnit },
    #[error(
        "{name}: told to move to {target} {suffix}, it reads {read:.4} {suffix}; {tolerance} {suffix} is allowed"
    )]
    NotThere { name: InstrumentName, target: f64, read: f64, suffix: &'static str, tolerance: f64 },
    #[error("{0}")]
    Laser(String),
    #[error("{}: its interlock {} while it was on", .0.laser, .0.why)]
    Interlock(Trip),
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    Several(Vec<Fault>),
    #[error("the cameras were triggered {skew:?} apart, more than {limit:?}, {times} times")]
    Skew { skew: Duration, limit: Duration, times: u32 },
    #[error("{0}")]
    Align(String),
    #[error("not done within {0:?}")]
    Deadline(Duration),
    #[error("the block that this step is in was not done within {0:?}")]
    Block(Duration),
    #[error("{name}: nobody answered within {within:?}, and the plan has no default")]
    Unanswered { name: String, within: Duration },
    #[error("{name}: there is nobody to ask, and the plan has no default; name a file of answers")]
    Nobody { name: String },
    #[error("{name}: expected {expected}, found {given:?} in the answers")]
    Refused { name: String, expected: String, given: String },
    #[error("a condition did not hold within {within:?}: {why}")]
    Condition { why: String, within: Duration },
    #[error(transparent)]
    Bench(#[from] EngineError),
}

impl Fault {
    /// One fault as it is, several together.
    pub(crate) fn of_several(mut faults: Vec<Self>) -> Result<(), Self> {
        match faults.len() {
            0 => Ok(()),
            1 => faults.pop().map_or(Ok(()), Err),
            _ => Err(Self::Several(faults)),
        }
    }

    /// What did not answer, each with its reason; empty where that is not what went wrong.
    pub(crate) fn missing(&self) -> Vec<Missing> {
        match self {
            Self::Instrument { name, .. } | Self::NotANumber { name, .. } => {
                let reason = match self {
                    Self::Instrument { source, .. } => source.to_string(),
                    _ => self.to_string(),
                };
                vec![Missing { instrument: name.clone(), reason }]
            }
            Self::Several(faults) => faults.iter().flat_map(Self::missing).collect(),
            _ => Vec::new(),
        }
    }
}
