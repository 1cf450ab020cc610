//! The fan from photographs: what a session's adjustment says of it (self-calibration).
//!
//! The adjustment holds the fan's common scale and the errors of its beams as unknowns with priors. A
//! turn of the whole fan against the module is no property of the fan: the module's orientation takes
//! it up, and only the priors hold it. It is taken out of the estimate and of its covariance, so that
//! what is left is what angles between beams depend on.
//!
//! What one session cannot show: dots on one flat wall, seen while the module moves without turning,
//! stay the same for a fan that is stretched as a whole while the module stands nearer, and for one
//! that is sheared towards a side while it stands further to that side. There the priors decide, and
//! the stated uncertainty says so ([`SessionFan::scale_told`]).

use nalgebra::{DMatrix, DVector, Vector2, Vector3};

use super::{AngleOfPair, FanModel};
use crate::adjust::Options;
use crate::pattern::{
    Order, Pattern, PatternModel, PatternUncertainty, angle_between, neighbour_pairs,
};
use crate::scene::Setup;
use crate::solve::{SessionSolution, SolvedCapture, solve_session_with};

/// Along the valley that a weak prior leaves open, steps are short.
const MAX_ITERATIONS: usize = 1000;

/// What is known of the fan before a session is asked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FanPrior {
    /// Relative standard uncertainty of the scale (pitch).
    pub scale: f64,
    /// Standard uncertainty of a single beam per axis, radians; a radial term that the pattern does
    /// not have must find its place in it.
    pub beam: f64,
}

impl FanPrior {
    /// Of a fan known from its data sheet only.
    #[must_use]
    pub fn nominal() -> Self {
        Self { scale: 0.01, beam: 0.05f64.to_radians() }
    }

    /// A setup in which no more is known of the fan.
    #[must_use]
    pub fn weaken(&self, setup: &Setup) -> Setup {
        let mut weak = setup.clone();
        let u =
            PatternUncertainty { angle_deg: self.beam.to_degrees(), common_relative: self.scale };
        weak.pattern.u = u;
        weak
    }
}

/// A fan calibrated from a session.
#[derive(Debug, Clone, PartialEq)]
pub struct SessionFan {
    /// The fan as a table, at its reference wavelength.
    pub pattern: Pattern,
    /// All angles between neighbours; random is what differs from beam to beam, shared the scale.
    pub angles: Vec<AngleOfPair>,
    /// Relative change of the fan's scale against the pattern before.
    pub scale: f64,
    /// Its standard uncertainty.
    pub scale_u: f64,
    /// Part of the scale's prior variance that the session took away: 0 where it told nothing.
    pub scale_told: f64,
    /// Covariance of the beams' direction cosines, (x, y) of each row by row.
    pub covariance: DMatrix<f64>,
    /// The radial grid that comes nearest to all beams, as [`FanModel::tangent`] takes it, with its
    /// covariance: to be held against one from a stage.
    pub grid: (Vec<f64>, DMatrix<f64>),
    /// Root of the a posteriori variance of unit weight of the session.
    pub sigma0: f64,
}

