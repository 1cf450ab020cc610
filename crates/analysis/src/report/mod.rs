//! The report of a session: one HTML page that needs nothing else.
//!
//! No scripts and no external resources: pictures are `data:` URIs, plots are inline SVG, colours
//! are CSS variables that follow the reader's light or dark preference and turn light on paper.
//! Does not read the store, choose what to show, or know the time.

mod axis;
mod calibration;
mod closing_in;
mod drift;
mod drift_plots;
mod environment;
mod fan;
mod field;
mod input;
mod interruptions;
mod overlay;
mod picture;
mod plot;
mod plots;
mod provenance;
mod side_by_side;
mod stability;
mod style;
mod summary;
mod tables;
mod wavelength_used;

use maud::{DOCTYPE, Markup, PreEscaped, html as markup};

pub use calibration::{CalibrationReport, InputFile, LeftOut, calibration_html};
pub use fan::{FanReport, SessionFanReport, fan_html, session_fan_html};
pub use input::{
    CalibrationOrigin, InputOrigin, Interruption, Provenance, RedoneStep, ReportCapture,
    ReportInput, ReportPicture, SourceOrigin, Trace,
};
pub use stability::{stability_html, verdict as stability_verdict};

/// Width in pixels to which pictures are reduced.
pub const PICTURE_WIDTH: usize = 1000;

/// The report as one self-contained HTML page: no scripts, no external resources.
#[must_use]
pub fn html(input: &ReportInput) -> String {
    let body = markup! {
        (summary::header(input))
        (summary::verdict(input))
        (translation(input))
        (side_by_side::section(&input.side_by_side))
        @if let Some(found) = &input.drift { (drift::section(found)) }
        @if let Some(angles) = &input.angles { (closing_in::section(angles)) }
        (scores(input))
        (pictures(input))
        (residuals(input))
        (poses(input))
        (interruptions::interruptions(input))
        section {
            h2 { "Environment" }
            (environment::environment(input))
            (wavelength_used::table(input))
        }
        @if has_captures(input) {
            section { h2 { "Computing time" } (environment::stages(input)) }
        }
        section { h2 { "Notes and failures" } (provenance::notes(input)) }
        section { h2 { "Provenance" } (provenance::provenance(&input.provenance)) }
    };
    page(&format!("{} · {}", input.title, input.verdict.as_str()), &body)
}

/// A whole page around its sections.
fn page(title: &str, body: &Markup) -> String {
    let page = markup! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (title) }
                style { (PreEscaped(style::CSS)) }
            }
            body { main { (body) } }
        }
    };
    page.into_string()
}

fn translation(input: &ReportInput) -> Markup {
    let Some(result) = &input.translation else { return markup! {} };
    let moved = result.methods.values().any(|m| m.differences.iter().any(|d| !d.first_stop));
    markup! {
        section {
            h2 { "Travelled distance against the rail" }
            @if moved {
                (summary::translation(result))
                (plots::differences(result))
                (plots::fit_residuals(result))
                (tables::positions(result))
            } @else {
                p.note { "There is no measured distance: no pass has poses at its first and at another stop." }
            }
        }
    }
}

fn scores(input: &ReportInput) -> Markup {
    markup! {
        @if !input.scores.is_empty() {
            section {
                h2 { "Poses against the truth" }
                (tables::scores(input))
                p.note {
                    "The truth is known because the scene is simulated or was measured otherwise. NEES \
                     is the error squared over its stated covariance: more than expected means that \
                     the covariance is too small."
                }
            }
        }
    }
}

fn pictures(input: &ReportInput) -> Markup {
    markup! {
        // What is in the picture of a closing-in, its course says.
        @if !input.pictures.is_empty() && input.angles.is_none() {
            section { h2 { "Pictures" } (overlay::pictures(input, PICTURE_WIDTH)) }
        }
    }
}

/// The residuals of the capture that is pictured, or else of the first that was solved.
fn residuals(input: &ReportInput) -> Markup {
    let solved = |c: &&ReportCapture| {
        c.solution.as_ref().is_ok_and(|s| s.cameras.values().any(|k| !k.observations.is_empty()))
    };
    let pictured = |c: &&ReportCapture| input.pictures.iter().any(|p| p.capture == c.id);
    let chosen = input.captures.iter().filter(solved).find(pictured);
    let Some(capture) = chosen.or_else(|| input.captures.iter().find(solved)) else {
        return markup! {};
    };
    markup! {
        section {
            h2 { "Residuals in the pictures" }
            p.note {
                "Observed minus computed, capture " (capture.id) ": laser dots in blue, targets in \
                 green, what was left out as an outlier dashed in red. One magnification for all cameras."
            }
            (field::fields(input, capture))
        }
    }
}

/// A drift of the wavelength takes none and misses none, and the pictures of a closing-in are not
/// solved; elsewhere their absence is told.
fn has_captures(input: &ReportInput) -> bool {
    input.angles.is_none() && (input.drift.is_none() || !input.captures.is_empty())
}

fn poses(input: &ReportInput) -> Markup {
    if !has_captures(input) {
        return markup! {};
    }
    markup! {
        section {
            h2 { "Poses" }
            @if input.captures.is_empty() { p.note { "No captures were taken." } }
            @else { @for method in &input.methods { (tables::poses(input, *method)) } }
        }
    }
}
