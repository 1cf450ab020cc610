//! Relative orientation of two cameras from points that both see.
//!
//! Two ways to a start, since each fails where the other holds: the essential matrix by eight or
//! more points (Longuet-Higgins 1981, conditioned as Hartley 1997) for points in space, the
//! homography (Ma, Soatto, Kosecka, Sastry 2004, section 5.3) for points on a plane. Every start is
//! refined on the Sampson distance; what sees the points in front of both cameras is kept.

use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, Vector2, Vector3};

use crate::pose::{Station, homography, triangulate};

/// The second camera in the first one's frame; the base has length 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RelativeOrientation {
    /// The second camera.
    pub second: Station,
    /// Root mean square of the Sampson distances, on the plane z = 1.
    pub rms: f64,
}

/// The relative orientations that two cameras' `directions` (x/z, y/z of the same points) allow,
/// the best first. A plane allows two.
///
/// Empty with fewer than five points, or when no orientation has most points in front.
#[must_use]
pub fn relative_orientations(
    first: &[Vector2<f64>],
    second: &[Vector2<f64>],
) -> Vec<RelativeOrientation> {
    if first.len() < FEWEST || first.len() != second.len() {
        return Vec::new();
    }
    let mut starts = Vec::new();
    if first.len() >= 8 {
        starts.extend(from_essential(first, second));
    }
    starts.extend(homography(first, second).iter().flat_map(from_homography));
    let mut found: Vec<RelativeOrientation> = starts
        .into_iter()
        .map(|start| refine(first, second, start))
        .filter(|found| are_in_front(first, second, &found.second))
        .collect();
    found.sort_by(|a, b| a.rms.total_cmp(&b.rms));
    let mut kept: Vec<RelativeOrientation> = Vec::new();
    for candidate in found {
        let is_known = kept.iter().any(|known| {
            let turn = known.second.rotation.angle_to(&candidate.second.rotation);
            turn < 1e-4 && (known.second.centre - candidate.second.centre).norm() < 1e-3
        });
        if !is_known && candidate.rms < 10.0 * kept.first().map_or(f64::MAX, |b| b.rms.max(1e-9)) {
            kept.push(candidate);
        }
    }
    kept
}

/// Five unknowns, five points.
const FEWEST: usize = 5;

/// `second^T E first = 0`: the four stations of an essential matrix.
fn from_essential(first: &[Vector2<f64>], second: &[Vector2<f64>]) -> Vec<Station> {
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (a, b) in first.iter().zip(second) {
        let row = SVector::<f64, 9>::from_column_slice(&[
            b.x * a.x,
            b.x * a.y,
            b.x,
            b.y * a.x,
            b.y * a.y,
            b.y,
            a.x,
            a.y,
            1.0,
        ]);
        normal += row * row.transpose();
    }
    let eigen = normal.symmetric_eigen();
    let e = Matrix3::from_row_slice(eigen.eigenvectors.column(eigen.eigenvalues.imin()).as_slice());
    let svd = e.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Vec::new() };
    let u = u * u.determinant().signum();
    let v_t = v_t * v_t.determinant().signum();
    let quarter = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let base: Vector3<f64> = u.column(2).into();
    [quarter, quarter.transpose()]
        .into_iter()
        .flat_map(|w| {
            let rotation = u * w * v_t;
            [base, -base].map(|t| station(&rotation, &t))
        })
        .collect()
}

/// The four stations that a plane's homography (first to second) allows.
fn from_homography(h: &Matrix3<f64>) -> Vec<Station> {
    let middle = {
        let mut values: Vec<f64> = h.singular_values().iter().copied().collect();
        values.sort_by(f64::total_cmp);
        values[1]
    };
    let h = h * (h.determinant().signum() / middle);
    let eigen = (h.transpose() * h).symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let [v1, v2, v3]: [Vector3<f64>; 3] = order.map(|i| eigen.eigenvectors.column(i).into());
    let [large, _, small] = order.map(|i| eigen.eigenvalues[i]);
    let spread = (large - small).sqrt();
    if spread < 1e-9 {
        return Vec::new();
    }
    let (a, b) = ((1.0 - small).max(0.0).sqrt() / spread, (large - 1.0).max(0.0).sqrt() / spread);
    [v1 * a + v3 * b, v1 * a - v3 * b]
        .into_iter()
        .flat_map(|u| {
            let normal = v2.cross(&u);
            let from = Matrix3::from_columns(&[v2, u, normal]);
            let to = Matrix3::from_columns(&[h * v2, h * u, (h * v2).cross(&(h * u))]);
            let rotation = to * from.transpose();
            let base = (h - rotation) * normal;
            [base, -base].map(|t| station(&rotation, &t))
        })
        .collect()
}

/// The station of `second_from_first`, its base of length 1.
fn station(rotation: &Matrix3<f64>, translation: &Vector3<f64>) -> Station {
    let mut back = Rotation3::from_matrix_unchecked(rotation.transpose());
    back.renormalize();
    let centre = -(back * translation);
    Station { centre: centre.try_normalize(1e-12).unwrap_or_else(Vector3::x), rotation: back }
}

