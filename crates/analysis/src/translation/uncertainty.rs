//! From the poses' covariances to the uncertainty of a travelled distance.
//!
//! A stated covariance has a random part (dot centroids) and a part common to all captures of a
//! session (camera calibration, artefact, fan scale, wavelength). One pose alone does not say how
//! it divides, so the simple rules take start and end as independent, which is Table 6.4's way, and
//! do not reduce the stated part by averaging over passes. Much of the common part cancels in a
//! distance, so they err on the safe side. [`DistanceRule::Joint`] knows better.

use std::fmt;

use beampose_core::{CaptureId, Pose};
use nalgebra::{Matrix3, Vector3};

/// The joint covariance of positions, as an adjustment of the whole session gives it.
pub trait JointCovariance {
    /// Cov(position of `a`, position of `b`) in mm^2, row by row. `None` where either capture is
    /// not part of the adjustment: it is then independent of the others, with its own covariance.
    fn block(&self, a: &CaptureId, b: &CaptureId) -> Option<[[f64; 3]; 3]>;
}

/// How the covariances of two poses become the uncertainty of the distance between them.
#[derive(Clone, Copy, Default)]
pub enum DistanceRule<'a> {
    /// `u_M^2 = u_start^2 + u_end^2` with u of the stated covariance along the direction of
    /// travel, since to first order only that direction changes a distance. The mean adds the
    /// repeatability over the passes: `u^2 = s_pooled^2 / n + u_M^2 + u_s^2`.
    #[default]
    AlongTravel,
    /// As Table 6.4 prints it: u is that of all three coordinates together (Table 6.3's u_c), and
    /// the first stop carries u_start. Larger than needed: u_x and u_y hardly act on a travel in z.
    AllCoordinates,
    /// `t' Cov t` from the joint covariance, correlations between captures and passes included; no
    /// repeatability is added, since the joint covariance has the random part already.
    Joint(&'a dyn JointCovariance),
}

impl DistanceRule<'_> {
    /// The name in results.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::AlongTravel => "along_travel",
            Self::AllCoordinates => "all_coordinates",
            Self::Joint(_) => "joint",
        }
    }
}

impl fmt::Debug for DistanceRule<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Whether the poses' covariances contain the uncertainty of the artefact's scale.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StatedScale {
    /// They do not: `u_s = scale * distance` is added (eq. 6.3).
    #[default]
    Separate,
    /// They do: it is not added again, but no distance is better than the scale itself.
    Included,
}

impl StatedScale {
    /// Combines the variance of a distance with that of the scale over it.
    #[must_use]
    pub fn combine(self, variance: f64, scale_variance: f64) -> f64 {
        match self {
            Self::Separate => variance + scale_variance,
            Self::Included => variance.max(scale_variance),
        }
    }
}

/// From a pass' first stop to another stop.
#[derive(Debug, Clone, Copy)]
pub(super) struct Leg<'a> {
    /// Capture and pose at the first stop.
    pub start: (&'a CaptureId, &'a Pose),
    /// Capture and pose at the stop.
    pub end: (&'a CaptureId, &'a Pose),
}

impl Leg<'_> {
    /// True at the first stop itself.
    pub fn is_first_stop(&self) -> bool {
        self.start.0 == self.end.0
    }

    fn travel(&self) -> Vector3<f64> {
        Vector3::from(self.end.1.position_mm) - Vector3::from(self.start.1.position_mm)
    }

    /// The travelled distance, millimetres.
    pub fn distance(&self) -> f64 {
        self.travel().norm()
    }

    /// The direction of travel; zero at the first stop.
    fn direction(&self) -> Vector3<f64> {
        self.travel().try_normalize(1e-9).unwrap_or_default()
    }
}

fn position_covariance(pose: &Pose) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| pose.covariance[i][j])
}

fn along(direction: &Vector3<f64>, pose: &Pose) -> f64 {
    (direction.transpose() * position_covariance(pose) * direction)[0]
}

impl DistanceRule<'_> {
    /// Variance of one distance, without scale.
    pub(super) fn variance(&self, leg: &Leg<'_>) -> f64 {
        match self {
            Self::AlongTravel if leg.is_first_stop() => 0.0,
            Self::AlongTravel => {
                let t = leg.direction();
                along(&t, leg.start.1) + along(&t, leg.end.1)
            }
            Self::AllCoordinates => {
                let end = position_covariance(leg.end.1).trace();
                if leg.is_first_stop() {
                    return end;
                }
                position_covariance(leg.start.1).trace() + end
            }
            Self::Joint(joint) => leg_covariance(*joint, leg, leg),
        }
    }

    /// Variance of the mean of the distances of `legs`, without scale. `repeatability` is the
    /// pooled variance of one distance over passes.
    pub(super) fn mean_variance(&self, legs: &[Leg<'_>], repeatability: Option<f64>) -> f64 {
        let n = legs.len().max(1) as f64;
        match self {
            Self::AlongTravel | Self::AllCoordinates => {
                let stated = legs.iter().map(|leg| self.variance(leg)).sum::<f64>() / n;
                let moved = legs.iter().any(|leg| !leg.is_first_stop());
                stated + repeatability.filter(|_| moved).unwrap_or(0.0) / n
            }
            Self::Joint(joint) => {
                let pairs = legs.iter().flat_map(|a| legs.iter().map(move |b| (a, b)));
                pairs.map(|(a, b)| leg_covariance(*joint, a, b)).sum::<f64>() / (n * n)
            }
        }
    }
}

/// Covariance of two distances.
fn leg_covariance(joint: &dyn JointCovariance, a: &Leg<'_>, b: &Leg<'_>) -> f64 {
    if a.is_first_stop() || b.is_first_stop() {
        return 0.0;
    }
    let difference =
        block(joint, a.end, b.end) - block(joint, a.end, b.start) - block(joint, a.start, b.end)
            + block(joint, a.start, b.start);
    (a.direction().transpose() * difference * b.direction())[0]
}

fn block(
    joint: &dyn JointCovariance,
    a: (&CaptureId, &Pose),
    b: (&CaptureId, &Pose),
) -> Matrix3<f64> {
    match joint.block(a.0, b.0) {
        Some(rows) => Matrix3::from_fn(|i, j| rows[i][j]),
        None if a.0 == b.0 => position_covariance(a.1),
        None => Matrix3::zeros(),
    }
}
