use nalgebra::Vector2;

use super::*;
use crate::detect::testing::{Canvas, Normal, Print, Spot, target_cell};
use crate::detect::{DotOptions, find_dots, find_dots_and_targets};

/// Chi-square of two degrees of freedom exceeds this once in ten thousand.
const RARE: f64 = 18.4;

fn square_error(target: &Target, truth: [f64; 2]) -> f64 {
    let error = target.point.at - Vector2::from(truth);
    (error.transpose() * target.point.covariance.try_inverse().unwrap() * error)[0]
}

fn find(canvas: Canvas, noise: f64, seed: u64) -> Vec<Target> {
    find_targets(&canvas.shoot(noise, &mut Normal::new(seed)), &TargetOptions::default())
}

/// One target in the middle of a picture must be found with its code, centre, axes.
#[track_caller]
fn check_found(print: Print, blur: f64) {
    let size = 2 * (print.at[0].ceil() as usize) + 1;
    let found = find(Canvas::new(size, size, print.levels[1]).prints(&[print]).blur(blur), 3.0, 7);
    assert_eq!(found.len(), 1, "radius {} tilt {}", print.radius, print.tilt);
    assert_eq!(found[0].code, canonical_code(print.code));
    assert!(square_error(&found[0], print.at) < RARE);
    // Blur shifts a curved edge inwards by blur^2 / (2 r); five times that, and noise, is room enough.
    let small = print.radius * print.tilt.cos();
    assert!((found[0].semi_axes[1] - small).abs() < 0.2 + 2.5 * blur * blur / small);
    assert!((found[0].semi_axes[0] - print.radius).abs() < 0.2 + 2.5 * blur * blur / small);
}

#[test]
fn targets_of_all_sizes_and_both_polarities_are_read() {
    for (i, radius) in [3.5, 4.0, 5.0, 7.0, 10.0, 14.0, 20.0, 30.0, 40.0].into_iter().enumerate() {
        let at = [3.7 * radius + 4.3, 3.7 * radius + 4.1];
        let dark = Print { turn: 0.7 * i as f64, ..Print::dark(at, 45, radius) };
        check_found(dark, 0.7);
        check_found(Print { levels: [180.0, 60.0], ..dark }, 0.7);
    }
}

#[test]
fn tilted_targets_are_read() {
    for tilt in [20.0f64, 40.0, 50.0, 60.0] {
        for axis in [0.0, 0.5, 1.3, 2.2, 3.0] {
            for radius in [8.0, 20.0] {
                let at = [3.7 * radius + 4.4, 3.7 * radius + 4.2];
                let print = Print::dark(at, 0b0010_1101_0011, radius);
                check_found(
                    Print { tilt: tilt.to_radians(), tilt_axis: axis, turn: axis * 1.7, ..print },
                    0.8,
                );
            }
        }
    }
}

#[test]
fn every_usable_code_is_read_at_any_turn() {
    let codes = usable_codes();
    assert!(codes.contains(&45) && !codes.contains(&0) && !codes.contains(&4095));
    for (i, &code) in codes.iter().enumerate() {
        check_found(Print { turn: 0.37 * i as f64, ..Print::dark([30.4, 30.2], code, 7.0) }, 0.8);
    }
}

#[test]
fn the_stated_covariance_of_a_centre_is_true() {
    for (radius, tilt) in [(12.0, 0.0f64), (6.0, 45.0), (3.5, 0.0)] {
        let mut normal = Normal::new(5);
        let pitch = 7.6 * radius;
        let prints: Vec<Print> = (0..100)
            .map(|i| {
                let place = |k: usize| (k as f64 + 0.6) * pitch;
                let at = [
                    place(i % 10) + normal.uniform(0.0, 1.0),
                    place(i / 10) + normal.uniform(0.0, 1.0),
                ];
                let print =
                    Print { turn: i as f64, levels: [60.0, 160.0], ..Print::dark(at, 45, radius) };
                Print { tilt: tilt.to_radians(), tilt_axis: 0.1 * i as f64, ..print }
            })
            .collect();
        let size = (10.4 * pitch) as usize;
        let targets = find(Canvas::new(size, size, 160.0).prints(&prints).blur(0.7), 4.0, 3);
        assert_eq!(targets.len(), 100);
        let near = |print: &Print| {
            targets.iter().find(|target| target.covers(&Vector2::from(print.at), 0.5)).unwrap()
        };
        let mean =
            prints.iter().map(|print| square_error(near(print), print.at)).sum::<f64>() / 100.0;
        // The mean of 100 squares has the standard deviation 2 / sqrt(100); three of them.
        assert!((mean - 2.0).abs() < 0.6, "radius {radius}: {mean}");
    }
}

