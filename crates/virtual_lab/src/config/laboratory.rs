//! The laboratory of the dissertation as a ready-made configuration: for examples, benches and
//! whoever needs pictures before there is a rig file.

use std::collections::BTreeMap;

use beampose_photogrammetry::scene::{RING_BITS, canonical_code};
use beampose_photogrammetry::{
    CalibratedCamera, Camera, InteriorSigma, Pattern, PatternModel, PatternUncertainty,
};

use super::{
    BeamConfig, CameraConfig, DiodeConfig, ErrorDraw, ModuleConfig, PictureConfig, Polarity,
    RailConfig, RoomConfig, SpeckleConfig, StageConfig, TargetConfig, TargetRole,
    ThermometerConfig, WallConfig, WavemeterConfig, WorldConfig,
};

impl WorldConfig {
    /// The calibrated 11x11 pattern on one wall (Z = 0), three cameras of 3456 x 2592 about 1.9 m
    /// away, 24 coded targets around the field, a rail that takes the module from 0.9 m to 1.8 m.
    #[must_use]
    pub fn laboratory() -> Self {
        Self {
            errors: ErrorDraw::Drawn,
            picture_scale: 1.0,
            module: ModuleConfig {
                position_mm: [0.0, 0.0, 900.0],
                rotation_omega_phi_kappa_deg: [0.0, 0.0, 0.0],
            },
            rail: Some(rail()),
            rotation: None,
            pattern: pattern(),
            beam: BeamConfig {
                diameter_mm: 4.0,
                divergence_mrad: 1.5,
                pointing: None,
                peak_grey: 150.0,
                peak_distance_mm: 900.0,
            },
            diode: DiodeConfig::default(),
            room: RoomConfig::default(),
            wavemeter: WavemeterConfig { noise_nm: 0.01, bias_u_nm: 0.1 },
            thermometer: ThermometerConfig { noise_degc: 0.05 },
            diode_thermometer: ThermometerConfig { noise_degc: 0.02 },
            walls: vec![WallConfig {
                point_mm: [0.0, 0.0, 0.0],
                normal: [0.0, 0.0, 1.0],
                half_size_mm: None,
            }],
            mirrors: Vec::new(),
            targets: targets(),
            artefact_scale_relative_u: 4e-4,
            cameras: cameras(),
            picture: PictureConfig::default(),
        }
    }
}

impl Default for DiodeConfig {
    /// 0.3 nm a degree; with [`RoomConfig::default`] 0.4 nm in the first 100 minutes of emission.
    fn default() -> Self {
        // 0.4 nm are 4/3 degree; the room gives 1/3 in 100 minutes, self-heating must give one
        // degree by then: 1 / (1 - exp(-100 / 25)).
        let self_heating_degc = 1.0 / (1.0 - (-4.0_f64).exp());
        Self {
            wavelength_nm: 658.0,
            reference_degc: 22.0,
            tuning_nm_per_degc: 0.3,
            self_heating_degc,
            time_constant_s: 25.0 * 60.0,
            emission_delay_s: 0.5,
            mode_hops: Vec::new(),
        }
    }
}

impl Default for RoomConfig {
    /// 22 degrees, 0.2 degrees warmer every hour.
    fn default() -> Self {
        Self { temperature_degc: 22.0, drift_degc_per_hour: 0.2 }
    }
}

impl Default for PictureConfig {
    /// A dim room, exposed for the dots.
    fn default() -> Self {
        Self {
            background_grey: 45.0,
            gradient_relative: [0.15, -0.1],
            vignetting_relative: 0.25,
            white_grey: 130.0,
            black_grey: 16.0,
            psf_sigma_px: 0.6,
            speckle: SpeckleConfig { contrast: 0.35, grain_px: 1.0 },
            photon_noise_grey: 0.02,
            read_noise_grey: 1.5,
            jpeg_quality: 95,
        }
    }
}

