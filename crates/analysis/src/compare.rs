//! Two processings side by side, of one session or of two: what differs, and by how much more than
//! their uncertainties explain.
//!
//! The uncertainty of a difference is made as if both were independent. Two processings of the same
//! pictures, or two sessions with the same calibrations, share errors that cancel: there it is an
//! upper bound, and a difference above it is real.

use std::collections::BTreeMap;

use beampose_core::{CaptureId, Pose};
use beampose_photogrammetry::rotation::from_wxyz;
use beampose_photogrammetry::solve::Method;
use serde::Serialize;

use crate::numbers::root;
use crate::report::ReportCapture;
use crate::translation::{PositionResult, TranslationResult};

/// Stops of the rail within this of each other are the same, millimetres.
const SAME_STOP_MM: f64 = 1e-3;

/// One of two that are compared.
#[derive(Debug, Clone, Copy)]
pub struct Side<'a> {
    /// Its captures, solved or not.
    pub captures: &'a [ReportCapture],
    /// Its result, if it has one.
    pub translation: Option<&'a TranslationResult>,
}

/// What two have in common and where they differ: B minus A.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// The poses, by method.
    pub poses: BTreeMap<Method, PoseComparison>,
    /// The results at the stops of the rail, by method.
    pub positions: BTreeMap<Method, Vec<PositionComparison>>,
}

/// The poses of one method.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct PoseComparison {
    /// Captures of the same name and setpoints with a pose on both sides.
    pub compared: usize,
    /// Of these, those with the same pose and covariance, to the bit.
    pub identical: usize,
    /// Captures with a pose in A alone.
    pub only_a: usize,
    /// Captures with a pose in B alone.
    pub only_b: usize,
    /// Root of the mean square of the distances between the positions.
    pub rms_distance_mm: Option<f64>,
    /// Captures whose positions differ by more than twice the standard uncertainty of the
    /// difference, on any axis.
    pub beyond_uncertainty: usize,
    /// Those that are not identical, in the order of A's captures.
    pub differences: Vec<PoseDifference>,
}

/// One capture, B minus A.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PoseDifference {
    /// Which capture.
    pub capture: CaptureId,
    /// Difference of the positions.
    pub difference_mm: [f64; 3],
    /// Its standard uncertainty on each axis.
    pub standard_uncertainty_mm: [f64; 3],
    /// Its length.
    pub distance_mm: f64,
    /// Angle of the rotation between both.
    pub rotation_deg: f64,
}

/// One stop of the rail, B minus A.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PositionComparison {
    /// The rail's setpoint.
    pub rail_mm: f64,
    /// Mean difference to the rail in A.
    pub a_mm: f64,
    /// Its expanded uncertainty.
    pub a_expanded_uncertainty_mm: f64,
    /// Mean difference to the rail in B.
    pub b_mm: f64,
    /// Its expanded uncertainty.
    pub b_expanded_uncertainty_mm: f64,
    /// B minus A.
    pub difference_mm: f64,
    /// Its expanded uncertainty (k = 2).
    pub expanded_uncertainty_mm: f64,
}

impl PoseComparison {
    /// The capture whose position differs most.
    #[must_use]
    pub fn largest(&self) -> Option<&PoseDifference> {
        self.differences.iter().max_by(|a, b| a.distance_mm.total_cmp(&b.distance_mm))
    }
}

/// Compares two sides.
#[must_use]
pub fn compare(a: &Side<'_>, b: &Side<'_>) -> Comparison {
    let mut poses = BTreeMap::new();
    let mut positions = BTreeMap::new();
    for method in Method::ALL {
        let compared = compare_poses(a.captures, b.captures, method);
        if compared.compared + compared.only_a + compared.only_b > 0 {
            poses.insert(method, compared);
        }
        let stops = compare_positions(stops(a, method), stops(b, method));
        if !stops.is_empty() {
            positions.insert(method, stops);
        }
    }
    Comparison { poses, positions }
}

fn stops<'a>(side: &Side<'a>, method: Method) -> &'a [PositionResult] {
    let of_method = side.translation.and_then(|result| result.methods.get(&method));
    of_method.map_or(&[], |of_method| of_method.positions.as_slice())
}

fn compare_poses(a: &[ReportCapture], b: &[ReportCapture], method: Method) -> PoseComparison {
    let mut found = PoseComparison::default();
    let others: BTreeMap<&CaptureId, &ReportCapture> = b.iter().map(|c| (&c.id, c)).collect();
    let mut squares = 0.0;
    let mut paired = 0;
    for capture in a {
        let other = others.get(&capture.id).filter(|c| c.setpoints == capture.setpoints);
        let other = other.and_then(|other| other.pose(method));
        match (capture.pose(method), other) {
            (Some(pose), Some(other)) => {
                found.compared += 1;
                paired += 1;
                if same_bits(pose, other) {
                    found.identical += 1;
                    continue;
                }
                let difference = difference(capture.id.clone(), pose, other);
                squares += difference.distance_mm.powi(2);
                let beyond = |i: usize| {
                    difference.difference_mm[i].abs() > 2.0 * difference.standard_uncertainty_mm[i]
                };
                found.beyond_uncertainty += usize::from((0..3).any(beyond));
                found.differences.push(difference);
            }
            (Some(_), None) => found.only_a += 1,
            (None, _) => {}
        }
    }
    let of_b = b.iter().filter(|c| c.pose(method).is_some()).count();
    found.only_b = of_b - paired;
    found.rms_distance_mm = (paired > 0).then(|| (squares / paired as f64).sqrt());
    found
}

fn same_bits(a: &Pose, b: &Pose) -> bool {
    let numbers = |pose: &Pose| -> Vec<u64> {
        let covariance = pose.covariance.iter().flatten();
        let all = pose.position_mm.iter().chain(&pose.quaternion_wxyz).chain(covariance);
        all.map(|number| number.to_bits()).collect()
    };
    numbers(a) == numbers(b)
}

fn difference(capture: CaptureId, a: &Pose, b: &Pose) -> PoseDifference {
    let difference_mm = [0, 1, 2].map(|i| b.position_mm[i] - a.position_mm[i]);
    let standard_uncertainty_mm = [0, 1, 2].map(|i| root(a.covariance[i][i] + b.covariance[i][i]));
    let turned = from_wxyz(a.quaternion_wxyz).angle_to(&from_wxyz(b.quaternion_wxyz));
    PoseDifference {
        capture,
        difference_mm,
        standard_uncertainty_mm,
        distance_mm: difference_mm.iter().map(|d| d * d).sum::<f64>().sqrt(),
        rotation_deg: turned.to_degrees(),
    }
}

fn compare_positions(a: &[PositionResult], b: &[PositionResult]) -> Vec<PositionComparison> {
    let pair = |a: &PositionResult| {
        let b = b.iter().find(|b| (b.rail_mm - a.rail_mm).abs() < SAME_STOP_MM)?;
        Some(PositionComparison {
            rail_mm: a.rail_mm,
            a_mm: a.mean_difference_mm,
            a_expanded_uncertainty_mm: a.expanded_uncertainty_mm,
            b_mm: b.mean_difference_mm,
            b_expanded_uncertainty_mm: b.expanded_uncertainty_mm,
            difference_mm: b.mean_difference_mm - a.mean_difference_mm,
            expanded_uncertainty_mm: a.expanded_uncertainty_mm.hypot(b.expanded_uncertainty_mm),
        })
    };
    a.iter().filter_map(pair).collect()
}
