//! What the report says first: verdict and key results.

use beampose_photogrammetry::solve::Method;
use maud::{Markup, html};

use super::input::ReportInput;
use super::plots::title;
use super::provenance::time;
use super::tables::method_class;
use crate::COVERAGE_FACTOR;
use crate::numbers::{NONE, bare_with_expanded, coarse, fixed, percent, with_expanded};
use crate::translation::{MethodTranslation, TranslationResult};
use crate::verdict::{Decision, Verdict};

/// The head of the page.
pub fn header(input: &ReportInput) -> Markup {
    let p = &input.provenance;
    let simulated = p.seed.is_some() || p.instruments.values().any(|i| i.simulated);
    html! {
        header {
            p.kind { "Measurement report · " (input.experiment) }
            h1 { (input.title) }
            dl.facts {
                dt { "date" } dd { (time(&p.opened)) }
                dt { "session" } dd { code { (p.session) } " (" (p.outcome.as_str()) ")" }
                @if let Some(found) = &input.drift {
                    dt { "readings" } dd { (super::drift::readings(&found.result)) }
                } @else if let Some(angles) = &input.angles {
                    dt { "measured" } dd { (crate::numbers::count(angles.input.measured.len(), "angle")) }
                } @else {
                    dt { "captures" } dd { (solved(input)) }
                }
                @if simulated { dt { "instruments" } dd { "simulated, at least in part" } }
            }
        }
    }
}

fn solved(input: &ReportInput) -> String {
    if input.captures.is_empty() {
        return "none were taken".to_owned();
    }
    let by = |m: &Method| {
        let n = input.captures.iter().filter(|c| c.pose(*m).is_some()).count();
        format!("{n} solved by {}", title(*m))
    };
    let methods: Vec<String> = input.methods.iter().map(by).collect();
    format!("{} taken; {}", input.captures.len(), methods.join(", "))
}

/// The verdict and why.
pub fn verdict(input: &ReportInput) -> Markup {
    let word = match input.verdict {
        Verdict::Pass => "Pass",
        Verdict::Fail => "Fail",
        Verdict::Inconclusive => "Inconclusive",
        Verdict::Aborted => "Aborted",
        Verdict::Error => "Ended by an error",
    };
    html! {
        section class=(format!("verdict {}", input.verdict.as_str())) aria-label="verdict" {
            strong { (word) }
            ul { @for reason in &input.reasons { li { (reason) } } }
        }
    }
}

/// Key results of a translation test, a column per method.
pub fn translation(result: &TranslationResult) -> Markup {
    type Row = (&'static str, fn(&MethodTranslation) -> String);
    let rows: [Row; 6] = [
        ("largest mean difference", largest),
        ("slope of distance over rail travel", slope),
        ("offset", offset),
        ("scatter of the stops about the line", |m| millimetres(m.scatter_mm)),
        ("repeatability of one difference (std. dev.)", |m| millimetres(m.repeatability_mm)),
        ("single differences within their own U", |m| percent(m.within_expanded_uncertainty)),
    ];
    html! {
        div.scroll { table.keys {
            thead { tr {
                th { }
                @for method in result.methods.keys() {
                    th class=(method_class(*method)) { (title(*method)) }
                }
            } }
            tbody {
                @for (name, value) in rows {
                    tr { th { (name) } @for m in result.methods.values() { td { (value(m)) } } }
                }
            }
        } }
        p.note { (budget(result)) }
    }
}

fn largest(m: &MethodTranslation) -> String {
    match m.worst().filter(|_| m.differences.iter().any(|d| !d.first_stop)) {
        Some(p) => format!(
            "{} at {} mm",
            with_expanded(p.mean_difference_mm, p.expanded_uncertainty_mm, "mm"),
            p.rail_mm
        ),
        None => NONE.to_owned(),
    }
}

fn slope(m: &MethodTranslation) -> String {
    let expanded = COVERAGE_FACTOR * m.slope_standard_uncertainty.unwrap_or(0.0);
    m.slope.map_or_else(|| NONE.to_owned(), |s| bare_with_expanded(s, expanded))
}

fn offset(m: &MethodTranslation) -> String {
    let expanded = COVERAGE_FACTOR * m.offset_standard_error_mm.unwrap_or(0.0);
    m.offset_mm.map_or_else(|| NONE.to_owned(), |o| with_expanded(o, expanded, "mm"))
}

fn millimetres(value: Option<f64>) -> String {
    value.map_or_else(|| NONE.to_owned(), |v| format!("{} mm", coarse(v)))
}

/// How the uncertainties were made, in words.
fn budget(result: &TranslationResult) -> String {
    let u = &result.uncertainty;
    let (first, rest) = u.rule.split_once("; ").unwrap_or((&u.rule, ""));
    let stated = match first {
        "all_coordinates" => {
            "the stated uncertainty of start and end position, all coordinates together \
             (Table 6.4's way), and the repeatability of the mean"
        }
        "joint" => "the joint covariance of the session's positions",
        _ => {
            "the stated uncertainty of start and end position along the direction of travel, taken \
             as independent, and the repeatability of the mean"
        }
    };
    let joint = if rest.ends_with("joint") {
        "; for the session adjustment, the joint covariance of the session's positions, in which \
         what they share cancels"
    } else {
        ""
    };
    let percent = fixed(100.0 * u.scale_relative_u, 3);
    let scale = if u.scale_in_stated_covariance {
        format!("the artefact's scale ({percent} %) is part of the stated uncertainty")
    } else {
        format!("with the artefact's scale ({percent} %)")
    };
    let decision = match result.limits.decision {
        Decision::Simple => "the value alone is held against the limit",
        Decision::GuardBand => "limits are judged with a guard band of U (ISO 14253-1)",
    };
    format!(
        "Uncertainty of a mean difference: {stated}{joint}; {scale}. U = 2 u. The slope's uncertainty is \
         the scatter about the line and the artefact's scale; the offset's is the scatter alone. \
         Decision: {decision}."
    )
}
