//! A whole session in one adjustment.
//!
//! Cameras, artefact, targets, the fan's scale and the errors of its single beams are the same
//! things in every capture; only the module's pose and its dots are new each time. One adjustment
//! over all captures therefore knows them far better, and its joint covariance of all poses says
//! what two of them share: the uncertainty of a distance between two is right, since what they
//! share cancels.

use std::collections::BTreeMap;

use beampose_core::Pose;
use nalgebra::{DMatrix, Matrix2, Matrix6, Quaternion, UnitQuaternion, Vector2, Vector3};

use super::knocks::unmoved_from;
use super::outcome::pose;
use super::types::{CameraSolution, CaptureSolution, Method, Subject};
use crate::adjust::{
    BeamObservation, CameraStation, Control, ImageObservation, InteriorOrientation, ModuleStation,
    Options, Problem, SharedFan, Summary, adjust,
};
use crate::pose::Station;
use crate::scene::Setup;
use crate::wavelength::Wavelength;

/// What is left of a beam's direction beside its constant error, radians: far below what a dot
/// tells, so that the dot lies on its beam.
const BEAM_JITTER: f64 = 2e-6;

/// One capture of the session: its own solution, and the wavelength there.
#[derive(Debug, Clone, Copy)]
pub struct SolvedCapture<'a> {
    /// The capture's solution by itself; observations, start values.
    pub solution: &'a CaptureSolution,
    /// What is known of the wavelength at it.
    pub wavelength: Wavelength,
}

/// A camera that was knocked: it has an orientation of its own from a capture on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Knock {
    /// The camera.
    pub camera: String,
    /// Index of the first capture after it.
    pub capture: usize,
}

/// All poses of a session with their joint covariance.
#[derive(Debug, Clone)]
pub struct SessionSolution {
    /// Per capture its pose, or why it has none; in the order given.
    pub poses: Vec<Result<Pose, String>>,
    /// Root of the a posteriori variance of unit weight.
    pub sigma0: f64,
    /// Observations of images and beams left out.
    pub outliers: usize,
    /// Cameras that stood or looked otherwise from some capture on.
    pub knocks: Vec<Knock>,
    /// The fan's common scale and the errors of its beams, against the pattern of the setup.
    pub fan: SharedFan,
    modules: Vec<Option<usize>>,
    summary: Summary,
}

impl SessionSolution {
    /// Covariance between the poses of two captures (indices as given), 6x6: position in mm, then
    /// rotation in rad about the world axes. `None` where one has no pose.
    #[must_use]
    pub fn between(&self, a: usize, b: usize) -> Option<Matrix6<f64>> {
        let (a, b) = ((*self.modules.get(a)?)?, (*self.modules.get(b)?)?);
        self.summary.covariance.between_modules(a, b)
    }

    /// Covariance of [`Self::fan`]: its scale, then the direction cosines (x, y) of each beam.
    #[must_use]
    pub fn fan_covariance(&self) -> Option<DMatrix<f64>> {
        self.summary.covariance.fan()
    }
}

