//! The page of a fan's calibration: angles against order, what each model leaves, the budget.

mod budget;
mod plots;
mod session;

pub use session::{SessionFanReport, session_fan_html};

use beampose_photogrammetry::calibrate::pattern::{
    AngleOfPair, Budget, BudgetSizes, Candidate, FanCalibration, FanFit, FanModel, FanOptions,
    MeanAngle,
};
use maud::{Markup, html};

use super::calibration::fine_decimals;
use super::{InputFile, page};
use crate::numbers::{NONE, coarse, count, fixed, optional, plain};

/// Everything that the page shows.
#[derive(Debug, Clone)]
pub struct FanReport<'a> {
    /// The fan's name.
    pub name: String,
    /// The result.
    pub found: &'a FanCalibration,
    /// How it was calibrated.
    pub options: &'a FanOptions,
    /// The budget of one angle.
    pub budget: &'a Budget,
    /// The standard uncertainties that it is made of.
    pub sizes: &'a BudgetSizes,
    /// Measurements that went in.
    pub measurements: usize,
    /// True where the wavelength was read.
    pub wavelength_was_read: bool,
    /// What went in.
    pub inputs: &'a [InputFile],
    /// The options, as they would be typed.
    pub command: String,
    /// Name and version of the program.
    pub software: String,
}

/// Decimals of an angle in degrees.
const DEGREE_DECIMALS: usize = 5;

/// The page, self-contained.
#[must_use]
pub fn fan_html(input: &FanReport) -> String {
    let body = html! {
        (header(input))
        section { h2 { "The fan" } (parameters(input.found, input.options)) }
        section { h2 { "Angles against order" } (plots::against_order(input.found)) (measured(input)) }
        section { h2 { "Residuals of each model" } (plots::residuals(input.found)) (comparison(input.found)) }
        section { h2 { "What all angles share" } (shared(input)) }
        section { h2 { "Budget of one angle" } (budget::budget(input.budget, input.sizes)) }
        section { h2 { "All angles between neighbours" } (tables(&input.found.angles)) }
        section { h2 { "Provenance" } (provenance(input)) }
    };
    page(&format!("{} · beam angles", input.name), &body)
}

fn header(input: &FanReport) -> Markup {
    let (found, fit) = (input.found, &input.found.fit);
    let wavelength =
        if input.wavelength_was_read { "each angle corrected to it" } else { "not read" };
    html! {
        header {
            p.kind { "Beam-angle calibration" }
            h1 { (input.name) }
            dl.facts {
                dt { "measured" } dd {
                    (count(found.means.len(), "pair")) " of beams, " (count(input.measurements, "angle"))
                }
                dt { "standard deviation of one angle" } dd {
                    @match found.spread {
                        Some(s) => { (degrees(s.sigma, 5)) "°, from repetitions, " (s.degrees) " degrees of freedom" },
                        None => { "nothing was repeated" },
                    }
                }
                dt { "reference wavelength" } dd {
                    (input.options.reference_wavelength_nm) " nm in vacuum, " (wavelength)
                }
                dt { "model taken" } dd { (title(fit.model)) }
                dt { "fit" } dd {
                    "χ² " (plain(fit.chi2)) " with " (fit.redundancy()) " degrees of freedom; chance gives \
                     as much with a probability of " (fixed(fit.probability(), 3))
                }
            }
        }
    }
}

/// A model's name in sentences.
fn title(model: FanModel) -> &'static str {
    match model {
        FanModel::RadialGrid => "square grid with a radial term (eq. 4.17)",
        FanModel::Grating => "crossed grating, tilted, with a radial term",
    }
}

/// Radians as degrees.
fn degrees(radians: f64, decimals: usize) -> String {
    fixed(radians.to_degrees(), decimals)
}

/// The fan within a session's report: its model's parameters.
pub(super) fn in_short(found: &FanCalibration, options: &FanOptions) -> Markup {
    html! {
        dl.facts {
            dt { "model taken" } dd { (title(found.fit.model)) }
            @if let Some(s) = found.spread {
                dt { "standard deviation of one angle" } dd { (degrees(s.sigma, 5)) "°" }
            }
        }
        (parameters(found, options))
        (plots::against_order(found))
    }
}

