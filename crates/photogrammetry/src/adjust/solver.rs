//! Levenberg-Marquardt on the reduced normal equations.

use nalgebra::{DVector, Vector3, Vector6};

use super::covariance::Covariance;
use super::datum::{Inner, defect};
use super::layout::{Block, Layout, PointPlace};
use super::loss::Loss;
use super::normal::{Normal, normal_equations, scalars};
use super::outliers::ObservationId;
use super::problem::{CameraStation, InteriorOrientation, ModuleStation, Problem, SharedFan};
use super::reduce::{Step, damped_step};
use super::rounds::{Kept, rounds};
use super::structure::{Observed, Structure};

/// What fixes position, orientation and scale.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Datum {
    /// Controls, held stations and points, scale bars; a freedom that they leave is an error.
    #[default]
    Observed,
    /// What they leave is fixed by inner constraints on all points (a free network). Every point
    /// stays in the dense system: for some hundreds of points.
    InnerConstraints,
    /// What they leave stays where the start values put it, by the damping of the steps alone: for
    /// networks of any size of which no covariance is asked.
    Damped,
}

/// How to solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Most iterations of one round, steps that were refused included. Default 60.
    pub max_iterations: usize,
    /// Ends when the linear model, or the pace of the last steps, promises to lower chi squared by less
    /// than this part of itself. Default 1e-10: far below what noise means.
    pub relative_decrease: f64,
    /// Observations whose residual is longer than this many of its standard deviations (Baarda's
    /// test) are left out and the rest adjusted again; infinite keeps all. Default 4.5: one in
    /// 25,000 good ones.
    pub outlier_sigmas: f64,
    /// How residuals count. Default least squares.
    pub loss: Loss,
    /// What fixes the whole.
    pub datum: Datum,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            max_iterations: 60,
            relative_decrease: 1e-10,
            outlier_sigmas: 4.5,
            loss: Loss::Squares,
            datum: Datum::Observed,
        }
    }
}

/// How an adjustment went.
#[derive(Debug, Clone)]
pub struct Summary {
    /// Iterations, over all rounds of outlier removal.
    pub iterations: usize,
    /// Weighted sum of squares at the start.
    pub initial_chi2: f64,
    /// Weighted sum of squares at the end.
    pub chi2: f64,
    /// Observations (priors included) minus unknowns.
    pub redundancy: usize,
    /// Image points left out, as indices into the problem's `images`.
    pub outlier_images: Vec<usize>,
    /// Beams left out, as indices into the problem's `beams`.
    pub outlier_beams: Vec<usize>,
    /// What did not fit and was left out, with the length of its residual in standard deviations
    /// of the residual when it was.
    pub left_out: Vec<(ObservationId, f64)>,
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
    let mut kept = Kept::all(problem);
    let result = rounds(problem, options, &mut kept);
    kept.restore(problem);
    let (mut fit, iterations, initial_chi2) = result?;
    // From here on observations go by the indices that the caller knows.
    for row in &mut fit.covariance.structure.rows {
        row.observed = match row.observed {
            Observed::Image(i) => Observed::Image(kept.images[i]),
            Observed::Beam(i) => Observed::Beam(kept.beams[i]),
        };
    }
    let missing = |kept: &[usize], count: usize| {
        (0..count).filter(|i| kept.binary_search(i).is_err()).collect()
    };
    Ok(Summary {
        iterations,
        initial_chi2,
        chi2: fit.covariance.normal.chi2,
        redundancy: redundancy(problem, &fit.covariance),
        outlier_images: missing(&kept.images, problem.images.len()),
        outlier_beams: missing(&kept.beams, problem.beams.len()),
        left_out: kept
            .outliers
            .iter()
            .map(|(o, statistic)| (ObservationId::from(*o), *statistic))
            .collect(),
        covariance: fit.covariance,
    })
}

/// An adjustment of what takes part in one round.
pub(super) struct Fit {
    pub covariance: Covariance,
    pub initial_chi2: f64,
    pub iterations: usize,
}

/// A gain of chi squared below this is nothing, whatever chi squared is.
const NOTHING: f64 = 1e-12;

