//! The points of a capture's adjustment: artefact targets, tie targets, dots.

use std::collections::BTreeMap;

use nalgebra::{Matrix2, Vector2, Vector3};

use super::eccentricity::circle_image_offset;
use super::orient::Oriented;
use super::types::Subject;
use crate::adjust::{CameraStation, Control, ImageObservation, InteriorOrientation, Problem};
use crate::detect::ImagePoint;
use crate::pattern::Order;
use crate::pose::{Station, triangulate};
use crate::scene::Setup;

/// An adjustment with the meaning of its points.
pub(super) struct Scene {
    pub problem: Problem,
    /// What each point is.
    pub subjects: Vec<Subject>,
    /// By what the dots' covariances are multiplied: their variance component.
    pub dot_variance: f64,
}

impl Scene {
    /// Multiplies the covariances of the dots' image points by the variance component.
    pub fn apply_dot_variance(&mut self) {
        for observation in &mut self.problem.images {
            if is_dot(self.subjects[observation.point]) {
                observation.information /= self.dot_variance;
            }
        }
    }
}

/// The sightings of one subject: (camera, image point).
type Seen = BTreeMap<Subject, Vec<(usize, ImagePoint)>>;

/// Where the module is, roughly, and its beams on the plane z = 1.
#[derive(Clone, Copy)]
pub(super) struct RoughModule<'a> {
    pub station: &'a Station,
    pub tangent: &'a dyn Fn(Order) -> Option<Vector2<f64>>,
}

/// Sets up cameras, targets and those dots that can be placed in space: by two cameras, or by one
/// camera and the module where its rough pose is known.
pub(super) fn build(
    setup: &Setup,
    cameras: &[Oriented<'_>],
    labels: &[Vec<Option<Order>>],
    module: Option<RoughModule<'_>>,
) -> Scene {
    let mut scene =
        Scene { problem: cameras_of(setup, cameras), subjects: Vec::new(), dot_variance: 1.0 };
    scene.problem.artefact_scale_sigma = setup.artefact.scale_relative_u;
    for (subject, seen) in sightings(setup, cameras, labels) {
        let control = control(setup, subject);
        let mut rays: Vec<(&Station, Vector2<f64>)> = seen
            .iter()
            .filter_map(|(c, p)| Some((&cameras[*c].station, cameras[*c].camera.normalise(&p.at)?)))
            .collect();
        if let (Subject::Dot(order), Some(module)) = (subject, module)
            && let Some(direction) = (module.tangent)(order)
        {
            rays.push((module.station, direction));
        }
        let Some(at) = control.map(|c| c.0).or_else(|| triangulate(&rays)) else { continue };
        let ahead = rays.iter().all(|(station, _)| station.station_point(&at).z > 1.0);
        if !ahead || rays.len() != seen.len() + usize::from(module.is_some() && is_dot(subject)) {
            continue;
        }
        add_point(&mut scene, subject, at, &seen);
        if let Some((place, sigma)) = control {
            let point = scene.problem.points.len() - 1;
            scene.problem.controls.push(Control { point, at: place, sigma });
        }
    }
    correct_eccentricity(setup, &mut scene);
    scene
}

fn is_dot(subject: Subject) -> bool {
    matches!(subject, Subject::Dot(_))
}

fn cameras_of(setup: &Setup, cameras: &[Oriented<'_>]) -> Problem {
    let stations = cameras.iter().enumerate().map(|(interior, camera)| CameraStation {
        station: camera.station,
        interior,
        is_held: false,
    });
    let interiors = cameras
        .iter()
        .map(|c| interior(setup, c.name).unwrap_or_else(|| InteriorOrientation::fixed(*c.camera)));
    Problem { cameras: stations.collect(), interiors: interiors.collect(), ..Problem::default() }
}

/// A camera's interior orientation with what is known of it.
pub(super) fn interior(setup: &Setup, name: &str) -> Option<InteriorOrientation> {
    let camera = setup.cameras.get(name)?;
    Some(InteriorOrientation::calibrated(camera.model, &camera.sigma))
}

fn sightings(setup: &Setup, cameras: &[Oriented<'_>], labels: &[Vec<Option<Order>>]) -> Seen {
    let mut seen = Seen::new();
    let ties = setup.tie_targets.is_some();
    for (i, camera) in cameras.iter().enumerate() {
        for target in &camera.sighting.targets {
            let subject = Subject::Target(target.code);
            if ties || control(setup, subject).is_some() {
                seen.entry(subject).or_default().push((i, target.point));
            }
        }
        for (dot, label) in camera.sighting.dots.iter().zip(&labels[i]) {
            if let Some(order) = label {
                seen.entry(Subject::Dot(*order)).or_default().push((i, dot.point));
            }
        }
    }
    seen
}

fn control(setup: &Setup, subject: Subject) -> Option<(Vector3<f64>, f64)> {
    let Subject::Target(code) = subject else { return None };
    let target = setup.artefact.targets.iter().find(|t| t.code == code)?;
    // A target that is declared perfect still cannot weigh infinitely.
    Some((Vector3::from(target.xyz_mm), target.u_mm.max(1e-6)))
}

fn add_point(scene: &mut Scene, subject: Subject, at: Vector3<f64>, seen: &[(usize, ImagePoint)]) {
    let point = scene.problem.points.len();
    for (camera, p) in seen {
        let information = p.covariance.try_inverse().unwrap_or_else(Matrix2::zeros);
        let at = p.at;
        scene.problem.images.push(ImageObservation { camera: *camera, point, at, information });
    }
    scene.problem.points.push(at);
    scene.subjects.push(subject);
}

/// Takes off the eccentricity of the targets' circles. Targets are taken to face the way the
/// artefact faces: its flat lies in X and Y by definition of the world.
fn correct_eccentricity(setup: &Setup, scene: &mut Scene) {
    let problem = &mut scene.problem;
    for observation in &mut problem.images {
        let Subject::Target(code) = scene.subjects[observation.point] else { continue };
        let of_artefact = setup.artefact.targets.iter().find(|t| t.code == code);
        let radius = of_artefact.map(|t| t.radius_mm).or(setup.tie_targets.map(|t| t.radius_mm));
        let camera = &problem.cameras[observation.camera];
        let model = &problem.interiors[camera.interior].camera;
        let offset = radius.and_then(|radius| {
            let centre = &problem.points[observation.point];
            circle_image_offset(model, &camera.station, centre, &Vector3::z(), radius)
        });
        observation.at -= offset.unwrap_or_default();
    }
}