fn parameters(found: &FanCalibration, options: &FanOptions) -> Markup {
    let fit = &found.fit;
    let read =
        fit.model.read(&fit.parameters, options.grid_distance, options.reference_wavelength_nm);
    let u = &found.pattern.u;
    html! {
        table {
            thead { tr {
                th { "parameter" } th { "value" } th { "u, scatter" } th { "u, shared" } th { "u" } th { "U (k = 2)" }
            } }
            tbody { @for (i, p) in read.iter().enumerate() {
                @let total = fit.covariance[(i, i)].max(0.0).sqrt() * p.slope.abs();
                @let random = fit.random[(i, i)].max(0.0).sqrt() * p.slope.abs();
                @let common = (total * total - random * random).max(0.0).sqrt();
                tr {
                    th { (p.name) } td { (number(p.value, total, 4)) }
                    @for u in [random, common, total, 2.0 * total] { td { (number(u, total, 1)) } }
                }
            } }
        }
        p.note {
            @if fit.model == FanModel::RadialGrid {
                "On a plane at " (options.grid_distance) " mm. "
            }
            "In the pattern file: " (fixed(u.angle_deg, 6)) "° for one beam alone, of which "
            (degrees(found.beam_sigma, 6)) "° are what the residuals cannot exclude that a single \
             beam is off the model; " (fixed(100.0 * u.common_relative, 4)) " % common to all beams."
        }
    }
}

/// A number with two digits of its uncertainty; very small ones as powers of ten with `places`.
fn number(value: f64, u: f64, places: usize) -> String {
    if value != 0.0 && u.abs() < 1e-8 {
        return format!("{value:.places$e}").replace('-', "\u{2212}");
    }
    fixed(value, fine_decimals(u))
}

fn measured(input: &FanReport) -> Markup {
    let found = input.found;
    let distance = input.options.grid_distance;
    html! {
        details {
            summary { "Measured angles " span { "(" (count(found.means.len(), "pair")) ")" } }
            div.scroll { table {
                thead { tr {
                    th { "pair" } th.text { "axis" } th { "n" } th { "turn" br; "°" } th { "wavelength" br; "°" }
                    th { "geometry" br; "°" } th { "angle" br; "°" } th { "s of one" br; "°" }
                    th { "u of the mean" br; "°" } th { "spacing at " (distance) " mm" br; "mm" }
                } }
                tbody { @for (mean, angle) in found.means.iter().zip(&found.corrected) {
                    (measured_row(mean, *angle, spacing(&found.fit, mean, distance)))
                } }
            } }
            p.note {
                "Turn: mean of the stage's turns at the reference wavelength, the correction to it in the \
                 next column included. Angle: between the two beams, after the correction for misalignment \
                 and tilt. Spacing: of the two dots on a plane, from the model. The uncertainty of a mean has "
                (degrees(input.options.u_stage, DEGREE_DECIMALS))
                "° in it for the difference of two readings of the stage, which is the same in all \
                 repetitions."
            }
        }
    }
}

fn measured_row(mean: &MeanAngle, angle: f64, spacing: Option<f64>) -> Markup {
    let d = DEGREE_DECIMALS;
    html! {
        tr {
            th { "(" (mean.from.m) ", " (mean.from.n) ") – (" (mean.to.m) ", " (mean.to.n) ")" }
            td.text { (mean.axis.name()) }
            td { (mean.count) }
            td { (degrees(mean.turn, d)) }
            td { (degrees(mean.wavelength_correction, d)) }
            td { (degrees(angle - mean.turn, d)) }
            td { (degrees(angle, d)) }
            td { (mean.scatter.map_or_else(|| NONE.to_owned(), |s| degrees(s, d))) }
            td { (degrees(mean.u, d)) }
            td { (optional(spacing)) }
        }
    }
}

fn spacing(fit: &FanFit, mean: &MeanAngle, distance: f64) -> Option<f64> {
    Some((fit.tangent(mean.to)? - fit.tangent(mean.from)?).norm() * distance)
}

fn comparison(found: &FanCalibration) -> Markup {
    html! {
        table {
            thead { tr {
                th { "model" } th { "parameters" } th { "determined" } th { "χ²" } th { "probability" }
                th { "AICc" } th { "BIC" } th.text { }
            } }
            tbody { @for (i, c) in found.candidates.iter().enumerate() { (candidate(c, i == found.chosen)) } }
        }
        p.note {
            "Determined: how many parameters the angles tell; what a prior holds counts in part. The model \
             with the lowest corrected Akaike criterion is taken, and a simpler one where the criterion is \
             no more than 2 above it."
        }
    }
}