fn rail() -> RailConfig {
    RailConfig {
        stage: StageConfig {
            limits: [0.0, 900.0],
            start: 0.0,
            speed_per_s: 50.0,
            settle_s: 0.5,
            positioning_sigma: 0.002,
            resolution: 0.001,
            noise: 0.001,
            lost_motion: 0.0,
            graduation: 0.0,
        },
        direction: [0.0, 0.0, 1.0],
        scale_error_relative: 1e-5,
        straightness_mm: [0.005, 0.003],
        tilt_arcsec: [8.0, 5.0],
        period_mm: 700.0,
    }
}

fn pattern() -> Pattern {
    Pattern {
        columns: 11,
        rows: 11,
        reference_wavelength_nm: 658.0,
        model: PatternModel::RadialGrid {
            pitch_mm: 52.22,
            k1_per_mm2: 3.5e-8,
            distance_mm: 1000.0,
        },
        u: PatternUncertainty { angle_deg: 0.0013, common_relative: 3e-4 },
        zero_order_relative_intensity: Some(3.0),
    }
}

fn cameras() -> BTreeMap<String, CameraConfig> {
    let places = [
        ("cam_a", [-800.0, 150.0, 1700.0], 0.010),
        ("cam_b", [0.0, 650.0, 1800.0], 0.022),
        ("cam_c", [800.0, 150.0, 1700.0], 0.035),
    ];
    places
        .into_iter()
        .map(|(name, position_mm, trigger_delay_s)| {
            let camera = CameraConfig {
                calibration: calibration(),
                position_mm,
                look_at_mm: [0.0, 0.0, 0.0],
                roll_deg: 0.0,
                trigger_delay_s,
                exposure_s: 0.1,
                readout_s: 0.4,
            };
            (name.to_owned(), camera)
        })
        .collect()
}

/// A lens of 6 mm on pixels of 1.7 um; uncertainties as calibrated ten times with power kept on:
/// 1.6 um in the focal length, 1.5 um in the principal point.
fn calibration() -> CalibratedCamera {
    CalibratedCamera {
        model: Camera {
            width: 3456,
            height: 2592,
            fx: 6000.0 / 1.7,
            fy: 6000.0 / 1.7,
            cx: 1731.0,
            cy: 1291.0,
            k1: -0.11,
            k2: 0.05,
            p1: 2e-4,
            p2: -1e-4,
            k3: 0.0,
        },
        sigma: InteriorSigma { focal_px: 1.6 / 1.7, principal_point_px: [1.5 / 1.7, 1.5 / 1.7] },
    }
}

/// Targets in a frame around the largest field that the fan covers (half-size 470 mm), so that no
/// dot falls on a label; two of three belong to the artefact, the rest are tie targets.
fn targets() -> Vec<TargetConfig> {
    frame(540.0, 6)
        .into_iter()
        .zip(distinct_codes())
        .enumerate()
        .map(|(i, ([x, y], code))| TargetConfig {
            code,
            xyz_mm: [x, y, 0.0],
            normal: [0.0, 0.0, 1.0],
            turn_deg: 37.0 * i as f64,
            radius_mm: 6.0,
            polarity: Polarity::DarkOnLight,
            role: if i % 3 != 2 { TargetRole::Artefact { u_mm: 0.02 } } else { TargetRole::Tie },
        })
        .collect()
}

/// `4 * sides` points on a square frame of half-size `half`, in turn on its four sides.
fn frame(half: f64, sides: usize) -> Vec<[f64; 2]> {
    let step = 2.0 * half / sides as f64;
    let along = |i: usize| -half + step * i as f64;
    (0..sides)
        .flat_map(|i| {
            let a = along(i);
            [[a, -half], [half, a], [-a, half], [-half, -a]]
        })
        .collect()
}

/// Canonical codes with four to eight bits set, spread over the whole set.
fn distinct_codes() -> impl Iterator<Item = u16> {
    (0..1u16 << RING_BITS)
        .filter(|&code| canonical_code(code) == code && (4..=8).contains(&code.count_ones()))
        .step_by(7)
}
