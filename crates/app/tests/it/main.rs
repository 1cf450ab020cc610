//! The program end to end: plans in, sessions, reports and exit codes out. Pictures are small, so
//! that a run takes seconds. The walls between crates and the state of the files are tested in
//! `tests/`.

#![expect(clippy::unwrap_used, clippy::panic, reason = "helpers of tests stop the test")]

mod bad_input;
mod beam_angles;
mod calibrating;
#[path = "../../../photogrammetry/tests/calibrating/draw.rs"]
mod draw;
mod drift;
mod exchange;
mod fault_matrix;
mod instants;
mod lab;
mod lineage;
mod other_pictures;
mod plans;
mod repeating;
mod reprocessing;
#[cfg(unix)]
mod resuming;
mod running;
mod score;
mod stopping;
mod stored;
mod unsolvable;
mod wavelength_use;
#[cfg(unix)]
mod wires;