#[test]
fn light_that_changes_across_a_target_does_not_move_its_centre() {
    let print = Print::dark([60.3, 60.6], 45, 12.0);
    let canvas = Canvas::new(121, 121, 180.0).prints(&[print]).blur(0.7);
    let found = find(canvas.map(|x, _, level| level * (0.7 + 0.005 * x)), 2.0, 4);
    assert_eq!(found.len(), 1);
    assert!(square_error(&found[0], print.at) < RARE);
}

#[test]
fn a_sector_that_is_neither_dark_nor_light_is_refused() {
    let print = Print::dark([60.3, 60.6], 45, 12.0);
    let other = Print { code: 45 | 0b1_0000, ..print };
    let mut half = Canvas::new(121, 121, 180.0).prints(&[print]).values().to_vec();
    let more = Canvas::new(121, 121, 180.0).prints(&[other]).values().to_vec();
    half.iter_mut().zip(more).for_each(|(a, b)| *a = 0.5 * (*a + b));
    let canvas = Canvas::new(121, 121, 0.0).map(|x, y, _| half[y as usize * 121 + x as usize]);
    assert!(find(canvas.blur(0.7), 2.0, 4).is_empty());
}

/// Prints in rows, one sector of each on the way from one code to another.
struct Between {
    prints: Vec<Print>,
    other: Vec<Print>,
    canvas: Canvas,
    size: usize,
}

impl Between {
    /// `side` by `side` prints; `parts` is how far each is on its way.
    fn drawn(side: usize, pitch: f64, radius: f64, parts: &[f64]) -> Self {
        let codes = usable_codes();
        let place = |k: usize| (k as f64 + 0.5) * pitch;
        let print = |i: usize| {
            let at = [place(i % side), place(i / side)];
            Print { turn: i as f64, ..Print::dark(at, codes[13 * i % codes.len()], radius) }
        };
        let prints: Vec<Print> = (0..side * side).map(print).collect();
        let changed =
            |(i, print): (usize, &Print)| Print { code: print.code ^ 1 << (i % 12), ..*print };
        let other: Vec<Print> = prints.iter().enumerate().map(changed).collect();
        let size = (side as f64 * pitch) as usize;
        let draw =
            |prints: &[Print]| Canvas::new(size, size, 180.0).prints(prints).values().to_vec();
        let (one, two) = (draw(&prints), draw(&other));
        let canvas = Canvas::new(size, size, 0.0).map(|x, y, _| {
            let i = y as usize * size + x as usize;
            let part = parts[(y / pitch) as usize * side + (x / pitch) as usize];
            one[i] + part * (two[i] - one[i])
        });
        Self { prints, other, canvas, size }
    }
}

#[test]
fn a_sector_between_dark_and_light_never_makes_a_code() {
    // One sector of each is 0.38 to 0.62 of the way: beyond the margin of 0.3 even with noise.
    let mut normal = Normal::new(17);
    let parts: Vec<f64> = (0..100).map(|_| normal.uniform(0.38, 0.62)).collect();
    let Between { prints, canvas, size, .. } = Between::drawn(10, 60.0, 8.0, &parts);
    assert!(find(canvas.blur(0.7), 3.0, 4).is_empty());
    // Without the change all are read: it is the sector that is refused.
    let canvas = Canvas::new(size, size, 180.0).prints(&prints);
    assert_eq!(find(canvas.blur(0.7), 3.0, 4).len(), 100);
}

