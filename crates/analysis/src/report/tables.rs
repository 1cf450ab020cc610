//! Tables: the stops of the rail, the poses, the score against the truth.

use beampose_core::Pose;
use beampose_photogrammetry::rotation::from_wxyz;
use beampose_photogrammetry::solve::{Method, MethodResult};
use maud::{Markup, html};

use super::input::{ReportCapture, ReportInput};
use super::plots::{look, title};
use crate::numbers::{
    NONE, decimals, fixed, omega_phi_kappa_deg, omega_phi_kappa_u_deg, optional, percent, root,
};
use crate::score::MethodScore;
use crate::translation::{MethodTranslation, TranslationResult};

/// The stops of a translation test, a group of columns per method.
pub fn positions(result: &TranslationResult) -> Markup {
    let mut rails: Vec<f64> =
        result.methods.values().flat_map(|m| m.positions.iter().map(|p| p.rail_mm)).collect();
    rails.sort_by(f64::total_cmp);
    rails.dedup_by(|a, b| (*a - *b).abs() < 5e-4);
    html! {
        div.scroll { table {
            thead {
                tr.group {
                    th { }
                    @for method in result.methods.keys() {
                        th class=(method_class(*method)) colspan="4" { (title(*method)) }
                    }
                }
                tr {
                    th { "rail" br; "mm" }
                    @for _ in &result.methods {
                        th.first { "mean difference" br; "mm" } th { "U (k = 2)" br; "mm" }
                        th.u { "std. dev." br; "mm" } th.u { "n" br; "\u{a0}" }
                    }
                }
            }
            tbody {
                @for rail in &rails {
                    tr {
                        th { (rail) }
                        @for of_method in result.methods.values() { (stop(of_method, *rail)) }
                    }
                }
            }
        } }
    }
}

fn stop(of_method: &MethodTranslation, rail: f64) -> Markup {
    let places = column_decimals(of_method.positions.iter().map(|p| p.expanded_uncertainty_mm));
    let here = of_method.positions.iter().find(|p| (p.rail_mm - rail).abs() < 5e-4);
    let Some(p) = here else {
        return html! { td.first { (NONE) } td { (NONE) } td.u { (NONE) } td.u { "0" } };
    };
    if p.travel_mm == 0.0 && p.expanded_uncertainty_mm == 0.0 {
        return html! { td.first { "0" } td { (NONE) } td.u { (NONE) } td.u { (p.passes) } };
    }
    html! {
        td.first { (fixed(p.mean_difference_mm, places)) }
        td { (fixed(p.expanded_uncertainty_mm, places)) }
        td.u { (p.standard_deviation_mm.map_or_else(|| NONE.to_owned(), |s| fixed(s, places))) }
        td.u { (p.passes) }
    }
}

/// Decimals that show the smallest uncertainty of a column with two digits.
fn column_decimals(us: impl Iterator<Item = f64>) -> usize {
    let smallest = us.filter(|u| u.is_finite() && *u > 0.0).fold(f64::INFINITY, f64::min);
    decimals(smallest, 2)
}

pub fn method_class(method: Method) -> &'static str {
    match look(method).0 {
        "s0" => "m0",
        "s1" => "m1",
        _ => "m2",
    }
}

