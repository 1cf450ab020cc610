use std::collections::BTreeMap;

use beampose_core::Emission;
use beampose_photogrammetry::scene::canonical_code;
use beampose_photogrammetry::{Camera, GrayImage};
use nalgebra::{Vector2, Vector3};

use super::{clean, world};
use crate::config::{Polarity, TargetConfig, TargetRole};
use crate::{World, WorldConfig};

const CODE: u16 = 0b1011_0010_0000;

/// One target at the origin, turned and tilted, seen by one small camera with much distortion.
fn one_target(polarity: Polarity, turn_deg: f64, tilt: [f64; 3]) -> World {
    let mut config = clean(WorldConfig::laboratory());
    let mut camera = config.cameras["cam_b"];
    camera.position_mm = [120.0, 60.0, 900.0];
    camera.look_at_mm = [20.0, -15.0, 0.0];
    camera.calibration.model = Camera {
        width: 320,
        height: 280,
        fx: 1800.0,
        fy: 1800.0,
        cx: 162.0,
        cy: 138.0,
        k1: -0.1,
        k2: 0.0,
        p1: 0.0,
        p2: 0.0,
        k3: 0.0,
    };
    config.cameras = BTreeMap::from([("eye".to_owned(), camera)]);
    config.targets = vec![TargetConfig {
        code: CODE,
        xyz_mm: [0.0; 3],
        normal: tilt,
        turn_deg,
        radius_mm: 6.0,
        polarity,
        role: TargetRole::Tie,
    }];
    world(config, 1)
}

fn picture(world: &World) -> GrayImage {
    let module = world.module_state(0.0, 0.0, 658.0, Emission::Off);
    world.render("eye", &module, 0).unwrap()
}

/// The image of a point of the label, for a target that faces along Z.
fn image(world: &World, right: f64, up: f64, tilt: [f64; 3]) -> Vector2<f64> {
    let truth = &world.true_parameters().cameras["eye"];
    let q = beampose_photogrammetry::rotation::from_wxyz(truth.quaternion_wxyz);
    let out = Vector3::from(tilt).normalize();
    let across_up = (Vector3::y() - out * out.y).normalize();
    let point = across_up.cross(&out) * right + across_up * up;
    let point = q.inverse() * (point - Vector3::from(truth.position_mm));
    truth.interior.project(&point).unwrap()
}

/// The area's centroid of the image of the circle of radius `r`, by its polygon.
fn circle_image_centre(world: &World, r: f64, tilt: [f64; 3]) -> Vector2<f64> {
    let n = 3600;
    let corner = |i: usize| {
        let (sin, cos) = (std::f64::consts::TAU * i as f64 / n as f64).sin_cos();
        image(world, r * cos, r * sin, tilt)
    };
    let origin = image(world, 0.0, 0.0, tilt);
    let (mut area, mut sum) = (0.0, Vector2::zeros());
    for i in 0..n {
        let (a, b) = (corner(i) - origin, corner(i + 1) - origin);
        let part = a.perp(&b) / 2.0;
        area += part;
        sum += (a + b) / 3.0 * part;
    }
    origin + sum / area
}

/// The centroid of the ink within `reach` pixels: more than the disc and less than the ring.
fn ink_centre(picture: &GrayImage, near: Vector2<f64>, reach: f64, paper: f64) -> Vector2<f64> {
    let (mut sum, mut first) = (0.0, Vector2::zeros());
    for (i, &grey) in picture.data.iter().enumerate() {
        let at = Vector2::new((i % picture.width) as f64, (i / picture.width) as f64);
        if (at - near).norm() < reach {
            let ink = f64::from(grey) - paper;
            sum += ink;
            first += (at - near) * ink;
        }
    }
    near + first / sum
}

#[test]
fn a_target_is_where_its_circle_is_projected() {
    let config = clean(WorldConfig::laboratory()).picture;
    for (polarity, paper) in
        [(Polarity::DarkOnLight, config.white_grey), (Polarity::LightOnDark, config.black_grey)]
    {
        for tilt in [[0.0, 0.0, 1.0], [0.5, 0.3, 1.0], [-0.6, 0.1, 1.0]] {
            let world = one_target(polarity, 17.0, tilt);
            let expected = circle_image_centre(&world, 6.0, tilt);
            let found = ink_centre(&picture(&world), expected, 15.5, paper);
            // Rounding to grey levels: 0.002 px. The eccentricity is in `expected`.
            assert!((found - expected).norm() < 0.003, "{} px for {tilt:?}", found - expected);
            let centre = world.imaged_targets("eye").unwrap()[0].pixel;
            let eccentricity = (expected - centre).norm();
            assert!(eccentricity < 0.06, "{eccentricity}");
        }
    }
}

#[test]
fn a_code_reads_clockwise_from_the_front_in_any_turn_and_polarity() {
    for (polarity, dark_ink) in [(Polarity::DarkOnLight, true), (Polarity::LightOnDark, false)] {
        for turn_deg in [0.0_f64, 75.0, 200.0] {
            let world = one_target(polarity, turn_deg, [0.0, 0.0, 1.0]);
            let picture = picture(&world);
            let bit = |sector: usize| {
                // Counter-clockwise turn of the target, clockwise sectors, from its top.
                let angle = (30.0 * sector as f64 + 15.0 - turn_deg).to_radians();
                let at = image(&world, 15.0 * angle.sin(), 15.0 * angle.cos(), [0.0, 0.0, 1.0]);
                let grey = picture.row(at.y.round() as usize)[at.x.round() as usize];
                (grey < 70) == dark_ink
            };
            let read = (0..12).fold(0, |code, sector| code << 1 | u16::from(bit(sector)));
            assert_eq!(read, CODE, "turned by {turn_deg}");
            // In the picture, too, sectors follow each other clockwise: x right, y down.
            let mirrored = (0..12).rev().fold(0, |code, sector| code << 1 | u16::from(bit(sector)));
            assert_ne!(canonical_code(mirrored), canonical_code(CODE));
        }
    }
}

#[test]
fn a_target_seen_from_behind_is_not_there() {
    let world = one_target(Polarity::DarkOnLight, 0.0, [0.0, 0.0, -1.0]);
    assert!(world.imaged_targets("eye").unwrap().is_empty());
    let bare = world.config().picture.background_grey as u8;
    assert!(picture(&world).data.iter().all(|&grey| grey == bare));
}
