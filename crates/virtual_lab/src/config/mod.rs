//! What the world is told: the rig as declared, with its uncertainties.
//!
//! Plain values, units in the names; `app` maps the rig file to them. To add something that the
//! world simulates: a struct here, its check in [`crate::World::new`], its draw in `truth`.

mod check;
mod laboratory;

use std::collections::BTreeMap;

use beampose_photogrammetry::{CalibratedCamera, Pattern};
use serde::{Deserialize, Serialize};

/// The whole simulated laboratory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WorldConfig {
    /// Whether true values differ from the declared ones.
    pub errors: ErrorDraw,
    /// Linear scale of all pictures, above 0 and up to 1; 1 gives the cameras' full size. The
    /// calibration shrinks with it: [`crate::World::calibrations`] is what a solver must be told.
    pub picture_scale: f64,
    /// The module at rail 0 and rotation 0.
    pub module: ModuleConfig,
    /// The rail that carries the module, if there is one.
    pub rail: Option<RailConfig>,
    /// The rotation stage between rail and module, if there is one.
    pub rotation: Option<RotationConfig>,
    /// The pattern as calibrated, with its uncertainty.
    pub pattern: Pattern,
    /// The beams' width and brightness.
    pub beam: BeamConfig,
    /// The laser diode.
    pub diode: DiodeConfig,
    /// The room.
    pub room: RoomConfig,
    /// The wavelength meter.
    pub wavemeter: WavemeterConfig,
    /// The thermometer.
    pub thermometer: ThermometerConfig,
    /// The thermometer on the diode.
    pub diode_thermometer: ThermometerConfig,
    /// The walls.
    pub walls: Vec<WallConfig>,
    /// The mirrors in the way of the beams, in any order.
    pub mirrors: Vec<MirrorConfig>,
    /// Coded targets: those of the artefact and tie targets.
    pub targets: Vec<TargetConfig>,
    /// Relative standard uncertainty of the artefact's scale as a whole.
    pub artefact_scale_relative_u: f64,
    /// The cameras by name.
    pub cameras: BTreeMap<String, CameraConfig>,
    /// What all pictures have in common.
    pub picture: PictureConfig,
}

/// Whether a world is as declared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ErrorDraw {
    /// True values are drawn once per world from the declared uncertainties.
    Drawn,
    /// Everything is exactly as declared. Noise of pictures and readings remains.
    Nominal,
}

/// Where the module is while its stages stand at zero.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModuleConfig {
    /// The grating's position in the world, mm.
    pub position_mm: [f64; 3],
    /// Omega, phi, kappa (eq. 2.4), degrees; 0, 0, 0 looks along -Z.
    pub rotation_omega_phi_kappa_deg: [f64; 3],
}

/// How a stage moves and what its encoder says, in the stage's own unit (mm or degrees).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StageConfig {
    /// Lowest and highest target that it accepts.
    pub limits: [f64; 2],
    /// Where it stands when the world begins.
    pub start: f64,
    /// Speed, units a second.
    pub speed_per_s: f64,
    /// Time to settle after a move, seconds.
    pub settle_s: f64,
    /// Standard deviation of where it stops about its target.
    pub positioning_sigma: f64,
    /// Step of the encoder's reading; 0 for none.
    pub resolution: f64,
    /// Standard deviation of the encoder's reading, before rounding to its step.
    pub noise: f64,
    /// Play between drive and table: turned back, the table stands still for so long.
    pub lost_motion: f64,
    /// Amplitude of the encoder's graduation error, a slow wave over its travel.
    pub graduation: f64,
}

