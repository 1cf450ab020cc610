//! The page of a camera calibration: what was found and how well, residuals, coverage, pictures.

use beampose_photogrammetry::calibrate::{Coverage, Interior, SelfCalibration, SolvedView};
use maud::{Markup, html};
use nalgebra::Vector2;

use super::axis::{Axis, Ends};
use super::field::{Arrow, magnification, vectors};
use super::page;
use super::plot::{Layer, Mark, Plot, Shape, at};
use crate::numbers::{coarse, count, decimals, fixed, percent, plain};

/// Correlations from here on are marked: such parameters can hardly be told apart.
const HIGH: f64 = 0.9;
/// Side of a cell of the map of coverage, drawing units.
const CELL: f64 = 40.0;

/// A file that went in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InputFile {
    /// Its name.
    pub name: String,
    /// Hash of its bytes.
    pub blake3: String,
}

/// A picture that could not be used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeftOut {
    /// Its name.
    pub name: String,
    /// Why.
    pub reason: String,
}

/// Everything that the page shows.
#[derive(Debug, Clone)]
pub struct CalibrationReport<'a> {
    /// The camera's name.
    pub name: String,
    /// The result.
    pub found: &'a SelfCalibration,
    /// What of the picture was seen.
    pub coverage: &'a Coverage,
    /// Pictures without a usable sheet.
    pub left_out: &'a [LeftOut],
    /// What went in.
    pub inputs: &'a [InputFile],
    /// The options, as they would be typed.
    pub options: String,
    /// Name and version of the program.
    pub software: String,
}

/// The page, self-contained.
#[must_use]
pub fn calibration_html(input: &CalibrationReport) -> String {
    let found = input.found;
    let body = html! {
        (header(input))
        section { h2 { "Interior orientation" } (parameters(found)) }
        section { h2 { "Correlations" } (correlations(found)) }
        section { h2 { "Residuals in the picture" } (residuals(found)) }
        section { h2 { "Residuals by distance from the principal point" } (by_radius(found)) }
        section { h2 { "Coverage" } (coverage(input.coverage)) }
        section { h2 { "Pictures" } (pictures(input)) }
        section { h2 { "Provenance" } (provenance(input)) }
    };
    page(&format!("{} · calibration", input.name), &body)
}

fn header(input: &CalibrationReport) -> Markup {
    let (found, camera) = (input.found, &input.found.camera);
    html! {
        header {
            p.kind { "Camera calibration" }
            h1 { (input.name) }
            dl.facts {
                dt { "pictures" } dd {
                    (found.views.len()) " of " (camera.width) " × " (camera.height) " pixels"
                    @if !input.left_out.is_empty() { ", " (input.left_out.len()) " more left out" }
                }
                dt { "points" } dd {
                    (found.points())
                    @if !found.rejected.is_empty() { ", " (found.rejected.len()) " more left out as gross errors" }
                }
                dt { "RMS of a point" } dd { (plain(found.rms_px)) " px" }
                dt { "sigma of a coordinate" } dd {
                    (plain(found.sigma0_px)) " px, from the residuals, redundancy " (found.redundancy)
                }
            }
        }
    }
}

fn unit(parameter: Interior) -> &'static str {
    if parameter.is_in_pixels() { "px" } else { "" }
}

fn parameters(found: &SelfCalibration) -> Markup {
    let held = Interior::ALL.into_iter().filter(|p| {
        let has_f = found.unknowns.contains(Interior::F);
        let is_focal = matches!(p, Interior::F | Interior::Fx | Interior::Fy);
        let is_shown = if has_f { !is_focal } else { *p != Interior::F };
        is_shown && !found.unknowns.contains(*p)
    });
    let held: Vec<String> = held.map(|p| format!("{p} = {}", p.of(&found.camera))).collect();
    html! {
        table {
            thead { tr { th { "parameter" } th { "value" } th { "standard deviation" } th { "U (k = 2)" } th { } } }
            tbody { @for p in found.unknowns.iter() { (parameter(found, p)) } }
        }
        @if !held.is_empty() { p.note { "Held: " (held.join(", ")) "." } }
        p.note {
            "All observations have equal weight; the standard deviations follow from the residuals. \
             They hold what differs from point to point. A sheet that is bent, or printed to another \
             scale in one direction, is not in them."
        }
    }
}

