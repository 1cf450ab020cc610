//! Analysis and report through their public face, on constructed data with known answers.
#![expect(clippy::unwrap_used, clippy::panic, reason = "helpers of tests: they fail by panicking")]

mod calibration;
mod compare;
mod export;
mod report;
mod score;
mod side_by_side;
mod synthetic;
mod table_6_4;
mod translation;
mod wavelength_drift;
