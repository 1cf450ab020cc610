//! The course of the wavelength: a settling exponential, a steady drift, and steps.
//!
//! `lambda(t) = c + r t + A exp(-t / tau) + sum of the hops before t`, by least squares with equal
//! weights: all readings are of one meter. All but tau is linear, so tau alone is searched (variable
//! projection, Golub and Pereyra 1973); the covariance is that of all together.

use nalgebra::{DMatrix, DVector};

use super::hops::Step;
use super::series::{Series, correlation};

/// An exponential that makes chi squared smaller by less than this is none: chance gives 10 at most
/// where a second parameter is searched.
const IS_SETTLING: f64 = 25.0;
/// Time constants tried before the search goes on between the best of them.
const TRIED: usize = 60;
/// Of what is between them the search leaves so much (in the logarithm).
const RESOLVED: f64 = 1e-7;

/// A fitted course.
#[derive(Debug, Clone)]
pub(super) struct Course {
    /// c, r per second, hops, then A and tau where it settles.
    parameters: DVector<f64>,
    covariance: DMatrix<f64>,
    /// Last reading before each hop, and its time.
    steps: Vec<f64>,
    settles: bool,
    /// Standard deviation of readings about it, nm.
    pub scatter: f64,
    /// Root mean square of what it leaves beyond noise, nm.
    pub misfit: f64,
}

impl Course {
    /// The course of a series with its hops. `None` where there are too few readings.
    pub(super) fn fit(series: &Series, hops: &[Step]) -> Option<Self> {
        let steps: Vec<f64> = hops
            .iter()
            .map(|hop| f64::midpoint(series.at_s[hop.after], series.at_s[hop.after + 1]))
            .collect();
        let unknowns = 4 + steps.len();
        if series.len() < 3 * unknowns {
            return None;
        }
        let straight = Self::with(series, &steps, None)?;
        let settling = best_time_constant(series, &steps)
            .and_then(|tau| Self::with(series, &steps, Some(tau)));
        let better = |course: &Self| {
            let n = series.len() as f64;
            let squares = |c: &Self| c.scatter.powi(2) * (n - c.parameters.len() as f64);
            let gain = squares(&straight) - squares(course);
            gain > IS_SETTLING * (course.scatter * course.inflation_of(series)).powi(2)
        };
        Some(settling.filter(better).unwrap_or(straight))
    }

    fn inflation_of(&self, series: &Series) -> f64 {
        correlation(&self.residuals(series), self.scatter).0
    }

    fn with(series: &Series, steps: &[f64], tau: Option<f64>) -> Option<Self> {
        let design = linear_design(&series.at_s, steps, tau);
        let (linear, _) = solve(&design, &series.value)?;
        let mut parameters = linear.as_slice().to_vec();
        let settles = tau.is_some();
        parameters.extend(tau);
        let size = parameters.len();
        let mut course = Self {
            parameters: DVector::from_vec(parameters),
            covariance: DMatrix::zeros(size, size),
            steps: steps.to_vec(),
            settles,
            scatter: 0.0,
            misfit: 0.0,
        };
        let residuals = course.residuals(series);
        let squares: f64 = residuals.iter().map(|r| r * r).sum();
        course.scatter = (squares / (series.len() - size) as f64).sqrt();
        let (inflation, misfit) = correlation(&residuals, course.scatter);
        course.misfit = misfit;
        let rows = series.len();
        let jacobian = DMatrix::from_fn(rows, size, |r, c| course.gradient(series.at_s[r])[c]);
        let variance = (course.scatter * inflation).powi(2);
        course.covariance = inverse(&(jacobian.transpose() * &jacobian))? * variance;
        Some(course)
    }

    fn residuals(&self, series: &Series) -> Vec<f64> {
        series.at_s.iter().zip(&series.value).map(|(t, y)| y - self.at(*t)).collect()
    }

    /// The wavelength at a time, nm.
    pub(super) fn at(&self, t: f64) -> f64 {
        self.without_hops(t) + self.hopped(t)
    }

