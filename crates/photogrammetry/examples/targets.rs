//! Ring-coded targets of known place: prints a Markdown table of what was read and how well:
//! `cargo run --release -p beampose-photogrammetry --example targets`.

use beampose_photogrammetry::detect::{TargetOptions, find_targets, usable_codes};
use nalgebra::Vector2;

#[path = "../src/detect/testing.rs"]
#[expect(dead_code, reason = "shared with the unit tests, which use all of it")]
mod testing;

use testing::{Print, target_cell};

/// Of each pixel, grey levels; disc and ground differ by 100.
const NOISE: f64 = 4.0;

fn main() {
    println!(
        "| radius px | tilt deg | blur px | disc | read of 100 | wrong | rms px | stated / true variance |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for radius in [4.0, 6.0, 12.0] {
        for tilt in [0.0, 45.0, 60.0] {
            for blur in [0.7, 1.5] {
                for (disc, levels) in [("dark", [60.0, 160.0]), ("light", [160.0, 60.0])] {
                    let kind = Print::dark([0.0; 2], 0, radius);
                    let kind = Print { levels, tilt: f64::to_radians(tilt), ..kind };
                    let figures = cell(kind, blur);
                    println!("| {radius} | {tilt} | {blur} | {disc} | {figures} |");
                }
            }
        }
    }
}

/// Read, read wrongly, rms error of a coordinate in pixels, stated over true variance.
fn cell(kind: Print, blur: f64) -> String {
    let (image, prints) = target_cell(kind, blur, NOISE, &usable_codes());
    let (mut read, mut wrong, mut squares, mut stated) = (0.0, 0, 0.0, 0.0);
    for target in find_targets(&image, &TargetOptions::default()) {
        let here = prints.iter().find(|print| target.covers(&Vector2::from(print.at), 0.5));
        match here {
            Some(print) if print.code == target.code => {
                read += 1.0;
                squares += (target.point.at - Vector2::from(print.at)).norm_squared();
                stated += target.point.covariance.trace();
            }
            _ => wrong += 1,
        }
    }
    let rms = f64::sqrt(squares / (2.0 * read));
    format!("{read} | {wrong} | {rms:.4} | {:.2}", stated / squares)
}
