//! The centre of a circle's image is not the image of its centre (Ahn, Warnecke and Kotowski 1999).
//! For targets of a few millimetres radius the offset is hundredths of a pixel: more than their
//! noise, so it is taken off.

use nalgebra::{Matrix3, Vector2, Vector3};

use crate::camera::Camera;
use crate::pose::Station;

/// The offset of the ellipse's centre from the image of the circle's centre, pixels: to be
/// subtracted from a measured ellipse centre. `None` where the circle has no whole image.
///
/// Exact for the projection by its dual conic `H diag(1, 1, -1) H^T`; the distortion is taken as
/// affine over the circle.
#[must_use]
pub fn circle_image_offset(
    camera: &Camera,
    station: &Station,
    centre: &Vector3<f64>,
    normal: &Vector3<f64>,
    radius: f64,
) -> Option<Vector2<f64>> {
    let at = station.station_point(centre);
    let normal = station.rotation.inverse() * normal.normalize();
    let u = normal.cross(&at).try_normalize(1e-9).unwrap_or_else(Vector3::x);
    let v = normal.cross(&u);
    let h = Matrix3::from_columns(&[u * radius, v * radius, at]);
    let dual = h * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0)) * h.transpose();
    if dual[(2, 2)] >= 0.0 || at.z <= 0.0 {
        return None;
    }
    let ellipse = Vector2::new(dual[(0, 2)], dual[(1, 2)]) / dual[(2, 2)];
    let exact = camera.project(&at)?;
    Some(camera.project(&ellipse.push(1.0))? - exact)
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    #[test]
    fn the_offset_is_that_of_the_projected_rim() {
        let camera = Camera {
            width: 3456,
            height: 2592,
            fx: 3529.0,
            fy: 3529.0,
            cx: 1727.5,
            cy: 1295.5,
            k1: 0.0,
            k2: 0.0,
            p1: 0.0,
            p2: 0.0,
            k3: 0.0,
        };
        let station = Station { centre: Vector3::zeros(), rotation: Rotation3::identity() };
        let centre = Vector3::new(500.0, 100.0, 2000.0);
        let normal = Vector3::new(0.7, 0.0, -0.7);
        let offset = circle_image_offset(&camera, &station, &centre, &normal, 20.0).unwrap();
        // The middle of opposite rim points is the ellipse's centre only for a conjugate pair; the
        // mean over the rim by area is: second moments by a polygon of many points.
        let u = normal.normalize().cross(&centre).normalize();
        let v = normal.normalize().cross(&u);
        let n = 3600;
        let rim: Vec<_> = (0..n)
            .map(|i| f64::from(i) / f64::from(n) * std::f64::consts::TAU)
            .map(|t| camera.project(&(centre + (u * t.cos() + v * t.sin()) * 20.0)).unwrap())
            .collect();
        let (mut area, mut moment) = (0.0, Vector2::zeros());
        for i in 0..rim.len() {
            let (a, b) = (rim[i], rim[(i + 1) % rim.len()]);
            let cross = a.x * b.y - b.x * a.y;
            area += cross / 2.0;
            moment += (a + b) * cross / 6.0;
        }
        let expected = moment / area - camera.project(&centre).unwrap();
        assert!((offset - expected).norm() < 1e-4, "{offset} {expected}");
        assert!(offset.norm() > 0.05);
    }
}
