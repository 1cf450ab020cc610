//! A calibrated fan as JSON, for programs: the parameters with their covariance, random and shared
//! parts apart, beside the pattern file.

use beampose_photogrammetry::calibrate::pattern::{
    AngleOfPair, Budget, Candidate, FanFit, FanModel, MeanAngle, SessionFan,
};
use nalgebra::DMatrix;
use serde_json::{Value, json};

use crate::report::{FanReport, SessionFanReport};

/// A calibration with everything that it is worth. Angles are in degrees; covariances are those of the
/// parameters as they are named.
#[must_use]
pub fn fan_json(input: &FanReport) -> Value {
    let found = input.found;
    let pattern = &found.pattern;
    json!({
        "name": input.name,
        "software": input.software,
        "options": input.command,
        "inputs": input.inputs.iter()
            .map(|i| json!({ "name": i.name, "blake3": i.blake3 })).collect::<Vec<_>>(),
        "columns": pattern.columns,
        "rows": pattern.rows,
        "reference_wavelength_nm": pattern.reference_wavelength_nm,
        "measurements": input.measurements,
        "standard_deviation_of_one_deg": found.spread.map(|s| s.sigma.to_degrees()),
        "u_of_stage_difference_deg": input.options.u_stage.to_degrees(),
        "model": found.fit.model.name(),
        "fit": fit(&found.fit, input),
        "models": found.candidates.iter().map(|c| candidate(c, input)).collect::<Vec<_>>(),
        "u": { "angle_deg": pattern.u.angle_deg, "common_relative": pattern.u.common_relative },
        "beam_sigma_deg": found.beam_sigma.to_degrees(),
        "means": found.means.iter().zip(&found.corrected).zip(&found.fit.residuals)
            .map(|((m, c), r)| mean(m, *c, *r)).collect::<Vec<_>>(),
        "angles": angles(&found.angles),
        "budget": budget(input.budget),
    })
}

fn angles(angles: &[AngleOfPair]) -> Vec<Value> {
    let one = |a: &AngleOfPair| {
        json!({
            "from": [a.pair.a.m, a.pair.a.n],
            "to": [a.pair.b.m, a.pair.b.n],
            "angle_deg": a.angle.to_degrees(),
            "u_deg": a.u.to_degrees(),
            "u_random_deg": a.u_random.to_degrees(),
            "u_shared_deg": a.u_shared.to_degrees(),
        })
    };
    angles.iter().map(one).collect()
}

/// A fan calibrated from sessions. The covariance is that of the beams' direction cosines, (x, y) of
/// each row by row.
#[must_use]
pub fn session_fan_json(input: &SessionFanReport) -> Value {
    let (found, prior) = (input.found, input.prior);
    let pattern = &found.pattern;
    let rows: Vec<Vec<f64>> =
        found.covariance.row_iter().map(|r| r.iter().copied().collect()).collect();
    json!({
        "name": input.name,
        "software": input.software,
        "sessions": input.sessions.iter()
            .map(|i| json!({ "session": i.name, "plan_blake3": i.blake3 })).collect::<Vec<_>>(),
        "captures": input.captures,
        "columns": pattern.columns,
        "rows": pattern.rows,
        "reference_wavelength_nm": pattern.reference_wavelength_nm,
        "prior": { "scale_relative": prior.scale, "beam_deg": prior.beam.to_degrees() },
        "scale_change_relative": found.scale,
        "scale_relative_u": found.scale_u,
        "scale_told_by_pictures": found.scale_told,
        "sigma0": found.sigma0,
        "radial_grid": nearest_grid(found).iter().map(|(name, value, u)| {
            json!({ "name": name, "value": value, "u": u })
        }).collect::<Vec<_>>(),
        "u": { "angle_deg": pattern.u.angle_deg, "common_relative": pattern.u.common_relative },
        "angles": angles(&found.angles),
        "covariance_of_cosines": rows,
    })
}

