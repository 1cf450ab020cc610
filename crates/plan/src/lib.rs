//! YAML -> `PlanFile`/`RigFile` -> validate -> `Plan`/`Rig` -> check (dry run) -> `Step`s.
//!
//! Pure: no files, no clock. The caller reads the bytes and hands them over; [`source`] turns what
//! went wrong in reading into a fault like any other.
//!
//! To add a step: a line in [`plan::file::StepFile`], one in [`plan::PlanStepKind`], its
//! expansion; the JSON Schema follows by itself.

mod analysed;
pub mod check;
pub mod estimate;
pub mod expand;
pub mod fault;
pub mod hash;
mod holds;
#[macro_use]
mod reader;
pub mod plan;
pub mod policy;
pub mod quantity;
pub mod rig;
pub mod schema;
pub mod source;
pub mod step;
mod suggest;
mod timing;
mod tree;

pub use check::{Summary, check, check_both};
pub use estimate::{Estimate, History, estimate};
pub use expand::expand;
pub use fault::{AsRead, At, Fault, Faults, Mark, Severity, Source};
pub use hash::plan_hash;
pub use plan::{
    Accept, Analyse, DriftLimits, Experiment, Limits, Method, Plan, WavelengthDrift, read_plan,
    read_plan_as_it_is,
};
pub use policy::{Condition, Holds, OnError, Policy, Rules};
pub use rig::{ClockKind, Instrument, Rig, read_rig, read_rig_as_it_is};
pub use schema::{plan_schema, rig_schema};
pub use step::{Action, Section, Step};
