//! Beams named in three pictures of 121 dots: all seen on a flat wall, and four tenths hidden beside
//! twenty strays on both walls of a corner. `cargo bench -p beampose-photogrammetry --bench identify`

#![expect(clippy::expect_used, reason = "a benchmark that cannot be set up stops")]

#[path = "../tests/solving/scene.rs"]
#[expect(dead_code, clippy::unwrap_used, reason = "the tests use more of it, and may panic")]
mod scene;

use beampose_photogrammetry::identify::{View, label_views};
use beampose_photogrammetry::{Order, Pattern};
use nalgebra::{Vector2, Vector3};
use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use scene::{look_at, pattern};

fn main() {
    divan::main();
}

/// The dots on the wall z = 0 and, left of `edge`, on one at right angles to it.
fn dots(pattern: &Pattern, edge: f64) -> Vec<(Order, Vector3<f64>)> {
    let module = look_at([-250.0, 250.0, 1200.0], [-450.0, 200.0, 0.0]);
    let dot = |d: Vector3<f64>| {
        let along = module.rotation * d;
        let flat = module.centre - along * (module.centre.z / along.z);
        if flat.x >= edge {
            return flat;
        }
        module.centre + along * ((edge - module.centre.x) / along.x)
    };
    pattern.beams(0.0).iter().map(|b| (b.order, dot(b.direction))).collect()
}

fn views(edge: f64, hidden: f64, strays: usize) -> Vec<View> {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut dots = dots(&pattern(), edge);
    dots.retain(|_| rng.random_range(0.0..1.0) >= hidden);
    [[-350.0, 800.0, 2000.0], [900.0, 600.0, 1900.0], [100.0, -650.0, 2100.0]]
        .iter()
        .map(|centre| {
            let station = look_at(*centre, [-450.0, 200.0, 0.0]);
            let see = |place: &Vector3<f64>| {
                let p = station.station_point(place);
                Vector2::new(p.x / p.z, p.y / p.z)
            };
            let mut directions: Vec<Vector2<f64>> = dots.iter().map(|d| see(&d.1)).collect();
            let bright =
                |order: &Order| if *order == (Order { m: 0, n: 0 }) { 300.0 } else { 110.0 };
            let mut amplitudes: Vec<f64> = dots.iter().map(|d| bright(&d.0)).collect();
            for _ in 0..strays {
                let mut along = || rng.random_range(-0.15..0.15);
                directions.push(Vector2::new(along(), along()));
                amplitudes.push(110.0);
            }
            View { station, directions, amplitudes }
        })
        .collect()
}

#[divan::bench]
fn whole_pattern_on_a_flat_wall(bencher: divan::Bencher) {
    let (views, pattern) = (views(f64::MIN, 0.0, 0), pattern());
    bencher.bench(|| label_views(&views, &pattern).expect("the pictures agree"));
}

#[divan::bench]
fn damaged_pattern_in_a_corner(bencher: divan::Bencher) {
    let (views, pattern) = (views(-550.0, 0.4, 20), pattern());
    bencher.bench(|| label_views(&views, &pattern).expect("the pictures agree"));
}