/// A rail: its truth differs from its encoder by scale and straightness.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RailConfig {
    /// Motion and encoder, mm.
    pub stage: StageConfig,
    /// Direction of positive motion in the world; any length but zero.
    pub direction: [f64; 3],
    /// True travel over encoder travel, minus one.
    pub scale_error_relative: f64,
    /// Amplitudes of the sinusoidal straightness error along two axes across the rail, mm.
    pub straightness_mm: [f64; 2],
    /// Amplitudes of the sinusoidal turning (pitch, yaw) about those two axes, arc seconds.
    pub tilt_arcsec: [f64; 2],
    /// Period of these errors along the rail, mm.
    pub period_mm: f64,
}

/// A rotation stage that the module stands on and the rail carries.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RotationConfig {
    /// Motion and encoder, degrees.
    pub stage: StageConfig,
    /// A point on its axis in the world, with the rail at 0, mm.
    pub axis_point_mm: [f64; 3],
    /// Direction of its axis in the world (right-hand rule); any length but zero.
    pub axis_direction: [f64; 3],
    /// Standard uncertainty of where the module stands off that axis, beyond what is configured:
    /// along the world's X, Y and Z, mm.
    pub misalignment_u_mm: [f64; 3],
    /// Standard uncertainty of how far the axis leans, about each of two directions across it,
    /// degrees.
    pub tilt_u_deg: f64,
}

/// The laser beams behind the grating.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BeamConfig {
    /// Diameter at 1/e^2 of the axial irradiance at the module, mm.
    pub diameter_mm: f64,
    /// Full divergence at 1/e^2, milliradians.
    pub divergence_mrad: f64,
    /// How the whole fan wanders, if it does.
    pub pointing: Option<PointingConfig>,
    /// Grey levels above the background in the middle of an ordinary beam's dot that falls
    /// perpendicularly on a wall at `peak_distance_mm`.
    pub peak_grey: f64,
    /// See `peak_grey`, mm.
    pub peak_distance_mm: f64,
}

/// Pointing stability: the fan as a whole wanders slowly, as laser diodes in mounts do.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointingConfig {
    /// Standard deviation about each of the two axes across the beam, degrees.
    pub wander_deg: f64,
    /// Its usual period, seconds.
    pub period_s: f64,
}

/// The laser diode: its wavelength follows its temperature, that of the room plus self-heating.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DiodeConfig {
    /// Wavelength in vacuum at `reference_degc`, nm.
    pub wavelength_nm: f64,
    /// Diode temperature at which it has `wavelength_nm`, degrees Celsius.
    pub reference_degc: f64,
    /// Wavelength over temperature, nm a degree.
    pub tuning_nm_per_degc: f64,
    /// How much warmer than the room it gets in the end, degrees.
    pub self_heating_degc: f64,
    /// Time constant of warming up and cooling down, seconds.
    pub time_constant_s: f64,
    /// From the command to light, seconds.
    pub emission_delay_s: f64,
    /// Where it hops from mode to mode.
    pub mode_hops: Vec<ModeHop>,
}

/// A mode hop: beyond it the wavelength is another one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModeHop {
    /// Where it is.
    pub at: HopAt,
    /// By how much longer the wavelength is beyond it, nm.
    pub by_nm: f64,
}

/// Where a mode hop is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HopAt {
    /// From this time of the world on, seconds.
    TimeS(f64),
    /// While the diode is at least so warm, degrees Celsius.
    DiodeDegc(f64),
}

/// The room.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RoomConfig {
    /// Temperature when the world begins, degrees Celsius.
    pub temperature_degc: f64,
    /// Its drift, degrees an hour.
    pub drift_degc_per_hour: f64,
}

/// The wavelength meter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WavemeterConfig {
    /// Standard deviation of a reading, nm.
    pub noise_nm: f64,
    /// Standard uncertainty of the bias common to all readings, nm.
    pub bias_u_nm: f64,
}

/// A thermometer.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ThermometerConfig {
    /// Standard deviation of a reading, degrees.
    pub noise_degc: f64,
}

