//! Rotations as people read them and as the store keeps them.
//!
//! Storage: unit quaternion (w, x, y, z) of `world_from_module`, module axes x right, y down,
//! z forward. For people: omega, phi, kappa of the dissertation (eq. 2.4), with photogrammetric
//! module axes (x right, y up, z back), so that a module that looks straight at the wall along -Z
//! reads 0, 0, 0.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Photogrammetric axes from machine-vision axes: half a turn about x.
fn flip() -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0))
}

/// Omega, phi, kappa in radians (eq. 2.4: `R = Rx(omega) Ry(phi) Rz(kappa)`).
#[must_use]
pub fn omega_phi_kappa(world_from_module: &UnitQuaternion<f64>) -> [f64; 3] {
    let r = world_from_module.to_rotation_matrix().into_inner() * flip();
    let phi = r[(0, 2)].clamp(-1.0, 1.0).asin();
    let omega = (-r[(1, 2)]).atan2(r[(2, 2)]);
    let kappa = (-r[(0, 1)]).atan2(r[(0, 0)]);
    [omega, phi, kappa]
}

/// The inverse of [`omega_phi_kappa`].
#[must_use]
pub fn from_omega_phi_kappa([omega, phi, kappa]: [f64; 3]) -> UnitQuaternion<f64> {
    let r = Rotation3::from_axis_angle(&Vector3::x_axis(), omega)
        * Rotation3::from_axis_angle(&Vector3::y_axis(), phi)
        * Rotation3::from_axis_angle(&Vector3::z_axis(), kappa);
    let matrix = r.into_inner() * flip();
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix))
}

/// (w, x, y, z) with w >= 0, so that equal rotations are equal numbers.
#[must_use]
pub fn wxyz(q: &UnitQuaternion<f64>) -> [f64; 4] {
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    [q.w * sign, q.i * sign, q.j * sign, q.k * sign]
}

/// The inverse of [`wxyz`].
#[must_use]
pub fn from_wxyz([w, x, y, z]: [f64; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z))
}

/// The matrix of the cross product: `cross(a) * b == a x b`.
#[must_use]
pub fn cross(a: &Vector3<f64>) -> Matrix3<f64> {
    a.cross_matrix()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_module_that_looks_straight_at_the_wall_reads_zero() {
        // z forward is -Z of the world, y down is -Y, x right stays X.
        let straight = from_omega_phi_kappa([0.0; 3]);
        let forward = straight * Vector3::z();
        assert!((forward + Vector3::z()).norm() < 1e-15);
        assert!((straight * Vector3::y() + Vector3::y()).norm() < 1e-15);
        assert_eq!(omega_phi_kappa(&straight), [0.0; 3]);
    }

    #[test]
    fn angles_come_back() {
        let angles = [0.3, -0.4, 1.2];
        let back = omega_phi_kappa(&from_omega_phi_kappa(angles));
        for (a, b) in angles.iter().zip(back) {
            assert!((a - b).abs() < 1e-14);
        }
    }
}
