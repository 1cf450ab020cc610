//! From measured angles to the pattern and the angles between all its neighbours.

use std::fmt::Write as _;

use nalgebra::{DMatrix, DVector};

use super::fit::{Known, fit, mean_step};
use super::means::pairs;
use super::{
    AngleSpread, Candidate, FanFit, FanFitError, FanModel, MeanAngle, MeasuredAngle, Nuisance,
    StageGeometry, choose, mean_angles, spread,
};
use crate::pattern::{
    AnglePair, Order, Pattern, PatternModel, PatternUncertainty, angle_between, neighbour_pairs,
};

/// Rounds of correcting the wavelength by the fan that the angles give: each gains three digits.
const ROUNDS: usize = 4;
/// Steps of differences of parameters, which are radians and relative numbers.
const STEP: f64 = 1e-6;

/// How a fan is calibrated.
#[derive(Debug, Clone, PartialEq)]
pub struct FanOptions {
    /// Columns and rows of the fan, both odd.
    pub size: [u32; 2],
    /// Wavelength in vacuum at which the result holds, nm.
    pub reference_wavelength_nm: f64,
    /// Distance of the plane on which a pitch is stated, mm.
    pub grid_distance: f64,
    /// The module in front of the plane, as far as it is known.
    pub geometry: StageGeometry,
    /// Standard uncertainty of the misalignment across the beam and along it, mm; across may be
    /// infinite, when it is estimated from the angles alone.
    pub u_offset: [f64; 2],
    /// Standard uncertainty that all wavelengths share, nm: of the readings' calibration, or of the
    /// wavelength itself where it was not read.
    pub u_wavelength_nm: f64,
    /// Standard uncertainty of an angle that does not state its own, radians; without it, the scatter
    /// of repetitions says.
    pub u_angle: Option<f64>,
    /// Standard uncertainty of the difference of two readings of the stage that all repetitions of a
    /// pair share, radians: its graduation, which no repetition shows. It differs from pair to pair.
    pub u_stage: f64,
    /// Standard uncertainty of the right angle between the directions of a grating, radians.
    pub non_orthogonality: f64,
    /// The model to take; without it, the angles say.
    pub model: Option<FanModel>,
}

impl Default for FanOptions {
    fn default() -> Self {
        Self {
            size: [11, 11],
            reference_wavelength_nm: 658.0,
            grid_distance: 1000.0,
            geometry: StageGeometry::aligned(5000.0),
            u_offset: [1.0, 1.0],
            u_wavelength_nm: 0.4,
            u_angle: None,
            u_stage: 0.0,
            // What masks of gratings are written to, with a wide margin.
            non_orthogonality: 0.05f64.to_radians(),
            model: None,
        }
    }
}

/// An angle between neighbours with its standard uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AngleOfPair {
    /// The beams.
    pub pair: AnglePair,
    /// The angle at the reference wavelength, radians.
    pub angle: f64,
    /// Standard uncertainty, radians: the root of the squares of the other two.
    pub u: f64,
    /// From the scatter of the measurements, and of single beams about the model.
    pub u_random: f64,
    /// From what all measurements share: wavelength and misalignment.
    pub u_shared: f64,
}

/// A calibrated fan.
#[derive(Debug, Clone, PartialEq)]
pub struct FanCalibration {
    /// The mean of each pair.
    pub means: Vec<MeanAngle>,
    /// The angle of each pair between the beams themselves: the mean turn, corrected for misalignment
    /// and tilt as far as they are known or estimated; radians.
    pub corrected: Vec<f64>,
    /// Scatter of repetitions, if there are any.
    pub spread: Option<AngleSpread>,
    /// Every model with its fit.
    pub candidates: Vec<Candidate>,
    /// Index of the one that was taken.
    pub chosen: usize,
    /// The fit that was taken.
    pub fit: FanFit,
    /// The pattern.
    pub pattern: Pattern,
    /// Standard uncertainty per axis of a single beam about the model that the residuals cannot
    /// exclude, radians.
    pub beam_sigma: f64,
    /// All angles between neighbours, as [`neighbour_pairs`] has them.
    pub angles: Vec<AngleOfPair>,
}

/// Calibrates a fan.
///
/// # Errors
/// [`FanFitError`].
pub fn calibrate_fan(
    measured: &[MeasuredAngle],
    options: &FanOptions,
) -> Result<FanCalibration, FanFitError> {
    let known = known(options);
    let means = corrected_means(measured, options, &known)?;
    let models: Vec<FanModel> = options.model.map_or_else(|| FanModel::ALL.to_vec(), |m| vec![m]);
    let step = mean_step(&means);
    let try_one =
        |model: FanModel| Candidate { model, fit: fit(model, &model.start(step), &means, &known) };
    let candidates: Vec<Candidate> = models.into_iter().map(try_one).collect();
    let chosen = choose(&candidates);
    let taken = chosen.and_then(|at| Some((at, candidates.get(at)?.fit.as_ref().ok()?.clone())));
    let Some((chosen, fit)) = taken else {
        let why = candidates.into_iter().find_map(|c| c.fit.err());
        return Err(why.unwrap_or(FanFitError::NoConvergence));
    };
    let beam_sigma = beam_sigma(&fit, &means);
    let corrected = corrected(&fit, &means)?;
    let u = worth(&fit, options.size, beam_sigma)?;
    let pattern = pattern_of(&fit, options, u).ok_or(FanFitError::NoBeam)?;
    let angles = angles(&fit, &pattern, beam_sigma)?;
    let spread = spread(&means);
    Ok(FanCalibration {
        means,
        corrected,
        spread,
        candidates,
        chosen,
        fit,
        pattern,
        beam_sigma,
        angles,
    })
}

