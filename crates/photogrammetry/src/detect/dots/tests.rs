use nalgebra::Vector2;

use super::*;
use crate::detect::find_targets;
use crate::detect::testing::{Canvas, Normal, Print, Spot};
use crate::detect::{TargetOptions, drop_dots_on_targets};

/// Spots on a jittered grid of `count` x `count`, turned about its middle.
fn grid(
    count: usize,
    pitch: f64,
    turn: f64,
    amplitude: f64,
    sigma: [f64; 2],
    normal: &mut Normal,
) -> Vec<Spot> {
    let half = 0.5 * (count - 1) as f64;
    let middle = pitch * (half + 1.0) * if turn == 0.0 { 1.0 } else { 1.3 };
    let (sin, cos) = turn.sin_cos();
    (0..count * count)
        .map(|i| {
            let u = ((i % count) as f64 - half) * pitch + normal.uniform(-1.0, 1.0);
            let v = ((i / count) as f64 - half) * pitch + normal.uniform(-1.0, 1.0);
            let at = [middle + u * cos - v * sin, middle + u * sin + v * cos];
            Spot { at, amplitude, sigma, angle: turn }
        })
        .collect()
}

fn size_for(spots: &[Spot]) -> usize {
    spots.iter().map(|spot| spot.at[0].max(spot.at[1])).fold(0.0, f64::max) as usize + 45
}

fn near<'a>(found: &'a DotsFound, spot: &Spot) -> Option<&'a Dot> {
    found.dots.iter().find(|dot| (dot.point.at - Vector2::from(spot.at)).norm() < 2.0)
}

/// Every spot found once and nothing else; returns the mean squared standardised error (2 expected)
/// and the rms error of a coordinate.
#[track_caller]
fn check_all_found(found: &DotsFound, spots: &[Spot]) -> (f64, f64) {
    assert_eq!(found.dots.len(), spots.len());
    let (mut standardised, mut squares) = (0.0, 0.0);
    for spot in spots {
        let dot = near(found, spot).unwrap();
        let error = dot.point.at - Vector2::from(spot.at);
        standardised +=
            (error.transpose() * dot.point.covariance.try_inverse().unwrap() * error)[0];
        squares += error.norm_squared();
    }
    let count = spots.len() as f64;
    (standardised / count, (squares / (2.0 * count)).sqrt())
}

fn find(canvas: &Canvas, noise: f64, seed: u64) -> DotsFound {
    find_dots(&canvas.shoot(noise, &mut Normal::new(seed)), &DotOptions::default())
}

#[test]
fn centres_are_at_the_noise_floor_and_their_covariance_is_true() {
    let mut normal = Normal::new(1);
    let spots = grid(11, 45.0, 0.0, 150.0, [3.0, 3.0], &mut normal);
    let size = size_for(&spots);
    let found = find(&Canvas::new(size, size, 30.0).spots(&spots, 0.0, 1.0, &mut normal), 4.0, 2);
    let (nees, rms) = check_all_found(&found, &spots);
    // Cramer-Rao: sqrt(2 / pi) n / A; the rms of 242 values varies by 1 / sqrt(484), three of them.
    let floor = (2.0 / std::f64::consts::PI).sqrt() * 4.0 / 150.0;
    assert!((rms / floor - 1.0).abs() < 0.14, "{rms} against {floor}");
    assert!((nees - 2.0).abs() < 0.55, "{nees}");
    assert!((found.noise.read_noise - 4.0).abs() < 0.1 && found.noise.speckle_contrast < 0.03);
}

#[test]
fn a_speckled_dot_is_one_dot_with_a_true_covariance() {
    for (contrast, grain, seed) in [(0.35, 5.0, 3), (0.6, 5.0, 4), (0.35, 12.0, 5)] {
        let mut normal = Normal::new(seed);
        let spots = grid(12, 45.0, 0.0, 120.0, [3.0, 3.0], &mut normal);
        let size = size_for(&spots);
        let found = find(
            &Canvas::new(size, size, 30.0).spots(&spots, contrast, grain, &mut normal),
            4.0,
            seed,
        );
        let (nees, rms) = check_all_found(&found, &spots);
        // The mean of 144 squares has the standard deviation 2 / sqrt(144) if errors were normal;
        // 20 % in the standard deviation besides.
        assert!(
            nees > 2.0 / 1.44 - 0.5 && nees < 2.0 * 1.44 + 0.5,
            "contrast {contrast}: {nees}, rms {rms}"
        );
        // The log-normal tail beyond saturation is cut off, which lowers the contrast.
        let seen = found.noise.speckle_contrast / contrast;
        assert!((0.7..1.1).contains(&seen), "{:?}", found.noise);
    }
}

