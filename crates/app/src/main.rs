//! `beampose`: runs an optical position sensor by itself, from a plan in YAML to a report with
//! uncertainties. This crate is the rim: files, terminal, wiring. What it wires knows nothing of it.

mod angle_report;
mod batch;
mod calibration;
mod calibration_record;
mod camera_calibration;
mod cli;
mod conduct;
mod drift_report;
mod estimating;
mod file_lock;
mod input;
mod interruptions;
mod journal_notes;
mod loaded;
mod log;
mod notify;
mod operator;
mod origins;
mod other_inputs;
mod output;
mod pipeline;
mod progress;
mod remote;
mod rescue;
mod rig_lock;
mod session_lock;
mod session_report;
mod settings;
mod side_by_side;
mod truth;
mod wavelengths;
mod wiring;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::main()
}
