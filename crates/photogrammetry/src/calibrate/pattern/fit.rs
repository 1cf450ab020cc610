//! Weighted least squares of a model of the fan, with what all angles share as further unknowns.
//!
//! Shared are the wavelength (relative error of its readings), and the misalignment of the grating
//! across and along the beam; each has a prior. Along the beam a misalignment stretches every angle
//! by nearly `y / CD`, as the pitch and the wavelength do: angles cannot tell the three apart, so what
//! the priors leave open goes into the uncertainty of the pitch. Across the beam it adds
//! `x (cos a - cos b) / CD`, of opposite sign on both sides of the middle: that shows a little in the
//! data of a symmetric fan, and cannot be told from a tilt of the grating.

use nalgebra::{DMatrix, DVector};

use super::{FanModel, MeanAngle, StageGeometry};
use crate::pattern::Order;

/// Something that all angles share, known beforehand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nuisance {
    /// What is known of it: value; relative for the wavelength, mm for misalignments.
    pub value: f64,
    /// Standard uncertainty; infinite where nothing is known.
    pub sigma: f64,
}

/// Number of shared unknowns: wavelength, misalignment across, misalignment along.
pub(super) const SHARED: usize = 3;
/// A step that changes no unknown by more than this part of its standard deviation is the last.
const SAME: f64 = 1e-8;
const MAX_ITERATIONS: usize = 50;
/// Below this eigenvalue of the scaled normal matrix a direction is not determined.
const LEAST_EIGENVALUE: f64 = 1e-10;
/// Below this one it may be so little determined that the curvature of the model leads away; where
/// the fit then does not settle, that is why.
const WEAK_EIGENVALUE: f64 = 1e-6;
/// Steps of differences: in radians and relative numbers, and in mm of misalignment. The curvature of
/// what is differentiated is of order one, so a central difference is good to ten digits.
const STEP: f64 = 1e-5;
const STEP_MM: f64 = 1e-2;

/// Why there is no fit.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FanFitError {
    /// More unknowns than angles.
    #[error("{angles} pairs of beams for {parameters} parameters: measure more pairs")]
    TooFew {
        /// Pairs measured.
        angles: usize,
        /// Parameters of the model.
        parameters: usize,
    },
    /// The angles do not determine a parameter.
    #[error("{parameter} is not determined by these angles")]
    Undetermined {
        /// Its name.
        parameter: String,
    },
    /// A beam that the fan does not have.
    #[error("the fan has no beam ({m}, {n}): state its size")]
    Outside {
        /// Column.
        m: i32,
        /// Row.
        n: i32,
    },
    /// A beam does not leave the grating.
    #[error("a beam of these orders does not leave the grating")]
    NoBeam,
    /// It did not settle.
    #[error(
        "no convergence within {MAX_ITERATIONS} iterations: are the orders of the beams right?"
    )]
    NoConvergence,
    /// Nothing tells what the angles are worth.
    #[error("nothing was repeated and no angle states its uncertainty")]
    NoUncertainty,
}

/// What is known before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Known {
    pub geometry: StageGeometry,
    pub shared: [Nuisance; SHARED],
    /// Standard uncertainty of a right angle between the rows and columns of a grating, radians.
    pub non_orthogonality: f64,
}

/// A fitted model.
#[derive(Debug, Clone, PartialEq)]
pub struct FanFit {
    /// The model.
    pub model: FanModel,
    /// Its parameters, as [`FanModel::tangent`] takes them.
    pub parameters: Vec<f64>,
    /// Their covariance, everything in it.
    pub covariance: DMatrix<f64>,
    /// The part of it that the scatter of single angles makes; the rest is of what they share.
    pub random: DMatrix<f64>,
    /// Wavelength (relative), misalignment across and along the beam (mm) after the fit.
    pub shared: [Nuisance; SHARED],
    /// Measured minus computed turns, radians, in the order of the means.
    pub residuals: Vec<f64>,
    /// Computed turns, radians.
    pub computed: Vec<f64>,
    /// Weighted sum of squares, priors included.
    pub chi2: f64,
    /// Number of parameters that the angles determine; what a prior holds counts in part.
    pub effective: f64,
    /// Steps taken.
    pub iterations: usize,
}

