//! Self-calibration: interior orientation and the pose of every picture in one least-squares
//! adjustment, points of the sheet held, all observations of equal weight.
//!
//! Levenberg-Marquardt on dense normal equations: a calibration has dozens of pictures, not
//! thousands. The sigma of unit weight comes from the residuals (sum of squares over the
//! redundancy, which is OpenCV's convention too): what dominates on a printed sheet is how flat and
//! how well printed it is, and the stated covariance of a disc's centre does not know that.
//! The centre of a disc's ellipse is not the image of its centre; the difference is computed from
//! the estimate and taken off, until it stays.

use nalgebra::{DMatrix, DVector, Matrix6, SMatrix, Vector2, Vector3};

use super::disc_image::disc_image_offset;
use super::{Interior, Unknowns, View};
use crate::camera::{Camera, Projection};
use crate::pose::{Station, resect};

/// Fewer points fix no pose with anything left to check it by.
const LEAST_POINTS: usize = 6;
/// Iterations before the adjustment is given up: from the closed form it takes about ten.
const MAX_ITERATIONS: usize = 200;
/// A step that gains less than this part of the cost is the last: it moves nothing by more than a
/// hundred thousandth of its standard deviation.
const SAME_COST: f64 = 1e-14;
/// Square of the rounding of a coordinate of thousands of pixels.
const ROUNDING: f64 = 1e-24;
/// An eccentricity that changes by less is final, pixels: a thousandth of the best centre.
const SAME_OFFSET: f64 = 1e-5;
/// Rounds of eccentricity: each gains two or three digits.
const MAX_ROUNDS: usize = 8;
/// Smallest eigenvalue of the scaled normal matrix that rounding leaves meaning to.
const LEAST_EIGENVALUE: f64 = 1e-13;

/// Why there is no calibration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// No views.
    #[error("there is no picture with enough points")]
    NoViews,
    /// The points of a view are too few.
    #[error("{view}: {points} points, at least {LEAST_POINTS} are needed")]
    TooFewPoints {
        /// Which.
        view: String,
        /// How many it has.
        points: usize,
    },
    /// No pose fits.
    #[error("{view}: no pose of the camera shows these points like that (are they on a line?)")]
    NoPose {
        /// Which.
        view: String,
    },
    /// The sheet faces the camera in every picture.
    #[error("the focal length is undetermined: photograph the sheet tilted, by 20 degrees or more")]
    NoPerspective,
    /// More unknowns than equations.
    #[error("{observations} coordinates for {unknowns} unknowns: take more pictures")]
    TooFewObservations {
        /// Coordinates measured.
        observations: usize,
        /// Unknowns of all kinds.
        unknowns: usize,
    },
    /// The views do not determine a parameter.
    #[error(
        "{parameter} is undetermined by these pictures: hold it, or vary tilt and distance more"
    )]
    Undetermined {
        /// Its name.
        parameter: String,
    },
    /// It does not settle.
    #[error(
        "the adjustment did not converge within {MAX_ITERATIONS} iterations (rms {rms_px:.3} px)"
    )]
    Diverged {
        /// Where it stood, pixels.
        rms_px: f64,
    },
}

/// A view after the adjustment.
#[derive(Debug, Clone, PartialEq)]
pub struct SolvedView {
    /// The picture's name.
    pub name: String,
    /// Where the camera stood, in the frame of the sheet.
    pub station: Station,
    /// Covariance of the station: centre in mm, then small rotation about the sheet's axes in rad.
    pub covariance: Matrix6<f64>,
    /// Measured points, pixels; of discs less the eccentricity.
    pub pixels: Vec<Vector2<f64>>,
    /// Observed minus computed, pixels, in the order of the points.
    pub residuals: Vec<Vector2<f64>>,
}

impl SolvedView {
    /// Root of the mean squared length of the residuals, pixels.
    #[must_use]
    pub fn rms_px(&self) -> f64 {
        let sum: f64 = self.residuals.iter().map(Vector2::norm_squared).sum();
        (sum / self.residuals.len().max(1) as f64).sqrt()
    }
}

/// A point that was left out.
#[derive(Debug, Clone, PartialEq)]
pub struct Rejection {
    /// The picture.
    pub view: String,
    /// The point on the sheet, millimetres.
    pub on_sheet: Vector2<f64>,
    /// Its standardised residual when it was left out.
    pub standardised: f64,
}

/// A calibrated camera and what it is worth.
#[derive(Debug, Clone, PartialEq)]
pub struct SelfCalibration {
    /// The interior orientation.
    pub camera: Camera,
    /// What was estimated of it.
    pub unknowns: Unknowns,
    /// Covariance of the unknowns in their order.
    pub covariance: DMatrix<f64>,
    /// The pictures.
    pub views: Vec<SolvedView>,
    /// Standard deviation of a coordinate from the residuals, pixels.
    pub sigma0_px: f64,
    /// Root of the mean squared length of the residuals, pixels (OpenCV's RMS).
    pub rms_px: f64,
    /// Coordinates minus unknowns.
    pub redundancy: usize,
    /// Steps of the last adjustment.
    pub iterations: usize,
    /// Points left out, worst first.
    pub rejected: Vec<Rejection>,
}