/// Signed Sampson distance of a pair.
fn sampson(second: &Station, a: &Vector2<f64>, b: &Vector2<f64>) -> f64 {
    let e = second.rotation.matrix().transpose() * second.centre.cross_matrix();
    let (a, b) = (a.push(1.0), b.push(1.0));
    let (to, back) = (e * a, e.transpose() * b);
    b.dot(&to) / (to.xy().norm_squared() + back.xy().norm_squared()).sqrt().max(1e-300)
}

/// A station moved by (turn, way of the base across itself).
fn moved(second: &Station, step: &SVector<f64, 5>) -> Station {
    let axis = if second.centre.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
    let across = second.centre.cross(&axis).normalize();
    let up = second.centre.cross(&across);
    let centre = (second.centre + across * step[3] + up * step[4]).normalize();
    let mut rotation = Rotation3::new(Vector3::new(step[0], step[1], step[2])) * second.rotation;
    rotation.renormalize();
    Station { centre, rotation }
}

/// Levenberg-Marquardt with numeric slopes: five unknowns, and only a start value.
fn refine(first: &[Vector2<f64>], second: &[Vector2<f64>], start: Station) -> RelativeOrientation {
    const H: f64 = 1e-6;
    let cost = |s: &Station| -> f64 {
        first.iter().zip(second).map(|(a, b)| sampson(s, a, b).powi(2)).sum()
    };
    let (mut station, mut now, mut damping) = (start, cost(&start), 1e-3);
    for _ in 0..50 {
        let nudged: [Station; 5] = std::array::from_fn(|i| {
            let mut step = SVector::<f64, 5>::zeros();
            step[i] = H;
            moved(&station, &step)
        });
        let mut normal = SMatrix::<f64, 5, 5>::zeros();
        let mut gradient = SVector::<f64, 5>::zeros();
        for (a, b) in first.iter().zip(second) {
            let value = sampson(&station, a, b);
            let slope = SVector::<f64, 5>::from_fn(|i, _| (sampson(&nudged[i], a, b) - value) / H);
            normal += slope * slope.transpose();
            gradient -= slope * value;
        }
        let damped = normal + SMatrix::from_diagonal(&(normal.diagonal() * damping));
        let Some(factor) = damped.cholesky() else { break };
        let candidate = moved(&station, &factor.solve(&gradient));
        let next = cost(&candidate);
        if next < now {
            let is_done = now - next < 1e-12 * now;
            (station, now, damping) = (candidate, next, (damping * 0.1).max(1e-9));
            if is_done {
                break;
            }
        } else if damping > 1e6 {
            break;
        } else {
            damping *= 10.0;
        }
    }
    RelativeOrientation { second: station, rms: (now / first.len() as f64).sqrt() }
}

/// True where nine in ten points lie in front of both cameras.
fn are_in_front(first: &[Vector2<f64>], second: &[Vector2<f64>], station: &Station) -> bool {
    let origin = Station { centre: Vector3::zeros(), rotation: Rotation3::identity() };
    let in_front = first
        .iter()
        .zip(second)
        .filter(|(a, b)| {
            triangulate(&[(&origin, **a), (station, **b)])
                .is_some_and(|p| p.z > 0.0 && station.station_point(&p).z > 0.0)
        })
        .count();
    10 * in_front >= 9 * first.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn see(station: &Station, points: &[Vector3<f64>]) -> Vec<Vector2<f64>> {
        let local = points.iter().map(|p| station.station_point(p));
        local.map(|p| Vector2::new(p.x / p.z, p.y / p.z)).collect()
    }

    #[track_caller]
    fn check(depth: f64) {
        let first = Station { centre: Vector3::zeros(), rotation: Rotation3::identity() };
        let second = Station {
            centre: Vector3::new(0.9, -0.2, 0.3).normalize(),
            rotation: Rotation3::from_euler_angles(0.1, -0.5, 0.3),
        };
        let points: Vec<Vector3<f64>> = (0..20)
            .map(|i| {
                let (x, y) = (f64::from(i % 5) * 0.2 - 0.4, f64::from(i / 5) * 0.25 - 0.4);
                Vector3::new(x, y, 2.0 + 0.2 * x + depth * f64::from(i * 7 % 5))
            })
            .collect();
        let found = relative_orientations(&see(&first, &points), &see(&second, &points));
        let is_it = |o: &RelativeOrientation| {
            (o.second.centre - second.centre).norm() < 1e-6
                && o.second.rotation.angle_to(&second.rotation) < 1e-6
        };
        assert!(found.iter().any(is_it), "depth {depth}: {found:?}");
    }

    #[test]
    fn cameras_are_oriented_on_points_in_space_and_on_a_plane() {
        check(0.1);
        check(0.0);
    }

    #[test]
    fn four_points_are_too_few() {
        let four = vec![Vector2::zeros(); 4];
        assert_eq!(relative_orientations(&four, &four), []);
    }
}