#[test]
fn photon_noise_is_told_from_speckle() {
    let mut normal = Normal::new(8);
    let spots = grid(11, 45.0, 0.0, 180.0, [3.0, 3.0], &mut normal);
    let size = size_for(&spots);
    let canvas = Canvas::new(size, size, 20.0).spots(&spots, 0.0, 1.0, &mut normal);
    let mut photons = Normal::new(9);
    let canvas = canvas.map(|_, _, level| level + (0.5 * (level - 20.0)).sqrt() * photons.next());
    let found = find(&canvas, 2.0, 3);
    let (nees, _) = check_all_found(&found, &spots);
    assert!((nees - 2.0).abs() < 0.55, "{nees}");
    // At half the amplitude photons make 45 of a variance of 49, a contrast of 0.08 would as well.
    let noise = found.noise;
    assert!((noise.pixel_variance(90.0) / 49.0 - 1.0).abs() < 0.15, "{noise:?}");
}

#[test]
fn a_pattern_is_found_at_every_angle() {
    for step in 0..36 {
        let turn = f64::from(10 * step).to_radians();
        let mut normal = Normal::new(20 + step as u64);
        let spots = grid(11, 40.0, turn, 120.0, [3.5, 2.5], &mut normal);
        let size = size_for(&spots) + 30;
        let found =
            find(&Canvas::new(size, size, 40.0).spots(&spots, 0.0, 1.0, &mut normal), 3.0, 2);
        let (_, rms) = check_all_found(&found, &spots);
        assert!(rms < 0.03, "{rms}");
    }
}

#[test]
fn a_third_of_the_dots_may_be_hidden() {
    let mut normal = Normal::new(81);
    let all = grid(11, 45.0, 0.2, 120.0, [3.0, 3.0], &mut normal);
    let seen: Vec<Spot> =
        all.iter().enumerate().filter(|(i, _)| i * 7 % 3 > 0).map(|(_, spot)| *spot).collect();
    assert_eq!(seen.len(), 80);
    let size = size_for(&all) + 30;
    let found = find(&Canvas::new(size, size, 30.0).spots(&seen, 0.2, 5.0, &mut normal), 4.0, 2);
    let (nees, _) = check_all_found(&found, &seen);
    // 80 squares: standard deviation 2 / sqrt(80), three of them.
    assert!((nees - 2.0).abs() < 0.7, "{nees}");
}

#[test]
fn small_and_large_dots_are_found() {
    for sigma in [1.0, 1.5, 5.0, 8.0] {
        let mut normal = Normal::new(31);
        let spots = grid(4, 12.0 * sigma + 20.0, 0.0, 120.0, [sigma, sigma], &mut normal);
        let size = size_for(&spots) + 30;
        let found =
            find(&Canvas::new(size, size, 40.0).spots(&spots, 0.0, 1.0, &mut normal), 3.0, 2);
        check_all_found(&found, &spots);
        assert!(found.dots.iter().all(|dot| (dot.sigma[1] / sigma - 1.0).abs() < 0.1));
    }
}

#[test]
fn saturated_dots_are_measured_from_their_flanks() {
    let mut normal = Normal::new(41);
    let spots = grid(6, 50.0, 0.0, 600.0, [3.0, 3.0], &mut normal);
    let size = size_for(&spots);
    let found = find(&Canvas::new(size, size, 30.0).spots(&spots, 0.0, 1.0, &mut normal), 4.0, 2);
    let (nees, _) = check_all_found(&found, &spots);
    // 36 squares: standard deviation 2 / 6.
    assert!((nees - 2.0).abs() < 1.0, "{nees}");
    assert!(found.dots.iter().all(|dot| dot.quality.is_saturated && dot.amplitude > 450.0));
}