#[test]
fn clutter_of_any_scale_is_never_read_as_a_code() {
    for (i, side) in [4.0f64, 6.0, 9.0, 14.0, 20.0, 30.0].into_iter().enumerate() {
        for seed in 0..3 {
            let mut normal = Normal::new(100 * i as u64 + seed);
            let canvas = Canvas::new(600, 600, 120.0).clutter(60.0, side * side, &mut normal);
            let found = find(canvas, 3.0, seed);
            assert!(found.is_empty(), "side {side}: {found:?}");
        }
    }
}

#[test]
fn targets_are_read_and_their_covariance_is_true_tilted_blurred_small_and_of_both_polarities() {
    let codes = usable_codes();
    for (radius, tilt, blur) in
        [(4.0, 0.0f64, 0.7), (12.0, 0.0, 2.0), (8.0, 60.0, 0.7), (12.0, 60.0, 1.2)]
    {
        for levels in [[60.0, 160.0], [160.0, 60.0]] {
            let kind =
                Print { levels, tilt: tilt.to_radians(), ..Print::dark([0.0; 2], 0, radius) };
            let (image, prints) = target_cell(kind, blur, 4.0, &codes);
            let found = find_targets(&image, &TargetOptions::default());
            let (mut squares, mut read) = (0.0, 0.0);
            for target in &found {
                let is_here = |print: &&Print| target.covers(&Vector2::from(print.at), 0.5);
                let print = prints.iter().find(is_here).unwrap();
                assert_eq!(target.code, canonical_code(print.code));
                squares += square_error(target, print.at);
                read += 1.0;
            }
            assert!(read > 97.0, "radius {radius} tilt {tilt} blur {blur}: {read}");
            // The mean of 100 squares has the standard deviation 2 / sqrt(100); three of them.
            assert!((squares / read - 2.0).abs() < 0.6, "{radius} {tilt} {blur}: {squares}");
        }
    }
}

#[test]
fn plain_discs_are_found_up_to_the_border() {
    // From 1.5 pixels beside the border on: a quiet zone of three tenths of the width does not fit.
    for (x, y) in [(7.5, 40.2), (72.4, 40.4), (40.3, 7.6), (40.1, 72.3), (7.4, 72.5), (40.2, 40.3)]
    {
        let disc = Print::dark([x, y], 0, 6.0);
        let canvas = Canvas::new(81, 81, 180.0).prints(&[disc]).blur(0.7);
        let image = canvas.shoot(3.0, &mut Normal::new(5));
        let found = find_plain_discs(&image, &TargetOptions::default());
        assert_eq!(found.len(), 1, "{x} {y}");
        // The centre of 100 pixels of edge of contrast 120 and noise 3: five times 0.01.
        assert!((found[0].point.at - Vector2::new(x, y)).norm() < 0.05, "{x} {y}");
    }
}

#[test]
fn one_pass_finds_the_same_dots_and_targets_as_two() {
    // A picture that is no whole number of bands and blocks, and rows that are no divisor of one.
    for min_semi_axis in [1.0, 2.5, 3.0, 5.0] {
        let prints: Vec<Print> = (0..9)
            .map(|i| {
                let at = [70.0 + 150.0 * f64::from(i % 3), 70.0 + 150.0 * f64::from(i / 3)];
                Print { turn: f64::from(i), ..Print::dark(at, 45, 10.0) }
            })
            .collect();
        let spots: Vec<Spot> = (0..16)
            .map(|i| [145.0 + 0.3 * f64::from(i), 20.0 + 27.3 * f64::from(i)])
            .map(|at| Spot::round(at, 150.0, 2.5))
            .collect();
        let mut normal = Normal::new(3);
        let canvas = Canvas::new(445, 451, 90.0).prints(&prints).blur(0.7);
        let image = canvas.spots(&spots, 0.2, 2.0, &mut normal).shoot(3.0, &mut normal);
        let options = TargetOptions { min_semi_axis, ..TargetOptions::default() };
        let dots = find_dots(&image, &DotOptions::default());
        let targets = find_targets(&image, &options);
        assert_eq!((dots.dots.len() >= 16, targets.len()), (true, 9));
        let both = find_dots_and_targets(&image, &DotOptions::default(), &options);
        assert_eq!(both, (dots, targets));
    }
}

