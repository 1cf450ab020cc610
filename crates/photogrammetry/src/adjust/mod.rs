//! Bundle adjustment: cameras, the module as a virtual camera, and points, in one least squares.
//!
//! Unknowns: pose of every camera and module; interior orientation of a camera with a prior; the
//! scale of the artefact and of the fan (wavelength, common angle error) with a prior; every point.
//! Points are eliminated (Schur complement), the reduced normal equations are dense and small, and
//! every sum runs in a fixed order: the same input gives the same bits for any number of threads.
//! Poses are (centre in mm, small rotation about the world axes in rad), so the covariance of a
//! module is what DESIGN calls the covariance of a pose, with no further propagation.

mod covariance;
mod linearise;
mod problem;
mod solver;

pub use covariance::{Covariance, PointCofactor};
pub use problem::{
    BeamObservation, CameraStation, Control, ImageObservation, Interior, ModuleStation, Problem,
    SharedFan, Tangent,
};
pub use solver::{AdjustError, Options, Summary, adjust};
