//! Which part of the picture the points cover: distortion is only known there.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::SolvedView;
use crate::camera::Camera;

/// Cells of the map across the picture.
pub const COVERAGE_COLUMNS: usize = 12;
/// Cells of the map down the picture.
pub const COVERAGE_ROWS: usize = 9;

/// Where points were seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coverage {
    /// Points in each cell, row by row from the top left.
    pub counts: Vec<Vec<usize>>,
    /// Part of the cells with a point.
    pub covered: f64,
    /// Distance of the outermost point from the principal point, as a part of that of the farthest
    /// corner: beyond it distortion is extrapolated.
    pub reach: f64,
}

impl Coverage {
    /// Of all views together.
    #[must_use]
    pub fn of(camera: &Camera, views: &[SolvedView]) -> Self {
        let mut counts = vec![vec![0; COVERAGE_COLUMNS]; COVERAGE_ROWS];
        let principal = Vector2::new(camera.cx, camera.cy);
        let mut farthest: f64 = 0.0;
        for at in views.iter().flat_map(|v| &v.pixels) {
            // A pixel reaches half a pixel around its centre.
            let column = cell(at.x + 0.5, camera.width, COVERAGE_COLUMNS);
            let row = cell(at.y + 0.5, camera.height, COVERAGE_ROWS);
            counts[row][column] += 1;
            farthest = farthest.max((at - principal).norm());
        }
        let seen = counts.iter().flatten().filter(|n| **n > 0).count();
        let covered = seen as f64 / (COVERAGE_COLUMNS * COVERAGE_ROWS) as f64;
        Self { counts, covered, reach: farthest / corner_distance(camera, &principal) }
    }
}

fn cell(at: f64, size: usize, cells: usize) -> usize {
    ((at / size.max(1) as f64 * cells as f64).max(0.0) as usize).min(cells - 1)
}

fn corner_distance(camera: &Camera, principal: &Vector2<f64>) -> f64 {
    let (right, bottom) = (camera.width as f64 - 0.5, camera.height as f64 - 0.5);
    let corners = [(-0.5, -0.5), (right, -0.5), (-0.5, bottom), (right, bottom)];
    corners.map(|(x, y)| (Vector2::new(x, y) - principal).norm()).into_iter().fold(1e-9, f64::max)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix6, Rotation3, Vector3};

    use super::*;
    use crate::pose::Station;

    #[test]
    fn the_map_counts_each_point_once_in_its_cell() {
        let camera = Camera::without_distortion([120, 90], [100.0, 100.0], [59.5, 44.5]);
        let view = SolvedView {
            name: String::new(),
            station: Station { centre: Vector3::zeros(), rotation: Rotation3::identity() },
            covariance: Matrix6::zeros(),
            pixels: [(-0.5, -0.5), (9.0, 9.0), (119.4, 89.4), (59.5, 44.5)]
                .map(|(x, y)| Vector2::new(x, y))
                .to_vec(),
            residuals: Vec::new(),
        };
        let coverage = Coverage::of(&camera, &[view]);
        assert_eq!(coverage.counts[0][0], 2);
        assert_eq!((coverage.counts[8][11], coverage.counts[4][6]), (1, 1));
        assert!((coverage.covered - 3.0 / 108.0).abs() < 1e-12);
        assert!((coverage.reach - 1.0).abs() < 1e-12, "a point is in the very corner");
    }
}
