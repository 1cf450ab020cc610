//! One capture, from sightings to poses.

use std::collections::BTreeMap;

use nalgebra::{Vector2, Vector3};

use super::by_angles::{self, Dots};
use super::orient::{Oriented, orient};
use super::outcome::{
    LeftOut, add_outliers, add_strays, camera_solutions, dots_in_space, dots_of, misfits, pose,
};
use super::points::{RoughModule, Scene, build};
use super::types::{CaptureSolution, Method, MethodResult, Subject};
use crate::adjust::{
    BeamObservation, ModuleStation, ObservationId, Options, Summary, Tested, adjust,
    test_observations, variance_component,
};
use crate::detect::{Dot, Target};
use crate::identify::{Labelled, View, choose_turn, label_views};
use crate::pattern::Order;
use crate::pose::{Estimator, Station};
use crate::scene::Setup;
use crate::wavelength::Wavelength;

/// Fewer dots in space than this do not fix six unknowns with anything to spare.
const FEWEST_BEAMS: usize = 6;

/// What one camera saw in one capture.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Sighting {
    /// Laser dots.
    pub dots: Vec<Dot>,
    /// Coded targets.
    pub targets: Vec<Target>,
}

/// Solves one capture.
///
/// `sightings` are keyed by camera name; `wavelength` is what is known of it at the capture. Every
/// method of `methods` that needs no other capture has a result, be it the reason why there is no
/// pose. `identified` is called when cameras are oriented and beams named, before the adjustment: nothing here reads a
/// clock, but the caller may.
#[must_use]
pub fn solve_capture(
    setup: &Setup,
    sightings: &BTreeMap<String, Sighting>,
    wavelength: &Wavelength,
    methods: &[Method],
    identified: &mut dyn FnMut(),
) -> CaptureSolution {
    let methods: Vec<Method> =
        methods.iter().copied().filter(|m| Method::OF_A_CAPTURE.contains(m)).collect();
    let methods = methods.as_slice();
    let (cameras, mut notes) = orient(setup, sightings);
    let scale = wavelength.fan_scale(&setup.pattern);
    let labels = label(setup, &cameras);
    identified();
    let outcome = labels.and_then(|labels| located(setup, &cameras, labels, scale, methods));
    let mut solution = match outcome {
        Ok(mut solution) => {
            notes.append(&mut solution.notes);
            CaptureSolution { notes, ..solution }
        }
        Err(reason) => failed(setup, methods, scale.0, &notes, &reason),
    };
    for result in &mut solution.results {
        result.wavelength = Some(*wavelength);
    }
    solution
}

fn failed(
    setup: &Setup,
    methods: &[Method],
    scale: f64,
    notes: &[String],
    reason: &str,
) -> CaptureSolution {
    let reason = std::iter::once(reason.to_owned()).chain(notes.iter().cloned());
    let reason = reason.collect::<Vec<_>>().join("; ");
    let result = |method: &Method| MethodResult {
        method: *method,
        pose: Err(reason.clone()),
        beams_used: 0,
        sigma0: 0.0,
        wavelength_nm: setup.pattern.reference_wavelength_nm * (1.0 + scale),
        wavelength: None,
        ambiguous: false,
    };
    CaptureSolution {
        cameras: BTreeMap::new(),
        dots: Vec::new(),
        results: methods.iter().map(result).collect(),
        notes: notes.to_vec(),
    }
}

