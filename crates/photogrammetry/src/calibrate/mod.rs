//! Camera calibration: photographs of a flat sheet of dots, or points that another program found
//! -> interior orientation with its covariance.
//!
//! A sheet is described by `sheet` and found in a picture by `find` (discs, then a grid); points
//! found elsewhere are read by `observations`. `start` gives first values without any guess,
//! `adjust` the self-calibration, `coverage` what of the picture was seen; `stability` compares
//! calibrations that were repeated. Nothing here opens a file. The fan's calibration, from angles on
//! a rotation stage, is a room of its own: [`pattern`].
//!
//! The frame of a sheet: the first dot is the origin, x along a row, y down a column, z into the
//! sheet, millimetres.

mod adjust;
mod chi_square;
mod coverage;
mod disc_image;
mod find;
mod observations;
pub mod pattern;
mod place;
mod sheet;
mod stability;
mod start;
mod stated;
mod unknowns;

pub use adjust::{
    CalibrationError, Rejection, SelfCalibration, SolvedView, self_calibrate,
    self_calibrate_robustly,
};
pub use coverage::{COVERAGE_COLUMNS, COVERAGE_ROWS, Coverage};
pub use find::find_sheet;
pub use observations::{ObservationsError, read_observations};
pub use sheet::{ControlMark, Sheet, SheetError, read_sheet};
pub use stability::{Change, ParameterStability, Stability, StabilityError, compare};
pub use start::start_camera;
pub use stated::{Stated, read_stated, write_calibration};
pub use unknowns::{Interior, Unknowns, UnknownsError};

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

/// A point of the sheet and where it was seen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SheetPoint {
    /// On the sheet, millimetres.
    pub on_sheet: Vector2<f64>,
    /// In the picture, pixels; of a disc the centre of its ellipse.
    pub pixel: Vector2<f64>,
    /// Radius of the disc, millimetres; 0 for a point without extent, as a corner has.
    pub radius_mm: f64,
}

/// What one picture shows of the sheet.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct View {
    /// The picture's name.
    pub name: String,
    /// Its points.
    pub points: Vec<SheetPoint>,
}
