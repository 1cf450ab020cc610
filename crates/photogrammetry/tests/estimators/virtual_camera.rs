//! The module as a camera inside the adjustment attains the bound that three cameras leave.
//!
//! The cameras stand firm (their targets are seen and known almost without error), so the dots'
//! covariances follow from the pixel noise alone and the bound from these.

use beampose_photogrammetry::Camera;
use beampose_photogrammetry::adjust::{
    BeamObservation, CameraStation, Control, ImageObservation, InteriorOrientation, ModuleStation,
    Options, Problem, adjust,
};
use beampose_photogrammetry::pose::Station;
use nalgebra::{Matrix2, Matrix3, Rotation3, Vector2, Vector3};

use crate::bound::{Bound, Paired, Scene, generator, normal};

/// Of a dot's image point, pixels: about 0.1 mm on the wall.
const PIXEL_SIGMA: f64 = 0.15;
/// Of what is taken as known: targets (mm and pixels), beams (rad); a ten-thousandth of the dots'.
const FIRM: f64 = 1e-5;

const CAMERA: Camera = Camera {
    width: 6000,
    height: 6000,
    fx: 3500.0,
    fy: 3500.0,
    cx: 3000.0,
    cy: 3000.0,
    k1: 0.0,
    k2: 0.0,
    p1: 0.0,
    p2: 0.0,
    k3: 0.0,
};

fn look_at(centre: Vector3<f64>, target: Vector3<f64>) -> Station {
    let z = (target - centre).normalize();
    let x = Vector3::y().cross(&z).normalize();
    let frame = Matrix3::from_columns(&[x, z.cross(&x), z]);
    Station { centre, rotation: Rotation3::from_matrix_unchecked(frame) }
}

fn stations() -> Vec<Station> {
    [[-1200.0, -300.0, 0.0], [1200.0, -300.0, 100.0], [0.0, 1100.0, -100.0]]
        .map(|centre| look_at(Vector3::from(centre), Vector3::new(0.0, 0.0, 2000.0)))
        .into()
}

/// What the cameras see: a pixel's derivative by the place of a dot in the world.
fn by_place(station: &Station, place: &Vector3<f64>) -> nalgebra::Matrix2x3<f64> {
    let projection = CAMERA.project_with_derivatives(&station.station_point(place)).unwrap();
    projection.by_point * station.rotation.inverse().matrix()
}

/// The covariance of a dot that all cameras see.
fn covariance(stations: &[Station], dot: &Vector3<f64>) -> Matrix3<f64> {
    let part = |s: &Station| by_place(s, dot).transpose() * by_place(s, dot);
    let information: Matrix3<f64> = stations.iter().map(part).sum();
    information.try_inverse().unwrap() * PIXEL_SIGMA.powi(2)
}

/// The adjustment as it stands: everything that knows its interface is here.
fn module_centre(
    scene: &Scene,
    stations: &[Station],
    pixels: &[Vec<Vector2<f64>>],
) -> Vector3<f64> {
    let mut problem =
        Problem { interiors: vec![InteriorOrientation::fixed(CAMERA)], ..Problem::default() };
    for station in stations {
        problem.cameras.push(CameraStation { station: *station, interior: 0, is_held: false });
    }
    let start = Station { centre: Vector3::new(3.0, -2.0, 5.0), rotation: Rotation3::identity() };
    problem.modules.push(ModuleStation { station: start, scale: 0.0, scale_prior: (0.0, 0.0) });
    let see = |problem: &mut Problem, point, camera, at, sigma: f64| {
        let information = Matrix2::identity() / (sigma * sigma);
        problem.images.push(ImageObservation { camera, point, at, information });
    };
    for i in 0..12 {
        let at = Vector3::new(
            f64::from(i % 4) * 300.0 - 450.0,
            f64::from(i / 4) * 400.0 - 400.0,
            1900.0 + f64::from(i % 3) * 100.0,
        );
        problem.points.push(at);
        problem.controls.push(Control { point: i as usize, at, sigma: FIRM });
        for (camera, station) in stations.iter().enumerate() {
            let pixel = CAMERA.project(&station.station_point(&at)).unwrap();
            see(&mut problem, i as usize, camera, pixel, FIRM);
        }
    }
    for (i, dot) in scene.dots.iter().enumerate() {
        let point = problem.points.len();
        problem.points.push(*dot);
        let cosines = scene.directions[i].xy();
        let sigma = FIRM * 0.1;
        problem.beams.push(BeamObservation { module: 0, point, cosines, sigma, shared: None });
        for (camera, pixels) in pixels.iter().enumerate() {
            see(&mut problem, point, camera, pixels[i], PIXEL_SIGMA);
        }
    }
    let options = Options { outlier_sigmas: f64::INFINITY, ..Options::default() };
    adjust(&mut problem, &options).unwrap();
    problem.modules[0].station.centre
}

#[track_caller]
fn attains_the_bound(size: u32, tilt_deg: f64, draws: u64) {
    let (scene, stations) = (Scene::new(size, 35.0, tilt_deg), stations());
    let covariances: Vec<Matrix3<f64>> =
        scene.dots.iter().map(|dot| covariance(&stations, dot)).collect();
    let bound = Bound::of(&scene.dots, &covariances);
    let paired = Paired::draw(draws, &bound, |k| {
        let mut rng = generator(u64::from(size), k);
        let mut drawn = Vec::new();
        let mut noise = vec![Vector3::zeros(); scene.dots.len()];
        for station in &stations {
            let mut pixels = Vec::new();
            for (i, dot) in scene.dots.iter().enumerate() {
                let off = Vector2::from_fn(|_, _| PIXEL_SIGMA * normal(&mut rng));
                pixels.push(CAMERA.project(&station.station_point(dot)).unwrap() + off);
                // The dot that the cameras together see at these pixels, to first order.
                let weight = covariances[i] / PIXEL_SIGMA.powi(2);
                noise[i] += weight * by_place(station, dot).transpose() * off;
            }
            drawn.push(pixels);
        }
        (module_centre(&scene, &stations, &drawn), bound.best(&noise))
    });
    let (ratio, bias) = (paired.ratio(), paired.bias());
    println!(
        "virtual camera, N = {size}, tilt {tilt_deg}: {ratio:.5} of the bound, bias {:.5}",
        bias.amax()
    );
    assert!((ratio - 1.0).abs() < 0.03, "N = {size}, tilt {tilt_deg}: {ratio} of the bound");
    assert!(bias.amax() < 0.1, "N = {size}, tilt {tilt_deg}: bias {bias} sigma");
}

#[test]
fn the_virtual_camera_attains_the_bound_on_a_plane_wall() {
    attains_the_bound(11, 0.0, 100);
    attains_the_bound(21, 0.0, 40);
    attains_the_bound(41, 0.0, 12);
    attains_the_bound(81, 0.0, 6);
}

#[test]
fn the_virtual_camera_attains_the_bound_on_a_tilted_wall() {
    attains_the_bound(11, 45.0, 100);
    attains_the_bound(21, 45.0, 40);
    attains_the_bound(41, 45.0, 12);
    attains_the_bound(81, 45.0, 6);
}
