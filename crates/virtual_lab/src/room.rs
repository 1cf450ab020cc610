//! What light meets: walls, which scatter it, and mirrors, which send it on.
//!
//! A mirror is flat, loses nothing, and is black on its back. A beam is followed by its axis: where
//! that misses the edge of a mirror, the whole of it does. Cameras look past mirrors and not into
//! them: what stands behind one is hidden, what is seen in one is left out.

use nalgebra::{Matrix3, Vector3};

use crate::config::{MirrorConfig, WallConfig};
use crate::geometry::plane_axes;

/// More reflections than any fold of a path has: a beam between two mirrors that face each other is
/// lost.
const MOST_REFLECTIONS: usize = 32;

/// A plane, bounded or not.
#[derive(Debug, Clone)]
struct Plane {
    point: Vector3<f64>,
    /// Columns: right, up, normal.
    axes: Matrix3<f64>,
    half_size: Option<[f64; 2]>,
}

/// Where a ray meets a wall.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hit {
    pub(crate) point: Vector3<f64>,
    pub(crate) normal: Vector3<f64>,
    /// In lengths of the ray's direction.
    pub(crate) distance: f64,
}

/// Where a beam comes to.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lit {
    /// On which wall; the distance is the whole way.
    pub(crate) hit: Hit,
    /// Where the beam seems to come from as it reaches the wall: its source, or the image of it in
    /// the mirrors on the way.
    pub(crate) origin: Vector3<f64>,
    /// Its direction there.
    pub(crate) along: Vector3<f64>,
}

/// The walls and mirrors of a world.
#[derive(Debug, Clone)]
pub(crate) struct Room {
    walls: Vec<Plane>,
    mirrors: Vec<Plane>,
}

impl Plane {
    fn new(point: [f64; 3], normal: [f64; 3], half_size: Option<[f64; 2]>) -> Self {
        let axes = plane_axes(&Vector3::from(normal));
        Self { point: Vector3::from(point), axes, half_size }
    }

    fn normal(&self) -> Vector3<f64> {
        self.axes.column(2).into_owned()
    }

    fn meet(&self, from: &Vector3<f64>, along: &Vector3<f64>) -> Option<Hit> {
        let normal = self.normal();
        let distance = normal.dot(&(self.point - from)) / normal.dot(along);
        if !(distance.is_finite() && distance > 1e-6) {
            return None;
        }
        let point = from + along * distance;
        if let Some([right, up]) = self.half_size {
            let on_wall = self.axes.tr_mul(&(point - self.point));
            if on_wall.x.abs() > right || on_wall.y.abs() > up {
                return None;
            }
        }
        Some(Hit { point, normal, distance })
    }
}

/// The first of these planes that a ray meets.
fn nearest<'a>(
    planes: &'a [Plane],
    from: &Vector3<f64>,
    along: &Vector3<f64>,
) -> Option<(Hit, &'a Plane)> {
    planes
        .iter()
        .filter_map(|plane| Some((plane.meet(from, along)?, plane)))
        .min_by(|(a, _), (b, _)| a.distance.total_cmp(&b.distance))
}

/// A direction after a mirror with this unit normal.
fn reflected(along: &Vector3<f64>, normal: &Vector3<f64>) -> Vector3<f64> {
    along - normal * (2.0 * normal.dot(along))
}

impl Room {
    pub(crate) fn new(walls: &[WallConfig], mirrors: &[MirrorConfig]) -> Self {
        let wall = |w: &WallConfig| Plane::new(w.point_mm, w.normal, w.half_size_mm);
        let mirror = |m: &MirrorConfig| Plane::new(m.point_mm, m.normal, Some(m.half_size_mm));
        Self {
            walls: walls.iter().map(wall).collect(),
            mirrors: mirrors.iter().map(mirror).collect(),
        }
    }

    /// The nearest wall that is seen along a ray; `None` where there is none, or a mirror before it.
    pub(crate) fn seen(&self, from: &Vector3<f64>, along: &Vector3<f64>) -> Option<Hit> {
        let (hit, _) = nearest(&self.walls, from, along)?;
        let is_before = |(mirror, _): (Hit, _)| mirror.distance < hit.distance;
        (!nearest(&self.mirrors, from, along).is_some_and(is_before)).then_some(hit)
    }

