//! Residual vectors, one drawing per camera, magnified, with a scale bar.

use beampose_photogrammetry::solve::{CameraSolution, Observation, Subject};
use maud::{Markup, html};

use super::axis::nice_step;
use super::input::{ReportCapture, ReportInput};
use super::plot::at;
use crate::numbers::{NONE, coarse};

/// Width of a drawing in drawing units.
const WIDTH: f64 = 360.0;
/// Room for the scale bar below the frame.
const FOOT: f64 = 30.0;

/// The residuals of one capture in every camera, and what they are over all captures.
pub fn fields(input: &ReportInput, capture: &ReportCapture) -> Markup {
    let Ok(solution) = &capture.solution else { return html! {} };
    // One magnification for all cameras, so that they can be compared.
    let scale = magnification(solution.cameras.iter().flat_map(|(name, camera)| {
        let width = frame(input, name, camera)[0];
        camera.observations.iter().filter(|o| o.used).map(move |o| (o.residual, width))
    }));
    html! {
        div.fields {
            @for (name, camera) in &solution.cameras {
                figure.field {
                    (drawing(name, camera, frame(input, name, camera), &scale))
                    figcaption {
                        (name) ": rms " (plain_rms(camera.observations.iter()))
                        " px; over all captures " (plain_rms(all(input, name))) " px"
                    }
                }
            }
        }
    }
}

fn all<'a>(input: &'a ReportInput, camera: &str) -> impl Iterator<Item = &'a Observation> {
    let solved = input.captures.iter().filter_map(|c| c.solution.as_ref().ok());
    let camera = camera.to_owned();
    solved.filter_map(move |s| s.cameras.get(&camera)).flat_map(|c| &c.observations)
}

/// Root mean square of the residual components of what was used.
fn plain_rms<'a>(observations: impl Iterator<Item = &'a Observation>) -> String {
    let used = observations.filter(|o| o.used).flat_map(|o| o.residual).filter(|v| v.is_finite());
    let (n, squares) = used.fold((0_usize, 0.0), |(n, sum), v| (n + 1, sum + v * v));
    if n == 0 { NONE.to_owned() } else { coarse((squares / n as f64).sqrt()) }
}

/// Width and height of a camera's pictures; where nobody says, what its observations span.
fn frame(input: &ReportInput, name: &str, camera: &CameraSolution) -> [f64; 2] {
    if let Some(size) = input.frames_px.get(name) {
        return size.map(|v| v.max(1) as f64);
    }
    let edge = |i: usize| camera.observations.iter().map(|o| o.at[i]).fold(1.0, f64::max) * 1.05;
    [edge(0), edge(1)]
}

/// Length of the scale bar in pixels of residual, and how many times residuals are magnified.
pub struct Magnification {
    bar_px: f64,
    times: f64,
}

/// Round numbers such that the larger residuals, given each with the width of its picture, become
/// about a twentieth of the drawing; outliers may be longer.
pub fn magnification(residuals: impl Iterator<Item = ([f64; 2], f64)>) -> Magnification {
    let lengths = residuals.map(|(residual, width)| {
        let length = residual[0].hypot(residual[1]);
        (length, length / width)
    });
    let mut lengths: Vec<(f64, f64)> = lengths.filter(|l| l.1.is_finite() && l.0 > 0.0).collect();
    lengths.sort_by(|a, b| a.1.total_cmp(&b.1));
    let (length, share) = lengths.get(lengths.len() * 95 / 100).copied().unwrap_or((1.0, 1e-3));
    Magnification { bar_px: nice_step(length), times: nice_step(0.03 / share) }
}

/// A residual and how it is drawn.
pub struct Arrow {
    /// Where, pixels.
    pub at: [f64; 2],
    /// Observed minus computed, pixels.
    pub residual: [f64; 2],
    /// CSS classes.
    pub class: &'static str,
}

fn drawing(name: &str, camera: &CameraSolution, size: [f64; 2], scale: &Magnification) -> Markup {
    let arrows = camera.observations.iter().map(|o| {
        let class = match (o.used, o.subject) {
            (false, _) => "arrow rejected",
            (true, Subject::Target(_)) => "arrow of-target",
            (true, Subject::Dot(_)) => "arrow",
        };
        Arrow { at: o.at, residual: o.residual, class }
    });
    vectors(&format!("residual vectors of camera {name}"), size, arrows, scale)
}

/// Residual vectors in a frame of the picture's size in pixels, with a scale bar.
pub fn vectors(
    title: &str,
    size: [f64; 2],
    arrows: impl Iterator<Item = Arrow>,
    scale: &Magnification,
) -> Markup {
    let shrink = WIDTH / size[0];
    let height = size[1] * shrink;
    let view = format!("0 0 {} {}", at(WIDTH), at(height + FOOT));
    let bar = scale.bar_px * scale.times * shrink;
    html! {
        svg viewBox=(view) role="img" aria-label=(title) {
            title { (title) }
            rect.frame x="1" y="1" width=(at(WIDTH - 2.0)) height=(at(height - 2.0)) {}
            @for one in arrows { (arrow(&one, shrink, scale)) }
            path.bar d=(format!("M1 {y}v-6m0 3h{w}m0 -3v6", y = at(height + 21.0), w = at(bar))) {}
            text x=(at(bar + 8.0)) y=(at(height + 22.0)) {
                (short(scale.bar_px)) " px, magnified " (short(scale.times)) " ×"
            }
        }
    }
}

/// A round number without the noise of its making.
fn short(number: f64) -> String {
    format!("{}", (number * 1e9).round() / 1e9)
}

fn arrow(arrow: &Arrow, shrink: f64, scale: &Magnification) -> Markup {
    let foot = arrow.at.map(|v| (v + 0.5) * shrink);
    let tip = [0, 1].map(|i| foot[i] + arrow.residual[i] * scale.times * shrink);
    if !(tip[0].is_finite() && tip[1].is_finite()) {
        return html! {};
    }
    html! {
        path class=(arrow.class) d=(format!("M{} {}L{} {}", at(foot[0]), at(foot[1]), at(tip[0]), at(tip[1]))) {}
        circle.foot cx=(at(foot[0])) cy=(at(foot[1])) r="1.2" {}
    }
}