/// Against the truth.
pub fn scores(input: &ReportInput) -> Markup {
    type Row = (&'static str, fn(&MethodScore) -> String);
    let rows: [Row; 10] = [
        ("captures solved", |s| format!("{} of {}", s.solved, s.captures)),
        ("position error, rms / mm", |s| optional(s.rms_position_error_mm)),
        ("position error, largest / mm", |s| optional(s.max_position_error_mm)),
        ("mean error in X, Y, Z / mm", |s| triple(s.mean_position_error_xyz_mm)),
        ("rotation error, rms / °", |s| optional(s.rms_rotation_error_deg)),
        ("rotation error, largest / °", |s| optional(s.max_rotation_error_deg)),
        ("NEES of the position, mean (3 expected)", |s| optional(s.nees_position_mean)),
        ("NEES of the pose, mean (6 expected)", |s| optional(s.nees_pose_mean)),
        ("truth within the 95 % region, position", |s| percent(s.coverage_95)),
        ("truth within the 95 % region, pose", |s| percent(s.coverage_95_pose)),
    ];
    html! {
        div.scroll { table.keys {
            thead { tr {
                th { }
                @for method in input.scores.keys() { th class=(method_class(*method)) { (title(*method)) } }
            } }
            tbody {
                @for (name, value) in rows {
                    tr { th { (name) } @for score in input.scores.values() { td { (value(score)) } } }
                }
            }
        } }
    }
}

fn triple(values: Option<[f64; 3]>) -> String {
    values.map_or_else(|| NONE.to_owned(), |v| v.map(|x| fixed(x, 3)).join(", "))
}

/// The poses of one method, collapsed.
pub fn poses(input: &ReportInput, method: Method) -> Markup {
    let solved: Vec<&Pose> = input.captures.iter().filter_map(|c| c.pose(method)).collect();
    let place = column_decimals(solved.iter().flat_map(|p| [0, 1, 2].map(|i| u_mm(p, i))));
    let turn = column_decimals(solved.iter().flat_map(|p| omega_phi_kappa_u_deg(p)));
    html! {
        details {
            summary { "Poses by " (title(method)) " " span { "(" (solved.len()) " of " (input.captures.len()) " captures)" } }
            div.scroll { table.wide {
                (pose_head())
                tbody { @for capture in &input.captures { (pose_row(capture, method, place, turn)) } }
            } }
            p.note {
                "Position in the artefact's frame and orientation as ω, φ, κ (R = Rx Ry Rz, module \
                 axes x right, y up, z back); u are standard uncertainties. σ₀ is the root of the a \
                 posteriori variance of unit weight, near 1 where the stated noise is true. An asterisk \
                 marks captures where the prior decided between labellings that fit alike. λ is the \
                 wavelength used, in vacuum, and from where it was known."
            }
        }
    }
}

fn pose_head() -> Markup {
    html! { thead {
        tr {
            th { "capture" } th.text { "setpoints" }
            @for axis in ["X", "Y", "Z"] { th { (axis) br; "mm" } th.u { "u" br; "mm" } }
            @for angle in ["ω", "φ", "κ"] { th { (angle) br; "°" } th.u { "u" br; "°" } }
            th { "σ₀" } th { "beams" } th { "λ" br; "nm" } th.text { "from" }
        }
    } }
}

fn pose_row(capture: &ReportCapture, method: Method, place: usize, turn: usize) -> Markup {
    let (result, pose) = match solved(capture, method) {
        Ok(found) => found,
        Err(reason) => {
            return html! {
                tr {
                    th { (capture.id) } td.name { (setpoints(capture)) }
                    td.text colspan="16" { "not solved: " (reason) }
                }
            };
        }
    };
    let angles = omega_phi_kappa_deg(&from_wxyz(pose.quaternion_wxyz));
    let angle_us = omega_phi_kappa_u_deg(pose);
    html! {
        tr {
            th { (capture.id) @if result.ambiguous { "\u{a0}*" } }
            td.name { (setpoints(capture)) }
            @for i in 0..3 {
                td { (fixed(pose.position_mm[i], place)) } td.u { (fixed(u_mm(pose, i), place)) }
            }
            @for i in 0..3 {
                td { (fixed(angles[i], turn)) } td.u { (fixed(angle_us[i], turn)) }
            }
            td { (fixed(result.sigma0, 2)) }
            td { (result.beams_used) }
            td { (fixed(result.wavelength_nm, 3)) }
            td.name { (result.wavelength.map_or(NONE, |known| known.source.name())) }
        }
    }
}

/// A method's result and pose, or why there is none.
fn solved(capture: &ReportCapture, method: Method) -> Result<(&MethodResult, &Pose), &str> {
    capture.solution.as_ref().map_err(String::as_str)?;
    let result = capture.result(method).ok_or("not computed")?;
    Ok((result, result.pose.as_ref().map_err(String::as_str)?))
}

fn u_mm(pose: &Pose, i: usize) -> f64 {
    root(pose.covariance[i][i])
}

/// `pass 2, rail 300 mm`.
fn setpoints(capture: &ReportCapture) -> String {
    let one = |(key, value): (&String, &f64)| match key.rsplit_once('_') {
        Some((name, unit)) => format!("{} {value} {}", name.replace('_', " "), symbol(unit)),
        None => format!("{key} {value}"),
    };
    capture.setpoints.iter().map(one).collect::<Vec<_>>().join(", ")
}

/// A key's suffix as people write the unit.
pub fn symbol(suffix: &str) -> &str {
    match suffix {
        "deg" => "°",
        "degc" => "°C",
        "ma" => "mA",
        other => other,
    }
}