/// A plane wall; each beam meets the nearest one in front of it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WallConfig {
    /// A point on it, its middle where it is finite, mm.
    pub point_mm: [f64; 3],
    /// Its normal; any length but zero, either side.
    pub normal: [f64; 3],
    /// Half its width and height, mm; infinite where absent. Height runs along the world's Y as
    /// far as the wall allows, width across it.
    pub half_size_mm: Option<[f64; 2]>,
}

/// A flat mirror without loss: it folds the way of the beams that meet its front.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MirrorConfig {
    /// Its middle, mm.
    pub point_mm: [f64; 3],
    /// Its normal, out of the front; any length but zero. The back is black.
    pub normal: [f64; 3],
    /// Half its width and height, mm, as of a wall.
    pub half_size_mm: [f64; 2],
}

/// A ring-coded target on a label.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TargetConfig {
    /// Its 12-bit code, in any rotation.
    pub code: u16,
    /// Its centre as declared, world, mm.
    pub xyz_mm: [f64; 3],
    /// Direction it faces; any length but zero.
    pub normal: [f64; 3],
    /// How far it is turned on its wall, counter-clockwise as seen from the front, degrees.
    pub turn_deg: f64,
    /// Radius of the centre disc, mm.
    pub radius_mm: f64,
    /// Which of disc and label is dark.
    pub polarity: Polarity,
    /// Artefact or tie.
    pub role: TargetRole,
}

/// Which part of a target is dark.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Polarity {
    /// Black disc and ring on a white label.
    DarkOnLight,
    /// White disc and ring on a black label.
    LightOnDark,
}

/// What is known of a target's place.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum TargetRole {
    /// It belongs to the artefact: declared with this standard uncertainty of each coordinate
    /// (mm), and shares the artefact's scale.
    Artefact {
        /// Standard uncertainty of each coordinate, mm.
        u_mm: f64,
    },
    /// Nobody is told where it is; it stands exactly where configured.
    Tie,
}

/// A camera: calibration as declared, true pose, timing.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraConfig {
    /// Interior orientation with its uncertainties, at full size.
    pub calibration: CalibratedCamera,
    /// Projection centre in the world, mm.
    pub position_mm: [f64; 3],
    /// A point on its optical axis, world, mm. Without roll the world's Y points up in the picture.
    pub look_at_mm: [f64; 3],
    /// Turn of the camera about its viewing direction, clockwise as seen by the camera, degrees.
    pub roll_deg: f64,
    /// From the trigger to the beginning of the exposure, seconds.
    pub trigger_delay_s: f64,
    /// Exposure, seconds.
    pub exposure_s: f64,
    /// From the end of the exposure until the picture is here, seconds.
    pub readout_s: f64,
}

/// What all pictures have in common.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PictureConfig {
    /// The bare wall in the middle of the picture, grey levels.
    pub background_grey: f64,
    /// Relative change of the illumination from the middle to the right and to the lower edge.
    pub gradient_relative: [f64; 2],
    /// Relative loss of light from the middle to the corners.
    pub vignetting_relative: f64,
    /// White of the labels, grey levels.
    pub white_grey: f64,
    /// Black of the labels, grey levels.
    pub black_grey: f64,
    /// Standard deviation of the lens' point spread, pixels (beside the pixel's own area).
    pub psf_sigma_px: f64,
    /// Speckle of the laser dots.
    pub speckle: SpeckleConfig,
    /// Photon noise: variance in squared grey levels per grey level of signal.
    pub photon_noise_grey: f64,
    /// Read noise, standard deviation in grey levels.
    pub read_noise_grey: f64,
    /// JPEG quality, 1 to 100.
    pub jpeg_quality: u8,
}

/// Speckle: a gamma-distributed factor of mean one on the dots' light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpeckleConfig {
    /// Standard deviation over mean; 0 switches speckle off, 1 is fully developed.
    pub contrast: f64,
    /// Side of a grain, pixels: the square root of the correlation area. Up to 1, pixels are
    /// independent.
    pub grain_px: f64,
}