/// Levenberg-Marquardt until there is nothing left to win.
pub(super) fn iterate(problem: &mut Problem, options: &Options) -> Result<Fit, AdjustError> {
    let is_free = options.datum == Datum::InnerConstraints;
    let layout = Layout::of(problem, is_free);
    let structure = Structure::of(problem, &layout);
    if options.datum == Datum::Observed
        && let Some(defect) = defect(problem, &structure, &layout)
    {
        return Err(AdjustError::Singular(defect));
    }
    let plain = |p: &Problem, old| normal_equations(p, &layout, &structure, options.loss, old);
    let mut normal = plain(problem, None).ok_or(AdjustError::NoImage)?;
    let mut spare = None;
    let constraints = |p: &Problem, normal: &mut Normal| {
        let inner = Inner::of(p, &structure, &layout)?.weighing(&normal.common);
        inner.add(&mut normal.common);
        Some(inner)
    };
    let inner = if is_free { constraints(problem, &mut normal) } else { None };
    let sums = |problem: &Problem, old| {
        let mut normal = plain(problem, old)?;
        inner.iter().for_each(|inner| inner.add(&mut normal.common));
        Some(normal)
    };
    let initial_chi2 = normal.chi2;
    let (mut damping, mut raises) = (1e-6, 0);
    let mut pace = Pace::default();
    for iterations in 1..=options.max_iterations {
        // At the minimum rounding decides whether a step lowers the sum: the gain that the linear
        // model promises tells that there is nothing left to win.
        let nothing = NOTHING.max(options.relative_decrease * normal.chi2);
        let is_at_rest = pace.next_gain() <= nothing;
        let step = (!is_at_rest).then(|| damped_step(&normal, &layout, &structure, damping));
        let step = step.flatten();
        if is_at_rest || step.as_ref().is_some_and(|step| step.gain <= nothing) {
            // The covariance is that of constraints at the result, not at the start.
            let inner = match inner {
                Some(_) => {
                    normal = plain(problem, None).ok_or(AdjustError::NoImage)?;
                    constraints(problem, &mut normal)
                }
                None => None,
            };
            let covariance = Covariance::of(normal, layout, structure, inner);
            return Ok(Fit { covariance, initial_chi2, iterations });
        }
        let gain = step.as_ref().map_or(f64::INFINITY, |step| step.gain);
        let before = step.map(|step| {
            let before = Unknowns::of(problem);
            apply(problem, &layout, &structure, &step);
            before
        });
        let next = before.as_ref().and_then(|_| sums(problem, spare.take()));
        if let Some(next) = next.filter(|next| next.chi2 <= normal.chi2) {
            spare = Some(std::mem::replace(&mut normal, next));
            (damping, raises) = ((damping * 0.1).max(1e-14), 0);
            pace.took(gain);
            continue;
        }
        before.into_iter().for_each(|before| before.put_back(problem));
        pace = Pace::default();
        if damping > 1e10 {
            return Err(stuck(problem, &normal, &layout));
        }
        // Many refusals in a row: far away from where the linear model holds.
        raises += 1;
        damping *= if raises > 2 { 100.0 } else { 10.0 };
    }
    Err(AdjustError::NoConvergence(options.max_iterations))
}

/// How fast the gains of the steps become less.
#[derive(Default)]
struct Pace {
    /// The last gain.
    gain: Option<f64>,
    /// The last two gains, each over the one before.
    quotients: [Option<f64>; 2],
}

impl Pace {
    /// A pace that is to be relied on: near the minimum of a good fit each gain is a millionth of the
    /// one before, or less. Twice in a row, since a first step from far away says nothing.
    const FAST: f64 = 1e-3;
    /// By how much the next gain may be more than the pace promises.
    const DOUBT: f64 = 10.0;

    fn took(&mut self, gain: f64) {
        let quotient = self.gain.map(|before| gain / before);
        *self = Self { gain: Some(gain), quotients: [self.quotients[1], quotient] };
    }

    /// What the next step gains at most; infinite where the pace does not tell.
    fn next_gain(&self) -> f64 {
        match (self.gain, self.quotients) {
            (Some(gain), [Some(before), Some(last)]) if before.max(last) < Self::FAST => {
                Self::DOUBT * last * gain
            }
            _ => f64::INFINITY,
        }
    }
}

