//! Levenberg-Marquardt on the reduced normal equations.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3, Vector6};

use super::covariance::Covariance;
use super::linearise::{ByPoint, Normal, PointBlock, beam_row, image_row, normal_equations};
use super::problem::{Interior, Layout, Problem};

/// How to solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Most iterations, steps that were refused included.
    pub max_iterations: usize,
    /// Ends when chi squared falls by less than this part of itself.
    pub relative_decrease: f64,
    /// Observations whose residual is longer than this many of their standard deviations are left
    /// out and the rest adjusted again; infinite keeps all.
    pub outlier_sigmas: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { max_iterations: 60, relative_decrease: 1e-10, outlier_sigmas: 4.5 }
    }
}

/// How an adjustment went.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// Iterations, over all rounds of outlier removal.
    pub iterations: usize,
    /// Weighted sum of squares at the start.
    pub initial_chi2: f64,
    /// Weighted sum of squares at the end.
    pub chi2: f64,
    /// Observations (priors included) minus unknowns.
    pub redundancy: usize,
    /// Image points left out, as indices into the problem's `images` as given.
    pub outlier_images: Vec<usize>,
    /// Beams left out, as indices into the problem's `beams` as given.
    pub outlier_beams: Vec<usize>,
    /// The covariance of everything.
    pub covariance: Covariance,
}

impl Summary {
    /// Root of the a posteriori variance of unit weight: 1 when the stated noise is true.
    #[must_use]
    pub fn sigma0(&self) -> f64 {
        if self.redundancy == 0 { 1.0 } else { (self.chi2 / self.redundancy as f64).sqrt() }
    }
}

/// Why there is no result.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum AdjustError {
    /// The normal equations have no inverse: something is not determined.
    #[error("not determined: {0}")]
    Singular(String),
    /// A start value is so far off that a point lies behind a camera.
    #[error("the start values put a point behind a camera or the module")]
    NoImage,
    /// It did not settle.
    #[error("no convergence within {0} iterations")]
    NoConvergence(usize),
}

/// Adjusts `problem` in place.
///
/// # Errors
/// [`AdjustError`]; the problem then holds the last estimate.
pub fn adjust(problem: &mut Problem, options: &Options) -> Result<Summary, AdjustError> {
    let mut images: Vec<usize> = (0..problem.images.len()).collect();
    let mut beams: Vec<usize> = (0..problem.beams.len()).collect();
    let all = (problem.images.clone(), problem.beams.clone());
    let (mut iterations, mut initial) = (0, None);
    for round in 0..ROUNDS {
        drop_lone_rays(problem, &mut images, &mut beams);
        let fit = iterate(problem, options)?;
        iterations += fit.iterations;
        let initial_chi2 = *initial.get_or_insert(fit.initial_chi2);
        let (keep_images, keep_beams) = within(problem, options.outlier_sigmas);
        let clean = keep_images.iter().chain(&keep_beams).all(|k| *k);
        if clean || round + 1 == ROUNDS {
            let summary = summarise(problem, &fit, initial_chi2, iterations, (images, beams), &all);
            (problem.images, problem.beams) = all;
            return Ok(summary);
        }
        retain(&mut images, &keep_images);
        retain(&mut beams, &keep_beams);
        retain(&mut problem.images, &keep_images);
        retain(&mut problem.beams, &keep_beams);
    }
    Err(AdjustError::NoConvergence(iterations))
}

/// Rounds of outlier removal; each at least halves the worst residual.
const ROUNDS: usize = 12;

/// Leaves out the observations of points that one ray alone observes: they say nothing.
fn drop_lone_rays(problem: &mut Problem, images: &mut Vec<usize>, beams: &mut Vec<usize>) {
    let mut rays = vec![0_usize; problem.points.len()];
    problem.images.iter().for_each(|o| rays[o.point] += 1);
    problem.beams.iter().for_each(|o| rays[o.point] += 1);
    problem.controls.iter().for_each(|c| rays[c.point] += 2);
    let keep_images: Vec<bool> = problem.images.iter().map(|o| rays[o.point] > 1).collect();
    let keep_beams: Vec<bool> = problem.beams.iter().map(|o| rays[o.point] > 1).collect();
    retain(images, &keep_images);
    retain(beams, &keep_beams);
    retain(&mut problem.images, &keep_images);
    retain(&mut problem.beams, &keep_beams);
}