#[test]
fn a_ring_without_changes_is_no_code() {
    for code in [0, 4095] {
        let print = Print::dark([60.3, 60.6], code, 12.0);
        assert!(find(Canvas::new(121, 121, 180.0).prints(&[print]).blur(0.7), 2.0, 4).is_empty());
    }
}

#[test]
fn a_laser_dot_on_a_target_never_makes_another_code() {
    for i in 0..24 {
        let (sin, cos) = (0.2618 * f64::from(i)).sin_cos();
        let radius = 12.0 * (1.0 + 0.1 * f64::from(i));
        let spot = Spot::round([60.0 + radius * cos, 60.0 + radius * sin], 150.0, 3.0);
        let print = Print { levels: [40.0, 100.0], ..Print::dark([60.0, 60.0], 45, 12.0) };
        let canvas = Canvas::new(121, 121, 100.0).prints(&[print]).spots(
            &[spot],
            0.0,
            1.0,
            &mut Normal::new(1),
        );
        assert!(find(canvas.blur(0.7), 3.0, 4).iter().all(|target| target.code == 45));
    }
}

#[test]
fn pictures_without_targets_give_none() {
    for (width, height) in [(0, 0), (1, 1), (2, 3), (1, 90), (90, 1), (130, 110)] {
        for level in [0.0, 128.0, 255.0] {
            assert!(find(Canvas::new(width, height, level), 0.0, 1).is_empty());
            assert!(find(Canvas::new(width, height, level), 25.0, 2).is_empty());
        }
    }
    let spots: Vec<Spot> = (0..9)
        .map(|i| {
            Spot::round(
                [30.0 + 50.0 * f64::from(i % 3), 30.0 + 50.0 * f64::from(i / 3)],
                150.0,
                3.0,
            )
        })
        .collect();
    let canvas = Canvas::new(160, 160, 30.0).spots(&spots, 0.4, 5.0, &mut Normal::new(2));
    assert!(find(canvas, 4.0, 3).is_empty());
}

/// What is read of a picture of targets that blur or tilt makes hard, and how many are not.
#[track_caller]
fn check_hard(radius: f64, tilt: f64, blur: f64, least: usize) {
    let codes = usable_codes();
    for levels in [[60.0, 160.0], [160.0, 60.0]] {
        let kind = Print { levels, tilt: tilt.to_radians(), ..Print::dark([0.0; 2], 0, radius) };
        let (image, prints) = target_cell(kind, blur, 4.0, &codes);
        let found = find_targets(&image, &TargetOptions::default());
        let mut squares = 0.0;
        for target in &found {
            let is_here = |print: &&Print| target.covers(&Vector2::from(print.at), 0.5);
            let print = prints.iter().find(is_here).unwrap();
            assert_eq!(target.code, canonical_code(print.code));
            squares += square_error(target, print.at);
        }
        assert!(found.len() >= least, "radius {radius} tilt {tilt} blur {blur}: {}", found.len());
        // The mean of n squares has the standard deviation 2 / sqrt(n); four of them.
        let (mean, count) = (squares / found.len() as f64, found.len() as f64);
        assert!((mean - 2.0).abs() < 8.0 / count.sqrt(), "{radius} {tilt} {blur}: {mean}");
    }
}

#[test]
fn small_targets_are_read_though_tilt_or_blur_mixes_their_sectors() {
    check_hard(4.0, 0.0, 1.5, 97);
    check_hard(4.0, 60.0, 0.7, 90);
    check_hard(6.0, 60.0, 1.5, 97);
}

