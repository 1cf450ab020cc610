//! The section of a wavelength drift: key figures, what they do to a measurement, hops.

use maud::{Markup, html};

use super::drift_plots;
use crate::COVERAGE_FACTOR;
use crate::numbers::{NONE, coarse, count, fixed, plain, with_expanded};
use crate::wavelength_drift::{
    Effect, ModeHop, Recommendation, WavelengthDrift, WavelengthDriftResult, minutes, not_settled,
};

/// How many readings over what time.
pub fn readings(result: &WavelengthDriftResult) -> String {
    let span = minutes(result.span_s[1] - result.span_s[0]);
    let stray = match result.stray_readings {
        0 => String::new(),
        n => format!(", {} left out", count(n, "stray one")),
    };
    format!("{} of the wavelength in {span}{stray}", result.readings)
}

/// The whole section.
pub fn section(found: &WavelengthDrift) -> Markup {
    let result = &found.result;
    html! {
        section {
            h2 { "Wavelength from a cold start" }
            (keys(result))
            @if !result.notes.is_empty() { ul { @for note in &result.notes { li { (note) } } } }
            @if !found.series.is_empty() { (drift_plots::over_time(found)) }
            (hops(&result.hops))
        }
        @if result.whole_test.is_some() {
            section { h2 { "What the change of wavelength does" } (effects(result)) }
        }
        @if result.temperature.is_some() {
            section { h2 { "Wavelength against diode temperature" } (temperature(found)) }
        }
        @if result.allan.iter().any(|segment| !segment.points.is_empty()) {
            section { h2 { "Stability" } (drift_plots::allan(result)) }
        }
    }
}

/// A value, its standard uncertainty, its unit.
fn value(value: f64, u: f64, unit: &str) -> String {
    with_expanded(value, COVERAGE_FACTOR * u, unit)
}

fn keys(result: &WavelengthDriftResult) -> Markup {
    let none = || NONE.to_owned();
    let of = |what: fn(&Recommendation) -> String| {
        result.recommendation.as_ref().map_or_else(none, what)
    };
    let warm_up = result.warm_up.as_ref();
    let over = minutes(result.settling.measurement_s);
    let rows: Vec<(String, String)> = vec![
        ("recommended warm-up".into(), recommended(result)),
        (
            format!("largest change of wavelength in {over} after it"),
            of(|r| value(r.largest_change_nm, r.largest_change_standard_uncertainty_nm, "nm")),
        ),
        (
            "mean drift after it, hops aside".into(),
            of(|r| value(r.drift_nm_per_hour, r.drift_standard_uncertainty_nm_per_hour, "nm/h")),
        ),
        (
            "time constant of warming up".into(),
            warm_up.map_or_else(none, |w| {
                let (tau, u) = (w.time_constant_s, w.time_constant_standard_uncertainty_s);
                value(tau / 60.0, u / 60.0, "min")
            }),
        ),
        (
            "rise by warming up".into(),
            warm_up.map_or_else(none, |w| value(w.rise_nm, w.rise_standard_uncertainty_nm, "nm")),
        ),
        (
            "steady drift beside it".into(),
            result.steady_drift.map_or_else(none, |d| {
                value(d.drift_nm_per_hour, d.standard_uncertainty_nm_per_hour, "nm/h")
            }),
        ),
        (
            "temperature coefficient".into(),
            result.temperature.map_or_else(none, |t| {
                value(t.coefficient_nm_per_degc, t.standard_uncertainty_nm_per_degc, "nm/°C")
            }),
        ),
        (
            "room temperature".into(),
            result.room.map_or_else(none, |room| {
                let drift = value(
                    room.drift_degc_per_hour,
                    room.drift_standard_uncertainty_degc_per_hour,
                    "°C/h",
                );
                format!("{} °C, drifting {drift}", fixed(room.mean_degc, 2))
            }),
        ),
        ("mode hops".into(), result.hops.len().to_string()),
        ("scatter of one reading (std. dev.)".into(), format!("{} nm", coarse(result.noise_nm))),
    ];
    html! {
        div.scroll { table.keys {
            tbody { @for (name, value) in rows { tr { th { (name) } td { (value) } } } }
        } }
        p.note { (how(result)) }
    }
}

fn recommended(result: &WavelengthDriftResult) -> String {
    let Some(found) = &result.recommendation else {
        return format!("none: {}", not_settled(result));
    };
    match found.warm_up_standard_uncertainty_s {
        Some(u) if u > 0.0 => value(found.warm_up_s / 60.0, u / 60.0, "min"),
        _ => minutes(found.warm_up_s),
    }
}

/// How the numbers were made.
fn how(result: &WavelengthDriftResult) -> String {
    let (within, over) =
        (result.settling.settled_within_nm, minutes(result.settling.measurement_s));
    let misfit = result.steady_drift.map_or(0.0, |d| d.misfit_nm);
    let left = if misfit > 0.0 {
        format!("; beyond noise it leaves {} nm (rms), which U contains", coarse(misfit))
    } else {
        String::new()
    };
    format!(
        "The recommended warm-up is the shortest after which the wavelength changes by at most {within} \
         nm in any measurement of {over}. The course is a settling exponential, a steady drift and \
         the hops, fitted by least squares{left}. Noise is taken from the readings; a bias that they share \
         cancels in every change. U = 2 u."
    )
}

