use super::{clean, small, world};
use crate::config::{MirrorConfig, TargetRole};
use crate::{TrueParameters, WorldConfig, WorldError};

const SEEDS: u64 = 400;

fn drawn(seed: u64) -> TrueParameters {
    world(small(), seed).true_parameters().clone()
}

/// The root mean square of `error` over all seeds must be `declared`.
#[track_caller]
fn check(
    name: &str,
    worlds: &[TrueParameters],
    declared: f64,
    error: impl Fn(&TrueParameters) -> Vec<f64>,
) {
    let errors: Vec<f64> = worlds.iter().flat_map(error).collect();
    let n = errors.len() as f64;
    let rms = (errors.iter().map(|e| e * e).sum::<f64>() / n).sqrt();
    // A standard deviation of n draws has a relative standard error of 1 / sqrt(2 n).
    assert!(
        (rms / declared - 1.0).abs() < 4.0 / (2.0 * n).sqrt() + 1e-3,
        "{name}: {rms}, not {declared}"
    );
    let mean = errors.iter().sum::<f64>() / n;
    assert!(mean.abs() < 4.0 * declared / n.sqrt(), "{name}: mean {mean}");
}

#[test]
fn drawn_errors_have_the_declared_sizes() {
    let config = small();
    let worlds: Vec<_> = (0..SEEDS).map(drawn).collect();
    let told = world(small(), 0).calibrations();
    let sigma = told["cam_b"].sigma;
    let camera = |of: fn(&beampose_photogrammetry::Camera) -> f64| {
        let told = told["cam_b"].model;
        move |t: &TrueParameters| vec![of(&t.cameras["cam_b"].interior) - of(&told)]
    };
    check("focal", &worlds, sigma.focal_px, camera(|c| c.fx));
    check("cx", &worlds, sigma.principal_point_px[0], camera(|c| c.cx));
    check("cy", &worlds, sigma.principal_point_px[1], camera(|c| c.cy));
    assert!(
        worlds.iter().all(|t| t.cameras["cam_b"].interior.fx == t.cameras["cam_b"].interior.fy)
    );
    check("artefact scale", &worlds, config.artefact_scale_relative_u, |t| {
        vec![t.artefact_scale_error]
    });
    check("fan", &worlds, config.pattern.u.common_relative, |t| vec![t.pattern_common_error]);
    check("wavemeter", &worlds, config.wavemeter.bias_u_nm, |t| vec![t.wavemeter_bias_nm]);
}

#[test]
fn every_beam_errs_by_the_declared_angle_per_axis() {
    let pattern = small().pattern;
    let worlds: Vec<_> = (0..20).map(drawn).collect();
    let sigma = pattern.u.angle_deg.to_radians();
    for order in [0, 5, 60, 120] {
        let order = pattern.orders().nth(order).unwrap();
        let nominal = pattern.direction(order, 0.0).unwrap();
        let angles: Vec<f64> = (0..SEEDS)
            .map(|seed| drawn(seed).pattern.direction(order, 0.0).unwrap().angle(&nominal))
            .collect();
        // Two axes: the squared angle over sigma^2 has mean 2 and variance 4.
        let mean = angles.iter().map(|a| a * a).sum::<f64>() / SEEDS as f64 / (sigma * sigma);
        assert!((mean - 2.0).abs() < 4.0 * 2.0 / (SEEDS as f64).sqrt(), "{order:?}: {mean}");
    }
    check("tangents near the middle", &worlds, sigma, |t| {
        let at = |i| t.pattern.tangent(pattern.orders().nth(i).unwrap()).unwrap();
        let nominal = |i| pattern.tangent(pattern.orders().nth(i).unwrap()).unwrap();
        [60, 59, 61].map(|i| (at(i) - nominal(i)).x).to_vec()
    });
}

#[test]
fn artefact_targets_share_a_scale_and_err_each_by_itself_and_tie_targets_do_not() {
    let config = small();
    let worlds: Vec<_> = (0..40).map(drawn).collect();
    let errors = |artefact: bool| {
        let config = &config;
        move |t: &TrueParameters| -> Vec<f64> {
            let chosen =
                |role: &TargetRole| matches!(role, TargetRole::Artefact { .. }) == artefact;
            let pairs = config.targets.iter().zip(&t.targets).filter(|(c, _)| chosen(&c.role));
            let scale = if artefact { 1.0 + t.artefact_scale_error } else { 1.0 };
            pairs.flat_map(|(c, t)| [0, 1, 2].map(|i| t.xyz_mm[i] - c.xyz_mm[i] * scale)).collect()
        }
    };
    check("targets", &worlds, 0.02, errors(true));
    assert!(worlds.iter().flat_map(errors(false)).all(|e| e == 0.0));
}

#[test]
fn a_nominal_world_is_as_declared() {
    let config = clean(small());
    let world = world(config.clone(), 5);
    let truth = world.true_parameters();
    for (name, told) in world.calibrations() {
        assert_eq!(truth.cameras[&name].interior, told.model);
    }
    assert!(config.targets.iter().zip(&truth.targets).all(|(c, t)| c.xyz_mm == t.xyz_mm));
    for order in config.pattern.orders() {
        let error = truth.pattern.tangent(order).unwrap() - config.pattern.tangent(order).unwrap();
        assert!(error.norm() < 1e-15);
    }
    assert_eq!(
        [truth.artefact_scale_error, truth.pattern_common_error, truth.wavemeter_bias_nm],
        [0.0; 3]
    );
}

#[test]
fn a_number_that_makes_no_sense_is_named() {
    #[track_caller]
    fn refused(change: impl FnOnce(&mut WorldConfig), what: &str) {
        let mut config = small();
        change(&mut config);
        match crate::World::new(config, 1) {
            Err(WorldError::Value { what: named, .. }) => assert_eq!(named, what),
            other => panic!("{other:?}"),
        }
    }
    refused(|c| c.picture_scale = 0.0, "picture_scale");
    refused(|c| c.targets[3].code = 4096, "targets[3].code");
    refused(|c| c.walls[0].normal = [0.0; 3], "walls[0].normal");
    let mirror = |normal, half_size_mm| MirrorConfig { point_mm: [0.0; 3], normal, half_size_mm };
    refused(|c| c.mirrors.push(mirror([0.0; 3], [9.0; 2])), "mirrors[0].normal");
    refused(|c| c.mirrors.push(mirror([1.0; 3], [9.0, 0.0])), "mirrors[0].half_size_mm");
    refused(|c| c.picture.jpeg_quality = 0, "picture.jpeg_quality");
    refused(|c| c.beam.diameter_mm = f64::NAN, "beam.diameter_mm");
}

#[test]
fn the_laboratory_has_its_targets_in_all_pictures_and_all_codes_differ() {
    let world = world(small(), 1);
    let mut codes: Vec<u16> = world.true_parameters().targets.iter().map(|t| t.code).collect();
    codes.sort_unstable();
    codes.dedup();
    assert_eq!(codes.len(), 24);
    for camera in ["cam_a", "cam_b", "cam_c"] {
        assert!(world.imaged_targets(camera).unwrap().len() >= 20, "{camera}");
    }
}