fn parameter(found: &SelfCalibration, p: Interior) -> Markup {
    let sigma = found.standard_deviation(p).unwrap_or(f64::NAN);
    let places = fine_decimals(sigma);
    html! {
        tr {
            th { (p) }
            td { (fixed(p.of(&found.camera), places)) }
            td { (fixed(sigma, places)) }
            td { (fixed(2.0 * sigma, places)) }
            td.u { (unit(p)) }
        }
    }
}

/// Decimals for two digits of a standard deviation, also where it is far below a millionth.
pub(super) fn fine_decimals(sigma: f64) -> usize {
    if sigma > 0.0 && sigma < 1e-4 {
        (1.0 - sigma.log10().floor()).clamp(0.0, 12.0) as usize
    } else {
        decimals(sigma, 2)
    }
}

fn correlations(found: &SelfCalibration) -> Markup {
    let matrix = found.correlations();
    let names: Vec<Interior> = found.unknowns.iter().collect();
    let class = |r: usize, c: usize| (r != c && matrix[(r, c)].abs() > HIGH).then_some("high");
    html! {
        div.scroll { table {
            thead { tr { th { } @for name in &names { th { (name) } } } }
            tbody {
                @for (r, name) in names.iter().enumerate() {
                    tr {
                        th { (name) }
                        @for c in 0..names.len() { td class=[class(r, c)] { (fixed(matrix[(r, c)], 2)) } }
                    }
                }
            }
        } }
        p.note {
            "Marked: above " (HIGH) ". k1, k2 and k3 always depend on one another; the principal point \
             and p1, p2 do where the pictures were not rolled."
        }
    }
}

fn residuals(found: &SelfCalibration) -> Markup {
    let size = [found.camera.width.max(1) as f64, found.camera.height.max(1) as f64];
    let each = |view: &SolvedView| {
        let pairs = view.pixels.iter().zip(&view.residuals);
        pairs.map(|(p, r)| ([p.x, p.y], [r.x, r.y])).collect::<Vec<_>>()
    };
    let all: Vec<([f64; 2], [f64; 2])> = found.views.iter().flat_map(each).collect();
    let scale = magnification(all.iter().map(|(_, residual)| (*residual, size[0])));
    let arrows =
        all.iter().map(|(at, residual)| Arrow { at: *at, residual: *residual, class: "arrow" });
    html! {
        figure.field {
            (vectors("residual vectors of all pictures", size, arrows, &scale))
            figcaption {
                "Observed minus computed, all pictures in one frame. Where neighbours point the same \
                 way, the model of the lens or the sheet is not what it is taken for."
            }
        }
    }
}

/// Radial and tangential parts over the radius: what the distortion model leaves shows there.
fn by_radius(found: &SelfCalibration) -> Markup {
    let principal = Vector2::new(found.camera.cx, found.camera.cy);
    let (mut radial, mut tangential) = (Vec::new(), Vec::new());
    for (at, residual) in found.views.iter().flat_map(|v| v.pixels.iter().zip(&v.residuals)) {
        let arm = at - principal;
        let along = arm / arm.norm().max(1e-9);
        radial.push((arm.norm(), along.dot(residual)));
        tangential.push((arm.norm(), along.x * residual.y - along.y * residual.x));
    }
    html! {
        (parts("radial residual / px", "s1 faint", radial))
        (parts("tangential residual / px", "s0 faint", tangential))
    }
}