    /// Where a beam comes to, reflected at the mirrors that it meets; `along` is a unit vector.
    /// `None` where it meets no wall, ends on the back of a mirror, or goes to and fro for ever.
    pub(crate) fn lit(&self, source: &Vector3<f64>, along: &Vector3<f64>) -> Option<Lit> {
        let (mut from, mut origin, mut along) = (*source, *source, *along);
        let mut way = 0.0;
        for _ in 0..=MOST_REFLECTIONS {
            let wall = nearest(&self.walls, &from, &along).map(|(hit, _)| hit);
            let mirror = nearest(&self.mirrors, &from, &along)
                .filter(|(hit, _)| wall.is_none_or(|wall| hit.distance < wall.distance));
            let Some((hit, mirror)) = mirror else {
                let hit = wall.map(|hit| Hit { distance: way + hit.distance, ..hit })?;
                return Some(Lit { hit, origin, along });
            };
            if hit.normal.dot(&along) >= 0.0 {
                return None;
            }
            way += hit.distance;
            from = hit.point;
            origin = mirror.point + reflected(&(origin - mirror.point), &hit.normal);
            along = reflected(&along, &hit.normal);
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wall(point_mm: [f64; 3], half_size_mm: Option<[f64; 2]>) -> WallConfig {
        WallConfig { point_mm, normal: [0.0, 0.0, 1.0], half_size_mm }
    }

    fn mirror(point_mm: [f64; 3], normal: [f64; 3], half_size_mm: [f64; 2]) -> MirrorConfig {
        MirrorConfig { point_mm, normal, half_size_mm }
    }

    /// A floor plan: in at (0, 0, 500) towards -Z, to the right at one mirror, back to -Z at another.
    fn folded() -> Room {
        let mirrors = [
            mirror([0.0, 0.0, 200.0], [1.0, 0.0, 1.0], [40.0, 30.0]),
            mirror([300.0, 0.0, 200.0], [-1.0, 0.1, -1.0], [60.0, 50.0]),
        ];
        Room::new(&[wall([0.0; 3], None), wall([0.0, 0.0, 900.0], None)], &mirrors)
    }

    #[test]
    fn a_ray_meets_the_nearest_wall_that_is_large_enough() {
        let walls = [
            wall([0.0; 3], None),
            wall([0.0, 0.0, 100.0], Some([50.0, 10.0])),
            wall([0.0, 0.0, 900.0], None),
        ];
        let room = Room::new(&walls, &[]);
        let depth =
            |x: f64, y: f64| room.seen(&Vector3::new(x, y, 500.0), &-Vector3::z()).unwrap().point.z;
        assert_eq!([depth(0.0, 0.0), depth(40.0, 0.0), depth(0.0, 40.0)], [100.0, 100.0, 0.0]);
        let only = Room::new(&walls[..1], &[]);
        assert!(only.seen(&Vector3::z(), &Vector3::z()).is_none());
    }

    /// The image of a point in a plane: as far behind it as the point stands before it.
    fn image(point: &Vector3<f64>, on_plane: [f64; 3], normal: [f64; 3]) -> Vector3<f64> {
        let normal = Vector3::from(normal);
        let foot = (point - Vector3::from(on_plane)).dot(&normal) / normal.norm_squared();
        point - normal * (2.0 * foot)
    }

    /// Derived from the other end: the wall is imaged in the second mirror and then in the first, and
    /// the beam goes straight on to that image. No beam is reflected here.
    #[test]
    fn a_folded_beam_comes_to_where_it_would_meet_the_image_of_the_wall() {
        let room = folded();
        let first = ([0.0, 0.0, 200.0], [1.0, 0.0, 1.0]);
        let second = ([300.0, 0.0, 200.0], [-1.0, 0.1, -1.0]);
        let unfolded = |p: Vector3<f64>| image(&image(&p, second.0, second.1), first.0, first.1);
        let source = Vector3::new(3.0, -2.0, 500.0);
        for (x, y) in [(0.0, 0.0), (0.05, -0.02), (-0.04, 0.06), (0.0, 0.07)] {
            let along = Vector3::new(x, y, -1.0).normalize();
            let lit = room.lit(&source, &along).unwrap();
            // The image of the wall Z = 0, by three of its points.
            let [a, b, c] = [Vector3::zeros(), Vector3::x(), Vector3::y()].map(unfolded);
            let normal = (b - a).cross(&(c - a));
            let distance = normal.dot(&(a - source)) / normal.dot(&along);
            assert!((lit.hit.distance - distance).abs() < 1e-9, "{lit:?} {distance}");
            let meets = source + along * distance;
            assert!((unfolded(lit.hit.point) - meets).norm() < 1e-9, "{lit:?}");
            assert!(lit.hit.point.z.abs() < 1e-9);
            // Straight from the image of the source: that is where the dot's shape comes from.
            let back = lit.hit.point - lit.along * lit.hit.distance;
            assert!((back - lit.origin).norm() < 1e-9, "{lit:?}");
            let seems = image(&image(&source, first.0, first.1), second.0, second.1);
            assert!((seems - lit.origin).norm() < 1e-9, "{lit:?}");
        }
    }

    #[test]
    fn a_beam_that_misses_a_mirror_goes_on() {
        let room = folded();
        let lit = |x: f64, y: f64| room.lit(&Vector3::new(x, y, 500.0), &-Vector3::z()).unwrap();
        // The first mirror's half width of 40 mm is 28.3 mm across the beam.
        assert!(lit(28.0, 0.0).hit.point.x > 200.0);
        assert_eq!(lit(28.6, 0.0).hit.point, Vector3::new(28.6, 0.0, 0.0));
        assert_eq!(lit(0.0, 31.0).hit.point, Vector3::new(0.0, 31.0, 0.0));
        assert_eq!((lit(0.0, 31.0).hit.distance, lit(0.0, 31.0).origin.z), (500.0, 500.0));
    }

    #[test]
    fn a_mirror_is_black_behind_and_hides_what_is_behind_it() {
        let room = folded();
        let behind = Vector3::new(0.0, 0.0, 100.0);
        assert!(room.lit(&behind, &Vector3::z()).is_none());
        assert!(room.seen(&Vector3::new(0.0, 0.0, 500.0), &-Vector3::z()).is_none());
        assert!(room.seen(&behind, &-Vector3::z()).is_some());
    }

    #[test]
    fn a_beam_between_mirrors_that_face_each_other_is_lost() {
        let facing = [
            mirror([0.0; 3], [0.0, 0.0, 1.0], [10.0, 10.0]),
            mirror([0.0, 0.0, 100.0], [0.0, 0.0, -1.0], [10.0, 10.0]),
        ];
        let room = Room::new(&[wall([0.0, 0.0, -50.0], None)], &facing);
        assert!(room.lit(&Vector3::new(0.0, 0.0, 50.0), &Vector3::z()).is_none());
    }
}
