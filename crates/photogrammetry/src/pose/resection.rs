//! Resection: the pose of a projective instrument from points of known place and the directions in
//! which it sees them (a camera), or sends beams to them (the module).
//!
//! Start: homography between the points' best plane and the normalised image (Zhang 2000), both
//! poses of the planar ambiguity (Schweighofer and Pinz 2006: the second has its normal mirrored
//! about the line of sight); then Levenberg-Marquardt on the true, not necessarily flat, points.

use nalgebra::{Matrix3, Matrix6, Rotation3, SMatrix, SVector, Vector2, Vector3, Vector6};

/// A projective instrument in the world: centre and rotation. A point X of the world is at
/// `rotation.transpose() * (X - centre)` in its frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Station {
    /// Projection centre in the world, mm.
    pub centre: Vector3<f64>,
    /// `world_from_station`.
    pub rotation: Rotation3<f64>,
}

impl Station {
    /// A point of the world in this station's frame.
    #[must_use]
    pub fn station_point(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation.inverse() * (point - self.centre)
    }

    /// This station moved by (centre, small rotation about the world axes).
    #[must_use]
    pub fn moved(&self, step: &Vector6<f64>) -> Self {
        let turn = Vector3::new(step[3], step[4], step[5]);
        let mut rotation = Rotation3::new(turn) * self.rotation;
        rotation.renormalize();
        Self { centre: self.centre + Vector3::new(step[0], step[1], step[2]), rotation }
    }

    /// A station from `station_from_world` as rotation matrix and translation.
    fn from_station_from_world(rotation: &Matrix3<f64>, translation: &Vector3<f64>) -> Self {
        let mut world_from_station = Rotation3::from_matrix_unchecked(rotation.transpose());
        world_from_station.renormalize();
        Self { centre: -(world_from_station * translation), rotation: world_from_station }
    }
}

/// The station that sees `points` (world, mm) at `directions` (x/z, y/z in its frame): the better
/// of the two poses that a flat set of points allows, all points in front.
///
/// `None` with fewer than four points, points on a line, or no pose with all points in front.
#[must_use]
pub fn resect(points: &[Vector3<f64>], directions: &[Vector2<f64>]) -> Option<Station> {
    if points.len() < 4 || points.len() != directions.len() {
        return None;
    }
    let plane = Plane::through(points)?;
    let start = from_homography(&plane, points, directions)?;
    let mirrored = mirror(&start, &plane);
    [start, mirrored]
        .into_iter()
        .filter_map(|start| refine(points, directions, start))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, station)| station)
}

/// The best plane of some points: origin and an orthonormal frame whose third axis is the normal.
struct Plane {
    origin: Vector3<f64>,
    frame: Matrix3<f64>,
}

impl Plane {
    fn through(points: &[Vector3<f64>]) -> Option<Self> {
        let origin = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
        let scatter: Matrix3<f64> =
            points.iter().map(|p| (p - origin) * (p - origin).transpose()).sum();
        let eigen = scatter.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        if eigen.eigenvalues[order[1]] < 1e-8 * eigen.eigenvalues[order[0]] {
            return None;
        }
        let u: Vector3<f64> = eigen.eigenvectors.column(order[0]).into();
        let v: Vector3<f64> = eigen.eigenvectors.column(order[1]).into();
        Some(Self { origin, frame: Matrix3::from_columns(&[u, v, u.cross(&v)]) })
    }

    fn flat(&self, point: &Vector3<f64>) -> Vector2<f64> {
        (self.frame.transpose() * (point - self.origin)).xy()
    }
}

/// The pose from the homography plane -> normalised image.
fn from_homography(
    plane: &Plane,
    points: &[Vector3<f64>],
    directions: &[Vector2<f64>],
) -> Option<Station> {
    let flat: Vec<Vector2<f64>> = points.iter().map(|p| plane.flat(p)).collect();
    let h = homography(&flat, directions)?;
    let scale = (h.column(0).norm() + h.column(1).norm()) / 2.0;
    // The plane's origin is in front of the station.
    let h = h * (h[(2, 2)].signum() / scale);
    let (a, b): (Vector3<f64>, Vector3<f64>) = (h.column(0).into(), h.column(1).into());
    let svd = Matrix3::from_columns(&[a, b, a.cross(&b)]).svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let sign = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant().signum()));
    let station_from_plane = u * sign * v_t;
    let station_from_world = station_from_plane * plane.frame.transpose();
    let translation = Vector3::from(h.column(2)) - station_from_world * plane.origin;
    Some(Station::from_station_from_world(&station_from_world, &translation))
}

