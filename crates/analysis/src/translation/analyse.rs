//! Means, fit, uncertainties and verdict.

use std::collections::{BTreeMap, BTreeSet};

use beampose_photogrammetry::solve::Method;

use super::distances::{Distance, by_stop, distances};
use super::result::{
    MethodTranslation, PositionResult, SingleDifference, TranslationLimits, TranslationResult,
    UncertaintyBudget,
};
use super::uncertainty::{Leg, StatedScale};
use super::{TranslationInput, TravelCapture};
use crate::COVERAGE_FACTOR;
use crate::fit::LineFit;
use crate::numbers::{root, with_expanded};
use crate::verdict::Verdict;

/// Analyses a translation test.
#[must_use]
pub fn translation(input: &TranslationInput<'_>) -> TranslationResult {
    let named: BTreeSet<Method> =
        input.captures.iter().flat_map(|c| c.poses.keys().copied()).collect();
    let methods: BTreeMap<Method, MethodTranslation> =
        named.into_iter().map(|method| (method, one_method(input, method))).collect();
    let solved = input.captures.iter().filter(|c| is_solved(c, &methods)).count();
    let (verdict, reasons) = judge(input, &methods, solved);
    TranslationResult {
        experiment: "translation".to_owned(),
        verdict,
        reasons,
        captures: input.captures.len(),
        solved,
        methods,
        limits: TranslationLimits {
            max_abs_difference_mm: input
                .limits
                .max_abs_difference
                .iter()
                .map(|(method, limit)| (*method, limit.get()))
                .collect(),
            min_solved_fraction: input.limits.min_solved_fraction,
            decision: input.limits.decision,
        },
        uncertainty: UncertaintyBudget {
            rule: input.rule.name().to_owned(),
            scale_relative_u: input.scale_relative_u,
            scale_in_stated_covariance: input.stated_scale == StatedScale::Included,
            coverage_factor: COVERAGE_FACTOR,
        },
    }
}

fn is_solved(capture: &TravelCapture, methods: &BTreeMap<Method, MethodTranslation>) -> bool {
    !methods.is_empty() && methods.keys().all(|m| matches!(capture.poses.get(m), Some(Ok(_))))
}

fn one_method(input: &TranslationInput<'_>, method: Method) -> MethodTranslation {
    let (all, notes) = distances(&input.captures, method);
    let stops = by_stop(&all);
    let repeatability = pooled_variance(&stops);
    let positions: Vec<PositionResult> =
        stops.iter().filter_map(|stop| position(input, stop, repeatability)).collect();
    let differences: Vec<SingleDifference> = all.iter().map(|d| single(input, d)).collect();
    let points: Vec<(f64, f64)> =
        positions.iter().map(|p| (p.travel_mm, p.travel_mm + p.mean_difference_mm)).collect();
    let line = LineFit::through(&points);
    let slope_error = line.and_then(|l| l.slope_error);
    let mut result = MethodTranslation {
        verdict: Verdict::Inconclusive,
        solved: input
            .captures
            .iter()
            .filter(|c| matches!(c.poses.get(&method), Some(Ok(_))))
            .count(),
        max_abs_difference_mm: None,
        max_abs_difference_expanded_uncertainty_mm: None,
        slope: line.map(|l| l.slope),
        slope_standard_error: slope_error,
        slope_standard_uncertainty: slope_error.map(|u| u.hypot(input.scale_relative_u)),
        offset_mm: line.map(|l| l.offset),
        offset_standard_error_mm: line.and_then(|l| l.offset_error),
        scatter_mm: line.and_then(|l| l.scatter),
        repeatability_mm: repeatability.map(f64::sqrt),
        within_expanded_uncertainty: within(&differences),
        positions,
        differences,
        notes,
    };
    let worst = result.worst().copied();
    result.max_abs_difference_mm = worst.map(|p| p.mean_difference_mm.abs());
    result.max_abs_difference_expanded_uncertainty_mm = worst.map(|p| p.expanded_uncertainty_mm);
    result.verdict = judge_method(input, method, &result);
    result
}

