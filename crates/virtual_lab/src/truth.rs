//! What is really so: errors drawn once per world, and the truth at a moment. For scoring alone;
//! no instrument and no solver may see it.

use std::collections::BTreeMap;

use beampose_photogrammetry::{Camera, Order, Pattern, PatternModel};
use nalgebra::{Vector2, Vector3};
use rand::RngExt;
use serde::{Deserialize, Serialize};

use crate::config::{ErrorDraw, TargetRole, WorldConfig};
use crate::geometry::{View, scaled};
use crate::streams::{Purpose, Streams, normal};

/// Everything about a world that was drawn, or that follows from what was drawn.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrueParameters {
    /// The cameras by name.
    pub cameras: BTreeMap<String, TrueCamera>,
    /// Targets, in the order of the configuration.
    pub targets: Vec<TargetTruth>,
    /// Artefact's true scale minus one.
    pub artefact_scale_error: f64,
    /// Each beam's true direction at the reference wavelength, the common error aside.
    pub pattern: Pattern,
    /// Relative error common to all beams.
    pub pattern_common_error: f64,
    /// What the wavelength meter reads too much, nm.
    pub wavemeter_bias_nm: f64,
    /// How the rotation stage stands; as declared in sessions from before there was such a thing.
    #[serde(default)]
    pub turntable: TrueTurntable,
    /// Phases of the waves in which the fan wanders about two axes, radians.
    #[serde(default)]
    pub pointing_phases_rad: [[f64; 3]; 2],
    /// Phases of the rail's straightness (two) and turning (two) at encoder 0, radians.
    pub rail_phases_rad: [f64; 4],
}

/// A rotation stage as it really is, beyond what is declared.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrueTurntable {
    /// Where the module stands off its declared place, world, mm.
    pub offset_mm: [f64; 3],
    /// How far the axis leans about two directions across it, degrees.
    pub tilt_deg: [f64; 2],
    /// Phase of the encoder's graduation error at 0, radians.
    pub graduation_phase_rad: f64,
}

/// A camera as it really is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrueCamera {
    /// True interior orientation, at the pictures' size.
    pub interior: Camera,
    /// Projection centre in the world, mm.
    pub position_mm: [f64; 3],
    /// (w, x, y, z) of `world_from_camera`.
    pub quaternion_wxyz: [f64; 4],
}

/// A target where it really is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TargetTruth {
    /// Its code, canonical.
    pub code: u16,
    /// Its centre in the world, mm.
    pub xyz_mm: [f64; 3],
}

/// The truth at a moment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Truth {
    /// The module's position in the world, mm.
    pub position_mm: [f64; 3],
    /// (w, x, y, z) of `world_from_module`.
    pub quaternion_wxyz: [f64; 4],
    /// Where the rail's encoder would read without noise, mm.
    pub rail_mm: Option<f64>,
    /// Where the rotation stage stands, degrees.
    pub rotation_deg: Option<f64>,
    /// True wavelength in vacuum, nm.
    pub wavelength_nm: f64,
    /// Diode temperature, degrees Celsius.
    pub diode_degc: f64,
    /// Room temperature, degrees Celsius.
    pub room_degc: f64,
    /// True while light comes out.
    pub emitting: bool,
    /// The beams, row by row; those of the present wavelength, whether or not light comes out.
    pub dots: Vec<DotTruth>,
}

/// A beam and its dot.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DotTruth {
    /// The beam.
    pub order: Order,
    /// Its unit direction in the module frame.
    pub direction: [f64; 3],
    /// Where its axis meets a wall, world, mm; `None` where it meets none.
    pub xyz_mm: Option<[f64; 3]>,
}

/// Draws everything of a world. Each item has a stream of its own: a target added at the end, or
/// another number of beams, changes no camera's error.
pub(crate) fn draw(config: &WorldConfig, streams: &Streams) -> TrueParameters {
    let size = match config.errors {
        ErrorDraw::Drawn => 1.0,
        ErrorDraw::Nominal => 0.0,
    };
    let one = |purpose, sigma: f64| size * sigma * normal(&mut streams.item(purpose, 0));
    let artefact_scale_error = one(Purpose::Artefact, config.artefact_scale_relative_u);
    TrueParameters {
        cameras: cameras(config, streams, size),
        targets: targets(config, streams, size, artefact_scale_error),
        artefact_scale_error,
        pattern: pattern(&config.pattern, streams, size),
        pattern_common_error: one(Purpose::Common, config.pattern.u.common_relative),
        wavemeter_bias_nm: one(Purpose::Wavemeter, config.wavemeter.bias_u_nm),
        turntable: turntable(config, streams, size),
        pointing_phases_rad: pointing_phases(streams),
        rail_phases_rad: rail_phases(streams, size),
    }
}

