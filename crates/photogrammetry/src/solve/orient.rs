//! Camera poses from the artefact's targets.

use std::collections::BTreeMap;

use nalgebra::{Vector2, Vector3};

use super::capture::Sighting;
use crate::camera::Camera;
use crate::pose::{Station, resect};
use crate::scene::Setup;

/// A camera that could be oriented.
#[derive(Debug, Clone)]
pub(super) struct Oriented<'a> {
    pub name: &'a str,
    pub camera: &'a Camera,
    pub station: Station,
    pub sighting: &'a Sighting,
    /// Normalised coordinates of its dots; those without are none of its field of view.
    pub dots: Vec<Option<Vector2<f64>>>,
}

/// Orients every camera that sees at least four targets of the artefact; a note for each that
/// cannot be.
pub(super) fn orient<'a>(
    setup: &'a Setup,
    sightings: &'a BTreeMap<String, Sighting>,
) -> (Vec<Oriented<'a>>, Vec<String>) {
    let known: BTreeMap<u16, Vector3<f64>> =
        setup.artefact.targets.iter().map(|t| (t.code, Vector3::from(t.xyz_mm))).collect();
    let mut oriented = Vec::new();
    let mut notes = Vec::new();
    for (name, calibrated) in &setup.cameras {
        let Some(sighting) = sightings.get(name) else {
            notes.push(format!("{name}: no picture"));
            continue;
        };
        let camera = &calibrated.model;
        match station(camera, sighting, &known) {
            Ok(station) => oriented.push(Oriented {
                name,
                camera,
                station,
                sighting,
                dots: sighting.dots.iter().map(|d| camera.normalise(&d.point.at)).collect(),
            }),
            Err(reason) => notes.push(format!("{name} left out: {reason}")),
        }
    }
    (oriented, notes)
}

fn station(
    camera: &Camera,
    sighting: &Sighting,
    known: &BTreeMap<u16, Vector3<f64>>,
) -> Result<Station, String> {
    let seen: Vec<(Vector3<f64>, Vector2<f64>)> = sighting
        .targets
        .iter()
        .filter_map(|t| Some((*known.get(&t.code)?, camera.normalise(&t.point.at)?)))
        .collect();
    let (points, directions): (Vec<_>, Vec<_>) = seen.iter().copied().unzip();
    if points.len() < 4 {
        return Err(format!("{} of the artefact's targets found, 4 needed", points.len()));
    }
    resect(&points, &directions)
        .ok_or_else(|| "the artefact's targets found are on a line or misread".to_owned())
}
