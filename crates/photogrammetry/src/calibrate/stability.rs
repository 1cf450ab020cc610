//! How stable a camera is: calibrations that were repeated, compared with one another and with the
//! standard deviations that they state (the dissertation, section 3.2.3: focal length and principal
//! point over ten calibrations, the camera kept on or switched).
//!
//! A change counts as significant where chance alone, with the stated standard deviations, gives
//! one as large in fewer than one of twenty *comparisons of all changes together*: the level of
//! 5 % is shared among the single tests (Bonferroni), since among eighty changes at 5 % each four
//! would be found in a camera that never changed.

use super::chi_square::exceeds;
use super::{Interior, Stated};
use crate::camera::Camera;

/// Probability of a single false alarm in a comparison.
const LEVEL: f64 = 0.05;

/// The step from one calibration to the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// Later minus earlier.
    pub difference: f64,
    /// Its standard deviation as stated; `None` where a calibration states none.
    pub sigma: Option<f64>,
    /// How often chance alone gives a change this large.
    pub probability: Option<f64>,
    /// Whether it is more than chance, all changes of the comparison considered.
    pub is_significant: bool,
}

/// One parameter over all calibrations.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterStability {
    /// Which.
    pub parameter: Interior,
    /// Its values, in order.
    pub values: Vec<f64>,
    /// Their stated standard deviations.
    pub stated: Vec<Option<f64>>,
    /// Mean.
    pub mean: f64,
    /// Standard deviation of a single calibration, from the scatter (n - 1).
    pub scatter: f64,
    /// Largest minus smallest.
    pub range: f64,
    /// Slope of the straight line over the calibrations' numbers, per calibration.
    pub drift: f64,
    /// Its standard deviation as stated.
    pub drift_sigma: Option<f64>,
    /// How often chance alone gives such a slope; `None` for fewer than three calibrations.
    pub drift_probability: Option<f64>,
    /// Whether the drift is more than chance.
    pub is_drifting: bool,
    /// How often chance alone gives a scatter this large, about the weighted mean.
    pub scatter_probability: Option<f64>,
    /// Whether the values scatter more than stated.
    pub is_unstable: bool,
    /// From each calibration to the next.
    pub changes: Vec<Change>,
}

/// Calibrations compared.
#[derive(Debug, Clone, PartialEq)]
pub struct Stability {
    /// Names of the calibrations, in order.
    pub names: Vec<String>,
    /// The parameters.
    pub parameters: Vec<ParameterStability>,
    /// Spatial scatter of the principal point, pixels: root of the sum of the two variances
    /// (eq. 3.6).
    pub principal_point_px: f64,
    /// Probability below which a single test is significant.
    pub level: f64,
}

/// Why calibrations cannot be compared.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StabilityError {
    /// One alone.
    #[error("one calibration alone cannot be compared: name two or more")]
    TooFew,
    /// Pictures of different sizes.
    #[error("{name} is for pictures of {found}, {first} for {expected}: not the same camera")]
    Size {
        /// Which.
        name: String,
        /// Its size.
        found: String,
        /// The first one's name.
        first: String,
        /// The first one's size.
        expected: String,
    },
}

/// Compares calibrations in the order in which they were made: a name, the interior orientation and
/// what it states of its worth.
///
/// # Errors
/// [`StabilityError`].
pub fn compare(
    calibrations: &[(String, Camera, Option<Stated>)],
) -> Result<Stability, StabilityError> {
    let [(first, camera, _), rest @ ..] = calibrations else { return Err(StabilityError::TooFew) };
    if rest.is_empty() {
        return Err(StabilityError::TooFew);
    }
    let size = |c: &Camera| format!("{} x {}", c.width, c.height);
    if let Some((name, other, _)) = rest.iter().find(|(_, c, _)| size(c) != size(camera)) {
        return Err(StabilityError::Size {
            name: name.clone(),
            found: size(other),
            first: first.clone(),
            expected: size(camera),
        });
    }
    let mut parameters: Vec<ParameterStability> =
        compared(calibrations).into_iter().map(|p| of_parameter(p, calibrations)).collect();
    // Every step, one slope and one scatter for each parameter.
    let tests = parameters.len() * (calibrations.len() + 1);
    let level = LEVEL / tests.max(1) as f64;
    parameters.iter_mut().for_each(|p| p.decide(level));
    let scatter =
        |wanted| parameters.iter().find(|p| p.parameter == wanted).map_or(0.0, |p| p.scatter);
    let principal_point_px = scatter(Interior::Cx).hypot(scatter(Interior::Cy));
    let names = calibrations.iter().map(|c| c.0.clone()).collect();
    Ok(Stability { names, parameters, principal_point_px, level })
}

