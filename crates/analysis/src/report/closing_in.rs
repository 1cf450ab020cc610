//! The section of a beam-angle calibration in a session's report: the fan in short, and how each
//! closing-in went.

use std::collections::BTreeMap;

use maud::{Markup, html};

use super::axis::{Axis, Ends};
use super::plot::{Layer, Mark, Plot, Shape};
use crate::beam_angles::{BeamAngles, Trace};
use crate::numbers::{count, fixed};

/// The section.
pub fn section(angles: &BeamAngles) -> Markup {
    let traces = &angles.input.traces;
    html! {
        section {
            h2 { "Angles between beams" }
            @match &angles.found {
                Ok(found) => {
                    (super::fan::in_short(found, &angles.input.options))
                    p.note {
                        "Angles, residuals, models and budget: "
                        a href="fan.html" { "fan.html" } ". For rigs and `solve --with-pattern`: "
                        a href="fan.yaml" { "fan.yaml" } ". What was measured, for `calibrate pattern`: "
                        a href="measured.csv" { "measured.csv" } "."
                    }
                }
                Err(why) => p.note { "There is no fan: " (why) }
            }
        }
        section { h2 { "Closing in" } (course(traces)) (moves(traces)) }
    }
}

/// Off the pixel over the looks, by amount; what is below a thousandth of a pixel is drawn there.
fn course(traces: &[Trace]) -> Markup {
    const LEAST_PX: f64 = 1e-3;
    let line = |trace: &Trace| -> Vec<(f64, f64)> {
        let looks = trace.off_px.iter().enumerate();
        looks.filter_map(|(i, off)| Some((i as f64 + 1.0, (*off)?.abs().max(LEAST_PX)))).collect()
    };
    let all: Vec<Vec<(f64, f64)>> = traces.iter().map(line).collect();
    let longest = traces.iter().map(|trace| trace.off_px.len()).max().unwrap_or(1);
    let ends = all.iter().filter_map(|line| line.last().copied()).collect();
    let mut layers: Vec<Layer> = all
        .iter()
        .map(|line| Layer {
            class: "s1 line faint".to_owned(),
            shift: 0.0,
            mark: Mark::Line(line.clone()),
        })
        .collect();
    let mark = Mark::Symbols(Shape::Circle, 3.0, ends);
    layers.push(Layer { class: "s0".to_owned(), shift: 0.0, mark });
    let plot = Plot {
        title: "How far each dot stood from its pixel, look by look".to_owned(),
        x: Axis::over("look", [1.0, longest as f64], 8.0, Ends::Padded),
        y: Axis::decades("off the pixel, px", all.iter().flatten().map(|point| point.1)),
        height: 300.0,
        layers,
    };
    html! {
        figure {
            (plot.draw())
            figcaption { "How far each dot stood from its pixel along its way, look by look; a dot where each ended." }
        }
    }
}

/// How many closings-in took how many moves.
fn moves(traces: &[Trace]) -> Markup {
    let mut by_moves: BTreeMap<usize, usize> = BTreeMap::new();
    for trace in traces.iter().filter(|trace| trace.closed) {
        *by_moves.entry(trace.off_px.len()).or_default() += 1;
    }
    let open: Vec<&Trace> = traces.iter().filter(|trace| !trace.closed).collect();
    let closed: usize = by_moves.values().sum();
    html! {
        table {
            thead { tr { th { "moves" } th { "closings-in" } th { "of all" } } }
            tbody { @for (moves, times) in &by_moves {
                tr {
                    th { (moves) } td { (times) }
                    td { (fixed(100.0 * *times as f64 / closed.max(1) as f64, 1)) " %" }
                }
            } }
        }
        @if !open.is_empty() {
            p.note {
                (count(open.len(), "closing-in")) " did not come to an end: step "
                (open.iter().map(|trace| trace.step.to_string()).collect::<Vec<_>>().join(", ")) "."
            }
        }
    }
}
