//! The section that holds several evaluations of one session side by side.

use beampose_photogrammetry::solve::Method;
use maud::{Markup, html};

use super::axis::{Axis, Ends};
use super::plot::{Layer, Mark, Plot, Shape, legend_entry, symbol};
use super::plots::title;
use crate::COVERAGE_FACTOR;
use crate::numbers::{NONE, bare_with_expanded, with_expanded};
use crate::side_by_side::Evaluation;

/// How many colours there are for processings; then they begin again.
const COLOURS: usize = 6;

/// The whole section; nothing with fewer than two.
pub fn section(all: &[Evaluation]) -> Markup {
    if all.len() < 2 {
        return html! {};
    }
    html! {
        section {
            h2 { "Side by side" }
            p.note {
                "The same pictures, evaluated in several ways. Colours are processings, symbols are \
                 methods; the report's other sections are of one processing alone."
            }
            (table(all))
            (plot(all))
        }
    }
}

fn table(all: &[Evaluation]) -> Markup {
    html! {
        div.scroll { table {
            thead { tr {
                th { "processing" } th.text { "method" } th.text { "evaluated with" }
                th { "largest mean difference" } th { "at" br; "mm" } th { "slope" }
                th { "stops within" br; "their own U" }
            } }
            tbody { @for one in all { (row(all, one)) } }
        } }
        p.note {
            "U = 2 u. It contains what each evaluation is told of its calibrations and of the wavelength: \
             where that is wrong, or where the wavelength is not corrected, differences may exceed it."
        }
    }
}

fn row(all: &[Evaluation], one: &Evaluation) -> Markup {
    let figures = one.figures();
    let none = || NONE.to_owned();
    let of_slope = figures.as_ref().and_then(|f| {
        let u = f.slope_standard_uncertainty.unwrap_or(0.0);
        f.slope.map(|slope| bare_with_expanded(slope, COVERAGE_FACTOR * u))
    });
    html! {
        tr {
            th { (key(all, one)) "\u{a0}" (one.processing) }
            td.text { (title(one.method)) }
            td.text { (one.label) }
            td { (figures.as_ref().map_or_else(none, |f| with_expanded(
                f.largest_mean_difference_mm, f.expanded_uncertainty_mm, "mm"))) }
            td { (figures.as_ref().map_or_else(none, |f| f.rail_mm.to_string())) }
            td { (of_slope.unwrap_or_else(none)) }
            td { (figures.as_ref().map_or_else(none, |f| {
                format!("{} of {}", f.stops_within_uncertainty, f.stops)
            })) }
        }
    }
}

/// The colour of a processing, the same wherever it is drawn.
fn class(all: &[Evaluation], one: &Evaluation) -> String {
    let mut numbers: Vec<i64> = all.iter().map(|other| other.processing).collect();
    numbers.dedup();
    let place = numbers.iter().position(|n| *n == one.processing).unwrap_or(0);
    format!("c{}", place % COLOURS)
}

fn shape(method: Method) -> Shape {
    match method {
        Method::InterBeamAngles | Method::InterBeamAnglesGls => Shape::Circle,
        Method::VirtualCamera | Method::RayFit => Shape::Square,
        Method::SessionAdjustment => Shape::Ring,
    }
}

fn key(all: &[Evaluation], one: &Evaluation) -> Markup {
    let drawing = symbol(shape(one.method), 8.0, 7.0, 7.0);
    html! {
        svg.key viewBox="0 0 14 14" aria-hidden="true" { g class=(class(all, one)) { (drawing) } }
    }
}

fn plot(all: &[Evaluation]) -> Markup {
    let points = |one: &Evaluation| -> Vec<(f64, f64)> {
        one.result.positions.iter().map(|p| (p.rail_mm, p.mean_difference_mm)).collect()
    };
    let layer = |class: String, mark: Mark| Layer { class, shift: 0.0, mark };
    let mut layers = vec![layer("zero".to_owned(), Mark::Level(0.0, String::new()))];
    for one in all {
        let class = class(all, one);
        layers.push(layer(format!("{class} line"), Mark::Line(points(one))));
        layers.push(layer(class, Mark::Symbols(shape(one.method), 7.0, points(one))));
    }
    let ends = |of: fn(&(f64, f64)) -> f64| -> Vec<f64> {
        all.iter().flat_map(|one| points(one).iter().map(of).collect::<Vec<_>>()).collect()
    };
    let figure = Plot {
        title: "Mean difference against rail position, evaluated in several ways".to_owned(),
        x: Axis::over("rail position / mm", ends(|p| p.0), 9.0, Ends::Padded),
        y: Axis::over("measured distance − rail travel / mm", ends(|p| p.1), 7.0, Ends::AtTicks),
        height: 360.0,
        layers,
    };
    html! {
        figure {
            ul.legend {
                @for one in all {
                    @let meaning = format!("{}: {}, {}", one.processing, title(one.method), one.label);
                    @let line = html! { polyline points="2,7 26,7" {} };
                    @let drawn = symbol(shape(one.method), 7.0, 14.0, 7.0);
                    (legend_entry(&format!("{} line", class(all, one)), &html! { (line) (drawn) }, &meaning))
                }
            }
            (figure.draw())
            figcaption {
                "Mean over the passes of measured distance minus rail travel, as in Fig. 4.22 of the \
                 dissertation, one line for each evaluation."
            }
        }
    }
}