fn hops(hops: &[ModeHop]) -> Markup {
    html! {
        @if !hops.is_empty() {
            h3 { "Mode hops" }
            div.scroll { table {
                thead { tr {
                    th { "time" br; "min" } th { "U (k = 2)" br; "min" } th { "size" br; "nm" }
                    th { "U (k = 2)" br; "nm" } th { "size / u" br; "\u{a0}" }
                } }
                tbody { @for hop in hops { (hop_row(hop)) } }
            } }
            p.note {
                "A hop is a step that stands out of the readings around it by more than 5.5 standard \
                 uncertainties: chance alone gives one in some twenty thousand series of a thousand readings."
            }
        }
    }
}

fn hop_row(hop: &ModeHop) -> Markup {
    let places = crate::numbers::decimals(COVERAGE_FACTOR * hop.by_standard_uncertainty_nm, 2);
    let time = |seconds: f64| fixed(seconds / 60.0, 2);
    html! {
        tr {
            td { (time(hop.at_s)) } td { (time(COVERAGE_FACTOR * hop.at_standard_uncertainty_s)) }
            td { (fixed(hop.by_nm, places)) }
            td { (fixed(COVERAGE_FACTOR * hop.by_standard_uncertainty_nm, places)) }
            td.u { (fixed(hop.significance, 1)) }
        }
    }
}

fn effects(result: &WavelengthDriftResult) -> Markup {
    let over = minutes(result.settling.measurement_s);
    let after = format!("in {over} after the warm-up");
    let columns: Vec<(&str, &Effect)> = [
        ("over the whole test", result.whole_test.as_ref()),
        (after.as_str(), result.after_warm_up.as_ref()),
    ]
    .into_iter()
    .filter_map(|(name, effect)| Some((name, effect?)))
    .collect();
    let beam = |order: beampose_photogrammetry::pattern::Order, deg: f64| {
        format!("beam ({}, {}), {}° from the zero order", order.m, order.n, fixed(deg, 2))
    };
    let (near, far) = result.beams.map_or_else(Default::default, |b| {
        (beam(b.neighbour, b.neighbour_deg), beam(b.outermost, b.outermost_deg))
    });
    type Row = fn(&Effect) -> String;
    let rows: [(String, Row); 5] = [
        ("change of wavelength".into(), |e| {
            value(e.wavelength_change_nm, e.wavelength_change_standard_uncertainty_nm, "nm")
        }),
        ("as a part of it".into(), |e| format!("{} %", plain(100.0 * e.relative))),
        (near, |e| in_proportion(e, e.neighbour_angle_deg, "°")),
        (far, |e| in_proportion(e, e.outermost_angle_deg, "°")),
        (format!("position of a module {} mm away", result.distance_mm), |e| {
            value(e.position_mm, e.position_standard_uncertainty_mm, "mm")
        }),
    ];
    html! {
        div.scroll { table.keys {
            thead { tr { th { } @for (name, _) in &columns { th { (name) } } } }
            tbody {
                @for (name, row) in &rows {
                    tr { th { (name) } @for (_, effect) in &columns { td { (row(effect)) } } }
                }
            }
        } }
        p.note {
            "Angles by eq. 4.12: arcsin(m(λ + Δλ)/d) − arcsin(mλ/d). All tangents of the fan change alike, \
             so a distance found with the old wavelength is off by the same part. Where the wavelength is \
             read at each capture and the fan corrected, what is left is the meter's uncertainty."
        }
    }
}

/// An effect whose relative uncertainty is that of the change.
fn in_proportion(effect: &Effect, of: f64, unit: &str) -> String {
    let relative = effect.wavelength_change_standard_uncertainty_nm / effect.wavelength_change_nm;
    value(of, (of * relative).abs(), unit)
}

fn temperature(found: &WavelengthDrift) -> Markup {
    let Some(t) = &found.result.temperature else { return html! {} };
    let flat = 100.0 * t.attenuation_relative;
    html! {
        (drift_plots::against_temperature(found))
        p.note {
            (t.pairs) " pairs; one wavelength scatters by " (coarse(t.wavelength_noise_nm)) " nm, one temperature by "
            (coarse(t.temperature_noise_degc)) " °C. Noise of the temperature would make an ordinary line too flat by "
            (plain(flat)) " % (" (fixed(t.ordinary_nm_per_degc, 5)) " nm/°C); the line here accounts for it (Deming). Each \
             mode has an offset of its own. A scale error of the thermometer is not in U."
        }
        @if let Some(lines) = &found.rig_lines {
            p { "With these lines below " code { "measurement:" } " in the rig, captures without a reading \
                 of the wavelength take it from the diode's temperature:" }
            pre { code { (lines) } }
        }
    }
}
