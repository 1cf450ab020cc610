//! The plots of a translation test: differences along the rail, and what a line leaves.

use beampose_photogrammetry::solve::Method;
use maud::{Markup, html};

use super::axis::{Axis, Ends};
use super::plot::{Layer, Mark, Plot, Shape, legend_entry, symbol};
use crate::translation::{MethodTranslation, TranslationResult};

/// Limits further out than this many times the data are named, not drawn: the plot would show
/// nothing but them.
const LIMIT_IN_VIEW: f64 = 4.0;

/// How far series at one place stand apart, in drawing units.
const APART: f64 = 9.0;

/// How far single passes stand beside their mean, so that its bar does not hide them.
const BESIDE: f64 = 7.0;

/// CSS class and symbol of a method, the same wherever it is drawn.
pub fn look(method: Method) -> (&'static str, Shape) {
    match method {
        Method::InterBeamAngles => ("s0", Shape::Circle),
        Method::InterBeamAnglesGls => ("s4", Shape::Square),
        Method::RayFit => ("s5", Shape::Circle),
        Method::VirtualCamera => ("s1", Shape::Square),
        Method::SessionAdjustment => ("s2", Shape::Circle),
    }
}

/// A method's name in sentences and headings.
pub fn title(method: Method) -> &'static str {
    match method {
        Method::InterBeamAngles => "inter-beam angles",
        Method::InterBeamAnglesGls => "weighted inter-beam angles",
        Method::RayFit => "ray fit",
        Method::VirtualCamera => "virtual camera",
        Method::SessionAdjustment => "session adjustment",
    }
}

/// Every method with its place side by side.
fn shifted(result: &TranslationResult) -> impl Iterator<Item = (Method, f64, &MethodTranslation)> {
    let n = result.methods.len() as f64;
    result.methods.iter().enumerate().map(move |(i, (method, of_method))| {
        (*method, (i as f64 - (n - 1.0) / 2.0) * APART, of_method)
    })
}

fn layer(class: &str, kind: &str, shift: f64, mark: Mark) -> Layer {
    Layer { class: format!("{class} {kind}").trim_end().to_owned(), shift, mark }
}

/// Mean differences with their expanded uncertainties, single passes, fitted lines and limits.
pub fn differences(result: &TranslationResult) -> Markup {
    let values = drawn(result);
    let reach = values.iter().fold(0.0, |r: f64, v| r.max(v.abs()));
    let limits = &result.limits.max_abs_difference_mm;
    let in_view: Vec<(Method, f64)> = limits
        .iter()
        .filter(|(_, l)| **l <= LIMIT_IN_VIEW * reach)
        .map(|(m, l)| (*m, *l))
        .collect();
    let values = values.into_iter().chain(in_view.iter().flat_map(|(_, l)| [-l, *l]));
    let rails = result.methods.values().flat_map(|m| m.positions.iter().map(|p| p.rail_mm));
    let mut layers = vec![layer("zero", "", 0.0, Mark::Level(0.0, String::new()))];
    let shown: Vec<Method> = in_view.iter().map(|(m, _)| *m).collect();
    for (_, limit) in &in_view {
        let text = |sign: &str| format!("limit {sign}{limit}");
        layers.push(layer("limit", "", 0.0, Mark::Level(*limit, text("+"))));
        layers.push(layer("limit", "", 0.0, Mark::Level(-*limit, text("\u{2212}"))));
    }
    for (method, shift, of_method) in shifted(result) {
        layers.extend(difference_layers(method, shift, of_method));
    }
    let plot = Plot {
        title: "Difference between measured distance and rail travel against rail position"
            .to_owned(),
        x: Axis::over("rail position / mm", rails, 9.0, Ends::Padded),
        y: Axis::over("measured distance − rail travel / mm", values, 7.0, Ends::AtTicks),
        height: 360.0,
        layers,
    };
    html! {
        figure {
            (legend(result))
            (plot.draw())
            figcaption {
                "Mean over the passes of measured distance minus rail travel; bars are the expanded \
                 uncertainty U of the mean (k = 2). Faint symbols are single passes. At the first \
                 stop the difference is 0 by definition. Symbols of one stop stand a little apart \
                 so that none hides another."
                @for (method, limit) in limits.iter().filter(|(m, _)| !shown.contains(m)) {
                    " The limit of ±" (limit) " mm (" (method.name()) ") lies outside the plot."
                }
            }
        }
    }
}