#[test]
fn dots_that_the_border_cuts_are_dropped() {
    let mut normal = Normal::new(51);
    let whole = Spot::round([60.2, 60.4], 150.0, 3.0);
    let spots =
        [whole, Spot::round([1.0, 60.0], 150.0, 3.0), Spot::round([60.0, 118.5], 150.0, 3.0)];
    let found = find(&Canvas::new(120, 120, 30.0).spots(&spots, 0.0, 1.0, &mut normal), 3.0, 2);
    check_all_found(&found, &[whole]);
}

#[test]
fn uneven_light_neither_hides_nor_moves_dots() {
    let mut normal = Normal::new(61);
    let spots = grid(8, 50.0, 0.0, 90.0, [3.0, 3.0], &mut normal);
    let size = size_for(&spots);
    // From 20 to 140 grey levels: 0.02 a pixel moves a centre by 4 sigma^2 / A of that, 0.008 px.
    let canvas = Canvas::new(size, size, 20.0).map(|x, y, level| level + 0.01 * x + 0.02 * y);
    let found = find(&canvas.spots(&spots, 0.0, 1.0, &mut normal), 3.0, 2);
    let (nees, _) = check_all_found(&found, &spots);
    assert!((nees - 2.0).abs() < 0.75, "{nees}");
}

#[test]
fn targets_and_discs_are_not_dots() {
    for radius in [3.5, 5.0, 8.0, 15.0, 28.0] {
        for levels in [[40.0, 180.0], [180.0, 40.0]] {
            let at = [4.0 * radius + 30.0, 4.0 * radius + 30.0];
            let print = Print { levels, ..Print::dark(at, 45, radius) };
            let size = 2 * at[0] as usize;
            let canvas = Canvas::new(size, size, levels[1]).prints(&[print]).blur(0.7);
            let image = canvas.shoot(3.0, &mut Normal::new(3));
            let mut dots = find_dots(&image, &DotOptions::default()).dots;
            drop_dots_on_targets(&mut dots, &find_targets(&image, &TargetOptions::default()));
            assert!(dots.is_empty(), "radius {radius} levels {levels:?}: {dots:?}");
        }
    }
}

#[test]
fn discs_among_dots_are_told_from_them() {
    for (contrast, grain) in [(0.0, 1.0), (0.2, 5.0)] {
        let mut normal = Normal::new(71);
        let spots = grid(6, 60.0, 0.0, 140.0, [3.0, 3.0], &mut normal);
        let size = size_for(&spots);
        let discs: Vec<Print> = (0..5)
            .map(|i| Print {
                levels: [170.0, 30.0],
                ..Print::dark([90.0 + 60.0 * f64::from(i), 150.0], 0, 3.5 + 2.0 * f64::from(i))
            })
            .collect();
        // Between the rows and columns of the dots.
        let canvas = Canvas::new(size, size, 30.0).prints(&discs).blur(0.6);
        let found = find(&canvas.spots(&spots, contrast, grain, &mut normal), 3.0, 2);
        check_all_found(&found, &spots);
    }
}

#[test]
fn known_noise_is_used_as_it_is() {
    let known = NoiseModel { read_noise: 8.0, ..NoiseModel::white(8.0) };
    let options = DotOptions { noise: Some(known), ..DotOptions::default() };
    let spot = Spot::round([40.2, 40.4], 150.0, 3.0);
    let canvas = Canvas::new(80, 80, 30.0).spots(&[spot], 0.0, 1.0, &mut Normal::new(1));
    let found = find_dots(&canvas.shoot(4.0, &mut Normal::new(2)), &options);
    assert_eq!(found.noise, known);
    // Cramer-Rao for the noise that was stated.
    let expected = 2.0 / std::f64::consts::PI * (8.0f64 / 150.0).powi(2);
    assert!((found.dots[0].point.covariance[(0, 0)] / expected - 1.0).abs() < 0.1);
}

#[test]
fn pictures_without_dots_give_none() {
    for (width, height) in [(0, 0), (1, 1), (2, 3), (1, 90), (90, 1), (130, 110)] {
        for level in [0.0, 128.0, 255.0] {
            for noise in [0.0, 4.0, 25.0] {
                let found = find(&Canvas::new(width, height, level), noise, 1);
                assert!(
                    found.dots.is_empty(),
                    "{width} x {height}, {level}, {noise}: {:?}",
                    found.dots
                );
            }
        }
    }
}
