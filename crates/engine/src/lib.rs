//! Runs the steps of a plan on instruments.
//!
//! A pure state machine ([`machine`]) decides what comes next; a thin runner does it and tells the
//! machine how it went. What a step acquired is durable in the [`beampose_core::RunSink`] before
//! the next step begins. Displays and the solving pipeline look on through [`Observers`] and can
//! neither delay nor end a run. Lasers are switched off in one place, [`safe_state`]. The engine
//! knows no SQL and no concrete driver.
//!
//! To add an action: a variant in `beampose_plan::Action`, an arm in `actions/mod.rs`.

mod actions;
mod bench;
mod closing_in;
mod control;
mod error;
mod interlock;
pub mod machine;
mod observe;
mod operator;
mod real_clock;
mod resume;
mod runner;
pub mod safe_state;
mod sight;
#[cfg(test)]
mod tests;

pub use bench::Bench;
pub use control::{Control, Wish};
pub use error::EngineError;
pub use observe::{CaptureSummary, Notice, Observer, Observers};
pub use operator::{Nobody, Operator, Question};
pub use real_clock::RealClock;
pub use resume::{Earlier, restoration};
pub use runner::{RunSummary, StepFailure, Surroundings, resume, run};
pub use sight::Sight;