fn parts(label: &str, class: &str, points: Vec<(f64, f64)>) -> Markup {
    let zero =
        Layer { class: "zero".to_owned(), shift: 0.0, mark: Mark::Level(0.0, String::new()) };
    let plot = Plot {
        title: format!("{label} against the distance from the principal point"),
        x: Axis::over(
            "distance from the principal point / px",
            points.iter().map(|p| p.0),
            8.0,
            Ends::Padded,
        ),
        y: Axis::over(label, points.iter().map(|p| p.1), 5.0, Ends::AtTicks),
        height: 230.0,
        layers: vec![
            zero,
            Layer {
                class: class.to_owned(),
                shift: 0.0,
                mark: Mark::Symbols(Shape::Circle, 3.0, points),
            },
        ],
    };
    plot.draw()
}

fn coverage(coverage: &Coverage) -> Markup {
    let (rows, columns) = (coverage.counts.len(), coverage.counts.first().map_or(0, Vec::len));
    let view = format!("0 0 {} {}", at(columns as f64 * CELL), at(rows as f64 * CELL));
    let most = coverage.counts.iter().flatten().copied().max().unwrap_or(0).max(1) as f64;
    html! {
        figure.coverage {
            svg viewBox=(view) role="img" aria-label="points in each part of the picture" {
                @for (r, row) in coverage.counts.iter().enumerate() {
                    @for (c, n) in row.iter().enumerate() {
                        @let (x, y) = (c as f64 * CELL, r as f64 * CELL);
                        rect x=(at(x)) y=(at(y)) width=(at(CELL)) height=(at(CELL))
                            fill-opacity=(format!("{:.2}", 0.7 * *n as f64 / most)) {}
                        text x=(at(x + CELL / 2.0)) y=(at(y + CELL / 2.0 + 4.0)) text-anchor="middle" { (n) }
                    }
                }
            }
            figcaption {
                "Points in each part of the picture: " (percent(Some(coverage.covered)))
                " of the parts have one. The outermost point is at " (percent(Some(coverage.reach)))
                " of the way from the principal point to the farthest corner; beyond it the distortion \
                 is extrapolated."
            }
        }
    }
}

fn pictures(input: &CalibrationReport) -> Markup {
    html! {
        div.scroll { table {
            thead { tr {
                th { "picture" } th { "points" } th { "RMS" br; "px" } th { "distance" br; "mm" }
                th { "tilt" br; "°" } th { "u of the place" br; "mm" }
            } }
            tbody { @for view in &input.found.views { (picture(view)) } }
        } }
        @if !input.left_out.is_empty() {
            h3 { "Left out" }
            ul { @for one in input.left_out { li { (one.name) ": " (one.reason) } } }
        }
        @if !input.found.rejected.is_empty() {
            h3 { "Gross errors" }
            ul { @for r in &input.found.rejected {
                li { (r.view) ": the point at (" (r.on_sheet.x) ", " (r.on_sheet.y) ") mm, "
                    (coarse(r.standardised)) " sigma" }
            } }
        }
    }
}

fn picture(view: &SolvedView) -> Markup {
    let centre = view.station.centre;
    // The sheet's z axis against the camera's: how far the sheet is from facing it.
    let facing = view.station.rotation.matrix()[(2, 2)].abs().min(1.0);
    let place = view.covariance.fixed_view::<3, 3>(0, 0).trace().sqrt();
    html! {
        tr {
            th { (view.name) }
            td { (view.residuals.len()) }
            td { (plain(view.rms_px())) }
            td { (plain(centre.z.abs())) }
            td { (fixed(facing.acos().to_degrees(), 1)) }
            td { (coarse(place)) }
        }
    }
}

fn provenance(input: &CalibrationReport) -> Markup {
    html! {
        dl.facts {
            dt { "program" } dd { (input.software) }
            dt { "options" } dd { code { (input.options) } }
            dt { "iterations" } dd { (input.found.iterations) }
        }
        details {
            summary { "Inputs " span { (count(input.inputs.len(), "file")) ", BLAKE3" } }
            table { tbody { @for file in input.inputs {
                tr { th { (file.name) } td.text { code { (file.blake3) } } }
            } } }
        }
    }
}
