//! Calibrations and their comparison as JSON, for programs.

use beampose_photogrammetry::calibrate::{
    Change, Interior, ParameterStability, SelfCalibration, SolvedView, Stability,
};
use beampose_photogrammetry::rotation::wxyz;
use nalgebra::{DMatrix, UnitQuaternion};
use serde_json::{Value, json};

use crate::report::CalibrationReport;

/// A calibration with everything that it is worth.
#[must_use]
pub fn calibration_json(input: &CalibrationReport) -> Value {
    let found = input.found;
    let of_parameter = |p: Interior| {
        json!({
            "name": p.name(),
            "value": p.of(&found.camera),
            "standard_deviation": found.standard_deviation(p),
        })
    };
    let left_out = input.left_out.iter().map(|l| json!({ "name": l.name, "reason": l.reason }));
    json!({
        "name": input.name,
        "software": input.software,
        "options": input.options,
        "inputs": input.inputs.iter()
            .map(|i| json!({ "name": i.name, "blake3": i.blake3 })).collect::<Vec<_>>(),
        "camera": found.camera,
        "parameters": found.unknowns.iter().map(of_parameter).collect::<Vec<_>>(),
        "covariance": rows(&found.covariance),
        "correlations": rows(&found.correlations()),
        "rms_px": found.rms_px,
        "sigma0_px": found.sigma0_px,
        "points": found.points(),
        "redundancy": found.redundancy,
        "iterations": found.iterations,
        "pictures": found.views.iter().map(picture).collect::<Vec<_>>(),
        "left_out": left_out.collect::<Vec<_>>(),
        "rejected": rejected(found),
        "coverage": input.coverage,
    })
}

fn picture(view: &SolvedView) -> Value {
    let q = UnitQuaternion::from_rotation_matrix(&view.station.rotation);
    let covariance: Vec<Vec<f64>> =
        view.covariance.row_iter().map(|r| r.iter().copied().collect()).collect();
    json!({
        "name": view.name,
        "points": view.residuals.len(),
        "rms_px": view.rms_px(),
        "position_mm": [view.station.centre.x, view.station.centre.y, view.station.centre.z],
        "quaternion_wxyz": wxyz(&q),
        "covariance": covariance,
    })
}

fn rejected(found: &SelfCalibration) -> Vec<Value> {
    let one = found.rejected.iter().map(|r| {
        json!({
            "picture": r.view,
            "x_mm": r.on_sheet.x,
            "y_mm": r.on_sheet.y,
            "standardised_residual": r.standardised,
        })
    });
    one.collect()
}

fn rows(matrix: &DMatrix<f64>) -> Vec<Vec<f64>> {
    matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
}

/// Repeated calibrations compared.
#[must_use]
pub fn stability_json(found: &Stability) -> Value {
    json!({
        "calibrations": found.names,
        "level_of_a_single_test": found.level,
        "principal_point_scatter_px": found.principal_point_px,
        "parameters": found.parameters.iter().map(parameter).collect::<Vec<_>>(),
    })
}

fn parameter(p: &ParameterStability) -> Value {
    json!({
        "name": p.parameter.name(),
        "values": p.values,
        "stated_standard_deviations": p.stated,
        "mean": p.mean,
        "standard_deviation": p.scatter,
        "range": p.range,
        "scatter_probability": p.scatter_probability,
        "is_unstable": p.is_unstable,
        "drift_per_calibration": p.drift,
        "drift_standard_deviation": p.drift_sigma,
        "drift_probability": p.drift_probability,
        "is_drifting": p.is_drifting,
        "changes": p.changes.iter().map(change).collect::<Vec<_>>(),
    })
}

fn change(c: &Change) -> Value {
    json!({
        "difference": c.difference,
        "standard_deviation": c.sigma,
        "probability": c.probability,
        "is_significant": c.is_significant,
    })
}