/// Every finite value that is drawn: ends of bars and single passes.
fn drawn(result: &TranslationResult) -> Vec<f64> {
    let bars = result.methods.values().flat_map(|m| &m.positions).flat_map(|p| {
        let (value, half) = (p.mean_difference_mm, p.expanded_uncertainty_mm);
        [value - half, value + half]
    });
    let singles = result.methods.values().flat_map(|m| &m.differences).map(|d| d.difference_mm);
    bars.chain(singles).filter(|v| v.is_finite()).collect()
}

fn difference_layers(method: Method, shift: f64, of_method: &MethodTranslation) -> Vec<Layer> {
    let (class, shape) = look(method);
    let moved = of_method.differences.iter().filter(|d| !d.first_stop);
    let singles: Vec<_> = moved.map(|d| (d.rail_mm, d.difference_mm)).collect();
    let stops = &of_method.positions;
    let bars = stops.iter().map(|p| (p.rail_mm, p.mean_difference_mm, p.expanded_uncertainty_mm));
    let means: Vec<_> = stops.iter().map(|p| (p.rail_mm, p.mean_difference_mm)).collect();
    let beside = shift + if shift < 0.0 { -BESIDE } else { BESIDE };
    let mut layers = vec![layer(class, "faint", beside, Mark::Symbols(shape, 4.0, singles))];
    if let Some(line) = of_method.line() {
        let ends = stops.iter().map(|p| (p.rail_mm, line.at(p.travel_mm) - p.travel_mm)).collect();
        layers.push(layer(class, "fit", 0.0, Mark::Line(ends)));
    }
    let bars = bars.filter(|b| b.2 > 0.0).collect();
    layers.push(layer(class, "bars", shift, Mark::Bars(bars)));
    layers.push(layer(class, "", shift, Mark::Symbols(shape, 7.0, means)));
    layers
}

/// What the fitted lines leave, against travel.
pub fn fit_residuals(result: &TranslationResult) -> Markup {
    let mut layers = vec![layer("zero", "", 0.0, Mark::Level(0.0, String::new()))];
    let mut travels = Vec::new();
    let mut values = vec![0.0];
    for (method, shift, of_method) in shifted(result) {
        let Some(line) = of_method.line() else { continue };
        let (class, shape) = look(method);
        let left = |travel: f64, difference: f64| (travel, travel + difference - line.at(travel));
        let means: Vec<_> =
            of_method.positions.iter().map(|p| left(p.travel_mm, p.mean_difference_mm)).collect();
        let moved = of_method.differences.iter().filter(|d| !d.first_stop);
        let singles: Vec<_> = moved.map(|d| left(d.travel_mm, d.difference_mm)).collect();
        travels.extend(means.iter().map(|p| p.0));
        values.extend(means.iter().chain(&singles).map(|p| p.1));
        let beside = shift + if shift < 0.0 { -BESIDE } else { BESIDE };
        layers.push(layer(class, "faint", beside, Mark::Symbols(shape, 4.0, singles)));
        layers.push(layer(class, "", shift, Mark::Symbols(shape, 7.0, means)));
    }
    let plot = Plot {
        title: "Residuals of the fitted lines against rail travel".to_owned(),
        x: Axis::over("rail travel / mm", travels, 9.0, Ends::Padded),
        y: Axis::over("distance − fitted line / mm", values, 4.0, Ends::AtTicks),
        height: 230.0,
        layers,
    };
    html! {
        figure {
            (plot.draw())
            figcaption { "What the fitted lines leave: means over the passes, and single passes (faint)." }
        }
    }
}

fn legend(result: &TranslationResult) -> Markup {
    html! {
        ul.legend {
            @for method in result.methods.keys() {
                @let (class, shape) = look(*method);
                (legend_entry(class, &symbol(shape, 8.0, 14.0, 7.0), title(*method)))
            }
            (legend_entry("s3 fit", &html! { line x1="1" x2="27" y1="7" y2="7" {} }, "fitted line − rail travel"))
        }
    }
}
