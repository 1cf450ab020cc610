//! The plots of a wavelength drift: over time, against temperature, Allan deviation.

use maud::{Markup, html};

use super::axis::{Axis, Ends};
use super::plot::{Layer, Mark, Plot, Shape, legend_entry, symbol};
use crate::numbers::{fixed, trimmed};
use crate::wavelength_drift::{
    AllanPoint, AllanSegment, PointMark, SeriesPoint, TemperatureCoefficient, WavelengthDrift,
    WavelengthDriftResult,
};

/// What is shown apart: the first six minutes, as in Fig. 4.17 (a).
const FIRST_S: f64 = 360.0;

fn layer(class: &str, mark: Mark) -> Layer {
    Layer { class: class.to_owned(), shift: 0.0, mark }
}

/// The whole test, and its first minutes where they are a small part of it.
pub fn over_time(found: &WavelengthDrift) -> Markup {
    let last = found.result.span_s[1];
    html! {
        figure {
            (legend(found))
            @if last > 2.0 * FIRST_S { (plot(found, FIRST_S)) }
            (plot(found, last))
            figcaption {
                "Readings and the fitted course"
                @if last > 2.0 * FIRST_S { ": the first six minutes, and the whole test" }
                @if found.result.recommendation.is_some() {
                    ". The band is where the course stays after the recommended warm-up"
                }
                "."
            }
        }
    }
}

fn legend(found: &WavelengthDrift) -> Markup {
    let dot = |size| symbol(Shape::Circle, size, 14.0, 7.0);
    let line = html! { line x1="1" x2="27" y1="7" y2="7" {} };
    let strays = found.series.iter().any(|p| p.mark == PointMark::Stray);
    html! {
        ul.legend {
            (legend_entry("s1 faint", &dot(5.0), "readings"))
            @if strays {
                (legend_entry("s0", &symbol(Shape::Ring, 7.0, 14.0, 7.0), "stray readings, left out"))
            }
            (legend_entry("s0 course", &line, "fitted course"))
            @if found.result.recommendation.is_some() {
                (legend_entry("band", &html! { rect x="2" y="1" width="24" height="12" {} }, "settled"))
            }
            @if !found.result.hops.is_empty() {
                (legend_entry("hop", &html! { line x1="14" x2="14" y1="0" y2="14" {} }, "mode hop"))
            }
        }
    }
}

fn plot(found: &WavelengthDrift, until_s: f64) -> Markup {
    let shown: Vec<&SeriesPoint> = found.series.iter().filter(|p| p.at_s <= until_s).collect();
    let minute = |p: &&SeriesPoint| p.at_s / 60.0;
    let is_stray = |p: &&&SeriesPoint| p.mark == PointMark::Stray;
    let read = |stray: bool| -> Vec<(f64, f64)> {
        let of = shown.iter().filter(|p| is_stray(p) == stray);
        of.map(|p| (minute(p), p.wavelength_nm)).collect()
    };
    let (readings, strays) = (read(false), read(true));
    let shown_nm = shown.iter().filter(|p| p.fitted_nm.is_finite()).map(|p| p.fitted_nm);
    let values: Vec<f64> = readings.iter().map(|p| p.1).chain(shown_nm).collect();
    let mut layers = settled(&found.result);
    layers.push(layer("s1 faint", Mark::Symbols(Shape::Circle, 3.0, readings)));
    layers.push(layer("s0", Mark::Symbols(Shape::Ring, 7.0, strays)));
    layers.extend(courses(&shown).into_iter().map(|line| layer("s0 course", Mark::Line(line))));
    for hop in &found.result.hops {
        let text = format!("{}{} nm", if hop.by_nm > 0.0 { "+" } else { "" }, fixed(hop.by_nm, 3));
        layers.push(layer("hop", Mark::Upright(hop.at_s / 60.0, text)));
    }
    let whole = until_s > FIRST_S;
    let figure = Plot {
        title: format!("wavelength over {} minutes", fixed(until_s / 60.0, 0)),
        x: Axis::over(
            "time since the light came on / min",
            shown.iter().map(|p| p.at_s / 60.0),
            10.0,
            Ends::Padded,
        ),
        y: Axis::over("wavelength in vacuum / nm", values, 5.0, Ends::AtTicks),
        height: if whole { 320.0 } else { 230.0 },
        layers,
    };
    figure.draw()
}

/// The band of the settled wavelength and the end of the warm-up.
fn settled(result: &WavelengthDriftResult) -> Vec<Layer> {
    let Some(found) = &result.recommendation else { return Vec::new() };
    let (from, to) = (found.warm_up_s / 60.0, result.span_s[1] / 60.0);
    vec![
        layer("band", Mark::Area([from, to], found.band_nm)),
        layer("mark", Mark::Upright(from, "warm-up ends".to_owned())),
    ]
}

/// The fitted course, one line for each mode: a hop is no slope.
fn courses(shown: &[&SeriesPoint]) -> Vec<Vec<(f64, f64)>> {
    let modes = shown.chunk_by(|a, b| a.mode == b.mode);
    let line = |points: &[&SeriesPoint]| {
        points.iter().map(|p| (p.at_s / 60.0, p.fitted_nm)).collect::<Vec<_>>()
    };
    modes.map(line).collect()
}