#[test]
fn small_rings_of_another_width_are_refused_or_read_as_what_they_are() {
    let (pitch, across) = (40.0, 20);
    let mut tried = 0;
    for seed in 0..12 {
        let mut normal = Normal::new(900 + seed);
        let (radius, blur) = (normal.uniform(3.0, 6.0), normal.uniform(0.6, 1.6));
        let (inner, outer) = [(1.5, 2.0), (2.5, 3.5), (2.0, 2.4)][seed as usize % 3];
        let rings: Vec<(u16, f64)> = (0..across * across)
            .map(|_| (normal.uniform(0.0, 4096.0) as u16, normal.uniform(0.5, 1.0)))
            .collect();
        tried += rings.len();
        let index = |x: f64, y: f64| (y / pitch) as usize * across + (x / pitch) as usize;
        let size = (across as f64 * pitch) as usize;
        let canvas = Canvas::new(size, size, 160.0).map(|x, y, level| {
            let (bits, squeeze) = rings[index(x, y)];
            let from_middle = |at: f64| at % pitch - 0.5 * pitch;
            let (u, v) = (from_middle(x), from_middle(y) / squeeze);
            let far = u.hypot(v) / radius;
            let turn = v.atan2(u) / std::f64::consts::TAU + 0.5;
            let is_dark = ring_sectors(bits)[((12.0 * turn) as usize).min(11)];
            let is_ring = (inner..outer).contains(&far) && is_dark;
            if far < 1.0 || is_ring { 60.0 } else { level }
        });
        let found = find(canvas.blur(blur), 4.0, seed);
        // A single mark beside a disc can pass for a code of one sector, which nobody prints.
        for target in found.iter().filter(|target| is_usable_code(target.code)) {
            let (bits, _) = rings[index(target.point.at.x, target.point.at.y)];
            assert_eq!(target.code, canonical_code(bits), "{inner} {outer} {radius} {blur}");
        }
    }
    assert!(tried > 4000);
}

#[test]
fn small_sectors_between_dark_and_light_never_make_a_code() {
    let mut normal = Normal::new(23);
    let pitch = 32.0;
    let parts: Vec<f64> = (0..400).map(|_| normal.uniform(0.2, 0.8)).collect();
    let Between { prints, other, canvas, .. } = Between::drawn(20, pitch, 4.0, &parts);
    let found = find(canvas.blur(1.3), 3.0, 4);
    // Where the sector is far enough on its way they are read: the rest is about these.
    assert!(found.len() >= 30, "{}", found.len());
    for target in found {
        let at = [target.point.at.x, target.point.at.y].map(|at| (at / pitch) as usize);
        let index = at[1] * 20 + at[0];
        // Nearer to one code than the margin and the noise allow it to be read as another.
        let nearer = if parts[index] < 0.5 { prints[index].code } else { other[index].code };
        assert_eq!(target.code, canonical_code(nearer), "{}", parts[index]);
        // The margin of 0.3 and three standard uncertainties of 0.05 beyond it.
        assert!((parts[index] - 0.5).abs() > 0.05, "{}", parts[index]);
    }
}

/// As a camera may deliver it: sharpened (unsharp mask, 15 % over the edge and more) and compressed.
fn developed(image: &GrayImage, amount: f64, quality: u8) -> GrayImage {
    let (width, height) = (image.width, image.height);
    let canvas =
        Canvas::new(width, height, 0.0).map(|x, y, _| f64::from(image.row(y as usize)[x as usize]));
    let soft = canvas.values().to_vec();
    let soft = Canvas::new(width, height, 0.0)
        .map(|x, y, _| soft[y as usize * width + x as usize])
        .blur(1.0);
    let sharp = |x: f64, y: f64, level: f64| {
        level + amount * (level - soft.values()[y as usize * width + x as usize])
    };
    let sharp = canvas.map(sharp).shoot(0.0, &mut Normal::new(1));
    let mut bytes = Vec::new();
    let encoder = jpeg_encoder::Encoder::new(&mut bytes, quality);
    let colour = jpeg_encoder::ColorType::Luma;
    encoder.encode(&sharp.data, width as u16, height as u16, colour).unwrap();
    crate::decode(&bytes).unwrap()
}

#[test]
fn targets_that_a_camera_sharpened_and_compressed_are_read() {
    let codes = usable_codes();
    for (radius, tilt) in [(8.0, 0.0), (12.0, 0.9)] {
        for levels in [[60.0, 160.0], [150.0, 175.0]] {
            for amount in [0.0, 1.0] {
                let kind = Print { levels, tilt, ..Print::dark([0.0; 2], 0, radius) };
                let (image, prints) = target_cell(kind, 0.8, 1.0, &codes);
                let image = developed(&image, amount, 75);
                let found = find_targets(&image, &TargetOptions::default());
                let is_true = |target: &&Target| {
                    let is_here = |print: &&Print| target.covers(&Vector2::from(print.at), 0.5);
                    prints.iter().find(is_here).is_some_and(|print| print.code == target.code)
                };
                let read = found.iter().filter(is_true).count();
                assert_eq!((read, found.len()), (100, 100), "{radius} {levels:?} {amount}");
            }
        }
    }
}

