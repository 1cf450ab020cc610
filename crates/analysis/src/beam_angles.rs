//! Beam angles measured on a goniometer: the fan that follows from them, and whether they are good
//! enough.

use beampose_core::units::{Degree, Millimetre};
use beampose_photogrammetry::calibrate::pattern::{
    Budget, BudgetSizes, FanCalibration, FanOptions, MeasuredAngle, budget, calibrate_fan,
};
use serde::Serialize;

use crate::report::{FanReport, InputFile};
use crate::verdict::Verdict;

/// Draws of each line of the budget: its root mean square is then good to half a percent.
const DRAWS: usize = 20_000;
/// The budget is drawn with one seed: what it says is a property of the rig, not of a session.
const SEED: u64 = 1;

/// What the plan asks of a calibration. An absent limit is not judged.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BeamAngleLimits {
    /// Of the standard deviation of one angle.
    pub max_standard_deviation: Option<Degree>,
    /// Of the standard uncertainty of any angle between neighbours.
    pub max_standard_uncertainty: Option<Degree>,
}

/// One closing-in as the session has it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Trace {
    /// The step.
    pub step: u32,
    /// The beam, columns to the right and rows down.
    pub beam: [i32; 2],
    /// Whether the dot came to its pixel.
    pub closed: bool,
    /// How far the dot stood from its pixel at each look, along the way that the axis moves it,
    /// pixels; nothing where it was not found.
    pub off_px: Vec<Option<f64>>,
}

/// What a session measured.
#[derive(Debug, Clone)]
pub struct BeamAnglesInput {
    /// The angles.
    pub measured: Vec<MeasuredAngle>,
    /// Geometry and uncertainties, as the rig declares them.
    pub options: FanOptions,
    /// For the budget; its angle is filled in from the result.
    pub sizes: BudgetSizes,
    /// All closings-in.
    pub traces: Vec<Trace>,
    /// What is asked.
    pub limits: BeamAngleLimits,
}

/// The calibration of a session.
#[derive(Debug, Clone)]
pub struct BeamAngles {
    /// What it was made from; the budget's angle is the mean between neighbours.
    pub input: BeamAnglesInput,
    /// The fan, or why there is none.
    pub found: Result<FanCalibration, String>,
    /// What a single angle is worth.
    pub budget: Budget,
    /// Whether it is good enough.
    pub verdict: Verdict,
    /// Why.
    pub reasons: Vec<String>,
}

/// Calibrates the fan from what a session measured.
#[must_use]
pub fn beam_angles(mut input: BeamAnglesInput) -> BeamAngles {
    let found = calibrate_fan(&input.measured, &input.options).map_err(|error| error.to_string());
    if let Ok(found) = &found {
        let neighbours = found.angles.iter().filter(|a| {
            let (dm, dn) = (a.pair.b.m - a.pair.a.m, a.pair.b.n - a.pair.a.n);
            (dm, dn) == (1, 0) || (dm, dn) == (0, 1)
        });
        let all: Vec<f64> = neighbours.map(|a| a.angle).collect();
        input.sizes.angle = all.iter().sum::<f64>() / all.len().max(1) as f64;
    }
    let budget = budget(&input.sizes, DRAWS, SEED);
    let (verdict, reasons) = judge(&input, &found);
    BeamAngles { input, found, budget, verdict, reasons }
}

fn judge(
    input: &BeamAnglesInput,
    found: &Result<FanCalibration, String>,
) -> (Verdict, Vec<String>) {
    let found = match found {
        Ok(found) => found,
        Err(why) => return (Verdict::Inconclusive, vec![format!("no fan: {why}")]),
    };
    let one = found.spread.map(|spread| spread.sigma.to_degrees());
    let worst = found.angles.iter().map(|angle| angle.u.to_degrees()).fold(0.0, f64::max);
    let asked = [
        ("standard deviation of one angle", one, input.limits.max_standard_deviation),
        (
            "largest standard uncertainty of an angle between neighbours",
            Some(worst),
            input.limits.max_standard_uncertainty,
        ),
    ];
    let (mut verdict, mut reasons) = (Verdict::Pass, Vec::new());
    if asked.iter().all(|(_, _, limit)| limit.is_none()) {
        verdict = Verdict::Inconclusive;
        reasons.push("the plan sets no limits".to_owned());
    }
    for (what, value, limit) in asked {
        let Some(limit) = limit else { continue };
        match value {
            Some(value) => {
                let is_kept = value <= limit.0;
                verdict = verdict.worse(if is_kept { Verdict::Pass } else { Verdict::Fail });
                reasons.push(format!("{what} {value:.5}°; at most {}° asked", limit.0));
            }
            None => {
                verdict = verdict.worse(Verdict::Inconclusive);
                reasons.push(format!("no {what}: nothing was repeated"));
            }
        }
    }
    (verdict, reasons)
}

impl BeamAngles {
    /// The fan as its own page and JSON have it; `None` where there is none.
    #[must_use]
    pub fn fan<'a>(
        &'a self,
        name: &str,
        inputs: &'a [InputFile],
        command: String,
        software: &str,
    ) -> Option<FanReport<'a>> {
        Some(FanReport {
            name: name.to_owned(),
            found: self.found.as_ref().ok()?,
            options: &self.input.options,
            budget: &self.budget,
            sizes: &self.input.sizes,
            measurements: self.input.measured.len(),
            wavelength_was_read: self.input.measured.iter().all(|a| a.wavelength_nm.is_some()),
            inputs,
            command,
            software: software.to_owned(),
        })
    }

    /// Pitch as the plane at the grid's distance has it, where the model is that of eq. 4.17.
    #[must_use]
    pub fn distance(&self) -> Millimetre {
        Millimetre(self.input.options.grid_distance)
    }
}