/// Variance of one difference, pooled over the stops that have several; `None` with one pass.
fn pooled_variance(stops: &[Vec<&Distance<'_>>]) -> Option<f64> {
    let mut squares = 0.0;
    let mut freedom = 0_usize;
    for stop in stops.iter().filter(|s| s.iter().any(|d| !d.leg.is_first_stop())) {
        let mean = mean(stop.iter().map(|d| d.difference_mm));
        squares += stop.iter().map(|d| (d.difference_mm - mean).powi(2)).sum::<f64>();
        freedom += stop.len() - 1;
    }
    (freedom > 0).then(|| squares / freedom as f64)
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let n = values.len().max(1) as f64;
    values.sum::<f64>() / n
}

fn position(
    input: &TranslationInput<'_>,
    stop: &[&Distance<'_>],
    repeatability: Option<f64>,
) -> Option<PositionResult> {
    let first = stop.first()?;
    let travel_mm = mean(stop.iter().map(|d| d.travel_mm));
    let mean_difference_mm = mean(stop.iter().map(|d| d.difference_mm));
    let squares: f64 = stop.iter().map(|d| (d.difference_mm - mean_difference_mm).powi(2)).sum();
    let legs: Vec<Leg<'_>> = stop.iter().map(|d| d.leg).collect();
    let scale = input.scale_relative_u * mean(stop.iter().map(|d| d.leg.distance()));
    let stated = input.rule.mean_variance(&legs, repeatability);
    let u = root(input.stated_scale.combine(stated, scale * scale));
    Some(PositionResult {
        rail_mm: first.capture.setpoint.get(),
        travel_mm,
        mean_difference_mm,
        standard_uncertainty_mm: u,
        expanded_uncertainty_mm: COVERAGE_FACTOR * u,
        standard_deviation_mm: (stop.len() > 1).then(|| (squares / (stop.len() - 1) as f64).sqrt()),
        passes: stop.len(),
    })
}

fn single(input: &TranslationInput<'_>, distance: &Distance<'_>) -> SingleDifference {
    let scale = input.scale_relative_u * distance.leg.distance();
    let variance = input.stated_scale.combine(input.rule.variance(&distance.leg), scale * scale);
    SingleDifference {
        id: distance.capture.id.clone(),
        pass: distance.capture.pass,
        rail_mm: distance.capture.setpoint.get(),
        travel_mm: distance.travel_mm,
        difference_mm: distance.difference_mm,
        expanded_uncertainty_mm: COVERAGE_FACTOR * root(variance),
        first_stop: distance.leg.is_first_stop(),
    }
}

fn within(differences: &[SingleDifference]) -> Option<f64> {
    let moved: Vec<_> = differences.iter().filter(|d| !d.first_stop).collect();
    let inside =
        moved.iter().filter(|d| d.difference_mm.abs() <= d.expanded_uncertainty_mm).count();
    (!moved.is_empty()).then(|| inside as f64 / moved.len() as f64)
}

/// The verdict on the difference limit. Every stop is judged, since with a guard band the stop
/// with the largest difference need not be the one that decides.
fn judge_method(
    input: &TranslationInput<'_>,
    method: Method,
    result: &MethodTranslation,
) -> Verdict {
    let Some(limit) = input.limits.max_abs_difference.get(&method) else {
        return Verdict::Inconclusive;
    };
    if !result.differences.iter().any(|d| !d.first_stop) {
        return Verdict::Inconclusive;
    }
    let judged = result.positions.iter().filter(|p| p.travel_mm > 0.0).map(|p| {
        let (value, expanded) = (p.mean_difference_mm, p.expanded_uncertainty_mm);
        input.limits.decision.judge(value, expanded, limit.get())
    });
    judged.fold(Verdict::Pass, Verdict::worse)
}

fn judge(
    input: &TranslationInput<'_>,
    methods: &BTreeMap<Method, MethodTranslation>,
    solved: usize,
) -> (Verdict, Vec<String>) {
    let mut verdict = None;
    let mut reasons = Vec::new();
    let mut note = |one: Verdict, reason: String| {
        verdict = Some(verdict.map_or(one, |v: Verdict| v.worse(one)));
        reasons.push(reason);
    };
    for (method, limit) in &input.limits.max_abs_difference {
        match methods.get(method) {
            Some(result) => note(result.verdict, difference_reason(*method, result, limit.get())),
            None => note(Verdict::Inconclusive, format!("{}: no result", method.name())),
        }
    }
    if let Some(least) = input.limits.min_solved_fraction {
        let fraction = solved as f64 / input.captures.len().max(1) as f64;
        let one = if fraction >= least { Verdict::Pass } else { Verdict::Fail };
        let of = input.captures.len();
        note(
            one,
            format!("{solved} of {of} captures solved; at least {:.0} % asked", 100.0 * least),
        );
    }
    if input.captures.is_empty() {
        return (Verdict::Inconclusive, vec!["no captures".to_owned()]);
    }
    match verdict {
        Some(verdict) => (verdict, reasons),
        None => (Verdict::Inconclusive, vec!["the plan states no limit".to_owned()]),
    }
}

fn difference_reason(method: Method, result: &MethodTranslation, limit: f64) -> String {
    let name = method.name();
    let moved = result.differences.iter().any(|d| !d.first_stop);
    let Some(worst) = result.worst().filter(|_| moved) else {
        return format!("{name}: no distance to judge");
    };
    let (value, expanded) = (worst.mean_difference_mm, worst.expanded_uncertainty_mm);
    let near = if (value.abs() - limit).abs() < expanded { ", within U of it" } else { "" };
    let value = with_expanded(value, expanded, "mm");
    format!(
        "{name}: largest mean difference {value} at rail {} mm; limit {limit} mm{near}",
        worst.rail_mm
    )
}
