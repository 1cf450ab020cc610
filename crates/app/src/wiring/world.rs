//! From a rig's simulation to what the virtual lab is told.

use std::collections::BTreeMap;

use beampose_core::Quantity;
use beampose_photogrammetry::Setup;
use beampose_plan::rig::{self, Simulation};
use beampose_plan::{At, Instrument, Rig};
use beampose_virtual_lab::config::{
    BeamConfig, CameraConfig, DiodeConfig, HopAt, MirrorConfig, ModeHop, ModuleConfig,
    PictureConfig, PointingConfig, Polarity, RailConfig, RoomConfig, RotationConfig, SpeckleConfig,
    StageConfig, TargetConfig, TargetRole, ThermometerConfig, WallConfig, WavemeterConfig,
};
use beampose_virtual_lab::{ErrorDraw, WorldConfig};

/// The world that the rig declares. Only what is declared goes in: true values are the world's own.
pub fn world_config(
    rig: &Rig,
    simulation: &Simulation,
    setup: &Setup,
) -> Result<WorldConfig, String> {
    let module = &simulation.module;
    Ok(WorldConfig {
        errors: if simulation.draw_errors { ErrorDraw::Drawn } else { ErrorDraw::Nominal },
        picture_scale: simulation.picture.scale,
        module: ModuleConfig {
            position_mm: module.origin.map(|x| x.0),
            rotation_omega_phi_kappa_deg: module.rotation_omega_phi_kappa.map(|a| a.0),
        },
        rail: rail(rig, simulation),
        rotation: rotation(rig, simulation),
        pattern: setup.pattern.clone(),
        beam: beam(simulation),
        diode: diode(rig, simulation),
        room: RoomConfig {
            temperature_degc: simulation.laser.ambient.0,
            drift_degc_per_hour: simulation.laser.room.drift_per_hour.0,
        },
        wavemeter: WavemeterConfig {
            noise_nm: NOISE_PART * setup.wavelength_u_nm,
            bias_u_nm: (1.0 - NOISE_PART * NOISE_PART).sqrt() * setup.wavelength_u_nm,
        },
        thermometer: ThermometerConfig { noise_degc: thermometer_u(rig, |s| s.of.is_none()) },
        diode_thermometer: ThermometerConfig { noise_degc: thermometer_u(rig, |s| s.of.is_some()) },
        walls: simulation
            .walls
            .iter()
            .map(|wall| WallConfig {
                point_mm: wall.value.point.map(|x| x.0),
                normal: wall.value.normal.value,
                half_size_mm: None,
            })
            .collect(),
        mirrors: simulation.mirrors.iter().flatten().map(mirror).collect(),
        targets: targets(simulation, setup),
        artefact_scale_relative_u: setup.artefact.scale_relative_u,
        cameras: cameras(rig, simulation, setup)?,
        picture: picture(simulation),
    })
}

/// Which part of a wavelength meter's declared uncertainty is noise; the rest is a bias that all
/// readings of a session share.
const NOISE_PART: f64 = 0.3;

fn thermometer_u(rig: &Rig, is_it: impl Fn(&rig::instruments::Sensor) -> bool) -> f64 {
    rig.sensors()
        .filter(|(_, s)| s.reads == Quantity::Temperature && is_it(s))
        .find_map(|(_, s)| s.u.as_ref().map(|u| u.value.number()))
        .unwrap_or_default()
}

/// A stage that errs in nothing, in its own unit; it begins at zero where it can.
fn stage(limits: [f64; 2], speed_per_s: f64, settle_s: f64) -> StageConfig {
    let start = limits[0].max(0.0);
    StageConfig {
        limits,
        start,
        speed_per_s,
        settle_s,
        positioning_sigma: 0.0,
        resolution: 0.0,
        noise: 0.0,
        lost_motion: 0.0,
        graduation: 0.0,
    }
}

fn rail(rig: &Rig, simulation: &Simulation) -> Option<RailConfig> {
    let module = &simulation.module;
    let Some(Instrument::LinearAxis(axis)) = rig.instruments.get(&module.axis.as_ref()?.value)
    else {
        return None;
    };
    let (travel, straightness) = (&axis.travel.value, module.straightness.amplitude.0);
    Some(RailConfig {
        stage: StageConfig {
            positioning_sigma: 0.002,
            resolution: 0.001,
            noise: 0.001,
            ..stage([travel.from.0, travel.to.0], axis.speed.0, axis.settle.0)
        },
        direction: module.direction.value,
        scale_error_relative: module.scale_relative,
        straightness_mm: [straightness; 2],
        // A carriage that leaves its line by a few micrometres also nods by a few seconds of arc.
        tilt_arcsec: [10.0 * straightness / 0.01, 10.0 * straightness / 0.01],
        period_mm: module.straightness.period.0,
    })
}

fn rotation(rig: &Rig, simulation: &Simulation) -> Option<RotationConfig> {
    let turntable = simulation.module.turntable.as_ref()?;
    let Some(Instrument::RotaryAxis(axis)) = rig.instruments.get(&turntable.axis.value) else {
        return None;
    };
    let travel = &axis.travel.value;
    Some(RotationConfig {
        stage: StageConfig {
            positioning_sigma: turntable.positioning.map_or(5e-4, |sigma| sigma.0),
            // One second of arc.
            resolution: 1.0 / 3600.0,
            noise: match turntable.graduation {
                Some(_) => 0.0,
                None => axis.u.map_or(0.0, |u| u.0),
            },
            lost_motion: turntable.lost_motion.map_or(0.0, |play| play.0),
            graduation: turntable.graduation.map_or(0.0, |wave| wave.0),
            ..stage([travel.from.0, travel.to.0], axis.speed.0, axis.settle.0)
        },
        axis_point_mm: turntable.about.map(|x| x.0),
        axis_direction: turntable.direction.value,
        misalignment_u_mm: turntable.misalignment_u.map_or([0.0; 3], |u| u.map(|u| u.0)),
        tilt_u_deg: turntable.tilt_u.map_or(0.0, |u| u.0),
    })
}

