//! Why a run could not be begun or kept. A step that fails is no error of the engine: it is in the
//! [`RunSummary`].

use beampose_core::{InstrumentName, SinkError, StepNumber};

use crate::RunSummary;

/// Why there is no properly stored run. Each text fits after "failed to run: ".
#[derive(Debug, thiserror::Error)]
pub enum EngineError {
    /// The steps need an instrument that the bench does not have: correct plan or rig.
    #[error("there is no {role} {name} on the bench{}", hint(known))]
    NoInstrument {
        /// What was asked for.
        name: InstrumentName,
        /// What it is to be.
        role: &'static str,
        /// The ones that there are.
        known: Vec<InstrumentName>,
    },
    /// The session could not be begun in the store; no step was run.
    #[error("the session could not be begun: {0}")]
    NotOpened(SinkError),
    /// What steps acquired could not be stored. The lasers were switched off at once and the
    /// session ended; `summary` says how.
    #[error("what step {} acquired could not be kept: {source}", numbers(steps))]
    NotStored {
        /// The steps that are missing in the store.
        steps: Vec<StepNumber>,
        /// Why the first of them is.
        source: SinkError,
        /// How the run ended.
        summary: Box<RunSummary>,
    },
    /// All steps are stored, the end of the session is not.
    #[error("the end of the session could not be stored: {source}")]
    NotClosed {
        /// Why.
        source: SinkError,
        /// How the run ended.
        summary: Box<RunSummary>,
    },
}

fn hint(known: &[InstrumentName]) -> String {
    if known.is_empty() {
        return String::new();
    }
    let names: Vec<_> = known.iter().map(InstrumentName::as_str).collect();
    format!("; there is {}", names.join(", "))
}

fn numbers(steps: &[StepNumber]) -> String {
    steps.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}
