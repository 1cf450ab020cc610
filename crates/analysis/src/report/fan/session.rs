//! The page of a fan that was calibrated from the photographs of sessions.

use beampose_photogrammetry::calibrate::pattern::{AngleOfPair, FanPrior, SessionFan};
use maud::{Markup, html};

use super::super::axis::{Axis, Ends};
use super::super::plot::{Layer, Mark, Plot, Shape, legend_entry, symbol};
use super::super::{InputFile, page};
use super::{degrees, number, tables};
use crate::fan_export::nearest_grid;
use crate::numbers::{count, fixed};

/// Everything that the page shows.
#[derive(Debug, Clone)]
pub struct SessionFanReport<'a> {
    /// The fan's name.
    pub name: String,
    /// The result.
    pub found: &'a SessionFan,
    /// What was known of the fan before.
    pub prior: FanPrior,
    /// Captures that took part.
    pub captures: usize,
    /// The sessions, each with the hash of its plan.
    pub sessions: &'a [InputFile],
    /// Name and version of the program.
    pub software: String,
}

/// The page, self-contained.
#[must_use]
pub fn session_fan_html(input: &SessionFanReport) -> String {
    let found = input.found;
    let body = html! {
        header {
            p.kind { "Beam angles from photographs" }
            h1 { (input.name) }
            dl.facts {
                dt { "captures" } dd { (input.captures) " of " (count(input.sessions.len(), "session")) }
                dt { "reference wavelength" } dd { (found.pattern.reference_wavelength_nm) " nm in vacuum" }
                dt { "σ₀ of the adjustment" } dd { (fixed(found.sigma0, 3)) ", near 1 where the stated noise is true" }
            }
        }
        section { h2 { "Before and after" } (before_and_after(input)) }
        section { h2 { "Angles against order" } (against_order(found)) }
        section { h2 { "All angles between neighbours" } (tables(&found.angles)) }
        section { h2 { "Provenance" }
            dl.facts { dt { "program" } dd { (input.software) } }
            table { tbody { @for s in input.sessions {
                tr { th { "session " (s.name) } td.text { "plan " code { (s.blake3) } } }
            } } }
        }
    };
    page(&format!("{} · beam angles", input.name), &body)
}

fn before_and_after(input: &SessionFanReport) -> Markup {
    let (found, u) = (input.found, input.found.pattern.u);
    let percent = |part: f64| format!("{} %", fixed(100.0 * part, 4));
    html! {
        table {
            thead { tr { th { "standard uncertainty" } th { "before" } th { "after" } } }
            tbody {
                tr { th { "common scale" } td { (percent(input.prior.scale)) } td { (percent(u.common_relative)) } }
                tr { th { "one beam alone, per axis" } td { (degrees(input.prior.beam, 5)) "°" } td { (fixed(u.angle_deg, 5)) "°" } }
            }
        }
        table {
            thead { tr { th { "nearest radial grid" } th { "value" } th { "u" } } }
            tbody { @for (name, value, u) in nearest_grid(found) {
                tr { th { (name) } td { (number(value, u, 4)) } td { (number(u, u, 1)) } }
            } }
        }
        p.note {
            "The scale changed by " (percent(found.scale)) " against the pattern before; the pictures took "
            (fixed(100.0 * found.scale_told, 0)) " % of the variance that its prior left. "
            @if found.scale_told < 0.9 {
                "They hardly tell it: a module that only moves before one flat wall looks the same with a \
                 fan that is stretched as a whole. Captures with the module turned tell it."
            }
        }
    }
}

/// Angles of the middle row and the middle column.
fn against_order(found: &SessionFan) -> Markup {
    let of = |step: (i32, i32)| -> Vec<&AngleOfPair> {
        let is_middle = |a: &&AngleOfPair| {
            let (dm, dn) = (a.pair.b.m - a.pair.a.m, a.pair.b.n - a.pair.a.n);
            (dm, dn) == step && (a.pair.a.m * dn, a.pair.a.n * dm) == (0, 0)
        };
        found.angles.iter().filter(is_middle).collect()
    };
    let kinds = [("s0", Shape::Circle, -5.0, (1, 0)), ("s1", Shape::Square, 5.0, (0, 1))];
    let (mut layers, mut places, mut values) = (Vec::new(), Vec::new(), Vec::new());
    for (class, shape, shift, step) in kinds {
        let bar = |a: &AngleOfPair| {
            let at = f64::from(a.pair.a.m * step.0 + a.pair.a.n * step.1) + 0.5;
            (at, a.angle.to_degrees(), 2.0 * a.u.to_degrees())
        };
        let bars: Vec<_> = of(step).into_iter().map(bar).collect();
        places.extend(bars.iter().map(|b| b.0));
        values.extend(bars.iter().flat_map(|b| [b.1 - b.2, b.1 + b.2]));
        let points = bars.iter().map(|b| (b.0, b.1)).collect();
        let layer = |class: String, mark| Layer { class, shift, mark };
        layers.push(layer(format!("{class} bars"), Mark::Bars(bars)));
        layers.push(layer(class.to_owned(), Mark::Symbols(shape, 7.0, points)));
    }
    let plot = Plot {
        title: "Angles of the middle row and column against order".to_owned(),
        x: Axis::over("middle of the pair, in orders from the centre", places, 11.0, Ends::Padded),
        y: Axis::over("angle / °", values, 7.0, Ends::AtTicks),
        height: 340.0,
        layers,
    };
    html! {
        figure {
            ul.legend {
                (legend_entry("s0", &symbol(Shape::Circle, 8.0, 14.0, 7.0), "middle row"))
                (legend_entry("s1", &symbol(Shape::Square, 8.0, 14.0, 7.0), "middle column"))
            }
            (plot.draw())
            figcaption { "Angles between neighbouring beams; bars are the expanded uncertainty (k = 2)." }
        }
    }
}