    /// The wavelength without its hops, nm.
    pub(super) fn without_hops(&self, t: f64) -> f64 {
        let p = &self.parameters;
        let settling = self.settling().map_or(0.0, |(a, tau)| a * (-t / tau).exp());
        p[0] + p[1] * t + settling
    }

    /// The sum of the hops before a time, nm.
    pub(super) fn hopped(&self, t: f64) -> f64 {
        let hops = self.parameters.iter().skip(2).zip(&self.steps);
        hops.filter(|(_, at)| **at < t).map(|(by, _)| by).sum()
    }

    /// How fast the wavelength changes between hops, nm a second.
    pub(super) fn slope(&self, t: f64) -> f64 {
        let settling = self.settling().map_or(0.0, |(a, tau)| -a / tau * (-t / tau).exp());
        self.parameters[1] + settling
    }

    /// Standard uncertainty of the change from one time to another, nm; hops count where asked.
    pub(super) fn change_u(&self, from: f64, to: f64, with_hops: WithHops) -> f64 {
        let mut gradient = self.gradient(to) - self.gradient(from);
        if with_hops == WithHops::No {
            gradient.rows_mut(2, self.steps.len()).fill(0.0);
        }
        gradient.dot(&(&self.covariance * &gradient)).max(0.0).sqrt()
    }

    /// A and tau.
    fn settling(&self) -> Option<(f64, f64)> {
        let n = self.parameters.len();
        self.settles.then(|| (self.parameters[n - 2], self.parameters[n - 1]))
    }

    /// Amplitude (nm) and time constant (s), each with its standard uncertainty.
    pub(super) fn warm_up(&self) -> Option<[(f64, f64); 2]> {
        let n = self.parameters.len();
        let (a, tau) = self.settling()?;
        let u = |i: usize| self.covariance[(i, i)].max(0.0).sqrt();
        Some([(a, u(n - 2)), (tau, u(n - 1))])
    }

    /// The steady drift and its standard uncertainty, nm a second.
    pub(super) fn drift(&self) -> (f64, f64) {
        (self.parameters[1], self.covariance[(1, 1)].max(0.0).sqrt())
    }

    /// Derivatives of the wavelength at a time by all parameters.
    fn gradient(&self, t: f64) -> DVector<f64> {
        let mut row = linear_row(t, &self.steps, self.settling().map(|(_, tau)| tau));
        if let Some((a, tau)) = self.settling() {
            row.push(a * t / (tau * tau) * (-t / tau).exp());
        }
        DVector::from_vec(row)
    }
}

/// Whether hops count in a change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum WithHops {
    Yes,
    No,
}

fn linear_row(t: f64, steps: &[f64], tau: Option<f64>) -> Vec<f64> {
    let mut row = vec![1.0, t];
    row.extend(steps.iter().map(|at| if *at < t { 1.0 } else { 0.0 }));
    row.extend(tau.map(|tau| (-t / tau).exp()));
    row
}

fn linear_design(at_s: &[f64], steps: &[f64], tau: Option<f64>) -> DMatrix<f64> {
    let rows: Vec<Vec<f64>> = at_s.iter().map(|t| linear_row(*t, steps, tau)).collect();
    DMatrix::from_fn(rows.len(), 2 + steps.len() + usize::from(tau.is_some()), |r, c| rows[r][c])
}

/// Least squares: the parameters and the sum of squares that they leave.
fn solve(design: &DMatrix<f64>, values: &[f64]) -> Option<(DVector<f64>, f64)> {
    let first = values.first()?;
    // About the first value, so that a wavelength of hundreds of nm does not cost digits.
    let right = DVector::from_iterator(values.len(), values.iter().map(|y| y - first));
    let inverse = inverse(&(design.transpose() * design))?;
    let mut parameters = inverse * (design.transpose() * &right);
    let squares = (&right - design * &parameters).norm_squared();
    parameters[0] += first;
    squares.is_finite().then_some((parameters, squares))
}

/// The inverse of a normal matrix, scaled to ones on its diagonal first: seconds and nanometres have
/// nothing in common.
fn inverse(normal: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let scale = normal.diagonal().map(|d| 1.0 / d.sqrt());
    if !scale.iter().all(|s| s.is_finite()) {
        return None;
    }
    let scale = DMatrix::from_diagonal(&scale);
    let inverse = (&scale * normal * &scale).cholesky()?.inverse();
    Some(&scale * inverse * &scale)
}