/// The other pose that shows a flat set of points almost alike: the plane's normal mirrored about
/// the line of sight to its origin.
fn mirror(station: &Station, plane: &Plane) -> Station {
    let sight = station.station_point(&plane.origin);
    let axis = sight.normalize();
    let normal = station.rotation.inverse() * Vector3::from(plane.frame.column(2));
    let mirrored = axis * (2.0 * axis.dot(&normal)) - normal;
    // The turn that brings the plane's normal there, about an axis through the plane's origin.
    let normal_to = if mirrored.dot(&normal) < 0.0 { -mirrored } else { mirrored };
    let turn = Rotation3::rotation_between(&normal, &normal_to).unwrap_or_default();
    let station_from_world = turn * station.rotation.inverse();
    let translation = sight - station_from_world * plane.origin;
    Station::from_station_from_world(station_from_world.matrix(), &translation)
}

/// The homography that maps `from` to `to`, by the normalised direct linear transform
/// (Hartley 1997), of unit norm. `None` when the points do not determine it.
#[must_use]
pub(crate) fn homography(from: &[Vector2<f64>], to: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    if from.len() < 4 {
        return None;
    }
    let (t_from, t_to) = (conditioning(from)?, conditioning(to)?);
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (a, b) in from.iter().zip(to) {
        let p = t_from * a.push(1.0);
        let q = t_to * b.push(1.0);
        let row_x = SVector::<f64, 9>::from_row_slice(&[
            p.x,
            p.y,
            1.0,
            0.0,
            0.0,
            0.0,
            -q.x * p.x,
            -q.x * p.y,
            -q.x,
        ]);
        let row_y = SVector::<f64, 9>::from_row_slice(&[
            0.0,
            0.0,
            0.0,
            p.x,
            p.y,
            1.0,
            -q.y * p.x,
            -q.y * p.y,
            -q.y,
        ]);
        normal += row_x * row_x.transpose() + row_y * row_y.transpose();
    }
    let eigen = normal.symmetric_eigen();
    let h = Matrix3::from_row_slice(eigen.eigenvectors.column(eigen.eigenvalues.imin()).as_slice());
    Some(t_to.try_inverse()? * h * t_from)
}

/// Shifts and scales points to mean zero and mean distance root two.
fn conditioning(points: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    let n = points.len() as f64;
    let mean = points.iter().sum::<Vector2<f64>>() / n;
    let spread = points.iter().map(|p| (p - mean).norm()).sum::<f64>() / n;
    if spread <= 0.0 {
        return None;
    }
    let s = std::f64::consts::SQRT_2 / spread;
    Some(Matrix3::new(s, 0.0, -s * mean.x, 0.0, s, -s * mean.y, 0.0, 0.0, 1.0))
}

/// Levenberg-Marquardt on the direction residuals. `None` when a point comes to lie behind.
fn refine(
    points: &[Vector3<f64>],
    directions: &[Vector2<f64>],
    start: Station,
) -> Option<(f64, Station)> {
    let mut station = start;
    let (mut cost, mut hessian, mut gradient) = normal_equations(points, directions, &station)?;
    let mut damping = 1e-4;
    for _ in 0..60 {
        let damped = hessian + Matrix6::from_diagonal(&(hessian.diagonal() * damping));
        let step = damped.cholesky()?.solve(&gradient);
        let candidate = station.moved(&step);
        match normal_equations(points, directions, &candidate) {
            Some((new_cost, h, g)) if new_cost <= cost => {
                let done = cost - new_cost <= 1e-14 * cost;
                (station, cost, hessian, gradient) = (candidate, new_cost, h, g);
                damping = (damping * 0.1).max(1e-12);
                if done {
                    break;
                }
            }
            _ => {
                damping *= 10.0;
                if damping > 1e8 {
                    break;
                }
            }
        }
    }
    Some((cost, station))
}