impl SelfCalibration {
    /// Standard deviation of an unknown; `None` where it was held.
    #[must_use]
    pub fn standard_deviation(&self, unknown: Interior) -> Option<f64> {
        let at = self.unknowns.iter().position(|u| u == unknown)?;
        Some(self.covariance[(at, at)].sqrt())
    }

    /// Correlations of the unknowns in their order.
    #[must_use]
    pub fn correlations(&self) -> DMatrix<f64> {
        let c = &self.covariance;
        DMatrix::from_fn(c.nrows(), c.ncols(), |i, j| c[(i, j)] / (c[(i, i)] * c[(j, j)]).sqrt())
    }

    /// Number of points.
    #[must_use]
    pub fn points(&self) -> usize {
        self.views.iter().map(|v| v.residuals.len()).sum()
    }
}

/// Calibrates a camera from views of a flat sheet, from a start (see [`super::start_camera`]).
///
/// # Errors
/// [`CalibrationError`].
pub fn self_calibrate(
    views: &[View],
    start: &Camera,
    unknowns: &Unknowns,
) -> Result<SelfCalibration, CalibrationError> {
    let mut state = State::begin(views, start, unknowns)?;
    let columns = unknowns.len() + 6 * views.len();
    let observations: usize = views.iter().map(|v| 2 * v.points.len()).sum();
    if observations <= columns {
        return Err(CalibrationError::TooFewObservations { observations, unknowns: columns });
    }
    let mut pixels: Vec<Vec<Vector2<f64>>> =
        views.iter().map(|v| v.points.iter().map(|p| p.pixel).collect()).collect();
    for _ in 0..MAX_ROUNDS {
        let iterations = minimise(views, &pixels, unknowns, &mut state)?;
        let corrected = without_eccentricity(views, &state);
        let moved = pixels.iter().flatten().zip(corrected.iter().flatten());
        let most = moved.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        if most < SAME_OFFSET {
            return finish(views, &pixels, unknowns, &state, iterations);
        }
        pixels = corrected;
    }
    let last = finish(views, &pixels, unknowns, &state, MAX_ITERATIONS)?;
    Err(CalibrationError::Diverged { rms_px: last.rms_px })
}

/// As [`self_calibrate`], leaving out points whose residual is more than `limit` times the sigma of
/// unit weight, the worst of each view at a time, until none is.
///
/// # Errors
/// [`CalibrationError`].
pub fn self_calibrate_robustly(
    views: &[View],
    start: &Camera,
    unknowns: &Unknowns,
    limit: f64,
) -> Result<SelfCalibration, CalibrationError> {
    let mut kept = views.to_vec();
    let mut rejected = Vec::new();
    loop {
        let mut found = self_calibrate(&kept, start, unknowns)?;
        let before = rejected.len();
        for (view, solved) in kept.iter_mut().zip(&found.views) {
            let lengths = solved.residuals.iter().map(|r| r.norm() / found.sigma0_px);
            let worst = lengths.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((at, standardised)) = worst.filter(|(_, length)| *length > limit) {
                let point = view.points.remove(at);
                let (view, on_sheet) = (view.name.clone(), point.on_sheet);
                rejected.push(Rejection { view, on_sheet, standardised });
            }
        }
        if rejected.len() == before {
            rejected.sort_by(|a, b| b.standardised.total_cmp(&a.standardised));
            found.rejected = rejected;
            return Ok(found);
        }
    }
}

/// What is estimated.
#[derive(Clone)]
struct State {
    camera: Camera,
    stations: Vec<Station>,
}

impl State {
    fn begin(
        views: &[View],
        start: &Camera,
        unknowns: &Unknowns,
    ) -> Result<Self, CalibrationError> {
        if views.is_empty() {
            return Err(CalibrationError::NoViews);
        }
        let mut camera = *start;
        if unknowns.contains(Interior::F) {
            camera.fx = Interior::F.of(start);
            camera.fy = camera.fx;
        }
        let stations: Result<Vec<Station>, CalibrationError> =
            views.iter().map(|view| first_station(view, &camera)).collect();
        Ok(Self { camera, stations: stations? })
    }

    fn moved(&self, unknowns: &Unknowns, step: &DVector<f64>) -> Self {
        let mut next = self.clone();
        for (unknown, step) in unknowns.iter().zip(step.iter()) {
            unknown.add(&mut next.camera, *step);
        }
        for (i, station) in next.stations.iter_mut().enumerate() {
            let first = unknowns.len() + 6 * i;
            *station = station.moved(&step.fixed_rows::<6>(first).into_owned());
        }
        next
    }
}