/// What is compared: both focal lengths, or the one where any calibration has one; the principal
/// point; and each coefficient that is not zero throughout.
fn compared(calibrations: &[(String, Camera, Option<Stated>)]) -> Vec<Interior> {
    let states = |p: Interior| {
        calibrations.iter().filter_map(|c| c.2.as_ref()).any(|s| s.parameters.contains(&p))
    };
    let is_tied = states(Interior::F);
    let differs = |p: Interior| calibrations.iter().any(|c| p.of(&c.1) != 0.0);
    let is_compared = |p: &Interior| match p {
        Interior::F => is_tied,
        Interior::Fx | Interior::Fy => !is_tied,
        Interior::Cx | Interior::Cy => true,
        _ => differs(*p),
    };
    Interior::ALL.into_iter().filter(is_compared).collect()
}

fn of_parameter(
    parameter: Interior,
    calibrations: &[(String, Camera, Option<Stated>)],
) -> ParameterStability {
    let values: Vec<f64> = calibrations.iter().map(|c| parameter.of(&c.1)).collect();
    let of_one = |s: &Stated| s.standard_deviation(parameter);
    let stated: Vec<Option<f64>> =
        calibrations.iter().map(|c| c.2.as_ref().and_then(of_one)).collect();
    let sigmas: Option<Vec<f64>> = stated.iter().copied().collect();
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    let (low, high) =
        values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    let (drift, drift_sigma) = slope(&values, sigmas.as_deref());
    // Of two calibrations the slope is the change.
    let is_series = values.len() > 2;
    ParameterStability {
        parameter,
        mean,
        scatter: (squares / (n - 1.0)).sqrt(),
        range: high - low,
        drift,
        drift_sigma,
        drift_probability: drift_sigma.filter(|_| is_series).map(|sigma| two_sided(drift, sigma)),
        is_drifting: false,
        scatter_probability: sigmas.map(|sigmas| scatter_probability(&values, &sigmas)),
        is_unstable: false,
        changes: changes(&values, &stated),
        values,
        stated,
    }
}

/// How often chance gives more than this, either way.
fn two_sided(difference: f64, sigma: f64) -> f64 {
    exceeds((difference / sigma).powi(2), 1)
}

fn changes(values: &[f64], stated: &[Option<f64>]) -> Vec<Change> {
    values
        .windows(2)
        .zip(stated.windows(2))
        .map(|(v, s)| {
            let difference = v[1] - v[0];
            let sigma = s[0].zip(s[1]).map(|(a, b)| a.hypot(b));
            let probability = sigma.map(|sigma| two_sided(difference, sigma));
            Change { difference, sigma, probability, is_significant: false }
        })
        .collect()
}

/// Slope of the straight line over 0, 1, 2, ... and what the stated standard deviations make of it.
fn slope(values: &[f64], sigmas: Option<&[f64]>) -> (f64, Option<f64>) {
    let middle = 0.5 * (values.len() as f64 - 1.0);
    let arm = |i: usize| i as f64 - middle;
    let arms: f64 = (0..values.len()).map(|i| arm(i).powi(2)).sum();
    let slope = values.iter().enumerate().map(|(i, v)| arm(i) * v).sum::<f64>() / arms;
    let variance = |s: &[f64]| s.iter().enumerate().map(|(i, s)| (arm(i) * s).powi(2)).sum::<f64>();
    (slope, sigmas.map(|s| variance(s).sqrt() / arms))
}

fn scatter_probability(values: &[f64], sigmas: &[f64]) -> f64 {
    let weight = |sigma: &f64| sigma.powi(-2);
    let total: f64 = sigmas.iter().map(weight).sum();
    let mean = values.iter().zip(sigmas).map(|(v, s)| v * weight(s)).sum::<f64>() / total;
    let sum: f64 = values.iter().zip(sigmas).map(|(v, s)| (v - mean).powi(2) * weight(s)).sum();
    exceeds(sum, values.len() - 1)
}

impl ParameterStability {
    fn decide(&mut self, level: f64) {
        let is_below = |p: Option<f64>| p.is_some_and(|p| p < level);
        self.is_drifting = is_below(self.drift_probability);
        self.is_unstable = is_below(self.scatter_probability);
        for change in &mut self.changes {
            change.is_significant = is_below(change.probability);
        }
    }
}