fn normal_equations(
    points: &[Vector3<f64>],
    directions: &[Vector2<f64>],
    station: &Station,
) -> Option<(f64, Matrix6<f64>, Vector6<f64>)> {
    let station_from_world = station.rotation.inverse().into_inner();
    let (mut cost, mut hessian, mut gradient) = (0.0, Matrix6::zeros(), Vector6::zeros());
    for (point, direction) in points.iter().zip(directions) {
        let arm = point - station.centre;
        let p = station_from_world * arm;
        if p.z <= 1e-9 {
            return None;
        }
        let residual = direction - Vector2::new(p.x / p.z, p.y / p.z);
        let by_point = SMatrix::<f64, 2, 3>::new(
            1.0 / p.z,
            0.0,
            -p.x / (p.z * p.z),
            0.0,
            1.0 / p.z,
            -p.y / (p.z * p.z),
        );
        let by_centre = -by_point * station_from_world;
        let by_turn = by_point * station_from_world * arm.cross_matrix();
        let mut j = SMatrix::<f64, 2, 6>::zeros();
        j.fixed_columns_mut::<3>(0).copy_from(&by_centre);
        j.fixed_columns_mut::<3>(3).copy_from(&by_turn);
        cost += residual.norm_squared();
        hessian += j.transpose() * j;
        gradient += j.transpose() * residual;
    }
    Some((cost, hessian, gradient))
}

/// Triangulates a point from rays (station, normalised direction) by linear least squares.
/// `None` for fewer than two rays or parallel ones.
#[must_use]
pub(crate) fn triangulate(rays: &[(&Station, Vector2<f64>)]) -> Option<Vector3<f64>> {
    if rays.len() < 2 {
        return None;
    }
    let mut a = Matrix3::zeros();
    let mut b = Vector3::zeros();
    for (station, direction) in rays {
        let along = (station.rotation * direction.push(1.0)).normalize();
        let across = Matrix3::identity() - along * along.transpose();
        a += across;
        b += across * station.centre;
    }
    let smallest = a.symmetric_eigenvalues().min();
    (smallest > 1e-6).then(|| a.cholesky().map(|c| c.solve(&b)))?
}

#[cfg(test)]
mod tests {
    use super::*;

    fn look_at(centre: Vector3<f64>, target: Vector3<f64>) -> Station {
        let z = (target - centre).normalize();
        let x = z.cross(&Vector3::y()).normalize();
        let y = z.cross(&x);
        Station {
            centre,
            rotation: Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, z])),
        }
    }

    fn see(station: &Station, points: &[Vector3<f64>]) -> Vec<Vector2<f64>> {
        points
            .iter()
            .map(|p| station.station_point(p))
            .map(|p| Vector2::new(p.x / p.z, p.y / p.z))
            .collect()
    }

    #[test]
    fn a_station_is_found_from_flat_and_from_solid_points() {
        let station =
            look_at(Vector3::new(-1500.0, 700.0, 1900.0), Vector3::new(-300.0, 200.0, 0.0));
        for depth in [0.0, 12.0, 150.0] {
            let points: Vec<_> = (0..8)
                .map(|i| {
                    let (x, y) = (f64::from(i % 3) * 120.0, f64::from(i / 3) * 190.0);
                    Vector3::new(100.0 + x, y, if i % 2 == 0 { depth } else { 0.0 })
                })
                .collect();
            let found = resect(&points, &see(&station, &points)).unwrap();
            assert!((found.centre - station.centre).norm() < 1e-5, "depth {depth}");
            assert!((found.rotation.matrix() - station.rotation.matrix()).norm() < 1e-8);
        }
    }

    #[test]
    fn three_points_or_points_on_a_line_are_refused() {
        let line: Vec<_> = (0..6).map(|i| Vector3::new(f64::from(i), 0.0, 0.0)).collect();
        let directions = vec![Vector2::zeros(); 6];
        assert_eq!(resect(&line, &directions), None);
        assert_eq!(resect(&line[..3], &directions[..3]), None);
    }

    #[test]
    fn rays_meet_in_the_point_they_come_from() {
        let point = Vector3::new(-420.0, 200.0, 3.0);
        let stations = [
            look_at(Vector3::new(-1500.0, 700.0, 1900.0), Vector3::zeros()),
            look_at(Vector3::new(900.0, 600.0, 1900.0), Vector3::zeros()),
        ];
        let rays: Vec<_> = stations.iter().map(|s| (s, see(s, &[point])[0])).collect();
        assert!((triangulate(&rays).unwrap() - point).norm() < 1e-9);
        assert_eq!(triangulate(&rays[..1]), None);
    }
}
