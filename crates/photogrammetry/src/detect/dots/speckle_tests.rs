//! Every dot found, and its covariance true, whatever contrast and grain the speckle has.

use nalgebra::Vector2;

use super::*;
use crate::detect::testing::speckle_cell;

/// Pictures per cell: 363 dots tell a mean square to 2 / sqrt(363), 5 %, if errors were normal.
const PICTURES: u64 = 3;

/// All dots of a cell found and nothing else; stated over true variance of a coordinate, and rms.
fn cell(contrast: f64, grain: f64) -> (f64, f64) {
    let (mut squares, mut stated, mut count) = (0.0, 0.0, 0.0);
    for seed in 0..PICTURES {
        let (image, spots) = speckle_cell(contrast, grain, 11, 100 + seed);
        let found = find_dots(&image, &DotOptions::default());
        assert_eq!(found.dots.len(), spots.len(), "contrast {contrast} grain {grain}");
        for spot in &spots {
            let error = |dot: &Dot| dot.point.at - Vector2::from(spot.at);
            let dot = found.dots.iter().find(|dot| error(dot).norm() < 3.0).unwrap();
            squares += error(dot).norm_squared();
            stated += dot.point.covariance.trace();
            count += 1.0;
        }
    }
    (stated / squares, (squares / (2.0 * count)).sqrt())
}

#[test]
fn speckle_of_any_contrast_and_grain_is_weighed_truly() {
    for contrast in [0.1, 0.2, 0.35, 0.6] {
        for grain in [0.7, 1.0, 2.0] {
            let (ratio, rms) = cell(contrast, grain);
            // 20 %, and one standard deviation of what this many dots tell.
            assert!((0.75..1.25).contains(&ratio), "{contrast}, {grain}: {ratio}, rms {rms}");
        }
    }
}