fn retain<T>(items: &mut Vec<T>, keep: &[bool]) {
    let mut flags = keep.iter();
    items.retain(|_| *flags.next().unwrap_or(&true));
}

/// Which observations lie within the limit. Of those beyond it only the worse half goes in one
/// round, since one gross error drags its neighbours along.
fn within(problem: &Problem, sigmas: f64) -> (Vec<bool>, Vec<bool>) {
    let images: Vec<f64> = problem.images.iter().map(|o| length(image_row(problem, o))).collect();
    let beams: Vec<f64> = problem.beams.iter().map(|o| length(beam_row(problem, o))).collect();
    let worst = images.iter().chain(&beams).copied().fold(0.0, f64::max);
    let limit = sigmas.max(worst / 2.0);
    let keep = |lengths: &[f64]| lengths.iter().map(|l| *l <= limit).collect();
    (keep(&images), keep(&beams))
}

/// The length of a residual in its own standard deviations.
fn length(row: Option<super::linearise::Row2>) -> f64 {
    row.map_or(f64::INFINITY, |r| (r.residual.transpose() * r.information * r.residual).x.sqrt())
}

struct Fit {
    layout: Layout,
    normal: Normal,
    initial_chi2: f64,
    iterations: usize,
}

fn iterate(problem: &mut Problem, options: &Options) -> Result<Fit, AdjustError> {
    let layout = Layout::of(problem);
    let by_point = ByPoint::of(problem);
    let mut normal = normal_equations(problem, &layout, &by_point).ok_or(AdjustError::NoImage)?;
    let initial_chi2 = normal.chi2;
    let mut damping = 1e-6;
    for iterations in 1..=options.max_iterations {
        let Some(Step { common, points, gain }) = damped_step(&normal, damping) else {
            damping = raise(damping, &normal, &layout)?;
            continue;
        };
        // At the minimum rounding decides whether a step lowers the sum: the gain that the linear
        // model promises tells that there is nothing left to win.
        if gain <= options.relative_decrease * normal.chi2 || gain < NOTHING {
            return Ok(Fit { layout, normal, initial_chi2, iterations });
        }
        let candidate = moved(problem, &layout, &common, &points);
        match normal_equations(&candidate, &layout, &by_point) {
            Some(next) if next.chi2 <= normal.chi2 => {
                *problem = candidate;
                normal = next;
                damping = (damping * 0.1).max(1e-14);
            }
            _ => damping = raise(damping, &normal, &layout)?,
        }
    }
    Err(AdjustError::NoConvergence(options.max_iterations))
}

fn raise(damping: f64, normal: &Normal, layout: &Layout) -> Result<f64, AdjustError> {
    if damping < 1e10 {
        return Ok(damping * 10.0);
    }
    let weak = (0..layout.size).find(|&i| normal.hessian[(i, i)] <= 0.0);
    let what =
        weak.map_or("no step lowers the sum of squares", |_| "an unknown has no observation");
    Err(AdjustError::Singular(what.to_owned()))
}

/// The inverse of a point's own block; zero for a point without observations, which so takes no
/// part. A point that is observed but not determined has none.
pub(super) fn point_inverse(own: &Matrix3<f64>, damping: f64) -> Option<Matrix3<f64>> {
    if *own == Matrix3::zeros() {
        return Some(Matrix3::zeros());
    }
    let damped = own + Matrix3::from_diagonal(&(own.diagonal() * damping));
    damped.cholesky().map(|c| c.inverse())
}

/// Eliminates the points: the reduced normal matrix and right side.
pub(super) fn reduce(normal: &Normal, damping: f64) -> Option<(DMatrix<f64>, DVector<f64>)> {
    let mut h = normal.hessian.clone();
    let mut g = normal.gradient.clone();
    for i in 0..h.nrows() {
        h[(i, i)] *= 1.0 + damping;
    }
    for block in &normal.points {
        let inverse = point_inverse(&block.own, damping)?;
        let shift = inverse * block.gradient;
        let scaled: Vec<(usize, Vector3<f64>)> =
            block.coupling.iter().map(|(i, w)| (*i, inverse * w)).collect();
        for (i, w) in &block.coupling {
            g[*i] -= w.dot(&shift);
            for (j, y) in &scaled {
                h[(*j, *i)] -= w.dot(y);
            }
        }
    }
    Some((h, g))
}