/// In perspective the ring is not quite about the middle of its disc.
#[test]
fn large_targets_in_perspective_are_read() {
    const FOCAL: f64 = 3500.0;
    for radius in [24.0, 44.0] {
        let (side, tilt) = (7.2 * radius, 0.9f64);
        let (sin, cos) = tilt.sin_cos();
        // Of the print from the camera, in radii of the disc.
        let distance = FOCAL / radius;
        let turns: Vec<f64> = (0..25).map(|i| 0.2513 * f64::from(i)).collect();
        let size = (5.0 * side) as usize;
        let index = |x: f64, y: f64| ((y / side) as usize * 5 + (x / side) as usize).min(24);
        let on_print = |x: f64, y: f64| {
            let [across, down] = [x, y].map(|at| (at % side - 0.5 * side) / FOCAL);
            let a = distance * across / (cos - sin * across);
            let b = (distance + a * sin) * down;
            let angle = (b.atan2(a) - turns[index(x, y)]).rem_euclid(std::f64::consts::TAU);
            let sector = (12.0 * angle / std::f64::consts::TAU) as usize;
            let is_ring = (2.0..3.0).contains(&a.hypot(b)) && ring_sectors(45)[sector.min(11)];
            a.hypot(b) < 1.0 || is_ring
        };
        let canvas = Canvas::new(size, size, 180.0).map(|x, y, level| {
            let parts = (0..16).map(|i| {
                on_print(x + 0.25 * f64::from(i % 4) - 0.375, y + 0.25 * f64::from(i / 4) - 0.375)
            });
            level - 7.5 * parts.filter(|is_dark| *is_dark).count() as f64
        });
        let found = find(canvas.blur(0.6), 2.0, 3);
        assert_eq!(found.len(), 25, "radius {radius}");
        assert!(found.iter().all(|target| target.code == 45), "radius {radius}: {found:?}");
    }
}

/// Rings that share the size of ours and nothing else, and of which none may pass for one of ours:
/// neither whole, nor one of their sectors as a disc among the others.
#[test]
fn rings_of_another_number_of_sectors_are_refused() {
    let (radius, across) = (12.0, 12);
    let pitch = 7.0 * radius;
    for sectors in [8, 9, 10, 11, 13, 14, 16, 24] {
        let mut normal = Normal::new(900 + sectors);
        let count = sectors as f64;
        let rings: Vec<(u32, f64, f64)> = (0..across * across)
            .map(|_| {
                let bits = normal.uniform(0.0, count.exp2()) as u32;
                (bits, normal.uniform(0.5, 1.0), normal.uniform(0.0, 1.0))
            })
            .collect();
        let index = |x: f64, y: f64| (y / pitch) as usize * across + (x / pitch) as usize;
        let size = (across as f64 * pitch) as usize;
        let canvas = Canvas::new(size, size, 160.0).map(|x, y, level| {
            let (bits, squeeze, begin) = rings[index(x, y)];
            let from_middle = |at: f64| at % pitch - 0.5 * pitch;
            let (u, v) = (from_middle(x), from_middle(y) / squeeze);
            let far = u.hypot(v) / radius;
            let turn = (v.atan2(u) / std::f64::consts::TAU + 0.5 + begin).fract();
            let is_dark = bits >> (count * turn) as u32 & 1 == 1;
            let is_ring = (2.0..3.0).contains(&far) && is_dark;
            if far < 1.0 || is_ring { 60.0 } else { level }
        });
        let found = find(canvas.blur(0.8), 3.0, 5);
        // Eight sectors of one kind are a code that nobody prints.
        let wrong: Vec<_> = found.iter().filter(|target| is_usable_code(target.code)).collect();
        assert!(wrong.is_empty(), "{sectors} sectors: {wrong:?}");
    }
}
