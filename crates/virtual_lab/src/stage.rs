//! The module's true pose from where its stages stand, and what their encoders say.

use nalgebra::{Rotation3, Unit, UnitQuaternion, Vector3};

use beampose_photogrammetry::rotation::from_omega_phi_kappa;

use crate::config::{ModuleConfig, RailConfig, RotationConfig, StageConfig};
use crate::geometry::plane_axes;
use crate::truth::TrueTurntable;

/// Position and attitude of the module in the world.
pub(crate) type ModulePose = (Vector3<f64>, UnitQuaternion<f64>);

/// Phases of a rail's errors, radians: straightness on two axes, tilt about two.
pub(crate) type RailPhases = [f64; 4];

/// Where the module is, with the rail's encoder at `rail_mm` and the stage's at `rotation_deg`.
///
/// The fixture rolls the module about its viewing axis, `roll_deg` counter-clockwise as the module
/// sees it; the rotation stage turns both about its axis; the rail carries both, and its small
/// turning acts about the module's place at zero.
pub(crate) fn module_pose(
    module: &ModuleConfig,
    roll_deg: f64,
    rotation: Option<(&RotationConfig, &TrueTurntable, f64)>,
    rail: Option<(&RailConfig, &RailPhases, f64)>,
) -> ModulePose {
    let home = Vector3::from(module.position_mm);
    let mut position = home;
    let mut attitude =
        from_omega_phi_kappa(module.rotation_omega_phi_kappa_deg.map(f64::to_radians));
    if roll_deg != 0.0 {
        // Module frame: x right, y down. Counter-clockwise brings y to x.
        attitude *= UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -roll_deg.to_radians());
    }
    if let Some((config, truth, angle_deg)) = rotation {
        position += Vector3::from(truth.offset_mm);
        let axes = plane_axes(&Vector3::from(config.axis_direction));
        let [about_right, about_up] = truth.tilt_deg.map(f64::to_radians);
        let lean = Vector3::new(about_up.tan(), -about_right.tan(), 1.0);
        let axis = Unit::new_normalize(axes * lean);
        let turn = UnitQuaternion::from_axis_angle(&axis, angle_deg.to_radians());
        let on_axis = Vector3::from(config.axis_point_mm);
        position = on_axis + turn * (position - on_axis);
        attitude = turn * attitude;
    }
    if let Some((config, phases, encoder_mm)) = rail {
        let (shift, tilt) = carriage(config, phases, encoder_mm);
        position = home + shift + tilt * (position - home);
        attitude = tilt * attitude;
    }
    (position, attitude)
}

/// The rail's true shift and turning.
fn carriage(
    rail: &RailConfig,
    phases: &RailPhases,
    encoder_mm: f64,
) -> (Vector3<f64>, UnitQuaternion<f64>) {
    let axes = plane_axes(&Vector3::from(rail.direction));
    let wave = |amplitude: f64, phase: f64| {
        amplitude * (std::f64::consts::TAU * encoder_mm / rail.period_mm + phase).sin()
    };
    let arcsec = (1.0_f64 / 3600.0).to_radians();
    let along = encoder_mm * (1.0 + rail.scale_error_relative);
    let [across, up] = rail.straightness_mm;
    let shift = axes * Vector3::new(wave(across, phases[0]), wave(up, phases[1]), along);
    let [pitch, yaw] = rail.tilt_arcsec;
    let small = axes * Vector3::new(wave(pitch, phases[2]), wave(yaw, phases[3]), 0.0) * arcsec;
    let tilt = UnitQuaternion::from_rotation_matrix(&Rotation3::from_scaled_axis(small));
    (shift, tilt)
}

/// Period of a graduation error, in the axis' unit: a few waves over a usual travel.
const GRADUATION_PERIOD: f64 = 7.3;

