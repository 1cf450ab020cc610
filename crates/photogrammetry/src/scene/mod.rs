//! What stands in the scene and is known: the artefact, the tie targets, the prior of the module.

mod ring_code;

pub use ring_code::{RING_BITS, canonical_code, ring_sectors};

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::camera::CalibratedCamera;
use crate::pattern::Pattern;

/// A coded target of known place on the artefact.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArtefactTarget {
    /// Its code: the smallest value over the 12 cyclic rotations.
    pub code: u16,
    /// Its centre in the world, millimetres.
    pub xyz_mm: [f64; 3],
    /// Standard uncertainty of each coordinate.
    pub u_mm: f64,
    /// Radius of the centre disc; the code ring is from two to three times that.
    pub radius_mm: f64,
}

/// The reference artefact: it defines the world frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Artefact {
    /// Its targets.
    pub targets: Vec<ArtefactTarget>,
    /// Relative standard uncertainty of its scale as a whole.
    pub scale_relative_u: f64,
}

/// Coded targets of unknown place, any code that is not the artefact's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TieTargets {
    /// Radius of the centre disc.
    pub radius_mm: f64,
}

/// Roughly how the module is turned, to choose among quarter turns.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModulePrior {
    /// Omega, phi, kappa in degrees.
    pub rotation_omega_phi_kappa_deg: [f64; 3],
    /// How far it may be from that.
    pub within_deg: f64,
}

/// Everything that solving a capture needs beside its pictures and readings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Setup {
    /// The cameras by name.
    pub cameras: BTreeMap<String, CalibratedCamera>,
    /// The fan of beams.
    pub pattern: Pattern,
    /// The artefact.
    pub artefact: Artefact,
    /// Tie targets, if there are any.
    pub tie_targets: Option<TieTargets>,
    /// Prior orientation of the module, if known.
    pub module_prior: Option<ModulePrior>,
    /// Standard uncertainty of the wavelength reading, nanometres.
    pub wavelength_u_nm: f64,
    /// How the wavelength follows the diode's temperature, where that was measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wavelength_by_temperature: Option<WavelengthByTemperature>,
}

/// The line of a diode's wavelength over its temperature, as a wavelength drift finds it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WavelengthByTemperature {
    /// The thermometer on the diode, by its name in the rig.
    pub thermometer: String,
    /// A temperature on the line, degrees Celsius.
    pub at_degc: f64,
    /// The wavelength there, in vacuum, nanometres.
    pub wavelength_nm: f64,
    /// Its standard uncertainty, nanometres.
    pub wavelength_u_nm: f64,
    /// The coefficient, nanometres per degree.
    pub per_degree_nm: f64,
    /// Its standard uncertainty, nanometres per degree.
    pub per_degree_u_nm: f64,
    /// Standard uncertainty of a reading of the thermometer, degrees.
    pub temperature_u_degc: f64,
}