fn first_station(view: &View, camera: &Camera) -> Result<Station, CalibrationError> {
    if view.points.len() < LEAST_POINTS {
        let (view, points) = (view.name.clone(), view.points.len());
        return Err(CalibrationError::TooFewPoints { view, points });
    }
    let seen = view
        .points
        .iter()
        .filter_map(|p| Some((in_space(p.on_sheet), camera.normalise(&p.pixel)?)));
    let (points, directions): (Vec<_>, Vec<_>) = seen.unzip();
    resect(&points, &directions).ok_or_else(|| CalibrationError::NoPose { view: view.name.clone() })
}

fn in_space(on_sheet: Vector2<f64>) -> Vector3<f64> {
    on_sheet.push(0.0)
}

/// The measured points less the eccentricity of their discs' images.
fn without_eccentricity(views: &[View], state: &State) -> Vec<Vec<Vector2<f64>>> {
    let corrected = |(view, station): (&View, &Station)| {
        let one = |p: &super::SheetPoint| {
            let centre = in_space(p.on_sheet);
            let offset = (p.radius_mm > 0.0)
                .then(|| disc_image_offset(&state.camera, station, &centre, p.radius_mm));
            p.pixel - offset.flatten().unwrap_or_default()
        };
        view.points.iter().map(one).collect()
    };
    views.iter().zip(&state.stations).map(corrected).collect()
}

/// Minimises the squared residuals; the number of steps.
fn minimise(
    views: &[View],
    pixels: &[Vec<Vector2<f64>>],
    unknowns: &Unknowns,
    state: &mut State,
) -> Result<usize, CalibrationError> {
    let sums = |state: &State| normal_equations(views, pixels, unknowns, state);
    let behind = || CalibrationError::NoPose { view: views[0].name.clone() };
    let mut now = sums(state).ok_or_else(behind)?;
    let points: usize = views.iter().map(|v| v.points.len()).sum();
    let mut damping = 1e-3;
    for iteration in 1..=MAX_ITERATIONS {
        let Some(step) = now.step(damping) else {
            damping *= 10.0;
            continue;
        };
        let next = state.moved(unknowns, &step);
        // What the step gains by the linear model: near the minimum the cost itself only shows its
        // rounding.
        if step.dot(&now.right) <= SAME_COST * now.cost + ROUNDING * points as f64 {
            *state = next;
            return Ok(iteration);
        }
        match sums(&next) {
            Some(sums) if sums.cost < now.cost => {
                (*state, now) = (next, sums);
                damping *= 0.1;
            }
            _ => damping *= 10.0,
        }
    }
    Err(CalibrationError::Diverged { rms_px: (now.cost / points as f64).sqrt() })
}

/// Normal equations and the sum of squared residuals.
struct Sums {
    normal: DMatrix<f64>,
    right: DVector<f64>,
    cost: f64,
}

impl Sums {
    /// Roots of the diagonal: what brings the unknowns to one scale.
    fn scale(&self) -> DVector<f64> {
        self.normal.diagonal().map(|d| if d > 0.0 { d.sqrt() } else { 1.0 })
    }

    /// The normal matrix with a diagonal of one.
    fn scaled(&self, scale: &DVector<f64>) -> DMatrix<f64> {
        let n = &self.normal;
        DMatrix::from_fn(n.nrows(), n.ncols(), |i, j| n[(i, j)] / (scale[i] * scale[j]))
    }

    fn step(&self, damping: f64) -> Option<DVector<f64>> {
        let scale = self.scale();
        let mut damped = self.scaled(&scale);
        for i in 0..damped.nrows() {
            damped[(i, i)] *= 1.0 + damping;
        }
        let right = self.right.component_div(&scale);
        Some(damped.cholesky()?.solve(&right).component_div(&scale))
    }
}

