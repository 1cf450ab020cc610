//! The result of a translation test, as it is stored and printed.

use std::collections::BTreeMap;

use beampose_core::CaptureId;
use beampose_photogrammetry::solve::Method;
use serde::{Deserialize, Serialize};

use crate::fit::LineFit;
use crate::verdict::{Decision, Verdict};

/// The result of a translation test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TranslationResult {
    /// `translation`.
    pub experiment: String,
    /// The most serious verdict over methods and limits.
    pub verdict: Verdict,
    /// Why, one sentence each.
    pub reasons: Vec<String>,
    /// Captures taken.
    pub captures: usize,
    /// Captures in which every method gives a pose.
    pub solved: usize,
    /// Per method.
    pub methods: BTreeMap<Method, MethodTranslation>,
    /// The limits that were applied.
    pub limits: TranslationLimits,
    /// How uncertainties were made.
    pub uncertainty: UncertaintyBudget,
}

/// The limits as applied, in numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TranslationLimits {
    /// Largest mean difference by amount, for the methods that are judged.
    pub max_abs_difference_mm: BTreeMap<Method, f64>,
    /// Smallest fraction of solved captures.
    pub min_solved_fraction: Option<f64>,
    /// The decision rule.
    pub decision: Decision,
}

/// How uncertainties were made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UncertaintyBudget {
    /// Name of the [`crate::DistanceRule`].
    pub rule: String,
    /// Relative standard uncertainty of the artefact's scale.
    pub scale_relative_u: f64,
    /// True where the poses' covariances contain the scale, so that it was not added again.
    pub scale_in_stated_covariance: bool,
    /// k of every expanded uncertainty.
    pub coverage_factor: f64,
}

/// One method in a translation test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MethodTranslation {
    /// This method's verdict on the difference limit.
    pub verdict: Verdict,
    /// Captures with a pose.
    pub solved: usize,
    /// Per stop of the rail, by setpoint.
    pub positions: Vec<PositionResult>,
    /// The largest mean difference by amount, over the stops.
    pub max_abs_difference_mm: Option<f64>,
    /// Expanded uncertainty of that mean difference.
    pub max_abs_difference_expanded_uncertainty_mm: Option<f64>,
    /// Slope of mean distance over rail travel, by stop, first stop included as in Fig. 5.6.
    pub slope: Option<f64>,
    /// Standard error of the slope from the scatter about the line.
    pub slope_standard_error: Option<f64>,
    /// That combined with the artefact's scale, which turns every slope alike.
    pub slope_standard_uncertainty: Option<f64>,
    /// Offset of that line.
    pub offset_mm: Option<f64>,
    /// Standard error of the offset from the scatter about the line.
    pub offset_standard_error_mm: Option<f64>,
    /// Standard deviation of the stops about the line.
    pub scatter_mm: Option<f64>,
    /// Standard deviation of a single difference, pooled over the stops.
    pub repeatability_mm: Option<f64>,
    /// Fraction of single differences within their own expanded uncertainty; the first stops,
    /// whose difference is 0 by definition, do not count.
    pub within_expanded_uncertainty: Option<f64>,
    /// Every single difference, in the order of the captures.
    pub differences: Vec<SingleDifference>,
    /// What was left out, and why.
    pub notes: Vec<String>,
}

impl TranslationResult {
    /// This result with the methods of another one on the same captures, whose uncertainties were
    /// made by another rule.
    #[must_use]
    pub fn merged(mut self, other: Self) -> Self {
        self.verdict = self.verdict.worse(other.verdict);
        let new = other.reasons.into_iter().filter(|r| !self.reasons.contains(r));
        self.reasons.extend(new.collect::<Vec<_>>());
        self.solved = self.solved.min(other.solved);
        let names: Vec<&str> = other.methods.keys().map(|m| m.name()).collect();
        let rule = format!("; {}: {}", names.join(", "), other.uncertainty.rule);
        self.uncertainty.rule.push_str(&rule);
        self.methods.extend(other.methods);
        self.limits.max_abs_difference_mm.extend(other.limits.max_abs_difference_mm);
        self
    }
}

impl MethodTranslation {
    /// The fitted line, if there is one.
    #[must_use]
    pub fn line(&self) -> Option<LineFit> {
        Some(LineFit {
            slope: self.slope?,
            slope_error: self.slope_standard_error,
            offset: self.offset_mm?,
            offset_error: self.offset_standard_error_mm,
            scatter: self.scatter_mm,
        })
    }

    /// The stop with the largest mean difference by amount.
    #[must_use]
    pub fn worst(&self) -> Option<&PositionResult> {
        self.positions
            .iter()
            .max_by(|a, b| a.mean_difference_mm.abs().total_cmp(&b.mean_difference_mm.abs()))
    }
}

/// One stop of the rail.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PositionResult {
    /// The rail's setpoint.
    pub rail_mm: f64,
    /// Mean travel of the rail from the passes' first stops, by readback.
    pub travel_mm: f64,
    /// Mean over the passes of measured distance minus rail travel.
    pub mean_difference_mm: f64,
    /// Standard uncertainty of that mean.
    pub standard_uncertainty_mm: f64,
    /// U = 2 u.
    pub expanded_uncertainty_mm: f64,
    /// Standard deviation over the passes; absent with one pass.
    pub standard_deviation_mm: Option<f64>,
    /// Differences that went into the mean.
    pub passes: usize,
}

/// One measured distance against the rail.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SingleDifference {
    /// The capture.
    pub id: CaptureId,
    /// Its pass.
    pub pass: u32,
    /// The rail's setpoint.
    pub rail_mm: f64,
    /// Travel of the rail from the pass' first stop, by readback.
    pub travel_mm: f64,
    /// Measured distance minus that travel.
    pub difference_mm: f64,
    /// Expanded uncertainty of this difference alone.
    pub expanded_uncertainty_mm: f64,
    /// True at the pass' first stop, where the difference is 0 by definition.
    pub first_stop: bool,
}