fn stuck(problem: &Problem, normal: &Normal, layout: &Layout) -> AdjustError {
    let weak = (0..layout.border).find(|&i| normal.common.border[(i, i)] <= 0.0);
    AdjustError::Singular(weak.map_or_else(
        || "no step lowers the sum of squares".to_owned(),
        |at| format!("{} has no observation", name(problem, layout, at)),
    ))
}

/// An unknown of the border, in words.
fn name(problem: &Problem, layout: &Layout, at: usize) -> String {
    let within = |block: &Block| (block.at..block.at + block.len).contains(&at);
    if let Some(i) = layout.cameras.iter().position(|b| b.as_ref().is_some_and(within)) {
        return format!("the pose of camera {i}");
    }
    if let Some(i) = layout.interiors.iter().position(within) {
        let unknown = problem.interiors[i].unknowns[at - layout.interiors[i].at];
        return format!("{:?} of interior orientation {i}", unknown.parameter);
    }
    if let Some(i) = layout.modules.iter().position(within) {
        return format!("the pose of module {i}");
    }
    let is_point = |p: &PointPlace| matches!(p, PointPlace::Border(b) if (*b..b + 3).contains(&at));
    layout
        .points
        .iter()
        .position(is_point)
        .map_or_else(|| format!("unknown {at}"), |i| format!("point {i}"))
}

/// The unknowns of a problem, to go back to.
struct Unknowns {
    interiors: Vec<InteriorOrientation>,
    cameras: Vec<CameraStation>,
    modules: Vec<ModuleStation>,
    points: Vec<Vector3<f64>>,
    artefact_scale: f64,
    fan: SharedFan,
}

impl Unknowns {
    fn of(problem: &Problem) -> Self {
        Self {
            interiors: problem.interiors.clone(),
            cameras: problem.cameras.clone(),
            modules: problem.modules.clone(),
            points: problem.points.clone(),
            artefact_scale: problem.artefact_scale,
            fan: problem.fan.clone(),
        }
    }

    fn put_back(self, problem: &mut Problem) {
        problem.interiors = self.interiors;
        problem.cameras = self.cameras;
        problem.modules = self.modules;
        problem.points = self.points;
        problem.artefact_scale = self.artefact_scale;
        problem.fan = self.fan;
    }
}

fn apply(problem: &mut Problem, layout: &Layout, structure: &Structure, step: &Step) {
    let common = &step.common;
    for (camera, block) in problem.cameras.iter_mut().zip(&layout.cameras) {
        if let Some(block) = block {
            camera.station = camera.station.moved(&six(common, *block));
        }
    }
    for (interior, block) in problem.interiors.iter_mut().zip(&layout.interiors) {
        for (i, unknown) in interior.unknowns.iter().enumerate().take(block.len) {
            unknown.parameter.add(&mut interior.camera, common[block.at + i]);
        }
    }
    for (module, block) in problem.modules.iter_mut().zip(&layout.modules) {
        module.station = module.station.moved(&six(common, *block));
        if block.len == 7 {
            module.scale += common[block.at + 6];
        }
    }
    problem.artefact_scale += layout.artefact_scale.map_or(0.0, |at| common[at]);
    problem.fan.scale += layout.fan_scale.map_or(0.0, |at| common[at]);
    for (i, error) in problem.fan.beams.iter_mut().enumerate() {
        let at = layout.fan_beams + 2 * i;
        *error += nalgebra::Vector2::new(common[at], common[at + 1]);
    }
    for (point, place) in problem.points.iter_mut().zip(&layout.points) {
        if let PointPlace::Border(at) = place {
            *point += common.fixed_rows::<3>(*at);
        }
    }
    for (point, shift) in structure.points.iter().zip(&step.points) {
        problem.points[point.index] += shift;
    }
}

fn six(step: &DVector<f64>, block: Block) -> Vector6<f64> {
    Vector6::from_fn(|i, _| step[block.at + i])
}

/// Observations minus unknowns. Points that nothing observes take no part.
fn redundancy(problem: &Problem, solved: &Covariance) -> usize {
    let (layout, structure) = (&solved.layout, &solved.structure);
    let rows = 2 * structure.rows.len()
        + 3 * structure.controls.len()
        + scalars(problem, layout, structure).len();
    let points = structure.points.len();
    let constraints = solved.inner.as_ref().map_or(0, Inner::count);
    (rows + constraints).saturating_sub(layout.size + 3 * points)
}