/// `None` where a point cannot be projected.
fn normal_equations(
    views: &[View],
    pixels: &[Vec<Vector2<f64>>],
    unknowns: &Unknowns,
    state: &State,
) -> Option<Sums> {
    let shared = unknowns.len();
    let size = shared + 6 * views.len();
    let mut sums =
        Sums { normal: DMatrix::zeros(size, size), right: DVector::zeros(size), cost: 0.0 };
    for (i, (view, station)) in views.iter().zip(&state.stations).enumerate() {
        let mut inner = DMatrix::zeros(shared + 6, shared + 6);
        let mut right = DVector::zeros(shared + 6);
        let mut rows = DMatrix::zeros(2, shared + 6);
        for (point, pixel) in view.points.iter().zip(&pixels[i]) {
            let arm = in_space(point.on_sheet) - station.centre;
            let station_from_sheet = station.rotation.inverse().into_inner();
            let at = state.camera.project_with_derivatives(&(station_from_sheet * arm))?;
            fill_interior(&mut rows, unknowns, &at);
            let by_arm: SMatrix<f64, 2, 3> = at.by_point * station_from_sheet;
            rows.fixed_view_mut::<2, 3>(0, shared).copy_from(&-by_arm);
            rows.fixed_view_mut::<2, 3>(0, shared + 3).copy_from(&(by_arm * arm.cross_matrix()));
            let residual = pixel - at.pixel;
            sums.cost += residual.norm_squared();
            inner.gemm_tr(1.0, &rows, &rows, 1.0);
            right.gemv_tr(1.0, &rows, &residual, 1.0);
        }
        sums.add(i, shared, &inner, &right);
    }
    Some(sums)
}

fn fill_interior(rows: &mut DMatrix<f64>, unknowns: &Unknowns, at: &Projection) {
    for (column, unknown) in unknowns.iter().enumerate() {
        for row in 0..2 {
            rows[(row, column)] = unknown.columns().iter().map(|&c| at.by_interior[(row, c)]).sum();
        }
    }
}

impl Sums {
    /// Adds the equations of one view: shared unknowns first, then its six.
    fn add(&mut self, view: usize, shared: usize, inner: &DMatrix<f64>, right: &DVector<f64>) {
        let place = |k: usize| if k < shared { k } else { k + 6 * view };
        for i in 0..inner.nrows() {
            self.right[place(i)] += right[i];
            for j in 0..inner.ncols() {
                self.normal[(place(i), place(j))] += inner[(i, j)];
            }
        }
    }
}

fn finish(
    views: &[View],
    pixels: &[Vec<Vector2<f64>>],
    unknowns: &Unknowns,
    state: &State,
    iterations: usize,
) -> Result<SelfCalibration, CalibrationError> {
    let behind = || CalibrationError::NoPose { view: views[0].name.clone() };
    let sums = normal_equations(views, pixels, unknowns, state).ok_or_else(behind)?;
    let inverse = inverse(&sums, unknowns, views)?;
    let points: usize = views.iter().map(|v| v.points.len()).sum();
    let redundancy = 2 * points - inverse.nrows();
    let variance = sums.cost / redundancy as f64;
    let shared = unknowns.len();
    let solved = views.iter().zip(&state.stations).enumerate().map(|(i, (view, station))| {
        let at = shared + 6 * i;
        let covariance = inverse.fixed_view::<6, 6>(at, at) * variance;
        let residuals = residuals(view, &pixels[i], &state.camera, station);
        let (name, pixels) = (view.name.clone(), pixels[i].clone());
        SolvedView { name, station: *station, covariance, pixels, residuals }
    });
    Ok(SelfCalibration {
        camera: state.camera,
        unknowns: unknowns.clone(),
        covariance: inverse.view((0, 0), (shared, shared)) * variance,
        views: solved.collect(),
        sigma0_px: variance.sqrt(),
        rms_px: (sums.cost / points as f64).sqrt(),
        redundancy,
        iterations,
        rejected: Vec::new(),
    })
}

fn residuals(
    view: &View,
    pixels: &[Vector2<f64>],
    camera: &Camera,
    station: &Station,
) -> Vec<Vector2<f64>> {
    let points = view.points.iter().zip(pixels);
    points
        .filter_map(|(point, pixel)| {
            Some(pixel - camera.project(&station.station_point(&in_space(point.on_sheet)))?)
        })
        .collect()
}

/// The inverse of the normal matrix, or the name of what it does not determine: the unknown that
/// moves most along the direction in which nothing changes.
fn inverse(
    sums: &Sums,
    unknowns: &Unknowns,
    views: &[View],
) -> Result<DMatrix<f64>, CalibrationError> {
    let scale = sums.scale();
    let eigen = sums.scaled(&scale).symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    if eigen.eigenvalues[least] < LEAST_EIGENVALUE {
        let direction = eigen.eigenvectors.column(least);
        let shared = unknowns.iter().zip(direction.iter());
        let named = shared.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
        let parameter = named.map_or_else(
            || format!("the pose of {}", views[(direction.iamax() - unknowns.len()) / 6].name),
            |(unknown, _)| unknown.name().to_owned(),
        );
        return Err(CalibrationError::Undetermined { parameter });
    }
    let inverted = eigen.eigenvalues.map(f64::recip);
    let scaled =
        &eigen.eigenvectors * DMatrix::from_diagonal(&inverted) * eigen.eigenvectors.transpose();
    Ok(DMatrix::from_fn(scaled.nrows(), scaled.ncols(), |i, j| {
        scaled[(i, j)] / (scale[i] * scale[j])
    }))
}
