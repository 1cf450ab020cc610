//! One session evaluated in several ways, side by side: what calibration, wavelength correction and
//! adjustment each do to the travelled distances.
//!
//! Holds what was analysed already; does not solve, and does not choose what is shown.

use std::fmt::Write as _;

use beampose_photogrammetry::solve::Method;
use serde::Serialize;
use serde_json::{Value, json};

use crate::translation::MethodTranslation;

/// One way of evaluating the session: a processing and a method of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluation {
    /// The processing's number.
    pub processing: i64,
    /// What is particular to the processing, for people.
    pub label: String,
    /// The method.
    pub method: Method,
    /// Its distances.
    pub result: MethodTranslation,
}

/// What a table says of one evaluation; lengths in mm.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Figures {
    /// The largest mean difference by amount, with its sign.
    pub largest_mean_difference_mm: f64,
    /// Where it is.
    pub rail_mm: f64,
    /// Its expanded uncertainty (k = 2).
    pub expanded_uncertainty_mm: f64,
    /// Slope of mean distance over rail travel.
    pub slope: Option<f64>,
    /// Its standard uncertainty.
    pub slope_standard_uncertainty: Option<f64>,
    /// Stops behind the first.
    pub stops: usize,
    /// Of these, those whose mean difference is within its own expanded uncertainty.
    pub stops_within_uncertainty: usize,
}

impl Evaluation {
    /// Its figures; `None` without a measured distance.
    #[must_use]
    pub fn figures(&self) -> Option<Figures> {
        let moved = self.result.positions.iter().filter(|p| p.travel_mm > 0.0);
        let within = |p: &&&crate::translation::PositionResult| {
            p.mean_difference_mm.abs() <= p.expanded_uncertainty_mm
        };
        let moved: Vec<_> = moved.collect();
        let worst = self.result.worst().filter(|_| !moved.is_empty())?;
        Some(Figures {
            largest_mean_difference_mm: worst.mean_difference_mm,
            rail_mm: worst.rail_mm,
            expanded_uncertainty_mm: worst.expanded_uncertainty_mm,
            slope: self.result.slope,
            slope_standard_uncertainty: self.result.slope_standard_uncertainty,
            stops: moved.len(),
            stops_within_uncertainty: moved.iter().filter(within).count(),
        })
    }
}

/// The evaluations as JSON: `processing`, `label`, `method`, `figures` and `positions` of each.
///
/// # Errors
/// None in practice: the types are plain data.
pub(crate) fn side_by_side_json(all: &[Evaluation]) -> Result<Value, serde_json::Error> {
    all.iter()
        .map(|one| {
            Ok(json!({
                "processing": one.processing,
                "label": one.label,
                "method": one.method,
                "figures": serde_json::to_value(one.figures())?,
                "positions": serde_json::to_value(&one.result.positions)?,
            }))
        })
        .collect()
}

/// The evaluations' stops, one line each.
#[must_use]
pub fn side_by_side_csv(all: &[Evaluation]) -> String {
    let mut out = String::from(
        "processing,label,method,rail_mm,travel_mm,mean_difference_mm,expanded_uncertainty_mm\n",
    );
    for one in all {
        let label = one.label.replace('"', "\"\"");
        for p in &one.result.positions {
            // Writing to a String cannot fail.
            let _ = writeln!(
                out,
                "{},\"{label}\",{},{},{},{},{}",
                one.processing,
                one.method.name(),
                p.rail_mm,
                p.travel_mm,
                p.mean_difference_mm,
                p.expanded_uncertainty_mm
            );
        }
    }
    out
}
