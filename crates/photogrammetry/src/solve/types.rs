//! What solving a capture gives: plain data that the store keeps and the report shows.

use std::collections::BTreeMap;

use beampose_core::Pose;
use serde::{Deserialize, Serialize};

use crate::pattern::Order;
use crate::wavelength::Wavelength;

/// How the module is found from the observations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// The dissertation's least squares on the angles between neighbouring beams (eq. 3.4).
    InterBeamAngles,
    /// The same angles weighted by their full covariance.
    InterBeamAnglesGls,
    /// Six unknowns from the distances of the dots in space from their beams, weighted.
    RayFit,
    /// The module as a camera inside the bundle adjustment (chapter 5).
    VirtualCamera,
    /// All captures of the session in one adjustment.
    SessionAdjustment,
}

impl Method {
    /// Every method, in the order in which reports show them.
    pub const ALL: [Self; 5] = [
        Self::InterBeamAngles,
        Self::InterBeamAnglesGls,
        Self::RayFit,
        Self::VirtualCamera,
        Self::SessionAdjustment,
    ];

    /// The methods that need no other capture: those of live solving.
    pub const OF_A_CAPTURE: [Self; 4] =
        [Self::InterBeamAngles, Self::InterBeamAnglesGls, Self::RayFit, Self::VirtualCamera];

    /// What is solved where nobody says with what: the dissertation's two.
    pub const USUAL: [Self; 2] = [Self::InterBeamAngles, Self::VirtualCamera];

    /// The name in files and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::InterBeamAngles => "inter-beam-angles",
            Self::InterBeamAnglesGls => "inter-beam-angles-gls",
            Self::RayFit => "ray-fit",
            Self::VirtualCamera => "virtual-camera",
            Self::SessionAdjustment => "session-adjustment",
        }
    }
}

/// What an observation is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Subject {
    /// The dot of this beam.
    Dot(Order),
    /// The target of this code.
    Target(u16),
}

/// A measured image point that took part in the adjustment.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Observation {
    /// What it is of.
    pub subject: Subject,
    /// Where, pixels.
    pub at: [f64; 2],
    /// Covariance, square pixels.
    pub covariance: [[f64; 2]; 2],
    /// Observed minus computed after the adjustment, pixels.
    pub residual: [f64; 2],
    /// False where it was found to be an outlier and left out.
    pub used: bool,
}

/// One camera in a solved capture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraSolution {
    /// Its projection centre in the world, millimetres.
    pub position_mm: [f64; 3],
    /// (w, x, y, z) of `world_from_camera`.
    pub quaternion_wxyz: [f64; 4],
    /// Its observations.
    pub observations: Vec<Observation>,
    /// Image points found that nothing was made of: stray spots, unlabelled dots.
    pub strays: Vec<[f64; 2]>,
}

/// A dot in space.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DotInSpace {
    /// Its beam.
    pub order: Order,
    /// Where it stands on the wall, world, millimetres.
    pub xyz_mm: [f64; 3],
    /// Covariance, square millimetres.
    pub covariance: [[f64; 3]; 3],
}

/// One method's result for one capture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MethodResult {
    /// Which method.
    pub method: Method,
    /// The pose, or why there is none.
    pub pose: Result<Pose, String>,
    /// Beams that took part.
    pub beams_used: usize,
    /// Root of the a posteriori variance of unit weight: near 1 when the stated noise is true.
    pub sigma0: f64,
    /// The wavelength used: read, or estimated with the reading as prior.
    pub wavelength_nm: f64,
    /// What was known of it before, and whence; `None` of what an earlier version solved.
    #[serde(default)]
    pub wavelength: Option<Wavelength>,
    /// True where more than one labelling fits as well and the prior decided.
    pub ambiguous: bool,
}

/// Wall-clock seconds per stage; filled in by whoever has a clock.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct StageSeconds {
    /// Pictures from bytes.
    pub decode: f64,
    /// Dots and targets in the pictures.
    pub detect: f64,
    /// Cameras oriented, beams named.
    pub identify: f64,
    /// Adjustment and poses.
    pub adjust: f64,
}

/// Everything that a solved capture gives.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CaptureSolution {
    /// Cameras by name, those that could be oriented.
    pub cameras: BTreeMap<String, CameraSolution>,
    /// Dots in space, by order.
    pub dots: Vec<DotInSpace>,
    /// One result for each method asked for.
    pub results: Vec<MethodResult>,
    /// Remarks for people: a camera left out, targets missing.
    pub notes: Vec<String>,
}
