//! The page of calibrations that were repeated.

use beampose_photogrammetry::calibrate::{Change, ParameterStability, Stability};
use maud::{Markup, html};

use super::axis::{Axis, Ends};
use super::calibration::fine_decimals;
use super::page;
use super::plot::{Layer, Mark, Plot, Shape};
use crate::numbers::{NONE, coarse, fixed, plain};

/// The page, self-contained.
#[must_use]
pub fn stability_html(found: &Stability) -> String {
    let body = html! {
        header {
            p.kind { "Camera stability" }
            h1 { (found.names.len()) " calibrations compared" }
            dl.facts {
                dt { "in order" } dd { (found.names.join(", ")) }
                dt { "scatter of the principal point" } dd { (plain(found.principal_point_px)) " px, both axes together" }
            }
        }
        section { h2 { "Summary" } (summary(found)) }
        section { h2 { "Parameters" } @for p in &found.parameters { (plot(p)) } }
        section { h2 { "Changes" } (changes(found)) }
    };
    page("camera stability", &body)
}

fn summary(found: &Stability) -> Markup {
    html! {
        div.scroll { table {
            thead { tr {
                th { "parameter" } th { "mean" } th { "std. dev." } th { "range" } th { "stated u" }
                th { "drift per" br; "calibration" } th { "u of the drift" } th { } th.text { "verdict" }
            } }
            tbody { @for p in &found.parameters { (row(p)) } }
        } }
        p.note {
            "Standard deviation: scatter of single calibrations. Stated u: what the calibrations say of \
             themselves, root mean square. A verdict says more than chance where chance alone gives as \
             much with a probability below " (format!("{:.1e}", found.level)) ": 5 % shared among all \
             tests of this page."
        }
    }
}

fn row(p: &ParameterStability) -> Markup {
    let places = fine_decimals(p.scatter);
    let unit = if p.parameter.is_in_pixels() { "px" } else { "" };
    let optional = |v: Option<f64>| v.map_or_else(|| NONE.to_owned(), |v| fixed(v, places + 1));
    html! {
        tr {
            th { (p.parameter) }
            td { (fixed(p.mean, places)) } td { (fixed(p.scatter, places)) } td { (fixed(p.range, places)) }
            td { (optional(mean_stated(p))) }
            td { (fixed(p.drift, places + 1)) } td { (optional(p.drift_sigma)) }
            td.u { (unit) }
            td.text { (verdict(p)) }
        }
    }
}

/// Root mean square of what is stated; `None` unless all state it.
fn mean_stated(p: &ParameterStability) -> Option<f64> {
    let all: Option<Vec<f64>> = p.stated.iter().copied().collect();
    all.map(|all| (all.iter().map(|s| s * s).sum::<f64>() / all.len().max(1) as f64).sqrt())
}

/// A parameter's verdict in words.
#[must_use]
pub fn verdict(p: &ParameterStability) -> &'static str {
    let has_jump = p.changes.iter().any(|c| c.is_significant);
    match (p.scatter_probability, p.is_drifting, has_jump, p.is_unstable) {
        (None, ..) => "no stated uncertainty to compare with",
        (_, _, true, _) => "changes from one calibration to the next",
        (_, true, ..) => "drifts",
        (_, _, _, true) => "scatters more than stated",
        _ => "within what is stated",
    }
}

fn plot(p: &ParameterStability) -> Markup {
    let points: Vec<(f64, f64)> =
        p.values.iter().enumerate().map(|(i, v)| (i as f64 + 1.0, *v)).collect();
    let bars = points.iter().zip(&p.stated).filter_map(|(at, s)| Some((at.0, at.1, 2.0 * (*s)?)));
    let bars: Vec<(f64, f64, f64)> = bars.collect();
    let shown =
        points.iter().map(|at| at.1).chain(bars.iter().flat_map(|b| [b.1 - b.2, b.1 + b.2]));
    let unit = if p.parameter.is_in_pixels() { " / px" } else { "" };
    let layer = |class: &str, mark| Layer { class: class.to_owned(), shift: 0.0, mark };
    let plot = Plot {
        title: format!("{} over the calibrations", p.parameter),
        x: Axis::over("calibration", points.iter().map(|at| at.0), 10.0, Ends::Padded),
        y: Axis::over(format!("{}{unit}", p.parameter), shown, 5.0, Ends::AtTicks),
        height: 220.0,
        layers: vec![
            layer("s1 fit", Mark::Level(p.mean, String::new())),
            layer("s1 bars", Mark::Bars(bars)),
            layer("s1", Mark::Symbols(Shape::Square, 7.0, points)),
        ],
    };
    html! { figure { (plot.draw()) figcaption { "Bars: U (k = 2) as stated. Dashed: the mean." } } }
}

fn changes(found: &Stability) -> Markup {
    let steps: Vec<(usize, &[String])> = found.names.windows(2).enumerate().collect();
    html! {
        div.scroll { table {
            thead { tr { th { "from, to" } @for p in &found.parameters { th { (p.parameter) } } } }
            tbody {
                @for (i, pair) in &steps {
                    tr {
                        th { (pair[0]) ", " (pair[1]) }
                        @for p in &found.parameters { (change(&p.changes[*i])) }
                    }
                }
            }
        } }
        p.note { "In parentheses: in units of the stated standard deviation of the difference. Marked: more than chance." }
    }
}

fn change(c: &Change) -> Markup {
    let class = c.is_significant.then_some("high");
    html! {
        td class=[class] {
            (coarse(c.difference))
            @if let Some(sigma) = c.sigma { " (" (fixed(c.difference / sigma, 1)) ")" }
        }
    }
}
