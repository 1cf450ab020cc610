//! What solving leaves to be kept and shown: poses, dots in space, each camera's observations.

use std::collections::BTreeMap;

use beampose_core::Pose;
use nalgebra::{Matrix6, UnitQuaternion, Vector2, Vector3};

use super::orient::Oriented;
use super::points::Scene;
use super::types::{CameraSolution, DotInSpace, Observation, Subject};
use crate::adjust::{ObservationId, Summary, test_observations};
use crate::identify::Labelled;
use crate::pattern::Order;
use crate::pose::Station;
use crate::rotation::wxyz;

/// An observation left out: (camera, subject, where).
pub(super) type LeftOut = (usize, Subject, Vector2<f64>);

/// Observed minus computed of an image point. `None` where the point has no image.
pub(super) fn residual(scene: &Scene, image: usize) -> Option<Vector2<f64>> {
    let o = &scene.problem.images[image];
    Some(o.at - scene.problem.image_of(o.camera, o.point)?)
}

/// The dots of a scene that took part, with their places.
pub(super) fn dots_of(
    scene: &Scene,
    summary: &Summary,
) -> (Vec<usize>, Vec<Order>, Vec<Vector3<f64>>) {
    let mut found = (Vec::new(), Vec::new(), Vec::new());
    for (point, subject) in scene.subjects.iter().enumerate() {
        if let Subject::Dot(order) = subject
            && summary.covariance.has_point(point)
        {
            found.0.push(point);
            found.1.push(*order);
            found.2.push(scene.problem.points[point]);
        }
    }
    found
}

/// A station with its covariance as a pose.
pub(super) fn pose(station: &Station, covariance: &Matrix6<f64>) -> Pose {
    let quaternion = UnitQuaternion::from_rotation_matrix(&station.rotation);
    Pose {
        position_mm: station.centre.into(),
        quaternion_wxyz: wxyz(&quaternion),
        covariance: std::array::from_fn(|r| {
            std::array::from_fn(|c| (covariance[(r, c)] + covariance[(c, r)]) / 2.0)
        }),
    }
}

/// The dots that took part, row by row.
pub(super) fn dots_in_space(scene: &Scene, summary: &Summary) -> Vec<DotInSpace> {
    let (points, orders, places) = dots_of(scene, summary);
    let mut dots: Vec<DotInSpace> = points
        .iter()
        .zip(orders.iter().zip(&places))
        .filter_map(|(point, (order, place))| {
            let c = summary.covariance.point(*point)?;
            Some(DotInSpace {
                order: *order,
                xyz_mm: (*place).into(),
                covariance: std::array::from_fn(|r| std::array::from_fn(|s| c[(r, s)])),
            })
        })
        .collect();
    dots.sort_by_key(|d| (d.order.n, d.order.m));
    dots
}

/// Each camera's pose and observations.
pub(super) fn camera_solutions(
    cameras: &[Oriented<'_>],
    scene: &Scene,
    summary: &Summary,
) -> BTreeMap<String, CameraSolution> {
    let mut solved: BTreeMap<String, CameraSolution> = cameras
        .iter()
        .zip(&scene.problem.cameras)
        .map(|(camera, adjusted)| {
            let rotation = UnitQuaternion::from_rotation_matrix(&adjusted.station.rotation);
            let solution = CameraSolution {
                position_mm: adjusted.station.centre.into(),
                quaternion_wxyz: wxyz(&rotation),
                observations: Vec::new(),
                strays: Vec::new(),
            };
            (camera.name.to_owned(), solution)
        })
        .collect();
    for (i, o) in scene.problem.images.iter().enumerate() {
        let Some(residual) = residual(scene, i) else { continue };
        let covariance = o.information.try_inverse().unwrap_or_default();
        if let Some(camera) = solved.get_mut(cameras[o.camera].name) {
            camera.observations.push(Observation {
                subject: scene.subjects[o.point],
                at: o.at.into(),
                covariance: std::array::from_fn(|r| std::array::from_fn(|c| covariance[(r, c)])),
                residual: residual.into(),
                used: summary.outlier_images.binary_search(&i).is_err(),
            });
        }
    }
    solved
}

/// Observations that the first adjustment left out, shown as such where the second kept them out.
pub(super) fn add_outliers(
    solved: &mut BTreeMap<String, CameraSolution>,
    cameras: &[Oriented<'_>],
    left_out: &[LeftOut],
    labelled: &Labelled,
) {
    for (camera, subject, at) in left_out {
        let subject = match subject {
            Subject::Dot(order) => Subject::Dot(labelled.apply(*order)),
            target => *target,
        };
        if let Some(camera) = solved.get_mut(cameras[*camera].name)
            && !camera.observations.iter().any(|o| o.subject == subject)
        {
            camera.strays.push([at.x, at.y]);
        }
    }
}

/// Dots that no beam was found for.
pub(super) fn add_strays(
    solved: &mut BTreeMap<String, CameraSolution>,
    cameras: &[Oriented<'_>],
    labels: &[Vec<Option<Order>>],
) {
    for (camera, labels) in cameras.iter().zip(labels) {
        if let Some(solution) = solved.get_mut(camera.name) {
            let unlabelled = camera.sighting.dots.iter().zip(labels).filter(|(_, l)| l.is_none());
            solution.strays.extend(unlabelled.map(|(d, _)| [d.point.at.x, d.point.at.y]));
        }
    }
}

/// Most misfits that are told one by one.
const TOLD: usize = 4;
/// A control whose residual is longer than this many of its standard deviations does not fit.
const CONTROL_LIMIT: f64 = 4.5;

/// The observations that do not fit the rest, in words: those left out, and targets of the artefact
/// that are not where it says.
pub(super) fn misfits(cameras: &[Oriented<'_>], scene: &Scene, summary: &Summary) -> Vec<String> {
    let subject = |subject: Subject| match subject {
        Subject::Dot(order) => format!("the dot of beam ({}, {})", order.m, order.n),
        Subject::Target(code) => format!("target {code}"),
    };
    let problem = &scene.problem;
    let mut left_out = summary.left_out.clone();
    left_out.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    let mut told: Vec<String> = left_out
        .iter()
        .take(TOLD)
        .filter_map(|(observation, statistic)| match observation {
            ObservationId::Image(i) => {
                let o = &problem.images[*i];
                let (name, what) = (cameras[o.camera].name, subject(scene.subjects[o.point]));
                Some(format!("{name}: {what} is {statistic:.1} sigma off; left out"))
            }
            ObservationId::Beam(i) => {
                let what = subject(scene.subjects[problem.beams[*i].point]);
                Some(format!("{what} is {statistic:.1} sigma off its calibrated beam; left out"))
            }
            ObservationId::Control(_) => None,
        })
        .collect();
    if left_out.len() > TOLD {
        told.push(format!("{} more observations do not fit; left out", left_out.len() - TOLD));
    }
    for tested in test_observations(problem, &summary.covariance, CONTROL_LIMIT / 3.0) {
        if let (ObservationId::Control(i), true) =
            (tested.observation, tested.statistic > CONTROL_LIMIT)
        {
            let what = subject(scene.subjects[problem.controls[i].point]);
            let by = tested.statistic;
            told.push(format!("{what} is {by:.1} sigma from its place on the artefact"));
        }
    }
    told
}
