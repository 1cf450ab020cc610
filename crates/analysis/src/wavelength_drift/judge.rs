//! Limits and reasons.

use super::result::{DriftLimitsApplied, WavelengthDriftResult};
use crate::COVERAGE_FACTOR;
use crate::numbers::{coarse, count, fixed, trimmed, with_expanded};
use crate::verdict::{Decision, Verdict};

/// The verdict on a result, and why.
pub(super) fn judge(result: &WavelengthDriftResult) -> (Verdict, Vec<String>) {
    let limits = &result.limits;
    let judged: Vec<(Verdict, String)> = [
        limits.max_warm_up_s.map(|limit| warm_up(result, limit)),
        limits.max_drift_nm_per_hour.map(|limit| drift(result, limit)),
        limits.max_position_error_mm.map(|limit| position(result, limit)),
        limits.max_hops.map(|limit| hops(result, limit)),
    ]
    .into_iter()
    .flatten()
    .collect();
    if judged.is_empty() {
        return (Verdict::Inconclusive, vec!["the plan states no limit".to_owned()]);
    }
    let verdict = judged.iter().fold(Verdict::Pass, |worst, (one, _)| worst.worse(*one));
    (verdict, judged.into_iter().map(|(_, reason)| reason).collect())
}

/// Minutes as people read them.
pub(crate) fn minutes(seconds: f64) -> String {
    format!("{} min", trimmed(seconds / 60.0))
}

fn warm_up(result: &WavelengthDriftResult, limit: f64) -> (Verdict, String) {
    let name = "recommended warm-up";
    let Some(found) = &result.recommendation else {
        // Whether it would have settled until the limit, a shorter test does not say.
        let looked = result.span_s[1] - result.settling.measurement_s;
        let verdict = if looked >= limit { Verdict::Fail } else { Verdict::Inconclusive };
        return (verdict, format!("{name}: none; {}", not_settled(result)));
    };
    let verdict = Decision::Simple.judge(found.warm_up_s, 0.0, limit);
    let expanded = COVERAGE_FACTOR * found.warm_up_standard_uncertainty_s.unwrap_or(0.0) / 60.0;
    let value = if expanded > 0.0 {
        with_expanded(found.warm_up_s / 60.0, expanded, "min")
    } else {
        minutes(found.warm_up_s)
    };
    (verdict, format!("{name}: {value}; limit {} min", limit / 60.0))
}

/// Why there is no recommendation.
pub(crate) fn not_settled(result: &WavelengthDriftResult) -> String {
    let asked = &result.settling;
    let (within, over) = (asked.settled_within_nm, minutes(asked.measurement_s));
    if result.span_s[1] - result.span_s[0] < asked.measurement_s {
        return format!("the test is shorter than a measurement of {over}");
    }
    format!("within the test the wavelength does not stay within {within} nm over {over}")
}

fn drift(result: &WavelengthDriftResult, limit: f64) -> (Verdict, String) {
    let name = "mean drift after the warm-up";
    let Some(found) = &result.recommendation else {
        return (Verdict::Inconclusive, format!("{name}: no recommended warm-up"));
    };
    let expanded = COVERAGE_FACTOR * found.drift_standard_uncertainty_nm_per_hour;
    let verdict = Decision::Simple.judge(found.drift_nm_per_hour, expanded, limit);
    let value = with_expanded(found.drift_nm_per_hour, expanded, "nm/h");
    (verdict, format!("{name}: {value}; limit {limit} nm/h"))
}

fn position(result: &WavelengthDriftResult, limit: f64) -> (Verdict, String) {
    let name = "largest error of position after the warm-up";
    let Some(found) = &result.after_warm_up else {
        return (Verdict::Inconclusive, format!("{name}: no recommended warm-up"));
    };
    let expanded = COVERAGE_FACTOR * found.position_standard_uncertainty_mm;
    let verdict = Decision::Simple.judge(found.position_mm, expanded, limit);
    let value = with_expanded(found.position_mm, expanded, "mm");
    let at = result.distance_mm;
    (verdict, format!("{name}: {value} at a distance of {at} mm; limit {limit} mm"))
}

fn hops(result: &WavelengthDriftResult, limit: usize) -> (Verdict, String) {
    let found = result.hops.len();
    let verdict = if found <= limit { Verdict::Pass } else { Verdict::Fail };
    let each = result.hops.iter().map(|hop| {
        let expanded = COVERAGE_FACTOR * hop.by_standard_uncertainty_nm;
        let size = with_expanded(hop.by_nm, expanded, "nm");
        format!("{size} after {} min", fixed(hop.at_s / 60.0, 1))
    });
    /// More are counted, not listed.
    const LISTED: usize = 4;
    let listed: Vec<String> = each.take(LISTED).collect();
    let list = if listed.is_empty() { String::new() } else { format!(" ({})", listed.join(", ")) };
    (verdict, format!("{}{list}; at most {limit} allowed", count(found, "mode hop")))
}

/// Why nothing can be judged at all.
pub(super) fn too_few(readings: usize) -> (Verdict, Vec<String>) {
    let text = format!("{} of the wavelength: too few to analyse", count(readings, "reading"));
    (Verdict::Inconclusive, vec![text])
}

/// The noise of a reading, for a note.
pub(super) fn noise_note(noise_nm: f64, stated_nm: f64) -> String {
    format!(
        "a reading of the wavelength scatters by {} nm, more than its sensor states ({} nm)",
        coarse(noise_nm),
        coarse(stated_nm)
    )
}

impl DriftLimitsApplied {
    pub(super) fn of(limits: &super::DriftLimits) -> Self {
        Self {
            max_drift_nm_per_hour: limits.max_drift_per_hour.map(|l| l.get()),
            max_position_error_mm: limits.max_position_error.map(|l| l.get()),
            max_hops: limits.max_hops,
            max_warm_up_s: limits.max_warm_up.map(|l| l.get()),
        }
    }
}