fn pointing_phases(streams: &Streams) -> [[f64; 3]; 2] {
    let mut rng = streams.item(Purpose::Pointing, 0);
    std::array::from_fn(|_| std::array::from_fn(|_| rng.random_range(0.0..std::f64::consts::TAU)))
}

fn turntable(config: &WorldConfig, streams: &Streams, size: f64) -> TrueTurntable {
    let Some(rotation) = &config.rotation else { return TrueTurntable::default() };
    let mut rng = streams.item(Purpose::Turntable, 0);
    TrueTurntable {
        offset_mm: rotation.misalignment_u_mm.map(|u| size * u * normal(&mut rng)),
        tilt_deg: std::array::from_fn(|_| size * rotation.tilt_u_deg * normal(&mut rng)),
        graduation_phase_rad: size * rng.random_range(0.0..std::f64::consts::TAU),
    }
}

fn cameras(config: &WorldConfig, streams: &Streams, size: f64) -> BTreeMap<String, TrueCamera> {
    let one = |(i, (name, camera)): (usize, (&String, &crate::config::CameraConfig))| {
        let mut rng = streams.item(Purpose::Interior, i as u64);
        let mut error = |sigma: f64| size * sigma * normal(&mut rng);
        let sigma = camera.calibration.sigma;
        let mut interior = camera.calibration.model;
        let focal = error(sigma.focal_px);
        interior.fx += focal;
        interior.fy += focal;
        interior.cx += error(sigma.principal_point_px[0]);
        interior.cy += error(sigma.principal_point_px[1]);
        let view = View::new(scaled(&interior, config.picture_scale), camera);
        let camera = TrueCamera {
            interior: view.camera,
            position_mm: camera.position_mm,
            quaternion_wxyz: beampose_photogrammetry::rotation::wxyz(&view.world_from_camera),
        };
        (name.clone(), camera)
    };
    config.cameras.iter().enumerate().map(one).collect()
}

fn targets(
    config: &WorldConfig,
    streams: &Streams,
    size: f64,
    scale_error: f64,
) -> Vec<TargetTruth> {
    let place = |(i, target): (usize, &crate::config::TargetConfig)| {
        let xyz_mm = match target.role {
            TargetRole::Tie => target.xyz_mm,
            TargetRole::Artefact { u_mm } => {
                let mut rng = streams.item(Purpose::Target, i as u64);
                target.xyz_mm.map(|x| x * (1.0 + scale_error) + size * u_mm * normal(&mut rng))
            }
        };
        TargetTruth { code: beampose_photogrammetry::scene::canonical_code(target.code), xyz_mm }
    };
    config.targets.iter().enumerate().map(place).collect()
}

/// The pattern as it really is, as a table. Errors are angles across each beam, so that oblique
/// beams err as much as straight ones.
fn pattern(nominal: &Pattern, streams: &Streams, size: f64) -> Pattern {
    let sigma = size * nominal.u.angle_deg.to_radians();
    let true_tangent = |(i, order): (usize, Order)| {
        let t = nominal.tangent(order).unwrap_or_else(Vector2::zeros);
        let direction = Vector3::new(t.x, t.y, 1.0).normalize();
        let across_x = Vector3::y().cross(&direction).normalize();
        let across_y = direction.cross(&across_x);
        let mut rng = streams.item(Purpose::Beam, i as u64);
        let (ex, ey) = (sigma * normal(&mut rng), sigma * normal(&mut rng));
        let turned = direction + across_x * ex.tan() + across_y * ey.tan();
        [turned.x / turned.z, turned.y / turned.z]
    };
    let tangents = nominal.orders().enumerate().map(true_tangent).collect();
    Pattern { model: PatternModel::Table { tangents }, ..nominal.clone() }
}

fn rail_phases(streams: &Streams, size: f64) -> [f64; 4] {
    let mut rng = streams.item(Purpose::Rail, 0);
    std::array::from_fn(|_| size * rng.random_range(0.0..std::f64::consts::TAU))
}