impl FanFit {
    /// The direction of a beam at the reference wavelength on the plane z = 1.
    #[must_use]
    pub fn tangent(&self, order: Order) -> Option<nalgebra::Vector2<f64>> {
        self.model.tangent(&self.parameters, order)
    }

    /// Angles minus parameters that they determine.
    #[must_use]
    pub fn redundancy(&self) -> usize {
        (self.residuals.len() as f64 - self.effective).round().max(0.0) as usize
    }

    /// Probability that chance alone gives a sum of squares this large.
    #[must_use]
    pub fn probability(&self) -> f64 {
        super::super::chi_square::exceeds(self.chi2, self.redundancy())
    }

    /// Akaike's criterion, corrected for few observations; the noise is known, so chi-square takes
    /// the place of the likelihood.
    #[must_use]
    pub fn aicc(&self) -> f64 {
        let (n, k) = (self.residuals.len() as f64, self.effective);
        let few = if n - k > 1.0 { 2.0 * k * (k + 1.0) / (n - k - 1.0) } else { f64::INFINITY };
        self.chi2 + 2.0 * k + few
    }

    /// Schwarz's criterion.
    #[must_use]
    pub fn bic(&self) -> f64 {
        self.chi2 + self.effective * (self.residuals.len() as f64).ln()
    }
}

/// Fits a model from start values.
///
/// # Errors
/// [`FanFitError`].
pub(super) fn fit(
    model: FanModel,
    start: &[f64],
    means: &[MeanAngle],
    known: &Known,
) -> Result<FanFit, FanFitError> {
    if means.len() < model.count() {
        return Err(FanFitError::TooFew { angles: means.len(), parameters: model.count() });
    }
    let system = System { model, means, known };
    let mut at: Vec<f64> = start.to_vec();
    at.extend(known.shared.iter().map(|s| s.value));
    for iterations in 1..=MAX_ITERATIONS {
        let linear = system.linear(&at)?;
        let (inverse, weakest) = system.inverse(&linear.normal(0))?;
        let step = &inverse * &linear.gradient();
        let next: Vec<f64> = at.iter().zip(step.iter()).map(|(a, s)| a + s).collect();
        let there = system.damped(&at, &next, linear.chi2());
        let weak = (weakest.1 < WEAK_EIGENVALUE).then(|| system.undetermined(weakest.0));
        at = match (there, weak) {
            (Some(there), _) if iterations < MAX_ITERATIONS => there,
            (_, Some(weak)) => return Err(weak),
            (_, None) => return Err(FanFitError::NoConvergence),
        };
        let still = |(i, s): (usize, &f64)| s.abs() <= SAME * inverse[(i, i)].sqrt();
        if step.iter().enumerate().all(still) {
            return system.finish(&at, iterations);
        }
    }
    Err(FanFitError::NoConvergence)
}

/// Fits a model to mean angles. `shared` are wavelength (relative), misalignment across and along
/// (mm), `non_orthogonality` the standard uncertainty (radians) of the right angle between the
/// directions of a grating, which angles along rows and columns alone do not show.
///
/// # Errors
/// [`FanFitError`].
pub fn fit_fan(
    model: FanModel,
    means: &[MeanAngle],
    geometry: &StageGeometry,
    shared: [Nuisance; 3],
    non_orthogonality: f64,
) -> Result<FanFit, FanFitError> {
    let known = Known { geometry: *geometry, shared, non_orthogonality };
    fit(model, &model.start(mean_step(means)), means, &known)
}

/// The mean angle between neighbours.
pub(super) fn mean_step(means: &[MeanAngle]) -> f64 {
    let apart = |m: &MeanAngle| {
        let (dm, dn) = (m.to.m - m.from.m, m.to.n - m.from.n);
        f64::from(dm).hypot(f64::from(dn)).max(1.0)
    };
    means.iter().map(|m| m.turn / apart(m)).sum::<f64>() / means.len().max(1) as f64
}

