//! Bundle adjustment: cameras, the module as a virtual camera, and points, in one least squares.
//!
//! Unknowns: pose of every camera and module; interior orientations, their numbers free or with a
//! prior; the scale of the artefact and of the fan (wavelength, common angle error) and the errors
//! of single beams, with priors; every point. Observed: image points, beams, controls, scale bars.
//!
//! Points are eliminated first (Schur complement), poses that share no point with one another next
//! (the modules of a session, the photographs of a calibration), and what is left is dense and
//! small. Every sum runs in a fixed order: the same input gives the same bits for any number of
//! threads. Poses are (centre in mm, small rotation about the world axes in rad), so the covariance
//! of a module is what DESIGN calls the covariance of a pose, with no further propagation.
//!
//! The way of one adjustment: [`Problem`] -> `layout` (where unknowns stand) -> `structure` (who
//! touches what) -> `rows` (residuals, Jacobians) -> `normal` -> `reduce` -> `solver` (steps),
//! `rounds` (outliers) -> [`Summary`] with its [`Covariance`].

mod covariance;
mod datum;
mod layout;
mod loss;
mod normal;
mod outliers;
mod problem;
mod reduce;
mod rounds;
mod rows;
mod solver;
mod structure;
#[cfg(test)]
mod tests;

pub use covariance::{Covariance, PointCofactor};
pub use loss::Loss;
pub use outliers::{ObservationId, Tested, test_observations, variance_component};
pub use problem::{
    BeamObservation, CameraStation, Control, ImageObservation, InteriorOrientation,
    InteriorParameter, InteriorUnknown, ModuleStation, Prior, Problem, ScaleBar, SharedFan,
    Tangent,
};
pub use solver::{AdjustError, Datum, Options, Summary, adjust};