/// Calibrates the fan from a session's captures: adjusts them together with what `prior` leaves open
/// of the pattern, and reads the fan out of it.
///
/// # Errors
/// Why there is no fan, in words.
pub fn calibrate_from_session(
    setup: &Setup,
    captures: &[SolvedCapture<'_>],
    prior: FanPrior,
) -> Result<SessionFan, String> {
    let weak = prior.weaken(setup);
    let options = Options { max_iterations: MAX_ITERATIONS, ..Options::default() };
    let solution = solve_session_with(&weak, captures, &options)?;
    fan_of_session(&weak, &solution)
        .ok_or_else(|| "the fan is not determined by these captures".to_owned())
}

/// Reads the fan out of a session that was adjusted with `setup`, whose pattern's uncertainty is the
/// prior. `None` where the fan is not determined, or a beam does not leave the grating.
#[must_use]
pub fn fan_of_session(setup: &Setup, solution: &SessionSolution) -> Option<SessionFan> {
    let before = &setup.pattern;
    let start: Vec<Vector2<f64>> =
        before.orders().map(|o| Some(before.direction(o, 0.0)?.xy())).collect::<Option<_>>()?;
    let fan = &solution.fan;
    let errors = start.iter().zip(&fan.beams);
    let cosines: Vec<Vector2<f64>> =
        errors.map(|(c, error)| (c + error) * (1.0 + fan.scale)).collect();
    let all = solution.fan_covariance()?;
    // The scale first, then the errors of the beams.
    let count = 2 * cosines.len();
    if all.nrows() != count + 1 {
        return None;
    }
    let mut by_unknowns = DMatrix::zeros(count, count + 1);
    for (i, (c, error)) in start.iter().zip(&fan.beams).enumerate() {
        for axis in 0..2 {
            by_unknowns[(2 * i + axis, 0)] = c[axis] + error[axis];
            by_unknowns[(2 * i + axis, 2 * i + axis + 1)] = 1.0 + fan.scale;
        }
    }
    let raw = &by_unknowns * &all * by_unknowns.transpose();
    let turns = turns(&cosines)?;
    let fit = (turns.tr_mul(&turns)).try_inverse()? * turns.transpose();
    let free = DMatrix::identity(count, count) - &turns * &fit;
    let covariance = &free * raw * free.transpose();
    let change = DVector::from_iterator(
        count,
        cosines.iter().zip(&start).flat_map(|(now, then)| [now.x - then.x, now.y - then.y]),
    );
    let moved = &free * change;
    let cosines: Vec<Vector2<f64>> = start
        .iter()
        .enumerate()
        .map(|(i, c)| c + Vector2::new(moved[2 * i], moved[2 * i + 1]))
        .collect();
    finish(before, setup, &cosines, covariance, solution.sigma0)
}

/// How direction cosines move when the fan turns about x, y and z.
fn turns(cosines: &[Vector2<f64>]) -> Option<DMatrix<f64>> {
    let mut turns = DMatrix::zeros(2 * cosines.len(), 3);
    for (i, c) in cosines.iter().enumerate() {
        let direction = direction(c)?;
        for (axis, unit) in [Vector3::x(), Vector3::y(), Vector3::z()].iter().enumerate() {
            let moved = unit.cross(&direction);
            turns[(2 * i, axis)] = moved.x;
            turns[(2 * i + 1, axis)] = moved.y;
        }
    }
    Some(turns)
}

fn direction(cosines: &Vector2<f64>) -> Option<Vector3<f64>> {
    let z2 = 1.0 - cosines.norm_squared();
    (z2 > 0.0).then(|| cosines.push(z2.sqrt()))
}

fn finish(
    before: &Pattern,
    setup: &Setup,
    cosines: &[Vector2<f64>],
    covariance: DMatrix<f64>,
    sigma0: f64,
) -> Option<SessionFan> {
    let flat = DVector::from_iterator(2 * cosines.len(), cosines.iter().flat_map(|c| [c.x, c.y]));
    // The scale is what all beams have in common; what is left is a single beam's.
    let scale_of = flat.transpose() / flat.norm_squared();
    let rest = DMatrix::identity(flat.len(), flat.len()) - &flat * &scale_of;
    let scale_u = (&scale_of * &covariance * scale_of.transpose())[(0, 0)].max(0.0).sqrt();
    let own = &rest * &covariance * rest.transpose();
    let single = (own.trace().max(0.0) / flat.len() as f64).sqrt();
    let start: Vec<f64> = before
        .orders()
        .map(|o| before.direction(o, 0.0).map(|d| [d.x, d.y]))
        .collect::<Option<Vec<_>>>()?
        .concat();
    let scale = 1.0 - (&scale_of * DVector::from_vec(start))[(0, 0)];
    let reading = setup.wavelength_u_nm / before.reference_wavelength_nm;
    let prior = before.u.common_relative.hypot(reading);
    let mut pattern = before.clone();
    let tangents: Option<Vec<[f64; 2]>> =
        cosines.iter().map(|c| direction(c).map(|d| [d.x / d.z, d.y / d.z])).collect();
    pattern.model = PatternModel::Table { tangents: tangents? };
    pattern.u = PatternUncertainty { angle_deg: single.to_degrees(), common_relative: scale_u };
    let angles = angles(&pattern, cosines, &covariance, &own)?;
    let grid = grid(before, &flat, &covariance)?;
    let scale_told = 1.0 - (scale_u / prior).powi(2).min(1.0);
    Some(SessionFan { pattern, angles, scale, scale_u, scale_told, covariance, grid, sigma0 })
}

/// Steps of Gauss and Newton from any fan: each gains some digits.
const GRID_STEPS: usize = 8;

/// The radial grid nearest to direction cosines. All beams have the same weight: what single beams are
/// off the grid is more than what is not known of them.
fn grid(
    before: &Pattern,
    cosines: &DVector<f64>,
    covariance: &DMatrix<f64>,
) -> Option<(Vec<f64>, DMatrix<f64>)> {
    let model = FanModel::RadialGrid;
    let computed = |at: &[f64]| -> Option<DVector<f64>> {
        let each = before.orders().map(|o| Some(model.direction(at, o, 0.0)?.xy()));
        let all: Vec<Vector2<f64>> = each.collect::<Option<_>>()?;
        Some(DVector::from_iterator(2 * all.len(), all.iter().flat_map(|c| [c.x, c.y])))
    };
    let middle = before.direction(Order { m: 1, n: 0 }, 0.0)?;
    let mut at = model.start(middle.x.atan2(middle.z));
    let mut solve = DMatrix::zeros(at.len(), cosines.len());
    for _ in 0..GRID_STEPS {
        let mut columns = Vec::new();
        for i in 0..at.len() {
            let moved = |by: f64| {
                let mut there = at.clone();
                there[i] += by;
                computed(&there)
            };
            columns.push((moved(1e-6)? - moved(-1e-6)?) / 2e-6);
        }
        let slopes = DMatrix::from_columns(&columns);
        solve = slopes.tr_mul(&slopes).try_inverse()? * slopes.transpose();
        let step = &solve * (cosines - computed(&at)?);
        at.iter_mut().zip(step.iter()).for_each(|(a, s)| *a += s);
    }
    let covariance = &solve * covariance * solve.transpose();
    Some((at, covariance))
}

/// All angles between neighbours with their uncertainties.
fn angles(
    pattern: &Pattern,
    cosines: &[Vector2<f64>],
    covariance: &DMatrix<f64>,
    own: &DMatrix<f64>,
) -> Option<Vec<AngleOfPair>> {
    let one = |pair: crate::pattern::AnglePair| {
        let (a, b) = (pattern.index(pair.a)?, pattern.index(pair.b)?);
        let angle = |moves: [f64; 4]| {
            let first = direction(&(cosines[a] + Vector2::new(moves[0], moves[1])))?;
            let second = direction(&(cosines[b] + Vector2::new(moves[2], moves[3])))?;
            Some(angle_between(&first, &second))
        };
        let places = [2 * a, 2 * a + 1, 2 * b, 2 * b + 1];
        let mut slopes = [0.0; 4];
        for (i, slope) in slopes.iter_mut().enumerate() {
            let step = |by: f64| std::array::from_fn(|j| if i == j { by } else { 0.0 });
            *slope = (angle(step(1e-6))? - angle(step(-1e-6))?) / 2e-6;
        }
        let variance = |matrix: &DMatrix<f64>| -> f64 {
            let sum = |(i, r): (usize, &usize)| -> f64 {
                let row = places.iter().zip(&slopes).map(|(c, slope)| matrix[(*r, *c)] * slope);
                slopes[i] * row.sum::<f64>()
            };
            places.iter().enumerate().map(sum).sum::<f64>().max(0.0)
        };
        let (all, random) = (variance(covariance), variance(own));
        Some(AngleOfPair {
            pair,
            angle: angle([0.0; 4])?,
            u: all.sqrt(),
            u_random: random.sqrt(),
            u_shared: (all - random).max(0.0).sqrt(),
        })
    };
    neighbour_pairs(pattern).into_iter().map(one).collect()
}