struct System<'a> {
    model: FanModel,
    means: &'a [MeanAngle],
    known: &'a Known,
}

/// Whitened rows at an estimate: angles, then priors.
struct Linear {
    jacobian: DMatrix<f64>,
    residuals: DVector<f64>,
    angles: usize,
}

impl Linear {
    fn chi2(&self) -> f64 {
        self.residuals.norm_squared()
    }

    /// Normal matrix of the rows from `first` on.
    fn normal(&self, first: usize) -> DMatrix<f64> {
        let rows = self.jacobian.rows(first, self.jacobian.nrows() - first);
        rows.tr_mul(&rows)
    }

    fn gradient(&self) -> DVector<f64> {
        self.jacobian.tr_mul(&self.residuals)
    }
}

impl System<'_> {
    fn len(&self) -> usize {
        self.model.count() + SHARED
    }

    /// Computed turns.
    fn turns(&self, at: &[f64]) -> Option<Vec<f64>> {
        let (parameters, shared) = at.split_at(self.model.count());
        let mut geometry = self.known.geometry;
        geometry.offset[0] = shared[1];
        geometry.offset[1] = shared[2];
        let one = |m: &MeanAngle| {
            let from = self.model.direction(parameters, m.from, shared[0])?;
            let to = self.model.direction(parameters, m.to, shared[0])?;
            geometry.turn(&from, &to, m.axis).map(f64::abs)
        };
        self.means.iter().map(one).collect()
    }

    /// What is known of an unknown beforehand.
    fn prior(&self, unknown: usize) -> Option<Nuisance> {
        let count = self.model.count();
        let prior = match (self.model, unknown) {
            (_, i) if i >= count => self.known.shared[i - count],
            (FanModel::Grating, 2) => Nuisance { value: 0.0, sigma: self.known.non_orthogonality },
            _ => return None,
        };
        prior.sigma.is_finite().then_some(prior)
    }

    /// Whitened residuals, angles first.
    fn residuals(&self, at: &[f64]) -> Option<Vec<f64>> {
        let turns = self.turns(at)?;
        let angles = self.means.iter().zip(turns).map(|(m, turn)| (m.turn - turn) / m.u);
        let mut all: Vec<f64> = angles.collect();
        for (i, value) in at.iter().enumerate() {
            // One that is known exactly does not move: its column is left out below.
            if let Some(prior) = self.prior(i).filter(|p| p.sigma > 0.0) {
                all.push((prior.value - value) / prior.sigma);
            }
        }
        Some(all)
    }

    fn is_held(&self, unknown: usize) -> bool {
        self.prior(unknown).is_some_and(|p| p.sigma <= 0.0)
    }

    fn linear(&self, at: &[f64]) -> Result<Linear, FanFitError> {
        let residuals = self.residuals(at).ok_or(FanFitError::NoBeam)?;
        let mut jacobian = DMatrix::zeros(residuals.len(), self.len());
        for i in (0..self.len()).filter(|i| !self.is_held(*i)) {
            let step = if i > self.model.count() { STEP_MM } else { STEP };
            let moved = |by: f64| {
                let mut there = at.to_vec();
                there[i] += by;
                self.residuals(&there).ok_or(FanFitError::NoBeam)
            };
            let (up, down) = (moved(step)?, moved(-step)?);
            for (row, (up, down)) in up.iter().zip(&down).enumerate() {
                jacobian[(row, i)] = (down - up) / (2.0 * step);
            }
        }
        Ok(Linear { jacobian, residuals: DVector::from_vec(residuals), angles: self.means.len() })
    }

    /// The inverse of a normal matrix, rows of what is held zero; the unknown that is determined
    /// worst, and its eigenvalue in the scaled matrix.
    fn inverse(&self, normal: &DMatrix<f64>) -> Result<(DMatrix<f64>, (usize, f64)), FanFitError> {
        let free: Vec<usize> = (0..normal.nrows()).filter(|i| !self.is_held(*i)).collect();
        let scale: Vec<f64> = free.iter().map(|i| normal[(*i, *i)].sqrt()).collect();
        if let Some(at) = scale.iter().position(|s| !(*s > 0.0 && s.is_finite())) {
            return Err(self.undetermined(free[at]));
        }
        let scaled = DMatrix::from_fn(free.len(), free.len(), |r, c| {
            normal[(free[r], free[c])] / (scale[r] * scale[c])
        });
        let eigen = scaled.symmetric_eigen();
        let weakest = eigen.eigenvalues.imin();
        let named = free[eigen.eigenvectors.column(weakest).iamax()];
        let value = eigen.eigenvalues[weakest];
        if value.is_nan() || value <= LEAST_EIGENVALUE {
            return Err(self.undetermined(named));
        }
        let mut inverse = DMatrix::zeros(normal.nrows(), normal.nrows());
        for (r, at_r) in free.iter().enumerate() {
            for (c, at_c) in free.iter().enumerate() {
                let sum: f64 = (0..free.len())
                    .map(|k| {
                        let vector = eigen.eigenvectors.column(k);
                        vector[r] * vector[c] / eigen.eigenvalues[k]
                    })
                    .sum();
                inverse[(*at_r, *at_c)] = sum / (scale[r] * scale[c]);
            }
        }
        Ok((inverse, (named, value)))
    }

    fn undetermined(&self, unknown: usize) -> FanFitError {
        const OF_ALL: [&str; SHARED] = [
            "the wavelength",
            "the misalignment across the beam",
            "the misalignment along the beam",
        ];
        let names = self.model.names();
        let parameter = match unknown.checked_sub(names.len()) {
            None => names[unknown].to_owned(),
            Some(at) => OF_ALL[at.min(SHARED - 1)].to_owned(),
        };
        FanFitError::Undetermined { parameter }
    }

    /// The whole step, or a part of it that lowers the sum.
    fn damped(&self, at: &[f64], next: &[f64], chi2: f64) -> Option<Vec<f64>> {
        let mut part = 1.0;
        for _ in 0..20 {
            let there: Vec<f64> = at.iter().zip(next).map(|(a, n)| a + part * (n - a)).collect();
            let sum = self.residuals(&there).map(|r| r.iter().map(|r| r * r).sum::<f64>());
            // At the minimum rounding decides: a step there does no harm.
            if sum.is_some_and(|sum| sum <= chi2 * (1.0 + 1e-9) + 1e-12) {
                return Some(there);
            }
            part *= 0.5;
        }
        None
    }

    fn finish(&self, at: &[f64], iterations: usize) -> Result<FanFit, FanFitError> {
        let linear = self.linear(at)?;
        let count = self.model.count();
        let (all, _) = self.inverse(&linear.normal(0))?;
        // With what is shared held at its estimate, only the scatter of the angles is left.
        let held = linear.normal(0);
        let own = System { known: &self.with_shared_held(at), ..*self };
        let random = own.inverse(&held)?.0.view((0, 0), (count, count)).into_owned();
        // The part of an unknown that the angles tell and no prior: the diagonal of C A^T A.
        let of_angles = linear.jacobian.rows(0, linear.angles);
        let information = of_angles.tr_mul(&of_angles);
        let told =
            |i: usize| -> f64 { (0..self.len()).map(|j| all[(i, j)] * information[(j, i)]).sum() };
        let computed = self.turns(at).ok_or(FanFitError::NoBeam)?;
        let shared = std::array::from_fn(|i| Nuisance {
            value: at[count + i],
            sigma: all[(count + i, count + i)].max(0.0).sqrt(),
        });
        Ok(FanFit {
            model: self.model,
            parameters: at[..count].to_vec(),
            covariance: all.view((0, 0), (count, count)).into_owned(),
            random,
            shared,
            residuals: self.means.iter().zip(&computed).map(|(m, c)| m.turn - c).collect(),
            computed,
            chi2: linear.chi2(),
            effective: (0..self.len()).map(told).sum(),
            iterations,
        })
    }

    fn with_shared_held(&self, at: &[f64]) -> Known {
        let held = |i: usize| Nuisance { value: at[self.model.count() + i], sigma: 0.0 };
        Known { shared: std::array::from_fn(held), ..*self.known }
    }
}
