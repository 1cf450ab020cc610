use beampose_core::Emission;
use beampose_photogrammetry::{Camera, GrayImage, Order};
use nalgebra::{Matrix2, Vector2, Vector3};

use super::{clean, world};
use crate::config::{MirrorConfig, WallConfig};
use crate::{ImagedDot, ModuleState, World, WorldConfig};

/// Centre and covariance of what `lit` has more than `dark` within four sigma of a dot.
fn moments(lit: &GrayImage, dark: &GrayImage, dot: &ImagedDot) -> (Vector2<f64>, Matrix2<f64>) {
    let reach = (4.5 * dot.sigma_px[0]).ceil() as usize;
    let [x, y] = [dot.pixel.x.round() as usize, dot.pixel.y.round() as usize];
    let (mut sum, mut first, mut second) = (0.0, Vector2::zeros(), Matrix2::zeros());
    for v in y - reach..=y + reach {
        for u in x - reach..=x + reach {
            let at = v * lit.width + u;
            let light = f64::from(lit.data[at]) - f64::from(dark.data[at]);
            let off = Vector2::new(u as f64, v as f64) - dot.pixel;
            sum += light;
            first += off * light;
            second += off * off.transpose() * light;
        }
    }
    let mean = first / sum;
    (mean, second / sum - mean * mean.transpose())
}

/// Errors of all dots' centres in a camera, pixels, and the dots.
fn centre_errors(
    world: &World,
    camera: &str,
    module: &ModuleState,
) -> Vec<(Vector2<f64>, ImagedDot)> {
    let dark = ModuleState { emission: Emission::Off, ..*module };
    let lit = world.render(camera, module, 0).unwrap();
    let dark = world.render(camera, &dark, 0).unwrap();
    let dots = world.imaged_dots(camera, module).unwrap();
    dots.into_iter().map(|dot| (moments(&lit, &dark, &dot).0, dot)).collect()
}

fn laboratory() -> WorldConfig {
    let mut config = clean(WorldConfig::laboratory());
    config.picture_scale = 0.5;
    config.beam.peak_grey = 180.0;
    config.pattern.zero_order_relative_intensity = None;
    config.targets.clear();
    config
}

fn rms(errors: &[(Vector2<f64>, ImagedDot)]) -> f64 {
    (errors.iter().map(|(e, _)| e.norm_squared()).sum::<f64>() / errors.len() as f64).sqrt()
}

fn mean(errors: &[(Vector2<f64>, ImagedDot)]) -> Vector2<f64> {
    errors.iter().map(|(e, _)| e).sum::<Vector2<f64>>() / errors.len() as f64
}

#[test]
fn a_dot_is_where_its_beam_meets_the_wall() {
    let mut config = laboratory();
    config.module.rotation_omega_phi_kappa_deg = [8.0, -12.0, 5.0];
    let world = world(config, 1);
    let module = world.module_state(200.0, 0.0, 658.3, Emission::On);
    for camera in ["cam_a", "cam_b", "cam_c"] {
        let errors = centre_errors(&world, camera, &module);
        assert!(errors.len() > 100);
        // Rounding to grey levels moves a centre by 0.005 px rms; the perspective of the footprint
        // by less than 0.002 px (it is what `mean` sees, since it has one sign).
        assert!(errors.iter().all(|(e, _)| e.norm() < 0.02), "{camera}: {errors:?}");
        assert!(mean(&errors).norm() < 0.002 && rms(&errors) < 0.008, "{}", rms(&errors));
    }
}

#[test]
fn a_dot_has_the_shape_that_is_said() {
    let world = world(laboratory(), 1);
    let module = world.module_state(0.0, 0.0, 658.0, Emission::On);
    let dark = ModuleState { emission: Emission::Off, ..module };
    let lit = world.render("cam_a", &module, 0).unwrap();
    let dark = world.render("cam_a", &dark, 0).unwrap();
    for dot in world.imaged_dots("cam_a", &module).unwrap() {
        let mut sigma = moments(&lit, &dark, &dot).1.symmetric_eigenvalues().map(f64::sqrt);
        sigma.as_mut_slice().sort_by(|a, b| b.total_cmp(a));
        for (found, said) in sigma.iter().zip(dot.sigma_px) {
            // Light below half a grey level is rounded away.
            assert!((found / said - 1.0).abs() < 0.03, "{found} px, not {said}");
        }
    }
}