/// Pitch on a plane at 1 m and radial term of the grid that comes nearest to a fan from a session, each
/// with its name and standard uncertainty.
#[must_use]
pub fn nearest_grid(found: &SessionFan) -> Vec<(&'static str, f64, f64)> {
    let (parameters, covariance) = &found.grid;
    let nm = found.pattern.reference_wavelength_nm;
    let read = FanModel::RadialGrid.read(parameters, 1000.0, nm);
    let u = |i: usize| covariance[(i, i)].max(0.0).sqrt();
    read.iter().enumerate().map(|(i, p)| (p.name, p.value, u(i) * p.slope.abs())).collect()
}

/// The covariance of the two, in their order.
#[must_use]
pub fn nearest_grid_covariance(found: &SessionFan) -> Vec<Vec<f64>> {
    let (parameters, covariance) = &found.grid;
    let nm = found.pattern.reference_wavelength_nm;
    let read = FanModel::RadialGrid.read(parameters, 1000.0, nm);
    let row = |i: usize| {
        (0..read.len()).map(|j| covariance[(i, j)] * read[i].slope * read[j].slope).collect()
    };
    (0..read.len()).map(row).collect()
}

fn candidate(candidate: &Candidate, input: &FanReport) -> Value {
    match &candidate.fit {
        Ok(found) => fit(found, input),
        Err(why) => json!({ "model": candidate.model.name(), "error": why.to_string() }),
    }
}

fn fit(fit: &FanFit, input: &FanReport) -> Value {
    let options = input.options;
    let nm = options.reference_wavelength_nm;
    let read = fit.model.read(&fit.parameters, options.grid_distance, nm);
    let scaled = |matrix: &DMatrix<f64>| -> Vec<Vec<f64>> {
        let row = |i: usize| {
            (0..read.len()).map(|j| matrix[(i, j)] * read[i].slope * read[j].slope).collect()
        };
        (0..read.len()).map(row).collect()
    };
    json!({
        "model": fit.model.name(),
        "parameters": read.iter().enumerate().map(|(i, p)| json!({
            "name": p.name,
            "value": p.value,
            "u": fit.covariance[(i, i)].max(0.0).sqrt() * p.slope.abs(),
        })).collect::<Vec<_>>(),
        "covariance": scaled(&fit.covariance),
        "covariance_random": scaled(&fit.random),
        "covariance_shared": scaled(&(&fit.covariance - &fit.random)),
        "wavelength_error_nm": { "value": nm * fit.shared[0].value, "u": nm * fit.shared[0].sigma },
        "misalignment_across_mm": { "value": fit.shared[1].value, "u": fit.shared[1].sigma },
        "misalignment_along_mm": { "value": fit.shared[2].value, "u": fit.shared[2].sigma },
        "chi2": fit.chi2,
        "degrees_of_freedom": fit.redundancy(),
        "probability": fit.probability(),
        "parameters_determined": fit.effective,
        "aicc": fit.aicc(),
        "bic": fit.bic(),
    })
}

fn mean(mean: &MeanAngle, corrected: f64, residual: f64) -> Value {
    json!({
        "from": [mean.from.m, mean.from.n],
        "to": [mean.to.m, mean.to.n],
        "axis": mean.axis.name(),
        "repetitions": mean.count,
        "turn_deg": mean.turn.to_degrees(),
        "angle_deg": corrected.to_degrees(),
        "standard_deviation_of_one_deg": mean.scatter.map(f64::to_degrees),
        "u_of_mean_deg": mean.u.to_degrees(),
        "wavelength_correction_deg": mean.wavelength_correction.to_degrees(),
        "residual_deg": residual.to_degrees(),
    })
}

fn budget(budget: &Budget) -> Value {
    json!({
        "sources": budget.sources.iter().map(|s| json!({
            "name": s.name,
            "at_size_deg": s.at_size.to_degrees(),
            "u_deg": s.closed.to_degrees(),
            "drawn_deg": s.drawn.to_degrees(),
            "is_shared": s.is_shared,
        })).collect::<Vec<_>>(),
        "random_deg": budget.random.to_degrees(),
        "shared_deg": budget.shared.to_degrees(),
        "combined_deg": budget.closed.to_degrees(),
        "combined_drawn_deg": budget.drawn.to_degrees(),
        "draws": budget.draws,
    })
}
