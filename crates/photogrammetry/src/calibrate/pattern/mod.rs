//! Calibration of the fan from angles between its beams, measured on a rotation stage (section 4.2
//! of the dissertation): mean angles at the reference wavelength -> a model of the fan, its
//! covariance, and the angle between every pair of neighbours.
//!
//! `measured` is what was read, `geometry` how far a stage turns between two beams, `models` how
//! directions follow from a few parameters, `means` the correction to the reference wavelength, `fit`
//! the weighted least squares, `choice` which model to take, `result` the pattern that follows,
//! `budget` what a single angle is worth (Table 4.1). `from_session` needs no stage: the fan as the
//! photographs of a session show it. Radians and millimetres; nothing here opens a
//! file.
//!
//! To add a model of the fan: a variant of [`FanModel`] with its parameters and tangents.

mod budget;
mod choice;
mod fit;
mod from_session;
mod geometry;
mod means;
mod measured;
mod models;
mod result;

pub use budget::{Budget, BudgetSizes, BudgetSource, budget};
pub use choice::{Candidate, choose};
pub use fit::{FanFit, FanFitError, Nuisance, fit_fan};
pub use from_session::{FanPrior, SessionFan, calibrate_from_session, fan_of_session};
pub use geometry::{
    StageGeometry, along_misalignment, cross_misalignment, dot_across, dot_height,
    wavelength_change,
};
pub use means::{AngleSpread, MeanAngle, mean_angles, spread};
pub use measured::{MeasuredAngle, MeasuredError, StageAxis, read_measured, write_measured};
pub use models::{FanModel, FanParameter};
pub use result::{
    AngleOfPair, FanCalibration, FanOptions, calibrate_fan, pattern_of, write_fan_angles,
};