#[test]
fn footprints_lie_on_the_wall_that_their_beam_meets() {
    let mut config = laboratory();
    // A box's front, 150 mm before the wall, catches the beams to the left of x = -40.
    config.walls.push(WallConfig {
        point_mm: [-540.0, 0.0, 150.0],
        normal: [0.0, 0.0, 1.0],
        half_size_mm: Some([500.0, 2000.0]),
    });
    let world = world(config, 1);
    let module = world.module_state(300.0, 0.0, 658.0, Emission::On);
    let depth = |m| {
        let dots = world.dots(&module);
        dots.iter().find(|d| d.order == Order { m, n: 1 }).unwrap().xyz_mm.unwrap()[2]
    };
    assert_eq!([depth(-3), depth(3)].map(f64::round), [150.0, 0.0]);
    let errors = centre_errors(&world, "cam_b", &module);
    assert!(errors.len() > 100 && errors.iter().all(|(e, _)| e.norm() < 0.02), "{errors:?}");
}

/// Two parallel mirrors only shift what is seen in them: the module before the first one is, unfolded,
/// the module 900 mm from the wall. A beam that meets both gives the same dot: place, shape and light.
#[test]
fn a_folded_path_gives_the_dots_of_the_unfolded_one() {
    let straight = world(laboratory(), 1);
    let mut config = laboratory();
    config.module.position_mm = [-300.0, 0.0, 600.0];
    let mirror = |x: f64, normal: [f64; 3], half_size_mm| MirrorConfig {
        point_mm: [x, 0.0, 500.0],
        normal,
        half_size_mm,
    };
    config.mirrors = vec![
        mirror(-300.0, [1.0, 0.0, 1.0], [60.0, 40.0]),
        mirror(0.0, [-1.0, 0.0, -1.0], [220.0, 80.0]),
    ];
    let folded = world(config, 1);
    let [there, here] = [&straight, &folded].map(|w| w.module_state(0.0, 0.0, 658.0, Emission::On));
    let mut compared = 0;
    for camera in ["cam_a", "cam_b", "cam_c"] {
        let expected = straight.imaged_dots(camera, &there).unwrap();
        for dot in folded.imaged_dots(camera, &here).unwrap() {
            let same = expected.iter().find(|e| e.order == dot.order).unwrap();
            compared += 1;
            assert!((dot.pixel - same.pixel).norm() < 1e-6, "{dot:?} {same:?}");
            let sizes = [0, 1].map(|i| dot.sigma_px[i] - same.sigma_px[i]);
            assert!(sizes.iter().all(|s| s.abs() < 1e-6), "{dot:?} {same:?}");
            assert!((dot.amplitude_grey - same.amplitude_grey).abs() < 1e-6, "{dot:?} {same:?}");
        }
    }
    // The second mirror stands before a part of the wall.
    assert!(compared > 100, "{compared}");
    // The outermost rows pass it above and below; of them the columns of one side meet no wall then.
    let lost = folded.dots(&here).into_iter().filter(|dot| dot.xyz_mm.is_none());
    let rows: Vec<i32> = lost.map(|dot| dot.order.n.abs()).collect();
    assert!(rows.len() >= 10 && rows.iter().all(|n| *n == 5), "{rows:?}");
}

#[test]
fn speckle_moves_a_dot_by_what_its_statistics_say() {
    let mut config = laboratory();
    config.picture.speckle.contrast = 0.35;
    let world = world(config, 1);
    let module = world.module_state(200.0, 0.0, 658.0, Emission::On);
    let errors = centre_errors(&world, "cam_b", &module);
    // The centroid of sum f(1 + C n) x over sum f: variance C^2 sum f^2 x^2 / (sum f)^2, for a
    // Gaussian C^2 / (8 pi) an axis, whatever its width.
    let expected = 0.35 / (8.0 * std::f64::consts::PI).sqrt() * std::f64::consts::SQRT_2;
    let found = rms(&errors);
    // Two coordinates of 121 dots: a relative standard error of 4.5 %; clipping at white is rare.
    assert!((found / expected - 1.0).abs() < 0.15, "{found} px, not {expected}");
}

#[test]
fn a_picture_of_half_the_size_shows_the_same_world() {
    let (full, half) = (WorldConfig::laboratory(), laboratory());
    let full = world(clean(full), 1);
    let half = world(half, 1);
    let place = |world: &World, name: &str| {
        let camera: Camera = world.calibrations()[name].model;
        let point = Vector3::new(0.1, -0.2, 1.0);
        (camera.project(&point).unwrap(), (camera.width, camera.height))
    };
    let ((at_full, size_full), (at_half, size_half)) =
        (place(&full, "cam_a"), place(&half, "cam_a"));
    assert_eq!((size_full.0 / 2, size_full.1 / 2), size_half);
    assert!((at_full.add_scalar(0.5) / 2.0 - at_half.add_scalar(0.5)).norm() < 1e-9);
}