fn located(
    setup: &Setup,
    cameras: &[Oriented<'_>],
    mut labels: Vec<Vec<Option<Order>>>,
    scale: (f64, f64),
    methods: &[Method],
) -> Result<CaptureSolution, String> {
    // Once with the cameras alone: dots in space, and outliers out.
    let mut scene = build(setup, cameras, &labels, None);
    let mut summary = adjust(&mut scene.problem, &Options::default()).map_err(in_words)?;
    scene.dot_variance = dot_variance(&scene, &summary).max(1.0);
    if scene.dot_variance > 1.0 {
        scene.apply_dot_variance();
        summary = adjust(&mut scene.problem, &Options::default()).map_err(in_words)?;
    }
    let labelled = turned(setup, &scene, &summary, scale.0)?;
    relabel(&mut labels, &mut scene, &labelled);
    let mut notes = misfits(cameras, &scene, &summary);
    // Outliers found once stay out of what follows.
    let free = remove_outliers(&mut scene, &mut summary);
    let module = labelled.fit.station;
    let virtual_camera = methods
        .contains(&Method::VirtualCamera)
        .then(|| by_virtual_camera(setup, cameras, &labels, &scene, &module, scale));
    let mut results = Vec::new();
    for method in methods {
        results.push(match (method, &virtual_camera) {
            (Method::VirtualCamera, Some(Ok((result, _, _)))) => result.clone(),
            (Method::VirtualCamera, Some(Err(reason))) => unsolved(setup, *method, scale.0, reason),
            _ => from_dots(setup, &scene, &summary, scale, (*method, module.centre)),
        });
    }
    for result in &mut results {
        result.ambiguous = labelled.ambiguous;
    }
    let (shown, shown_summary) = match virtual_camera {
        Some(Ok((_, scene, summary))) => (scene, summary),
        _ => {
            notes.clear();
            (scene, summary)
        }
    };
    let dots = dots_in_space(&shown, &shown_summary);
    let mut solved = camera_solutions(cameras, &shown, &shown_summary);
    add_outliers(&mut solved, cameras, &free, &labelled);
    add_strays(&mut solved, cameras, &labels);
    notes.extend(misfits(cameras, &shown, &shown_summary));
    Ok(CaptureSolution { cameras: solved, dots, results, notes })
}

fn in_words(error: crate::adjust::AdjustError) -> String {
    format!("the adjustment failed: {error}")
}

/// Beams of all dots, up to a quarter turn.
fn label(setup: &Setup, cameras: &[Oriented<'_>]) -> Result<Vec<Vec<Option<Order>>>, String> {
    if cameras.len() < 2 {
        return Err(format!("{} of {} cameras oriented", cameras.len(), setup.cameras.len()));
    }
    let views: Vec<View> = cameras
        .iter()
        .map(|c| {
            let seen = c.dots.iter().zip(&c.sighting.dots);
            let (directions, amplitudes) =
                seen.filter_map(|(n, d)| Some(((*n)?, d.amplitude))).unzip();
            View { station: c.station, directions, amplitudes }
        })
        .collect();
    let labels = label_views(&views, &setup.pattern)?;
    // Back to all dots of each camera, those without a direction included.
    Ok(cameras
        .iter()
        .zip(labels)
        .map(|(camera, labels)| {
            let mut labels = labels.into_iter();
            camera.dots.iter().map(|n| n.and_then(|_| labels.next().flatten())).collect()
        })
        .collect())
}

/// The variance component of the dots: how many times larger the squares of their residuals are
/// than their covariances let expect. Speckle that a picture's own noise model does not see whole
/// (dots of few grains) shows here.
fn dot_variance(scene: &Scene, summary: &Summary) -> f64 {
    let tested = test_observations(&scene.problem, &summary.covariance, 0.0);
    let is_dot = |t: &&Tested| match t.observation {
        ObservationId::Image(i) => {
            matches!(scene.subjects[scene.problem.images[i].point], Subject::Dot(_))
        }
        _ => false,
    };
    variance_component(tested.iter().filter(is_dot), FEWEST_REDUNDANT).unwrap_or(1.0)
}

/// With fewer redundant coordinates than this a variance component is mostly chance.
const FEWEST_REDUNDANT: f64 = 40.0;

fn turned(setup: &Setup, scene: &Scene, summary: &Summary, scale: f64) -> Result<Labelled, String> {
    let (_, orders, places) = dots_of(scene, summary);
    if places.len() < FEWEST_BEAMS {
        return Err(format!("{} dots found in space, {FEWEST_BEAMS} needed", places.len()));
    }
    choose_turn(&places, &orders, &setup.pattern, scale, setup.module_prior.as_ref())
}

fn relabel(labels: &mut [Vec<Option<Order>>], scene: &mut Scene, labelled: &Labelled) {
    for label in labels.iter_mut().flatten().flatten() {
        *label = labelled.apply(*label);
    }
    for subject in &mut scene.subjects {
        if let Subject::Dot(order) = subject {
            *order = labelled.apply(*order);
        }
    }
}

fn remove_outliers(scene: &mut Scene, summary: &mut Summary) -> Vec<LeftOut> {
    let out: Vec<LeftOut> = summary
        .outlier_images
        .iter()
        .map(|&i| &scene.problem.images[i])
        .map(|o| (o.camera, scene.subjects[o.point], o.at))
        .collect();
    let mut index = 0;
    scene.problem.images.retain(|_| {
        index += 1;
        summary.outlier_images.binary_search(&(index - 1)).is_err()
    });
    summary.outlier_images.clear();
    out
}

/// The module from the dots in space, by one of the methods that need no more, and a start.
fn from_dots(
    setup: &Setup,
    scene: &Scene,
    summary: &Summary,
    scale: (f64, f64),
    (method, start): (Method, Vector3<f64>),
) -> MethodResult {
    let estimator = match method {
        Method::InterBeamAnglesGls => Estimator::AnglesGeneralised,
        Method::RayFit => Estimator::Rays,
        Method::InterBeamAngles | Method::VirtualCamera | Method::SessionAdjustment => {
            Estimator::Angles
        }
    };
    let (points, orders, places) = dots_of(scene, summary);
    let cofactors: Vec<_> =
        points.iter().filter_map(|p| summary.covariance.point_cofactor(*p)).collect();
    let cofactors = cofactors.iter().collect();
    let dots = Dots { orders, places, cofactors, covariance: &summary.covariance };
    match by_angles::solve(&setup.pattern, &dots, scale, start, estimator) {
        Ok(found) => MethodResult {
            method,
            pose: Ok(found.pose),
            beams_used: dots.orders.len(),
            sigma0: found.sigma0,
            wavelength_nm: setup.pattern.reference_wavelength_nm * (1.0 + scale.0),
            wavelength: None,
            ambiguous: false,
        },
        Err(reason) => unsolved(setup, method, scale.0, &reason),
    }
}

fn unsolved(setup: &Setup, method: Method, scale: f64, reason: &str) -> MethodResult {
    MethodResult {
        method,
        pose: Err(reason.to_owned()),
        beams_used: 0,
        sigma0: 0.0,
        wavelength_nm: setup.pattern.reference_wavelength_nm * (1.0 + scale),
        wavelength: None,
        ambiguous: false,
    }
}

/// The module as a camera inside the adjustment (chapter 5), with the dots that identification named:
/// those which two cameras or more see.
fn by_virtual_camera(
    setup: &Setup,
    cameras: &[Oriented<'_>],
    labels: &[Vec<Option<Order>>],
    adjusted: &Scene,
    module: &Station,
    scale: (f64, f64),
) -> Result<(MethodResult, Scene, Summary), String> {
    let cameras: Vec<Oriented<'_>> = cameras
        .iter()
        .zip(&adjusted.problem.cameras)
        .map(|(c, s)| Oriented { station: s.station, ..c.clone() })
        .collect();
    let tangent = |order| {
        let d = setup.pattern.direction(order, scale.0)?;
        Some(Vector2::new(d.x / d.z, d.y / d.z))
    };
    let rough = RoughModule { station: module, tangent: &tangent };
    let mut scene = build(setup, &cameras, labels, Some(rough));
    scene.problem.modules.push(ModuleStation {
        station: *module,
        scale: scale.0,
        scale_prior: scale,
    });
    scene.problem.interiors.clone_from(&adjusted.problem.interiors);
    scene.problem.artefact_scale = adjusted.problem.artefact_scale;
    scene.dot_variance = adjusted.dot_variance;
    scene.apply_dot_variance();
    add_beams(setup, &mut scene);
    let summary = adjust(&mut scene.problem, &Options::default()).map_err(in_words)?;
    let station = &scene.problem.modules[0].station;
    let covariance = summary.covariance.module(0).ok_or("the module's pose is not determined")?;
    let left_out = &summary.outlier_beams;
    let result = MethodResult {
        method: Method::VirtualCamera,
        pose: Ok(pose(station, &covariance)),
        beams_used: scene.problem.beams.len() - left_out.len(),
        sigma0: summary.sigma0(),
        wavelength_nm: setup.pattern.reference_wavelength_nm
            * (1.0 + scene.problem.modules[0].scale),
        wavelength: None,
        ambiguous: false,
    };
    Ok((result, scene, summary))
}

fn add_beams(setup: &Setup, scene: &mut Scene) {
    let sigma = setup.pattern.u.angle_deg.to_radians();
    for (point, subject) in scene.subjects.iter().enumerate() {
        if let Subject::Dot(order) = subject
            && let Some(direction) = setup.pattern.direction(*order, 0.0)
        {
            let cosines = direction.xy();
            scene.problem.beams.push(BeamObservation {
                module: 0,
                point,
                cosines,
                sigma,
                shared: None,
            });
        }
    }
}