/// A gain of chi squared below this is nothing, whatever chi squared is.
const NOTHING: f64 = 1e-12;

struct Step {
    common: DVector<f64>,
    points: Vec<Vector3<f64>>,
    /// By how much the linear model lowers chi squared.
    gain: f64,
}

fn damped_step(normal: &Normal, damping: f64) -> Option<Step> {
    let (h, g) = reduce(normal, damping)?;
    let common = h.cholesky()?.solve(&g);
    let points = normal
        .points
        .iter()
        .map(|block| back_substitute(block, &common, damping))
        .collect::<Option<Vec<_>>>()?;
    let of_points: f64 =
        normal.points.iter().zip(&points).map(|(block, step)| block.gradient.dot(step)).sum();
    Some(Step { gain: normal.gradient.dot(&common) + of_points, common, points })
}

fn back_substitute(block: &PointBlock, step: &DVector<f64>, damping: f64) -> Option<Vector3<f64>> {
    let mut right = block.gradient;
    for (i, w) in &block.coupling {
        right -= w * step[*i];
    }
    Some(point_inverse(&block.own, damping)? * right)
}

fn moved(
    problem: &Problem,
    layout: &Layout,
    step: &DVector<f64>,
    points: &[Vector3<f64>],
) -> Problem {
    let six = |at: usize| Vector6::from_fn(|i, _| step[at + i]);
    let mut next = problem.clone();
    for (camera, (pose, interior)) in next.cameras.iter_mut().zip(&layout.cameras) {
        camera.station = camera.station.moved(&six(*pose));
        if let Some(at) = interior {
            camera.correction += Vector3::from_fn(|i, _| step[at + i]);
        }
    }
    for (module, (pose, scale)) in next.modules.iter_mut().zip(&layout.modules) {
        module.station = module.station.moved(&six(*pose));
        if let Some(at) = scale {
            module.scale += step[*at];
        }
    }
    if let Some(at) = layout.artefact_scale {
        next.artefact_scale += step[at];
    }
    if let Some(at) = layout.fan_scale {
        next.fan.scale += step[at];
    }
    for (i, error) in next.fan.beams.iter_mut().enumerate() {
        let at = layout.fan_beams + 2 * i;
        *error += nalgebra::Vector2::new(step[at], step[at + 1]);
    }
    for (point, shift) in next.points.iter_mut().zip(points) {
        *point += shift;
    }
    next
}

fn summarise(
    problem: &Problem,
    fit: &Fit,
    initial_chi2: f64,
    iterations: usize,
    kept: (Vec<usize>, Vec<usize>),
    all: &(Vec<super::ImageObservation>, Vec<super::BeamObservation>),
) -> Summary {
    let missing = |kept: &[usize], count: usize| {
        (0..count).filter(|i| kept.binary_search(i).is_err()).collect()
    };
    let priors: usize = problem
        .cameras
        .iter()
        .map(|c| if matches!(c.interior, Interior::Prior(_)) { 3 } else { 0 })
        .sum::<usize>()
        + problem.modules.iter().filter(|m| m.scale_prior.1 > 0.0).count()
        + usize::from(problem.artefact_scale_sigma > 0.0)
        + usize::from(problem.fan.scale_sigma > 0.0)
        + 2 * problem.fan.beams.len();
    let rows =
        2 * (problem.images.len() + problem.beams.len()) + 3 * problem.controls.len() + priors;
    // A point whose observations were all left out has no part in the sum.
    let points = fit.normal.points.iter().filter(|b| b.own != Matrix3::zeros()).count();
    Summary {
        iterations,
        initial_chi2,
        chi2: fit.normal.chi2,
        redundancy: rows.saturating_sub(fit.layout.size + 3 * points),
        outlier_images: missing(&kept.0, all.0.len()),
        outlier_beams: missing(&kept.1, all.1.len()),
        covariance: Covariance::of(&fit.normal, &fit.layout),
    }
}