/// Wavelength against the diode's temperature, with a line for each mode.
pub fn against_temperature(found: &WavelengthDrift) -> Markup {
    let Some(fit) = &found.result.temperature else { return html! {} };
    let used = found.series.iter().filter(|p| p.mark != PointMark::Stray);
    let pairs: Vec<(f64, f64)> =
        used.filter_map(|p| Some((p.diode_degc?, p.wavelength_nm))).collect();
    let mut layers = vec![layer("s1 faint", Mark::Symbols(Shape::Circle, 3.0, pairs.clone()))];
    for line in lines(found, fit) {
        layers.push(layer("s0 course", Mark::Line(line)));
    }
    let figure = Plot {
        title: "wavelength against the diode's temperature".to_owned(),
        x: Axis::over("diode temperature / °C", pairs.iter().map(|p| p.0), 9.0, Ends::Padded),
        y: Axis::over("wavelength in vacuum / nm", pairs.iter().map(|p| p.1), 5.0, Ends::AtTicks),
        height: 320.0,
        layers,
    };
    html! {
        figure {
            (figure.draw())
            figcaption { "Readings of both at the same time, and the line of the temperature coefficient." }
        }
    }
}

/// The line of each mode through the middle of its readings.
fn lines(found: &WavelengthDrift, fit: &TemperatureCoefficient) -> Vec<Vec<(f64, f64)>> {
    let used = found.series.iter().filter(|p| p.mark != PointMark::Stray);
    let pairs: Vec<(usize, f64, f64)> =
        used.filter_map(|p| Some((p.mode, p.diode_degc?, p.wavelength_nm))).collect();
    let line = |of: &[(usize, f64, f64)]| {
        let n = of.len() as f64;
        let (degc, nm) = of.iter().fold((0.0, 0.0), |(x, y), p| (x + p.1 / n, y + p.2 / n));
        let ends = of.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| {
            (low.min(p.1), high.max(p.1))
        });
        let at = |x: f64| (x, nm + fit.coefficient_nm_per_degc * (x - degc));
        vec![at(ends.0), at(ends.1)]
    };
    pairs.chunk_by(|a, b| a.0 == b.0).map(line).collect()
}

/// Allan deviations, both axes logarithmic: what is zero has no place there.
pub fn allan(result: &WavelengthDriftResult) -> Markup {
    let points = || result.allan.iter().flat_map(drawn);
    let ends = points().flat_map(|p| {
        let half = half_bar(p);
        [p.deviation_nm - half, p.deviation_nm + half]
    });
    let figure = Plot {
        title: "overlapping Allan deviation of the wavelength over the averaging time".to_owned(),
        x: Axis::decades("averaging time τ / s", points().map(|p| p.tau_s)),
        y: Axis::decades("Allan deviation / nm", ends.collect::<Vec<_>>()),
        height: 300.0,
        layers: result.allan.iter().enumerate().flat_map(|(i, s)| deviations(i, s)).collect(),
    };
    html! {
        figure {
            ul.legend { @for (i, segment) in result.allan.iter().enumerate() { (meaning(i, segment)) } }
            (figure.draw())
            figcaption {
                "Overlapping Allan deviation (NIST SP 1065), hops stepped over, bars of one standard \
                 uncertainty. Noise of the meter falls as τ to the power −1/2, drift rises as τ: the \
                 lowest point is the longest time over which it pays to average."
            }
        }
    }
}

fn drawn(segment: &AllanSegment) -> impl Iterator<Item = &AllanPoint> {
    segment.points.iter().filter(|p| p.deviation_nm > 0.0)
}

/// Half a bar; on a logarithmic axis it must not reach zero.
fn half_bar(point: &AllanPoint) -> f64 {
    point.standard_uncertainty_nm.min(0.7 * point.deviation_nm)
}

/// Class and symbol of a part.
fn look(i: usize) -> (&'static str, Shape) {
    [("s1", Shape::Square), ("s0", Shape::Circle), ("s2", Shape::Ring)][i % 3]
}

fn deviations(i: usize, segment: &AllanSegment) -> [Layer; 3] {
    let (class, shape) = look(i);
    let points: Vec<(f64, f64)> = drawn(segment).map(|p| (p.tau_s, p.deviation_nm)).collect();
    let bars = drawn(segment).map(|p| (p.tau_s, p.deviation_nm, half_bar(p))).collect();
    [
        layer(&format!("{class} line"), Mark::Line(points.clone())),
        layer(&format!("{class} bars"), Mark::Bars(bars)),
        layer(class, Mark::Symbols(shape, 7.0, points)),
    ]
}

fn meaning(i: usize, segment: &AllanSegment) -> Markup {
    let (class, shape) = look(i);
    let text = format!("{} readings every {} s", segment.readings, trimmed(segment.interval_s));
    legend_entry(class, &symbol(shape, 8.0, 14.0, 7.0), &text)
}
