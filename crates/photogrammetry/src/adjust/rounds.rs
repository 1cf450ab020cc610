//! Rounds of adjustment and outlier removal.

use super::outliers::{ObservationId, test_observations};
use super::problem::{BeamObservation, ImageObservation, Problem};
use super::rows::{Linear, Rows};
use super::solver::{AdjustError, Fit, Options, iterate};
use super::structure::Observed;

/// Most rounds; each at least halves the worst residual.
const ROUNDS: usize = 12;

/// Which observations take part, as indices into the problem as given.
pub(super) struct Kept {
    pub images: Vec<usize>,
    pub beams: Vec<usize>,
    /// Observations as given, once some are left out.
    given: Option<(Vec<ImageObservation>, Vec<BeamObservation>)>,
    /// Observations that did not fit, by their indices as given, with their statistics.
    pub outliers: Vec<(Observed, f64)>,
}

impl Kept {
    pub fn all(problem: &Problem) -> Self {
        Self {
            images: (0..problem.images.len()).collect(),
            beams: (0..problem.beams.len()).collect(),
            given: None,
            outliers: Vec::new(),
        }
    }

    /// Gives the problem back what was left out.
    pub fn restore(&mut self, problem: &mut Problem) {
        if let Some(given) = self.given.take() {
            (problem.images, problem.beams) = given;
        }
    }

    fn retain(&mut self, problem: &mut Problem, keep_images: &[bool], keep_beams: &[bool]) {
        self.given.get_or_insert_with(|| (problem.images.clone(), problem.beams.clone()));
        retain(&mut self.images, keep_images);
        retain(&mut problem.images, keep_images);
        retain(&mut self.beams, keep_beams);
        retain(&mut problem.beams, keep_beams);
    }

    fn leave_out(&mut self, problem: &mut Problem, bad: &[(Observed, f64)]) {
        let mut images = vec![true; problem.images.len()];
        let mut beams = vec![true; problem.beams.len()];
        for (observed, statistic) in bad {
            match *observed {
                Observed::Image(i) => {
                    images[i] = false;
                    self.outliers.push((Observed::Image(self.images[i]), *statistic));
                }
                Observed::Beam(i) => {
                    beams[i] = false;
                    self.outliers.push((Observed::Beam(self.beams[i]), *statistic));
                }
            }
        }
        self.retain(problem, &images, &beams);
    }

    /// Takes back those outliers that fit now, shorter than `sigmas`: a gross error dragged them.
    /// False where there are none.
    fn readmit(&mut self, problem: &mut Problem, sigmas: f64) -> bool {
        if self.outliers.is_empty() {
            return false;
        }
        self.restore(problem);
        let mut linear = Linear::new();
        let rows = Rows::of(problem);
        let mut fits = |(observed, _): &(Observed, f64)| {
            rows.linear(*observed, &mut linear).is_some() && linear.square() < sigmas * sigmas
        };
        let (back, outliers): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.outliers).into_iter().partition(&mut fits);
        self.outliers = outliers;
        for (observed, _) in &back {
            match *observed {
                Observed::Image(i) => self.images.push(i),
                Observed::Beam(i) => self.beams.push(i),
            }
        }
        self.images.sort_unstable();
        self.beams.sort_unstable();
        self.given = Some((problem.images.clone(), problem.beams.clone()));
        problem.images = self.images.iter().map(|i| problem.images[*i]).collect();
        problem.beams = self.beams.iter().map(|i| problem.beams[*i]).collect();
        !back.is_empty()
    }
}

fn retain<T>(items: &mut Vec<T>, keep: &[bool]) {
    let mut flags = keep.iter();
    items.retain(|_| *flags.next().unwrap_or(&true));
}

/// Adjusts, leaves out what does not fit, and adjusts again; the last fit with the iterations of all
/// and chi squared at the start.
pub(super) fn rounds(
    problem: &mut Problem,
    options: &Options,
    kept: &mut Kept,
) -> Result<(Fit, usize, f64), AdjustError> {
    let (mut iterations, mut initial, mut is_last) = (0, None, false);
    for round in 1.. {
        drop_lone_rays(problem, kept);
        let fit = iterate(problem, options)?;
        iterations += fit.iterations;
        let initial_chi2 = *initial.get_or_insert(fit.initial_chi2);
        let is_over = is_last || round == ROUNDS || !options.outlier_sigmas.is_finite();
        let bad =
            if is_over { Vec::new() } else { outliers(problem, &fit, options.outlier_sigmas) };
        if bad.is_empty() {
            if is_over || !kept.readmit(problem, READMITTED * options.outlier_sigmas) {
                return Ok((fit, iterations, initial_chi2));
            }
            is_last = true;
        }
        kept.leave_out(problem, &bad);
    }
    Err(AdjustError::NoConvergence(iterations))
}

/// An observation that was left out comes back when it is shorter than this part of the limit.
const READMITTED: f64 = 0.7;

/// Leaves out the observations of points that one ray alone observes: they say nothing.
fn drop_lone_rays(problem: &mut Problem, kept: &mut Kept) {
    let mut rays = vec![0_usize; problem.points.len()];
    problem.images.iter().for_each(|o| rays[o.point] += 1);
    problem.beams.iter().for_each(|o| rays[o.point] += 1);
    problem.controls.iter().for_each(|c| rays[c.point] += 2);
    problem.held_points.iter().for_each(|p| rays[*p] += 2);
    if rays.iter().all(|rays| *rays != 1) {
        return;
    }
    let images: Vec<bool> = problem.images.iter().map(|o| rays[o.point] > 1).collect();
    let beams: Vec<bool> = problem.beams.iter().map(|o| rays[o.point] > 1).collect();
    kept.retain(problem, &images, &beams);
}

/// Residuals shorter than this part of the limit, in standard deviations of their observation, are
/// not looked at: what is as little checked as that cannot be told to be wrong.
const WORTH_TESTING: f64 = 0.4;

/// The observations that do not fit. Of those beyond the limit only the worse half goes in one
/// round, and of a point only its worst, since one gross error drags its neighbours along.
fn outliers(problem: &Problem, fit: &Fit, sigmas: f64) -> Vec<(Observed, f64)> {
    let from = WORTH_TESTING * sigmas;
    let rows = Rows::of(problem);
    let mut linear = Linear::new();
    let is_long =
        |observed| rows.linear(observed, &mut linear).is_none() || linear.square() > from * from;
    let images = (0..problem.images.len()).map(Observed::Image);
    if !images.chain((0..problem.beams.len()).map(Observed::Beam)).any(is_long) {
        return Vec::new();
    }
    let mut tested = test_observations(problem, &fit.covariance, from);
    tested.retain(|t| t.statistic > sigmas);
    let mut bad: Vec<(f64, Observed, usize)> = tested
        .iter()
        .filter_map(|t| match t.observation {
            ObservationId::Image(i) => {
                Some((t.statistic, Observed::Image(i), problem.images[i].point))
            }
            ObservationId::Beam(i) => {
                Some((t.statistic, Observed::Beam(i), problem.beams[i].point))
            }
            ObservationId::Control(_) => None,
        })
        .collect();
    bad.sort_by(|a, b| b.0.total_cmp(&a.0));
    let worst = bad.first().map_or(0.0, |b| b.0);
    let mut has_lost = vec![false; problem.points.len()];
    bad.retain(|(statistic, _, point)| {
        *statistic >= worst / 2.0 && !std::mem::replace(&mut has_lost[*point], true)
    });
    bad.into_iter().map(|(statistic, observed, _)| (observed, statistic)).collect()
}