fn known(options: &FanOptions) -> Known {
    let [across, along, _] = options.geometry.offset;
    let wavelength = options.u_wavelength_nm / options.reference_wavelength_nm;
    Known {
        geometry: options.geometry,
        shared: [
            Nuisance { value: 0.0, sigma: wavelength },
            Nuisance { value: across, sigma: options.u_offset[0] },
            Nuisance { value: along, sigma: options.u_offset[1] },
        ],
        non_orthogonality: options.non_orthogonality,
    }
}

/// Means at the reference wavelength, corrected by the fan that they give themselves.
fn corrected_means(
    measured: &[MeasuredAngle],
    options: &FanOptions,
    known: &Known,
) -> Result<Vec<MeanAngle>, FanFitError> {
    let [half_m, half_n] = options.size.map(|n| n / 2);
    let is_inside = |o: Order| o.m.unsigned_abs() <= half_m && o.n.unsigned_abs() <= half_n;
    let outside = measured.iter().flat_map(|a| [a.from, a.to]).find(|o| !is_inside(*o));
    if let Some(order) = outside {
        return Err(FanFitError::Outside { m: order.m, n: order.n });
    }
    let grid = FanModel::RadialGrid;
    let apart = |a: &MeasuredAngle| {
        f64::from((a.to.m - a.from.m).abs().max((a.to.n - a.from.n).abs()).max(1))
    };
    let step = measured.iter().map(|a| a.angle / apart(a)).sum::<f64>() / measured.len() as f64;
    let mut parameters = grid.start(step);
    for _ in 0..ROUNDS {
        let means = means(measured, options, known, &parameters)?;
        if pairs(measured).len() < grid.count() {
            let (angles, parameters) = (means.len(), grid.count());
            return Err(FanFitError::TooFew { angles, parameters });
        }
        parameters = fit(grid, &parameters, &means, known)?.parameters;
    }
    means(measured, options, known, &parameters)
}

fn means(
    measured: &[MeasuredAngle],
    options: &FanOptions,
    known: &Known,
    parameters: &[f64],
) -> Result<Vec<MeanAngle>, FanFitError> {
    let direction = |order, scale| FanModel::RadialGrid.direction(parameters, order, scale);
    let reference = options.reference_wavelength_nm;
    let mut means = mean_angles(measured, &direction, &known.geometry, reference, options.u_angle)
        .ok_or(FanFitError::NoUncertainty)?;
    // Repeating does not make it smaller.
    means.iter_mut().for_each(|mean| mean.u = mean.u.hypot(options.u_stage));
    Ok(means)
}

/// What single beams may be off the model, per axis: half of the variance of an angle that the
/// residuals show above their noise, but never less than they could not show (chi-square over its
/// degrees of freedom scatters by the root of two over them).
fn beam_sigma(fit: &FanFit, means: &[MeanAngle]) -> f64 {
    let redundancy = fit.redundancy().max(1) as f64;
    let above = (fit.chi2 / redundancy - 1.0).max((2.0 / redundancy).sqrt());
    let weights: f64 = means.iter().map(|m| m.u.powi(-2)).sum();
    (0.5 * above * means.len() as f64 / weights).sqrt()
}

/// Each mean turn as an angle between two beams.
fn corrected(fit: &FanFit, means: &[MeanAngle]) -> Result<Vec<f64>, FanFitError> {
    let one = |(mean, computed): (&MeanAngle, &f64)| {
        let at = |order| fit.model.direction(&fit.parameters, order, 0.0);
        let (from, to) = (at(mean.from)?, at(mean.to)?);
        Some(mean.turn + angle_between(&from, &to) - computed)
    };
    let all: Option<Vec<f64>> = means.iter().zip(&fit.computed).map(one).collect();
    all.ok_or(FanFitError::NoBeam)
}

/// The derivative of a vector of numbers by the parameters, by central differences.
fn jacobian(
    fit: &FanFit,
    of: &dyn Fn(&[f64]) -> Option<Vec<f64>>,
) -> Result<DMatrix<f64>, FanFitError> {
    let moved = |i: usize, by: f64| {
        let mut there = fit.parameters.clone();
        there[i] += by;
        of(&there).ok_or(FanFitError::NoBeam)
    };
    let mut columns = Vec::new();
    for i in 0..fit.parameters.len() {
        let (up, down) = (moved(i, STEP)?, moved(i, -STEP)?);
        let slopes = up.iter().zip(&down).map(|(u, d)| (u - d) / (2.0 * STEP));
        columns.push(DVector::from_iterator(up.len(), slopes));
    }
    Ok(DMatrix::from_columns(&columns))
}

