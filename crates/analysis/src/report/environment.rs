//! Readings over the session's time, and where the computing time went.

use beampose_core::{Quantity, Stamp};
use beampose_photogrammetry::solve::{Method, StageSeconds};
use maud::{Markup, html};

use super::axis::{Axis, Ends};
use super::input::{ReportInput, Trace};
use super::plot::{Layer, Mark, Plot, Shape, at, legend_entry, symbol};
use super::tables::symbol as unit_symbol;
use crate::numbers::{fixed, plain};

/// One plot per quantity that was read.
pub fn environment(input: &ReportInput) -> Markup {
    let mut quantities: Vec<Quantity> =
        input.environment.iter().filter(|t| !t.readings.is_empty()).map(|t| t.quantity).collect();
    quantities.sort();
    quantities.dedup();
    let clock = TimeUnit::of(input);
    html! {
        @if quantities.is_empty() { p.note { "No readings were taken." } }
        @for quantity in quantities { (plot(input, quantity, &clock)) }
    }
}

fn plot(input: &ReportInput, quantity: Quantity, clock: &TimeUnit) -> Markup {
    let traces: Vec<&Trace> = input
        .environment
        .iter()
        .filter(|t| t.quantity == quantity && !t.readings.is_empty())
        .collect();
    let mut layers = Vec::new();
    let mut legend = Vec::new();
    let mut points: Vec<(f64, f64)> = Vec::new();
    let estimated = if quantity == Quantity::Wavelength { estimates(input, clock) } else { vec![] };
    if !estimated.is_empty() {
        points.extend(&estimated);
        legend.push(legend_entry(
            "s1",
            &symbol(Shape::Ring, 8.0, 14.0, 7.0),
            "estimated in the adjustment (virtual camera)",
        ));
        layers.push(layer("s1", Mark::Symbols(Shape::Ring, 5.0, estimated)));
    }
    for (i, trace) in traces.iter().enumerate() {
        let class = ["s3", "s2", "s0"][i % 3];
        let line: Vec<_> = trace.readings.iter().map(|r| (clock.at(&r.at), r.value)).collect();
        points.extend(&line);
        let key = html! { polyline points="2,7 26,7" {} (symbol(Shape::Circle, 5.0, 14.0, 7.0)) };
        legend.push(legend_entry(&format!("{class} line"), &key, trace.instrument.as_str()));
        layers.push(layer(&format!("{class} line"), Mark::Line(line.clone())));
        layers.push(layer(class, Mark::Symbols(Shape::Circle, 3.0, line)));
    }
    let unit = unit_symbol(quantity.suffix());
    let figure = Plot {
        title: format!("{} over time", quantity.name()),
        x: Axis::over(
            format!("time since the start / {}", clock.name),
            points.iter().map(|p| p.0),
            8.0,
            Ends::Padded,
        ),
        y: Axis::over(
            format!("{} / {unit}", quantity.name()),
            points.iter().map(|p| p.1),
            4.0,
            Ends::AtTicks,
        ),
        height: 210.0,
        layers,
    };
    html! { figure { ul.legend { @for entry in legend { (entry) } } (figure.draw()) } }
}

fn layer(class: &str, mark: Mark) -> Layer {
    Layer { class: class.to_owned(), shift: 0.0, mark }
}

/// The wavelength as the virtual camera estimates it, capture by capture.
fn estimates(input: &ReportInput, clock: &TimeUnit) -> Vec<(f64, f64)> {
    let solved = input.captures.iter().filter_map(|c| {
        c.pose(Method::VirtualCamera)?;
        Some((clock.at(c.at.as_ref()?), c.result(Method::VirtualCamera)?.wavelength_nm))
    });
    solved.filter(|p| p.1.is_finite()).collect()
}

/// Seconds, minutes or hours, counted from the opening of the session.
struct TimeUnit {
    name: &'static str,
    seconds: f64,
    start: f64,
}

impl TimeUnit {
    fn of(input: &ReportInput) -> Self {
        let start = input.provenance.opened.monotonic.as_secs_f64();
        let read = input.environment.iter().flat_map(|t| &t.readings).map(|r| r.at);
        let taken = input.captures.iter().filter_map(|c| c.at);
        let last = read.chain(taken).map(|s| s.monotonic.as_secs_f64() - start).fold(0.0, f64::max);
        let (name, seconds) = match last {
            t if t > 3.0 * 3600.0 => ("h", 3600.0),
            t if t > 180.0 => ("min", 60.0),
            _ => ("s", 1.0),
        };
        Self { name, seconds, start }
    }

    fn at(&self, stamp: &Stamp) -> f64 {
        (stamp.monotonic.as_secs_f64() - self.start) / self.seconds
    }
}

/// Where the computing time went, summed over the captures.
pub fn stages(input: &ReportInput) -> Markup {
    let sum = |f: fn(&StageSeconds) -> f64| -> f64 {
        input.captures.iter().map(|c| f(&c.seconds)).filter(|s| s.is_finite()).sum()
    };
    let stages = [
        ("decode pictures", sum(|s| s.decode)),
        ("detect dots and targets", sum(|s| s.detect)),
        ("identify", sum(|s| s.identify)),
        ("adjust", sum(|s| s.adjust)),
    ];
    let total: f64 = stages.iter().map(|s| s.1).sum();
    if total <= 0.0 {
        return html! { p.note { "No times were recorded." } };
    }
    html! {
        p { (plain(total)) " s in all, " (plain(total / input.captures.len().max(1) as f64)) " s per capture." }
        figure.stages {
            (bar(&stages, total))
            ul.legend {
                @for (i, (name, seconds)) in stages.iter().enumerate() {
                    (legend_entry(&format!("t{i}"), &html! { rect x="6" y="1" width="16" height="12" {} },
                        &format!("{name}: {} s ({} %)", plain(*seconds), fixed(100.0 * seconds / total, 0))))
                }
            }
        }
    }
}

fn bar(stages: &[(&str, f64)], total: f64) -> Markup {
    let mut from = 0.0;
    let pieces: Vec<(usize, f64, f64)> = stages
        .iter()
        .enumerate()
        .map(|(i, (_, seconds))| {
            let piece = (i, from, 760.0 * seconds / total);
            from += piece.2;
            piece
        })
        .collect();
    html! {
        svg viewBox="0 0 760 26" preserveAspectRatio="none" role="img" aria-label="share of each stage in the computing time" {
            title { "share of each stage in the computing time" }
            @for (i, x, width) in pieces {
                rect class=(format!("t{i}")) x=(at(x)) y="0" width=(at(width)) height="26" {}
            }
        }
    }
}
