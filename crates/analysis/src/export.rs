//! Results for programs: JSON and CSV.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use beampose_photogrammetry::rotation::from_wxyz;
use beampose_photogrammetry::solve::MethodResult;
use serde_json::{Map, Value, json};

use crate::numbers::{omega_phi_kappa_deg, omega_phi_kappa_u_deg, root};
use crate::report::{ReportCapture, ReportInput};
use crate::side_by_side::side_by_side_json;
use crate::translation::TranslationResult;
use crate::wavelength_drift::SeriesPoint;

/// The session's result as one JSON object: `experiment`, `verdict`, `reasons`, `captures`,
/// `solved`, `methods`, `limits` as [`TranslationResult`] has them (without a translation test
/// `methods` has the number of solved captures only; a wavelength drift adds the members of
/// [`crate::WavelengthDriftResult`] and `rig_lines`), then `title`, `session`, `processing`, `inputs`
/// (the files that solving was told, and the recorded calibrations that they are) and, where there
/// are any, `wavelength_sources` (by method, how many captures have it from where), `side_by_side`,
/// `interruptions` and, where the truth is known, `scores`.
///
/// # Errors
/// None in practice: the types are plain data.
pub fn json(input: &ReportInput) -> Result<Value, serde_json::Error> {
    let mut object = match &input.translation {
        Some(result) => match serde_json::to_value(result)? {
            Value::Object(object) => object,
            other => Map::from_iter([("translation".to_owned(), other)]),
        },
        None => plain(input),
    };
    if let Some(drift) = &input.drift
        && let Value::Object(members) = serde_json::to_value(&drift.result)?
    {
        object.extend(members);
    }
    if let Some(lines) = input.drift.as_ref().and_then(|drift| drift.rig_lines.as_ref()) {
        object.insert("rig_lines".to_owned(), json!(lines));
    }
    if let Some(angles) = &input.angles {
        object.insert("closing_in".to_owned(), serde_json::to_value(&angles.input.traces)?);
        let software = &input.provenance.processed_with;
        let fan = angles.fan("fan", &[], String::new(), software);
        object.insert("fan".to_owned(), fan.map_or(Value::Null, |fan| crate::fan_json(&fan)));
    }
    let mut put = |key: &str, value: Value| object.insert(key.to_owned(), value);
    put("experiment", json!(input.experiment));
    put("verdict", json!(input.verdict));
    put("reasons", json!(input.reasons));
    put("title", json!(input.title));
    put("session", json!(input.provenance.session));
    put("processing", json!(input.provenance.processing));
    put("inputs", serde_json::to_value(&input.provenance.inputs)?);
    let sources = wavelength_sources(input);
    if !sources.is_empty() {
        put("wavelength_sources", json!(sources));
    }
    if !input.side_by_side.is_empty() {
        put("side_by_side", side_by_side_json(&input.side_by_side)?);
    }
    if !input.interruptions.is_empty() {
        let all = input.interruptions.iter().map(|one| {
            json!({
                "stopped_utc": one.stopped.utc.to_string(),
                "resumed_utc": one.resumed.utc.to_string(),
                "duration_s": one.seconds(),
                "reason": one.reason,
                "restored": one.restored,
                "redone": one.redone,
            })
        });
        put("interruptions", all.collect());
    }
    if !input.scores.is_empty() {
        put("scores", serde_json::to_value(&input.scores)?);
    }
    Ok(Value::Object(object))
}

/// By method how many captures have their wavelength from where.
fn wavelength_sources(input: &ReportInput) -> BTreeMap<&str, BTreeMap<&str, usize>> {
    let mut sources: BTreeMap<&str, BTreeMap<&str, usize>> = BTreeMap::new();
    for solution in input.captures.iter().filter_map(|c| c.solution.as_ref().ok()) {
        for result in &solution.results {
            let Some(known) = &result.wavelength else { continue };
            let of_method = sources.entry(result.method.name()).or_default();
            *of_method.entry(known.source.name()).or_default() += 1;
        }
    }
    sources
}

fn plain(input: &ReportInput) -> Map<String, Value> {
    let methods: BTreeMap<&str, Value> = input
        .methods
        .iter()
        .map(|m| {
            let solved = input.captures.iter().filter(|c| c.pose(*m).is_some()).count();
            (m.name(), json!({ "solved": solved }))
        })
        .collect();
    let all = |c: &&ReportCapture| {
        !input.methods.is_empty() && input.methods.iter().all(|m| c.pose(*m).is_some())
    };
    Map::from_iter([
        ("captures".to_owned(), json!(input.captures.len())),
        ("solved".to_owned(), json!(input.captures.iter().filter(all).count())),
        ("methods".to_owned(), json!(methods)),
        ("limits".to_owned(), json!({})),
    ])
}

/// The stops of a translation test, one line per method and stop.
#[must_use]
pub fn positions_csv(result: &TranslationResult) -> String {
    let mut out = String::from(
        "method,rail_mm,travel_mm,mean_difference_mm,standard_uncertainty_mm,\
         expanded_uncertainty_mm,standard_deviation_mm,passes\n",
    );
    for (method, of_method) in &result.methods {
        for p in &of_method.positions {
            let deviation = p.standard_deviation_mm.map(|s| s.to_string()).unwrap_or_default();
            // Writing to a String cannot fail.
            let _ = writeln!(
                out,
                "{},{},{},{},{},{},{deviation},{}",
                method.name(),
                p.rail_mm,
                p.travel_mm,
                p.mean_difference_mm,
                p.standard_uncertainty_mm,
                p.expanded_uncertainty_mm,
                p.passes
            );
        }
    }
    out
}