/// Adjusts all captures of a session together. Captures without a pose of their own are left out.
///
/// # Errors
/// Why there is no solution, in words.
pub fn solve_session(
    setup: &Setup,
    captures: &[SolvedCapture<'_>],
) -> Result<SessionSolution, String> {
    solve_session_with(setup, captures, &Options::default())
}

/// As [`solve_session`]. A fan of which little is known before leaves a long curved valley (it may
/// stretch while the module comes nearer), which takes many iterations.
///
/// # Errors
/// Why there is no solution, in words.
pub fn solve_session_with(
    setup: &Setup,
    captures: &[SolvedCapture<'_>],
    options: &Options,
) -> Result<SessionSolution, String> {
    let mut builder = Builder::new(setup, captures)?;
    let modules: Vec<Option<usize>> =
        captures.iter().enumerate().map(|(i, c)| builder.add_capture(i, c)).collect();
    let knocks = builder.knocks();
    let mut problem = builder.problem;
    let summary = adjust(&mut problem, options)
        .map_err(|error| format!("the session's adjustment failed: {error}"))?;
    let poses = modules
        .iter()
        .map(|module| {
            let module = module.ok_or("this capture has no pose of its own to start from")?;
            let covariance =
                summary.covariance.module(module).ok_or("the pose is not determined")?;
            Ok(pose(&problem.modules[module].station, &covariance))
        })
        .collect();
    let outliers = summary.outlier_images.len() + summary.outlier_beams.len();
    let sigma0 = summary.sigma0();
    let fan = problem.fan;
    Ok(SessionSolution { poses, sigma0, outliers, knocks, fan, modules, summary })
}

fn station(position_mm: [f64; 3], [w, x, y, z]: [f64; 4]) -> Station {
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    Station { centre: Vector3::from(position_mm), rotation: rotation.to_rotation_matrix() }
}

struct Builder<'a> {
    setup: &'a Setup,
    problem: Problem,
    /// Per camera its stations: from which capture on, and the index in the problem.
    cameras: BTreeMap<&'a str, Vec<(usize, usize)>>,
    /// Points of the targets, shared by all captures.
    targets: BTreeMap<u16, usize>,
}

impl<'a> Builder<'a> {
    fn new(setup: &'a Setup, captures: &[SolvedCapture<'_>]) -> Result<Self, String> {
        let mut problem = Problem {
            artefact_scale_sigma: setup.artefact.scale_relative_u,
            fan: fan(setup, captures),
            ..Problem::default()
        };
        let mut cameras = BTreeMap::new();
        for (name, calibrated) in &setup.cameras {
            let solutions: Vec<Option<&CameraSolution>> =
                captures.iter().map(|c| c.solution.cameras.get(name)).collect();
            let mut stations = Vec::new();
            for first in unmoved_from(&solutions) {
                let Some(start) = solutions[first..].iter().flatten().next() else { continue };
                stations.push((first, problem.cameras.len()));
                problem.cameras.push(CameraStation {
                    station: station(start.position_mm, start.quaternion_wxyz),
                    interior: problem.interiors.len(),
                    is_held: false,
                });
            }
            if !stations.is_empty() {
                cameras.insert(name.as_str(), stations);
                let interior = InteriorOrientation::calibrated(calibrated.model, &calibrated.sigma);
                problem.interiors.push(interior);
            }
        }
        if cameras.len() < 2 {
            return Err(format!("{} cameras were oriented in the session", cameras.len()));
        }
        Ok(Self { setup, problem, cameras, targets: BTreeMap::new() })
    }

    /// Adds a capture's module, dots and observations; the module's index.
    fn add_capture(&mut self, index: usize, capture: &SolvedCapture<'_>) -> Option<usize> {
        let solution = capture.solution;
        let of = |method| {
            let result = solution.results.iter().find(|r| r.method == method)?;
            result.pose.as_ref().ok()
        };
        let start = of(Method::VirtualCamera)
            .or_else(|| Method::OF_A_CAPTURE.iter().find_map(|method| of(*method)))?;
        let module = self.problem.modules.len();
        let pattern = &self.setup.pattern;
        // What the readings share (the meter's error) is the shared fan's.
        let scale = pattern.scale_at(capture.wavelength.nm);
        let sigma = capture.wavelength.own_u_nm / pattern.reference_wavelength_nm;
        self.problem.modules.push(ModuleStation {
            station: station(start.position_mm, start.quaternion_wxyz),
            scale,
            scale_prior: (scale, sigma),
        });
        let mut dots = BTreeMap::new();
        for dot in &solution.dots {
            let point = self.problem.points.len();
            self.problem.points.push(Vector3::from(dot.xyz_mm));
            dots.insert(Subject::Dot(dot.order), point);
            if let (Some(direction), Some(index)) =
                (pattern.direction(dot.order, 0.0), pattern.index(dot.order))
            {
                self.problem.beams.push(BeamObservation {
                    module,
                    point,
                    cosines: direction.xy(),
                    sigma: BEAM_JITTER,
                    shared: Some(index),
                });
            }
        }
        self.add_observations(index, solution, &dots);
        Some(module)
    }

    /// The station of a camera in a capture.
    fn camera_at(&self, name: &str, capture: usize) -> Option<usize> {
        let stations = self.cameras.get(name)?;
        stations.iter().rev().find(|(first, _)| *first <= capture).map(|(_, index)| *index)
    }

    fn knocks(&self) -> Vec<Knock> {
        let later = |(name, stations): (&&str, &Vec<(usize, usize)>)| -> Vec<Knock> {
            let knock = |(capture, _): &(usize, usize)| Knock {
                camera: (*name).to_owned(),
                capture: *capture,
            };
            stations.iter().skip(1).map(knock).collect()
        };
        self.cameras.iter().flat_map(later).collect()
    }

    fn add_observations(
        &mut self,
        capture: usize,
        solution: &CaptureSolution,
        dots: &BTreeMap<Subject, usize>,
    ) {
        for (name, camera) in &solution.cameras {
            let Some(camera_index) = self.camera_at(name, capture) else { continue };
            for o in camera.observations.iter().filter(|o| o.used) {
                let point = match o.subject {
                    Subject::Dot(_) => dots.get(&o.subject).copied(),
                    Subject::Target(code) => self.target(code, solution),
                };
                let covariance = Matrix2::from_fn(|r, c| o.covariance[r][c]);
                if let (Some(point), Some(information)) = (point, covariance.try_inverse()) {
                    let at = Vector2::from(o.at);
                    let observation =
                        ImageObservation { camera: camera_index, point, at, information };
                    self.problem.images.push(observation);
                }
            }
        }
    }

    /// The point of a target, placed where this capture's cameras see it when it is new.
    fn target(&mut self, code: u16, solution: &CaptureSolution) -> Option<usize> {
        if let Some(&point) = self.targets.get(&code) {
            return Some(point);
        }
        let known = self.setup.artefact.targets.iter().find(|t| t.code == code);
        let at = match known {
            Some(target) => Vector3::from(target.xyz_mm),
            None => self.seen_at(code, solution)?,
        };
        let point = self.problem.points.len();
        self.problem.points.push(at);
        self.targets.insert(code, point);
        if let Some(target) = known {
            let sigma = target.u_mm.max(1e-6);
            self.problem.controls.push(Control { point, at, sigma });
        }
        Some(point)
    }

    fn seen_at(&self, code: u16, solution: &CaptureSolution) -> Option<Vector3<f64>> {
        let stations: Vec<(Station, Vector2<f64>)> = solution
            .cameras
            .iter()
            .filter_map(|(name, camera)| {
                let seen = |o: &&super::types::Observation| o.subject == Subject::Target(code);
                let at = camera.observations.iter().find(seen)?.at;
                let model = &self.setup.cameras.get(name)?.model;
                let direction = model.normalise(&Vector2::from(at))?;
                Some((station(camera.position_mm, camera.quaternion_wxyz), direction))
            })
            .collect();
        let rays: Vec<_> = stations.iter().map(|(s, d)| (s, *d)).collect();
        crate::pose::triangulate(&rays)
    }
}

fn fan(setup: &Setup, captures: &[SolvedCapture<'_>]) -> SharedFan {
    let pattern = &setup.pattern;
    // Where sources are mixed, the most uncertain counts: they are not told apart.
    let common = captures.iter().map(|c| c.wavelength.common_u_nm).fold(0.0, f64::max);
    let of_reading = common / pattern.reference_wavelength_nm;
    SharedFan {
        scale: 0.0,
        scale_sigma: pattern.u.common_relative.hypot(of_reading),
        beams: vec![Vector2::zeros(); (pattern.columns * pattern.rows) as usize],
        beam_sigma: pattern.u.angle_deg.to_radians(),
    }
}