fn candidate(candidate: &Candidate, is_taken: bool) -> Markup {
    html! {
        tr {
            th { (candidate.model.name()) }
            td { (candidate.model.count()) }
            @match &candidate.fit {
                Ok(fit) => {
                    td { (fixed(fit.effective, 2)) } td { (fixed(fit.chi2, 2)) }
                    td { (fixed(fit.probability(), 3)) } td { (fixed(fit.aicc(), 2)) }
                    td { (fixed(fit.bic(), 2)) }
                    td.text { @if is_taken { "taken" } }
                }
                Err(why) => { td.text colspan="6" { (why) } }
            }
        }
    }
}

fn shared(input: &FanReport) -> Markup {
    let options = input.options;
    let nm = options.reference_wavelength_nm;
    let after = input.found.fit.shared;
    let rows = [
        (
            "wavelength",
            "nm",
            0.0,
            options.u_wavelength_nm,
            nm * after[0].value,
            nm * after[0].sigma,
        ),
        (
            "misalignment across the beam",
            "mm",
            options.geometry.offset[0],
            options.u_offset[0],
            after[1].value,
            after[1].sigma,
        ),
        (
            "misalignment along the beam",
            "mm",
            options.geometry.offset[1],
            options.u_offset[1],
            after[2].value,
            after[2].sigma,
        ),
    ];
    html! {
        table {
            thead { tr {
                th { } th { "before" } th { "u before" } th { "estimated" } th { "u after" } th { }
            } }
            tbody { @for (name, unit, before, u_before, value, u) in rows {
                tr {
                    th { (name) }
                    td { (coarse(before)) }
                    td { @if u_before.is_finite() { (coarse(u_before)) } @else { "not known" } }
                    td { (fixed(value, fine_decimals(u))) } td { (fixed(u, fine_decimals(u))) }
                    td.u { (unit) }
                }
            } }
        }
        p.note {
            "Wavelength and misalignment along the beam stretch every angle alike, as the pitch does: no \
             set of angles tells the three apart, so what is known of them before goes into the \
             uncertainty of the pitch as it is. A misalignment across the beam changes angles on the two \
             sides of the middle in opposite ways, and shows a little; a tilt of the grating looks the \
             same."
        }
    }
}

/// All angles, by their direction.
fn tables(angles: &[AngleOfPair]) -> Markup {
    let kinds = [
        ("horizontal", (1, 0)),
        ("vertical", (0, 1)),
        ("diagonal, down to the right", (1, 1)),
        ("diagonal, up to the right", (1, -1)),
    ];
    html! {
        @for (name, step) in kinds {
            @let of_kind: Vec<_> = angles
                .iter()
                .filter(|a| (a.pair.b.m - a.pair.a.m, a.pair.b.n - a.pair.a.n) == step)
                .collect();
            @let most = of_kind.iter().map(|a| a.u).fold(0.0, f64::max);
            @let least = of_kind.iter().map(|a| a.u).fold(f64::INFINITY, f64::min);
            details {
                summary { (of_kind.len()) " " (name) " "
                    span { "u from " (degrees(least, 5)) "° to " (degrees(most, 5)) "°" } }
                (table_of(&of_kind))
            }
        }
        p.note { "Rows run down and columns to the right, as seen from the module; degrees. The CSV has each with its uncertainty." }
    }
}

fn table_of(angles: &[&AngleOfPair]) -> Markup {
    let mut rows: Vec<i32> = angles.iter().map(|a| a.pair.a.n).collect();
    rows.sort_unstable();
    rows.dedup();
    html! {
        div.scroll { table.wide { tbody { @for row in rows {
            tr { @for a in angles.iter().filter(|a| a.pair.a.n == row) { td { (degrees(a.angle, 4)) } } }
        } } } }
    }
}

fn provenance(input: &FanReport) -> Markup {
    html! {
        dl.facts {
            dt { "program" } dd { (input.software) }
            dt { "options" } dd { code { (input.command) } }
            dt { "iterations" } dd { (input.found.fit.iterations) }
        }
        details {
            summary { "Inputs " span { (count(input.inputs.len(), "file")) ", BLAKE3" } }
            table { tbody { @for file in input.inputs {
                tr { th { (file.name) } td.text { code { (file.blake3) } } }
            } } }
        }
    }
}
