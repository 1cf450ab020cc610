use beampose_core::Emission;
use beampose_photogrammetry::decode;
use rayon::prelude::*;

use super::{clean, small, world};
use crate::{World, WorldConfig, WorldError};

const CAMERAS: [&str; 3] = ["cam_a", "cam_b", "cam_c"];

/// Two captures of all cameras, as files, rendered by `threads` threads.
fn files(world: &World, threads: usize, backwards: bool) -> Vec<Vec<u8>> {
    let mut jobs: Vec<(u64, &str)> =
        (0..2).flat_map(|capture| CAMERAS.map(|camera| (capture, camera))).collect();
    if backwards {
        jobs.reverse();
    }
    let file = |&(capture, camera): &(u64, &str)| {
        let module = world.module_state(100.0 * capture as f64, 0.0, 658.1, Emission::On);
        world.render_jpeg(camera, &module, capture).unwrap()
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let mut files: Vec<_> = pool.install(|| jobs.par_iter().map(file).collect());
    if backwards {
        files.reverse();
    }
    files
}

#[test]
fn the_same_seed_gives_the_same_bytes_for_any_number_of_threads_and_any_order() {
    let mut config = small();
    config.picture.speckle.grain_px = 2.0;
    let one = files(&world(config.clone(), 7), 1, false);
    assert!(one == files(&world(config.clone(), 7), 2, false));
    assert!(one == files(&world(config, 7), 2, true));
}

#[test]
fn another_seed_another_capture_and_another_camera_give_other_pictures() {
    let (one, other) = (world(small(), 1), world(small(), 2));
    let module = one.module_state(0.0, 0.0, 658.0, Emission::On);
    let picture = one.render("cam_a", &module, 0).unwrap();
    assert_ne!(picture, other.render("cam_a", &module, 0).unwrap());
    assert_ne!(picture, one.render("cam_a", &module, 1).unwrap());
    assert_ne!(picture, one.render("cam_b", &module, 0).unwrap());
    assert_eq!(picture, one.render("cam_a", &module, 0).unwrap());
}

#[test]
fn a_picture_without_light_has_no_dots() {
    let world = world(clean(small()), 1);
    let on = world.module_state(0.0, 0.0, 658.0, Emission::On);
    let off = world.module_state(0.0, 0.0, 658.0, Emission::Off);
    let lit = world.render("cam_b", &on, 0).unwrap();
    let dark = world.render("cam_b", &off, 0).unwrap();
    let dots = world.imaged_dots("cam_b", &on).unwrap();
    assert_eq!(dots.len(), 121);
    for dot in dots {
        let at = (dot.pixel.y.round() as usize) * dark.width + dot.pixel.x.round() as usize;
        // A pixel centre is at most half a diagonal from the dot's centre.
        let least = dot.amplitude_grey * (-0.25 / dot.sigma_px[1].powi(2)).exp() - 1.0;
        assert!(f64::from(lit.data[at] - dark.data[at]) >= least.min(120.0), "{dot:?}");
    }
    let paper = world.config().picture.white_grey as u8;
    assert!(dark.data.iter().all(|&grey| grey <= paper));
}

#[test]
fn near_dots_are_bright_and_far_dots_fainter() {
    let world = world(WorldConfig::laboratory(), 1);
    let median = |rail_mm: f64| {
        let module = world.module_state(rail_mm, 0.0, 658.0, Emission::On);
        let mut grey: Vec<f64> =
            world.imaged_dots("cam_b", &module).unwrap().iter().map(|d| d.amplitude_grey).collect();
        grey.sort_by(f64::total_cmp);
        (grey[grey.len() / 2], grey[grey.len() - 1])
    };
    let ((near, zero_order), (far, _)) = (median(0.0), median(900.0));
    assert!((110.0..160.0).contains(&near) && (2.5..3.5).contains(&(zero_order / near)), "{near}");
    assert!((60.0..0.95 * near).contains(&far), "{far}");
}

#[test]
fn a_file_decodes_to_the_picture() {
    let world = world(small(), 1);
    let module = world.module_state(0.0, 0.0, 658.0, Emission::On);
    let picture = world.render("cam_c", &module, 3).unwrap();
    let decoded = decode(&world.render_jpeg("cam_c", &module, 3).unwrap()).unwrap();
    assert_eq!((decoded.width, decoded.height), (picture.width, picture.height));
    let square = |(a, b): (&u8, &u8)| (f64::from(*a) - f64::from(*b)).powi(2);
    let sum: f64 = decoded.data.iter().zip(&picture.data).map(square).sum();
    // Quality 95 quantises coefficients by 2 to 10: a good grey level.
    assert!((sum / picture.data.len() as f64).sqrt() < 2.0);
}

#[test]
fn an_unknown_camera_is_refused() {
    let world = world(small(), 1);
    let module = world.module_state(0.0, 0.0, 658.0, Emission::On);
    let error = world.render("cam_x", &module, 0).unwrap_err();
    assert_eq!(error, WorldError::UnknownCamera("cam_x".to_owned()));
}
