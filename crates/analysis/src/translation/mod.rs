//! The translation test (section 5.3): travelled distance against the rail.
//!
//! In each pass the distance of every position from the position at that pass' first stop is held
//! against the difference of the rail's readbacks. Does not choose methods, read plans or solve.

mod analyse;
mod distances;
mod result;
mod uncertainty;

use std::collections::BTreeMap;

use beampose_core::units::Millimetre;
use beampose_core::{CaptureId, Pose};
use beampose_photogrammetry::solve::Method;

pub use analyse::translation;
pub use result::{
    MethodTranslation, PositionResult, SingleDifference, TranslationLimits, TranslationResult,
    UncertaintyBudget,
};
pub use uncertainty::{DistanceRule, JointCovariance, StatedScale};

use crate::verdict::Limits;

/// One capture of a translation test.
#[derive(Debug, Clone, PartialEq)]
pub struct TravelCapture {
    /// Its name.
    pub id: CaptureId,
    /// The pass that it belongs to.
    pub pass: u32,
    /// Where the rail was told to be: captures of equal setpoint (to a micrometre) are one stop.
    pub setpoint: Millimetre,
    /// Where the rail says it was. A caller whose rail has no encoder passes the setpoint.
    pub readback: Millimetre,
    /// Per method a pose, or why there is none.
    pub poses: BTreeMap<Method, Result<Pose, String>>,
}

/// What the analysis is given.
#[derive(Debug, Clone)]
pub struct TranslationInput<'a> {
    /// The captures in the order in which they were taken.
    pub captures: Vec<TravelCapture>,
    /// Relative standard uncertainty of the artefact's scale (0.0004 in section 6.3).
    pub scale_relative_u: f64,
    /// Whether the poses' covariances already contain that scale.
    pub stated_scale: StatedScale,
    /// How the poses' covariances become the uncertainty of a distance.
    pub rule: DistanceRule<'a>,
    /// What the plan asks for.
    pub limits: Limits,
}
