//! Where the centre of a disc's image is measured, against the image of the disc's centre.
//!
//! `solve::circle_image_offset` takes the distortion as affine over the circle, which is right for
//! targets of a few pixels' radius. The dots of a calibration sheet are larger, and the distortion is
//! what is looked for: here the rim goes through the whole camera, and the centre is that of the
//! ellipse which fits it best.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use crate::camera::Camera;
use crate::pose::Station;

/// Points of the rim. The distortion changes the rim by harmonics up to the third: sixteen points
/// tell them apart exactly, and those that follow to rounding.
const RIM: usize = 16;

/// The offset of the measured centre from the image of the centre, pixels, of a disc that lies in
/// the sheet's plane: to be subtracted from what was measured. `None` where the disc has no whole
/// image.
pub(super) fn disc_image_offset(
    camera: &Camera,
    station: &Station,
    centre: &Vector3<f64>,
    radius: f64,
) -> Option<Vector2<f64>> {
    let at = station.station_point(centre);
    let axis = |v: Vector3<f64>| station.rotation.inverse() * v * radius;
    let h = Matrix3::from_columns(&[axis(Vector3::x()), axis(Vector3::y()), at]);
    // The dual conic of the image without distortion (Hartley and Zisserman 2004, section 8.3).
    let dual = h * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0)) * h.transpose();
    if dual[(2, 2)] >= 0.0 || at.z <= 0.0 {
        return None;
    }
    let dual = dual / dual[(2, 2)];
    let middle = Vector2::new(dual[(0, 2)], dual[(1, 2)]);
    let spread = middle * middle.transpose() - dual.fixed_view::<2, 2>(0, 0);
    let map = spread.cholesky()?.l();
    let mut rim = [Vector2::zeros(); RIM];
    for (point, unit) in rim.iter_mut().zip(units()) {
        *point = camera.project(&(middle + map * unit).push(1.0))?;
    }
    Some(fitted_centre(&rim)? - camera.project(&at)?)
}

/// Directions all around.
fn units() -> impl Iterator<Item = Vector2<f64>> {
    (0..RIM).map(|i| {
        let (sin, cos) = (std::f64::consts::TAU * i as f64 / RIM as f64).sin_cos();
        Vector2::new(cos, sin)
    })
}

/// The centre of the ellipse that is nearest to a rim. In the frame where the rim is a unit circle,
/// a shift of the centre changes the radius by its first harmonic, size and shape by the others.
fn fitted_centre(rim: &[Vector2<f64>; RIM]) -> Option<Vector2<f64>> {
    let n = RIM as f64;
    let mean = rim.iter().sum::<Vector2<f64>>() / n;
    let map: Matrix2<f64> = rim.iter().zip(units()).map(|(p, u)| p * u.transpose()).sum();
    let map = map * (2.0 / n);
    let back = map.try_inverse()?;
    let shift: Vector2<f64> =
        rim.iter().zip(units()).map(|(p, u)| u * ((back * (p - mean)).norm() - 1.0)).sum();
    Some(mean + map * shift * (2.0 / n))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation3, SMatrix, SVector};

    use super::*;
    use crate::solve::circle_image_offset;

    const CAMERA: Camera = Camera {
        k1: -0.12,
        k2: 0.05,
        p1: 8e-4,
        p2: -5e-4,
        ..Camera::without_distortion([640, 480], [610.0, 607.0], [325.0, 236.0])
    };

    fn station() -> Station {
        let rotation = Rotation3::from_euler_angles(0.25, -0.35, 0.4);
        Station { centre: rotation * Vector3::new(-170.0, -100.0, -400.0), rotation }
    }

    #[test]
    fn without_distortion_it_is_the_offset_of_the_conic() {
        let camera = Camera { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, ..CAMERA };
        let centre = Vector3::new(10.0, -5.0, 0.0);
        let here = disc_image_offset(&camera, &station(), &centre, 7.0).unwrap();
        let conic = circle_image_offset(&camera, &station(), &centre, &Vector3::z(), 7.0).unwrap();
        assert!((here - conic).norm() < 1e-9 && conic.norm() > 0.05, "{here} {conic}");
    }

    #[test]
    fn with_distortion_it_is_the_centre_of_the_conic_through_the_rim() {
        let (centre, radius) = (Vector3::new(10.0, -5.0, 0.0), 7.0);
        let at = |p: &Vector3<f64>| CAMERA.project(&station().station_point(p)).unwrap();
        let middle = at(&centre);
        let (mut normal, mut right) = (SMatrix::<f64, 5, 5>::zeros(), SVector::<f64, 5>::zeros());
        for i in 0..720 {
            let (sin, cos) = (f64::from(i) * std::f64::consts::TAU / 720.0).sin_cos();
            let p = (at(&(centre + Vector3::new(cos, sin, 0.0) * radius)) - middle) / 10.0;
            let row = SVector::from([p.x * p.x, p.x * p.y, p.y * p.y, p.x, p.y]);
            normal += row * row.transpose();
            right += row;
        }
        let c = normal.cholesky().unwrap().solve(&right);
        let quadratic = Matrix2::new(c[0], 0.5 * c[1], 0.5 * c[1], c[2]);
        let conic = -5.0 * quadratic.try_inverse().unwrap() * Vector2::new(c[3], c[4]);
        let here = disc_image_offset(&CAMERA, &station(), &centre, radius).unwrap();
        let affine =
            circle_image_offset(&CAMERA, &station(), &centre, &Vector3::z(), radius).unwrap();
        // The two fits weigh the rim a little differently: a tenth of what the affine map misses.
        let missed = (affine - conic).norm();
        assert!((here - conic).norm() < 0.1 * missed && missed > 5e-3, "{here} {conic} {affine}");
    }
}