/// What an encoder reads at `position`, with `noise` drawn from N(0, 1) and the phase of its
/// graduation error.
pub(crate) fn encoder_reading(stage: &StageConfig, position: f64, phase: f64, noise: f64) -> f64 {
    let wave = (std::f64::consts::TAU * position / GRADUATION_PERIOD + phase).sin();
    let value = position + stage.graduation * wave + stage.noise * noise;
    if stage.resolution > 0.0 {
        // Divided by the whole number of steps a unit, so that 0.203 does not read 0.20300000000000001.
        (value / stage.resolution).round() / (1.0 / stage.resolution)
    } else {
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::WorldConfig;

    #[test]
    fn the_rail_is_not_quite_straight_and_not_quite_to_scale() {
        let config = WorldConfig::laboratory();
        let rail = config.rail.unwrap();
        let at = |mm| module_pose(&config.module, 0.0, None, Some((&rail, &[0.0; 4], mm)));
        let (start, end) = (at(0.0), at(700.0));
        assert!((end.0.z - start.0.z - 700.0 * (1.0 + 1e-5)).abs() < 1e-9);
        let quarter = at(175.0);
        let off = (quarter.0 - start.0).xy();
        assert!((off.norm() - f64::hypot(0.005, 0.003)).abs() < 1e-9, "{off}");
        let turned_arcsec = quarter.1.angle_to(&start.1).to_degrees() * 3600.0;
        assert!((turned_arcsec - f64::hypot(8.0, 5.0)).abs() < 1e-3, "{turned_arcsec}");
    }

    #[test]
    fn the_stage_turns_the_module_about_its_axis() {
        let module = ModuleConfig {
            position_mm: [100.0, 0.0, 900.0],
            rotation_omega_phi_kappa_deg: [0.0; 3],
        };
        let rotation = RotationConfig {
            stage: WorldConfig::laboratory().rail.unwrap().stage,
            axis_point_mm: [0.0, 0.0, 900.0],
            axis_direction: [0.0, 2.0, 0.0],
            misalignment_u_mm: [0.0; 3],
            tilt_u_deg: 0.0,
        };
        let truth = TrueTurntable::default();
        let (position, attitude) = module_pose(&module, 0.0, Some((&rotation, &truth, 90.0)), None);
        assert!((position - Vector3::new(0.0, 0.0, 800.0)).norm() < 1e-9);
        assert!((attitude * Vector3::z() + Vector3::x()).norm() < 1e-12);
    }

    #[test]
    fn rolled_by_a_quarter_turn_the_lower_beams_are_on_the_right() {
        let module = ModuleConfig { position_mm: [0.0; 3], rotation_omega_phi_kappa_deg: [0.0; 3] };
        let attitude = |roll| module_pose(&module, roll, None, None).1;
        // The module frame's own right in the world, and where its down is once rolled.
        let right = attitude(0.0) * Vector3::x();
        assert!((attitude(90.0) * Vector3::y() - right).norm() < 1e-12);
    }

    #[test]
    fn a_leaning_axis_lifts_the_module_and_the_offset_goes_round() {
        let module = ModuleConfig { position_mm: [0.0; 3], rotation_omega_phi_kappa_deg: [0.0; 3] };
        let rotation = RotationConfig {
            stage: WorldConfig::laboratory().rail.unwrap().stage,
            axis_point_mm: [0.0; 3],
            axis_direction: [0.0, 1.0, 0.0],
            misalignment_u_mm: [1.0; 3],
            tilt_u_deg: 1.0,
        };
        let offset = TrueTurntable { offset_mm: [1.0, 0.0, 0.0], ..TrueTurntable::default() };
        let (position, _) = module_pose(&module, 0.0, Some((&rotation, &offset, 90.0)), None);
        assert!((position - Vector3::new(0.0, 0.0, -1.0)).norm() < 1e-12, "{position}");
        let leaning = TrueTurntable { tilt_deg: [1.0, 0.0], ..TrueTurntable::default() };
        let (_, attitude) = module_pose(&module, 0.0, Some((&rotation, &leaning, 180.0)), None);
        let (_, plain) =
            module_pose(&module, 0.0, Some((&rotation, &TrueTurntable::default(), 180.0)), None);
        let lean = attitude.angle_to(&plain).to_degrees();
        assert!((lean - 2.0).abs() < 1e-9, "{lean}");
    }
}