/// What a pattern file says of a fan: errors common to all beams as a scale, and the rest of each.
fn worth(
    fit: &FanFit,
    [columns, rows]: [u32; 2],
    beam_sigma: f64,
) -> Result<PatternUncertainty, FanFitError> {
    let (half_m, half_n) = ((columns / 2) as i32, (rows / 2) as i32);
    let orders: Vec<Order> =
        (-half_n..=half_n).flat_map(|n| (-half_m..=half_m).map(move |m| Order { m, n })).collect();
    let cosines = |parameters: &[f64]| {
        let each = orders.iter().map(|o| fit.model.direction(parameters, *o, 0.0));
        let all: Option<Vec<_>> = each.collect();
        Some(all?.iter().flat_map(|d| [d.x, d.y]).collect::<Vec<f64>>())
    };
    let here = DVector::from_vec(cosines(&fit.parameters).ok_or(FanFitError::NoBeam)?);
    let by_parameters = jacobian(fit, &cosines)?;
    let scale = by_parameters.tr_mul(&here).transpose() / here.norm_squared();
    let rest = &by_parameters - &here * &scale;
    let common = (&scale * &fit.covariance * scale.transpose())[(0, 0)].max(0.0).sqrt();
    let single = (&rest * &fit.covariance * rest.transpose()).trace().max(0.0) / here.len() as f64;
    let angle_deg = (single + beam_sigma * beam_sigma).sqrt().to_degrees();
    Ok(PatternUncertainty { angle_deg, common_relative: common })
}

/// The pattern of a fit, for a file: the radial grid as such, any other model as a table.
#[must_use]
pub fn pattern_of(fit: &FanFit, options: &FanOptions, u: PatternUncertainty) -> Option<Pattern> {
    let distance = options.grid_distance;
    let mut pattern = Pattern {
        columns: options.size[0],
        rows: options.size[1],
        reference_wavelength_nm: options.reference_wavelength_nm,
        model: PatternModel::Table { tangents: Vec::new() },
        u,
        zero_order_relative_intensity: None,
    };
    pattern.model = match (fit.model, fit.parameters.as_slice()) {
        (FanModel::RadialGrid, [pitch, radial]) => PatternModel::RadialGrid {
            pitch_mm: pitch * distance,
            k1_per_mm2: radial / (distance * distance),
            distance_mm: distance,
        },
        _ => {
            let tangents: Option<Vec<[f64; 2]>> =
                pattern.orders().map(|o| fit.tangent(o).map(|t| [t.x, t.y])).collect();
            PatternModel::Table { tangents: tangents? }
        }
    };
    Some(pattern)
}

fn angles(
    fit: &FanFit,
    pattern: &Pattern,
    beam_sigma: f64,
) -> Result<Vec<AngleOfPair>, FanFitError> {
    let pairs = neighbour_pairs(pattern);
    let all = |parameters: &[f64]| -> Option<Vec<f64>> {
        let direction = |order| fit.model.direction(parameters, order, 0.0);
        pairs.iter().map(|p| Some(angle_between(&direction(p.a)?, &direction(p.b)?))).collect()
    };
    let values = all(&fit.parameters).ok_or(FanFitError::NoBeam)?;
    let slopes = jacobian(fit, &all)?;
    let shared = &fit.covariance - &fit.random;
    let of = |pair: usize, covariance: &DMatrix<f64>| {
        let row = slopes.row(pair);
        (row * covariance * row.transpose())[(0, 0)].max(0.0)
    };
    let one = |(i, (pair, angle)): (usize, (&AnglePair, f64))| {
        let random = of(i, &fit.random) + 2.0 * beam_sigma * beam_sigma;
        let shared = of(i, &shared);
        AngleOfPair {
            pair: *pair,
            angle,
            u: (random + shared).sqrt(),
            u_random: random.sqrt(),
            u_shared: shared.sqrt(),
        }
    };
    Ok(pairs.iter().zip(values).enumerate().map(one).collect())
}

/// All angles between neighbours as CSV, degrees.
#[must_use]
pub fn write_fan_angles(angles: &[AngleOfPair]) -> String {
    let mut text =
        "from_m,from_n,to_m,to_n,direction,angle_deg,u_deg,u_random_deg,u_shared_deg\n".to_owned();
    for a in angles {
        let direction = match (a.pair.b.m - a.pair.a.m, a.pair.b.n - a.pair.a.n) {
            (1, 0) => "horizontal",
            (0, 1) => "vertical",
            (1, 1) => "diagonal-down",
            _ => "diagonal-up",
        };
        let numbers = [a.angle, a.u, a.u_random, a.u_shared].map(f64::to_degrees);
        let [angle, u, random, shared] = numbers;
        let (from, to) = (a.pair.a, a.pair.b);
        let _ = writeln!(
            text,
            "{},{},{},{},{direction},{angle:.7},{u:.7},{random:.7},{shared:.7}",
            from.m, from.n, to.m, to.n
        );
    }
    text
}