fn beam(simulation: &Simulation) -> BeamConfig {
    BeamConfig {
        diameter_mm: simulation.laser.beam.diameter.0,
        divergence_mrad: simulation.laser.beam.divergence.radians() * 1e3,
        pointing: simulation.laser.beam.pointing.as_ref().map(|pointing| PointingConfig {
            wander_deg: pointing.wander.0,
            period_s: pointing.period.0,
        }),
        peak_grey: simulation.picture.dot_amplitude * FULL_SCALE,
        peak_distance_mm: 900.0,
    }
}

fn diode(rig: &Rig, simulation: &Simulation) -> DiodeConfig {
    let laser = &simulation.laser;
    let emission_delay_s = rig.lasers().map(|(_, l)| l.emission_delay.0).fold(0.0, f64::max);
    DiodeConfig {
        wavelength_nm: laser.wavelength_at.value.0,
        reference_degc: laser.wavelength_at.temperature.0,
        tuning_nm_per_degc: laser.per_degree.0,
        self_heating_degc: laser.warm_up.rise.0,
        time_constant_s: laser.warm_up.time_constant.0,
        emission_delay_s,
        mode_hops: laser.mode_hops.iter().flatten().map(mode_hop).collect(),
    }
}

fn mode_hop(hop: &rig::simulation::ModeHop) -> ModeHop {
    let at = match hop.at {
        rig::simulation::HopAt::Time(time) => HopAt::TimeS(time.0),
        rig::simulation::HopAt::Temperature(temperature) => HopAt::DiodeDegc(temperature.0),
    };
    ModeHop { at, by_nm: hop.by.0 }
}

fn mirror(mirror: &At<rig::simulation::Mirror>) -> MirrorConfig {
    MirrorConfig {
        point_mm: mirror.value.point.map(|x| x.0),
        normal: mirror.value.normal.value,
        half_size_mm: mirror.value.half_size.map(|x| x.0),
    }
}

/// Grey levels at full scale.
const FULL_SCALE: f64 = 255.0;

fn picture(simulation: &Simulation) -> PictureConfig {
    let p = &simulation.picture;
    let wall = p.background * FULL_SCALE;
    let half = p.target_contrast * FULL_SCALE / 2.0;
    // Labels are printed about the wall's own grey as far as black allows.
    let middle = wall.max(half + 0.02 * FULL_SCALE);
    PictureConfig {
        background_grey: wall,
        gradient_relative: [p.gradient, p.gradient / 2.0],
        vignetting_relative: p.gradient,
        white_grey: middle + half,
        black_grey: middle - half,
        speckle: SpeckleConfig { contrast: p.speckle.contrast, grain_px: p.speckle.grain.0 },
        photon_noise_grey: FULL_SCALE / p.full_well_electrons,
        read_noise_grey: p.read_noise * FULL_SCALE,
        jpeg_quality: u8::try_from(p.jpeg_quality).unwrap_or(100),
        ..PictureConfig::default()
    }
}

fn targets(simulation: &Simulation, setup: &Setup) -> Vec<TargetConfig> {
    let normal = |place: [beampose_core::units::Millimetre; 3]| {
        simulation.nearest_wall(place).map_or([0.0, 0.0, 1.0], |wall| wall.normal.value)
    };
    let placed = |code: u16, xyz_mm: [f64; 3], radius_mm: f64, role: TargetRole| TargetConfig {
        code,
        xyz_mm,
        normal: normal(xyz_mm.map(beampose_core::units::Millimetre)),
        // Nobody sticks targets on a wall all the same way up.
        turn_deg: f64::from(code % 12) * 31.0,
        radius_mm,
        polarity: Polarity::DarkOnLight,
        role,
    };
    let artefact = setup
        .artefact
        .targets
        .iter()
        .map(|t| placed(t.code, t.xyz_mm, t.radius_mm, TargetRole::Artefact { u_mm: t.u_mm }));
    let tie_radius = setup.tie_targets.map_or(6.0, |t| t.radius_mm);
    let ties = simulation.tie_targets.iter().flatten().map(|t| {
        placed(t.value.code.value, t.value.position.map(|x| x.0), tie_radius, TargetRole::Tie)
    });
    artefact.chain(ties).collect()
}

fn cameras(
    rig: &Rig,
    simulation: &Simulation,
    setup: &Setup,
) -> Result<BTreeMap<String, CameraConfig>, String> {
    let mut cameras = BTreeMap::new();
    for (index, (name, camera)) in rig.cameras().enumerate() {
        let name = name.as_str();
        let (Some(placed), Some(calibration)) =
            (simulation.cameras.get(name), setup.cameras.get(name))
        else {
            return Err(format!("{name}: the simulation does not say where this camera stands"));
        };
        let camera = CameraConfig {
            calibration: *calibration,
            position_mm: placed.value.position.map(|x| x.0),
            look_at_mm: placed.value.look_at.value.map(|x| x.0),
            roll_deg: placed.value.roll.0,
            // Cameras of one make do not answer in the same millisecond.
            trigger_delay_s: 0.012 + 0.008 * index as f64,
            exposure_s: camera.exposure.map_or(0.1, |s| s.0),
            readout_s: camera.delivery.map_or(1.0, |s| s.0),
        };
        cameras.insert(name.to_owned(), camera);
    }
    Ok(cameras)
}
