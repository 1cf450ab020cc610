//! Self-calibration: interior orientation and the pose of every picture in one least-squares
//! adjustment, points of the sheet held, all observations of equal weight.
//!
//! The general adjustment (`adjust`) does it; what is here is what a sheet adds. The sigma of unit
//! weight comes from the residuals (sum of squares over the redundancy, which is OpenCV's convention
//! too): what dominates on a printed sheet is how flat and how well printed it is, and the stated
//! covariance of a disc's centre does not know that. The centre of a disc's ellipse is not the image
//! of its centre; the difference is computed from the estimate and taken off, until it stays.

use nalgebra::{DMatrix, Matrix2, Matrix6, Vector2, Vector3};

use super::disc_image::disc_image_offset;
use super::{Interior, Unknowns, View};
use crate::adjust::{
    AdjustError, CameraStation, ImageObservation, InteriorOrientation, Options, Problem, Summary,
    adjust,
};
use crate::camera::Camera;
use crate::pose::{Station, resect};

/// Fewer points fix no pose with anything left to check it by.
const LEAST_POINTS: usize = 6;
/// From the closed form it takes about ten.
const MAX_ITERATIONS: usize = 200;
/// A step that gains less than this part of the cost is the last: it would move nothing by more than
/// a hundred thousandth of its standard deviation.
const SAME_COST: f64 = 1e-14;
/// An eccentricity that changes by less is final, pixels: a thousandth of the best centre.
const SAME_OFFSET: f64 = 1e-5;
/// Rounds of eccentricity: each gains two or three digits.
const MAX_ROUNDS: usize = 8;

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
    /// The eccentricity of the discs grows instead of settling.
    #[error("the eccentricity of the dots does not settle: is their diameter right?")]
    Unsettled,
    /// The adjustment failed.
    #[error(transparent)]
    Adjustment(#[from] AdjustError),
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
        let (summary, next) = minimise(views, &pixels, unknowns, &state)?;
        state = next;
        let corrected = without_eccentricity(views, &state);
        let moved = pixels.iter().flatten().zip(corrected.iter().flatten());
        let most = moved.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        if most < SAME_OFFSET {
            return finish(views, &pixels, unknowns, &state, &summary);
        }
        pixels = corrected;
    }
    Err(CalibrationError::Unsettled)
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

/// Minimises the squared residuals from a state; the state that does.
fn minimise(
    views: &[View],
    pixels: &[Vec<Vector2<f64>>],
    unknowns: &Unknowns,
    state: &State,
) -> Result<(Summary, State), CalibrationError> {
    let parameters: Vec<_> = unknowns.iter().map(Interior::parameter).collect();
    let interior = InteriorOrientation::free(state.camera, &parameters);
    let mut problem = Problem { interiors: vec![interior], ..Problem::default() };
    for (camera, (view, station)) in views.iter().zip(&state.stations).enumerate() {
        problem.cameras.push(CameraStation { station: *station, interior: 0, is_held: false });
        for (point, at) in view.points.iter().zip(&pixels[camera]) {
            let (index, information) = (problem.points.len(), Matrix2::identity());
            problem.points.push(in_space(point.on_sheet));
            problem.images.push(ImageObservation { camera, point: index, at: *at, information });
        }
    }
    problem.held_points = (0..problem.points.len()).collect();
    let options = Options {
        max_iterations: MAX_ITERATIONS,
        relative_decrease: SAME_COST,
        outlier_sigmas: f64::INFINITY,
        ..Options::default()
    };
    let summary = adjust(&mut problem, &options)?;
    let stations = problem.cameras.iter().map(|c| c.station).collect();
    Ok((summary, State { camera: *problem.interior(0), stations }))
}

fn finish(
    views: &[View],
    pixels: &[Vec<Vector2<f64>>],
    unknowns: &Unknowns,
    state: &State,
    summary: &Summary,
) -> Result<SelfCalibration, CalibrationError> {
    let cofactors = &summary.covariance;
    let undetermined = |parameter: String| CalibrationError::Undetermined { parameter };
    let all = || undetermined("the interior orientation".to_owned());
    let interior = cofactors.interior(0).ok_or_else(all)?;
    if let Some(unknown) = open(unknowns, &interior, &state.camera) {
        return Err(undetermined(unknown.name().to_owned()));
    }
    let variance = summary.chi2 / summary.redundancy.max(1) as f64;
    let mut solved = Vec::with_capacity(views.len());
    for (i, (view, station)) in views.iter().zip(&state.stations).enumerate() {
        let pose = || undetermined(format!("the pose of {}", view.name));
        solved.push(SolvedView {
            name: view.name.clone(),
            station: *station,
            covariance: cofactors.camera(i).ok_or_else(pose)? * variance,
            pixels: pixels[i].clone(),
            residuals: residuals(view, &pixels[i], &state.camera, station),
        });
    }
    let points: usize = views.iter().map(|v| v.points.len()).sum();
    Ok(SelfCalibration {
        camera: state.camera,
        unknowns: unknowns.clone(),
        covariance: interior * variance,
        views: solved,
        sigma0_px: variance.sqrt(),
        rms_px: (summary.chi2 / points as f64).sqrt(),
        redundancy: summary.redundancy,
        iterations: summary.iterations,
        rejected: Vec::new(),
    })
}

/// The unknown that the pictures leave open most, if one is: coordinates good to a pixel would leave
/// it so uncertain that the corner of the picture could be anywhere.
fn open(unknowns: &Unknowns, cofactors: &DMatrix<f64>, camera: &Camera) -> Option<Interior> {
    let size = (camera.width as f64).hypot(camera.height as f64);
    let focal = Interior::F.of(camera);
    let corner = 0.5 * size / focal;
    let moved = unknowns.iter().zip(cofactors.diagonal().iter().copied().collect::<Vec<_>>());
    let moved = moved.map(|(u, cofactor)| (u, cofactor.abs().sqrt() * u.moves(focal, corner)));
    let most = moved.max_by(|a, b| a.1.total_cmp(&b.1))?;
    (most.1 > size).then_some(most.0)
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
