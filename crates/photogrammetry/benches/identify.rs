//! Beams named in three pictures of 121 dots: all seen on a flat wall, and four tenths hidden beside
//! twenty strays on both walls of a corner. `cargo bench -p beampose-photogrammetry --bench identify`

#![expect(clippy::expect_used, reason = "a benchmark that cannot be set up stops")]

use beampose_photogrammetry::identify::{View, label_views};
use beampose_photogrammetry::pose::Station;
use beampose_photogrammetry::{Order, Pattern, PatternModel, PatternUncertainty};
use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};
use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn main() {
    divan::main();
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
        u: PatternUncertainty { angle_deg: 0.0013, common_relative: 1e-4 },
        zero_order_relative_intensity: Some(3.0),
    }
}

fn look_at(centre: [f64; 3], target: [f64; 3]) -> Station {
    let centre = Vector3::from(centre);
    let z = (Vector3::from(target) - centre).normalize();
    let x = z.cross(&Vector3::y()).normalize();
    let frame = Matrix3::from_columns(&[x, z.cross(&x), z]);
    Station { centre, rotation: Rotation3::from_matrix_unchecked(frame) }
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