/// The readings of a wavelength drift, one line each: `mark` is `warming_up`, `settled`, `hop` (the
/// first one behind a hop) or `stray` (left out), `mode` counts the hops before it.
#[must_use]
pub fn series_csv(series: &[SeriesPoint]) -> String {
    let mut out = String::from(
        "at_s,wavelength_nm,fitted_nm,diode_temperature_degc,room_temperature_degc,mode,mark\n",
    );
    let number = |value: Option<f64>| {
        value.filter(|v| v.is_finite()).map(|v| v.to_string()).unwrap_or_default()
    };
    for p in series {
        let (fitted, diode, room) =
            (number(Some(p.fitted_nm)), number(p.diode_degc), number(p.room_degc));
        let (at, nm, mode, mark) = (p.at_s, p.wavelength_nm, p.mode, p.mark.as_str());
        // Writing to a String cannot fail.
        let _ = writeln!(out, "{at},{nm},{fitted},{diode},{room},{mode},{mark}");
    }
    out
}

/// The poses, one line per capture and method, with the upper triangle of the covariance
/// (`c11` .. `c66`: position in mm, then rotation vector in rad about the world axes).
#[must_use]
pub fn poses_csv(captures: &[ReportCapture]) -> String {
    let setpoints: std::collections::BTreeSet<&str> =
        captures.iter().flat_map(|c| c.setpoints.keys().map(String::as_str)).collect();
    let mut header = vec!["id".to_owned()];
    header.extend(setpoints.iter().map(|s| (*s).to_owned()));
    header.extend(POSE_COLUMNS.map(str::to_owned));
    header.extend(triangle().map(|(i, j)| format!("c{}{}", i + 1, j + 1)));
    let columns = header.len();
    let mut out = line(&header);
    for capture in captures {
        let mut left = vec![capture.id.to_string()];
        left.extend(
            setpoints
                .iter()
                .map(|s| capture.setpoints.get(*s).map(f64::to_string).unwrap_or_default()),
        );
        let rows: Vec<Vec<String>> = match &capture.solution {
            Ok(solution) => solution.results.iter().map(pose_row).collect(),
            Err(reason) => vec![vec![String::new(), reason.clone()]],
        };
        for row in rows {
            let mut row = [left.clone(), row].concat();
            row.resize(columns, String::new());
            out.push_str(&line(&row));
        }
    }
    out
}

const POSE_COLUMNS: [&str; 24] = [
    "method",
    "status",
    "x_mm",
    "y_mm",
    "z_mm",
    "u_x_mm",
    "u_y_mm",
    "u_z_mm",
    "qw",
    "qx",
    "qy",
    "qz",
    "omega_deg",
    "phi_deg",
    "kappa_deg",
    "u_omega_deg",
    "u_phi_deg",
    "u_kappa_deg",
    "beams",
    "sigma0",
    "wavelength_nm",
    "wavelength_source",
    "wavelength_u_nm",
    "wavelength_age_s",
];

fn triangle() -> impl Iterator<Item = (usize, usize)> {
    (0..6).flat_map(|i| (i..6).map(move |j| (i, j)))
}

fn pose_row(result: &MethodResult) -> Vec<String> {
    let method = result.method.name().to_owned();
    let pose = match &result.pose {
        Ok(pose) => pose,
        Err(reason) => return vec![method, reason.clone()],
    };
    let u = |i: usize| root(pose.covariance[i][i]);
    let q = from_wxyz(pose.quaternion_wxyz);
    let mut numbers: Vec<f64> = pose.position_mm.to_vec();
    numbers.extend([u(0), u(1), u(2)]);
    numbers.extend(pose.quaternion_wxyz);
    numbers.extend(omega_phi_kappa_deg(&q));
    numbers.extend(omega_phi_kappa_u_deg(pose));
    numbers.extend([result.beams_used as f64, result.sigma0, result.wavelength_nm]);
    let number = |x: f64| if x.is_finite() { x.to_string() } else { String::new() };
    let mut row = vec![method, "solved".to_owned()];
    row.extend(numbers.iter().map(|x| number(*x)));
    let known = result.wavelength.as_ref();
    row.push(known.map_or_else(String::new, |known| known.source.name().to_owned()));
    row.push(known.map_or_else(String::new, |known| number(known.u_nm())));
    row.push(known.and_then(|known| known.age_s).map_or_else(String::new, number));
    row.extend(triangle().map(|(i, j)| number(pose.covariance[i][j])));
    row
}

/// One line, quoted as RFC 4180 asks.
fn line(fields: &[String]) -> String {
    let quoted = fields.iter().map(|f| {
        if f.contains([',', '"', '\n', '\r']) {
            format!("\"{}\"", f.replace('"', "\"\""))
        } else {
            f.clone()
        }
    });
    quoted.collect::<Vec<_>>().join(",") + "\n"
}