/// The time constant that leaves least; `None` where the best is at the end of what can be told:
/// far below the first readings' interval or far beyond the test.
fn best_time_constant(series: &Series, steps: &[f64]) -> Option<f64> {
    let (first, last) = (series.at_s.first()?, series.at_s.last()?);
    let (shortest, longest) = (2.0 * series.interval(0), 3.0 * (last - first));
    if !(shortest > 0.0 && longest > shortest) {
        return None;
    }
    let squares = |log_tau: f64| {
        let design = linear_design(&series.at_s, steps, Some(log_tau.exp()));
        solve(&design, &series.value).map_or(f64::INFINITY, |(_, squares)| squares)
    };
    let width = (longest / shortest).ln() / (TRIED - 1) as f64;
    let tried = |i: usize| shortest.ln() + width * i as f64;
    let all: Vec<f64> = (0..TRIED).map(|i| squares(tried(i))).collect();
    let best = (0..TRIED).min_by(|a, b| all[*a].total_cmp(&all[*b]))?;
    if best == 0 || best == TRIED - 1 || !all[best].is_finite() {
        return None;
    }
    Some(golden(squares, tried(best - 1), tried(best + 1)).exp())
}

/// Golden-section search of a minimum between two places.
fn golden(of: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    let part = (5.0_f64.sqrt() - 1.0) / 2.0;
    let (mut a, mut b) = (high - part * (high - low), low + part * (high - low));
    let (mut at_a, mut at_b) = (of(a), of(b));
    while high - low > RESOLVED {
        if at_a < at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - part * (high - low);
            at_a = of(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + part * (high - low);
            at_b = of(b);
        }
    }
    f64::midpoint(low, high)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exact(hop: f64) -> Series {
        let at_s: Vec<f64> = (0..600).map(|i| 10.0 * f64::from(i)).collect();
        let value = at_s.iter().map(|t| {
            658.0 + 2e-5 * t - 0.3 * (-t / 1500.0).exp() + if *t > 3000.0 { hop } else { 0.0 }
        });
        Series { value: value.collect(), at_s }
    }

    #[test]
    fn a_course_without_noise_is_found_as_it_is() {
        let step = Step { after: 300, by_nm: 0.05, u_nm: 0.001 };
        let course = Course::fit(&exact(0.05), &[step]).unwrap();
        let [(amplitude, _), (tau, _)] = course.warm_up().unwrap();
        assert!((tau - 1500.0).abs() < 1e-2 && (amplitude + 0.3).abs() < 1e-6, "{tau} {amplitude}");
        assert!((course.drift().0 - 2e-5).abs() < 1e-10);
        assert!((course.hopped(3100.0) - 0.05).abs() < 1e-6 && course.hopped(2900.0) == 0.0);
        assert!(course.scatter < 1e-7);
    }

    #[test]
    fn the_slope_and_the_gradient_are_those_of_finite_differences() {
        let course = Course::fit(&exact(0.0), &[]).unwrap();
        let slope = (course.at(2001.0) - course.at(1999.0)) / 2.0;
        assert!((course.slope(2000.0) / slope - 1.0).abs() < 1e-6);
        let gradient = course.gradient(2000.0);
        for i in 0..gradient.len() {
            let h = (course.parameters[i].abs() * 1e-5).max(1e-9);
            let mut moved = course.clone();
            moved.parameters[i] += h;
            let numeric = (moved.at(2000.0) - course.at(2000.0)) / h;
            assert!((gradient[i] - numeric).abs() < 1e-4 * numeric.abs().max(1e-3), "{i}");
        }
    }

    #[test]
    fn a_straight_course_does_not_settle() {
        let at_s: Vec<f64> = (0..400).map(f64::from).collect();
        let value = at_s.iter().map(|t| 658.0 + 1e-5 * t + 0.003 * (2.4 * t * t).sin()).collect();
        assert!(Course::fit(&Series { at_s, value }, &[]).unwrap().warm_up().is_none());
    }
}
