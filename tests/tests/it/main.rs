//! Tests that cross rooms: walls between crates, and what every file must be. Sessions end to end
//! are in `crates/app/tests`.

#![expect(clippy::unwrap_used, reason = "helpers of tests stop the test")]

mod interlock;
mod layering;
mod reading_code;
mod tidy;
mod truth;
mod wavelength_drift;
