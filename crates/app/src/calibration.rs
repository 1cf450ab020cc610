//! From the rig's files to what solving needs: calibrations, pattern, artefact, prior.

use std::collections::BTreeMap;
use std::path::Path;

use beampose_core::{InstrumentName, Quantity, UsedFile};
use beampose_photogrammetry::camera::read_camera_info;
use beampose_photogrammetry::pattern::{read_pattern_with, read_table};
use beampose_photogrammetry::{
    Artefact, ArtefactTarget, CalibratedCamera, InteriorSigma, ModulePrior, Pattern, Setup,
    TieTargets, WavelengthByTemperature, wavelength,
};
use beampose_plan::Rig;
use beampose_plan::rig::instruments::Camera;

use crate::input::referred;

/// What solving is told, and the files that it was read from.
#[derive(Debug, Clone)]
pub struct MeasuredWith {
    /// What solving is told.
    pub setup: Setup,
    /// Pattern and cameras' calibrations.
    pub files: Vec<UsedFile>,
}

/// Everything that solving needs, at the cameras' full picture size.
///
/// # Errors
/// Which file is at fault and why, for people.
pub fn setup(rig: &Rig, folder: &Path) -> Result<MeasuredWith, String> {
    let (pattern, file) = pattern(&rig.measurement.pattern.value, folder)?;
    let mut files = vec![file];
    let mut cameras = BTreeMap::new();
    for (name, camera) in rig.cameras() {
        let (calibrated, file) = calibrated(name, camera, folder)?;
        cameras.insert(name.as_str().to_owned(), calibrated);
        files.push(file);
    }
    Ok(MeasuredWith { setup: measurement(rig, pattern, cameras), files })
}

fn measurement(rig: &Rig, pattern: Pattern, cameras: BTreeMap<String, CalibratedCamera>) -> Setup {
    let m = &rig.measurement;
    let wavelength_u_nm = wavelength_u_nm(rig).unwrap_or(wavelength::UNSTATED_U_NM);
    let artefact = m.artefact.as_ref();
    let artefact = Artefact {
        targets: artefact
            .iter()
            .flat_map(|artefact| &artefact.targets.value)
            .map(|t| ArtefactTarget {
                code: t.value.code.value,
                xyz_mm: t.value.xyz.map(|x| x.0),
                u_mm: t.value.u.0,
                radius_mm: t.value.radius.0,
            })
            .collect(),
        scale_relative_u: artefact.map_or(0.0, |artefact| artefact.scale_relative_u),
    };
    Setup {
        cameras,
        pattern,
        artefact,
        tie_targets: m.tie_targets.as_ref().map(|t| TieTargets { radius_mm: t.radius.0 }),
        module_prior: m.module_prior.as_ref().map(|p| ModulePrior {
            rotation_omega_phi_kappa_deg: p.rotation_omega_phi_kappa.map(|a| a.0),
            within_deg: p.within.0,
        }),
        wavelength_u_nm,
        wavelength_by_temperature: by_temperature(rig),
    }
}

/// How the wavelength follows the diode's temperature, where the rig says.
fn by_temperature(rig: &Rig) -> Option<WavelengthByTemperature> {
    let law = rig.measurement.wavelength_from_temperature.as_ref()?;
    let thermometer = rig.sensors().find(|(name, _)| **name == law.of.value);
    let u = thermometer.and_then(|(_, sensor)| sensor.u.as_ref());
    Some(WavelengthByTemperature {
        thermometer: law.of.value.as_str().to_owned(),
        at_degc: law.at.0,
        wavelength_nm: law.wavelength.0,
        wavelength_u_nm: law.wavelength_u.0,
        per_degree_nm: law.per_degree.0,
        per_degree_u_nm: law.per_degree_u.0,
        temperature_u_degc: u.map_or(0.0, |u| u.value.number()),
    })
}

/// Standard uncertainty of a wavelength reading, nanometres, where the rig declares one.
pub fn wavelength_u_nm(rig: &Rig) -> Option<f64> {
    rig.sensors()
        .filter(|(_, s)| s.reads == Quantity::Wavelength)
        .find_map(|(_, s)| s.u.as_ref().map(|u| u.value.number()))
}

/// A pattern that a rig refers to.
fn pattern(file: &str, folder: &Path) -> Result<(Pattern, UsedFile), String> {
    let text = referred(folder, file, "pattern")?;
    let path = folder.join(file);
    let beside = path.parent().unwrap_or(folder);
    let table =
        |file: &str, size| read_table(file, &referred(beside, file, "table of beams")?, size);
    let read = read_pattern_with(&text, table);
    let read = read.map_err(|error| format!("{}: {error}", path.display()))?;
    Ok((read, UsedFile::of(None, file, &text)))
}

/// The fan of the simulated module, where it is not the one that solving is told; for the simulated
/// world alone.
///
/// # Errors
/// Which file is at fault and why, for people.
pub fn simulated_fan(rig: &Rig, folder: &Path) -> Result<Option<Pattern>, String> {
    let module = rig.simulation.as_ref().map(|simulation| &simulation.module);
    let file = module.and_then(|module| module.pattern.as_ref());
    file.map(|file| pattern(&file.value, folder).map(|(fan, _)| fan)).transpose()
}

fn calibrated(
    name: &InstrumentName,
    camera: &Camera,
    folder: &Path,
) -> Result<(CalibratedCamera, UsedFile), String> {
    let file = &camera.calibration.value;
    let text = referred(folder, file, "camera calibration")?;
    let model = read_camera_info(&text)
        .map_err(|error| format!("{}: {error}", folder.join(file).display()))?;
    let sigma = camera.interior_u.as_ref().map_or(
        InteriorSigma { focal_px: 0.0, principal_point_px: [0.0; 2] },
        |u| InteriorSigma {
            focal_px: u.focal.0 / camera.pixel_pitch.0,
            principal_point_px: u.principal_point.map(|p| p.0 / camera.pixel_pitch.0),
        },
    );
    Ok((CalibratedCamera { model, sigma }, UsedFile::of(Some(name), file, &text)))
}
