//! Numbers as people read them: digits by the uncertainty, a true minus sign, derived angles.

use beampose_core::Pose;
use beampose_photogrammetry::rotation::{from_wxyz, omega_phi_kappa};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// What stands where there is no number.
pub const NONE: &str = "–";

/// Omega, phi, kappa in degrees.
pub fn omega_phi_kappa_deg(world_from_module: &UnitQuaternion<f64>) -> [f64; 3] {
    omega_phi_kappa(world_from_module).map(f64::to_degrees)
}

/// Standard uncertainties of omega, phi, kappa in degrees, from the covariance of the small
/// rotation about the world axes. NaN where phi is a right angle and they are not defined.
///
/// With `R = Rx Ry Rz` a small change turns the world by
/// `ex d_omega + Rx ey d_phi + Rx Ry ez d_kappa`.
pub fn omega_phi_kappa_u_deg(pose: &Pose) -> [f64; 3] {
    let [omega, phi, _] = omega_phi_kappa(&from_wxyz(pose.quaternion_wxyz));
    let rx = Rotation3::from_axis_angle(&Vector3::x_axis(), omega);
    let ry = Rotation3::from_axis_angle(&Vector3::y_axis(), phi);
    let turn = Matrix3::from_columns(&[Vector3::x(), rx * Vector3::y(), rx * (ry * Vector3::z())]);
    let covariance = Matrix3::from_fn(|i, j| pose.covariance[3 + i][3 + j]);
    match turn.try_inverse().filter(|_| phi.cos().abs() > 1e-6) {
        Some(inverse) => {
            let c = inverse * covariance * inverse.transpose();
            [0, 1, 2].map(|i| root(c[(i, i)]).to_degrees())
        }
        None => [f64::NAN; 3],
    }
}

/// The standard uncertainty of a variance; one that rounding made negative is 0, one that is no
/// number stays so (`f64::max` would make it 0, a very good measurement).
pub fn root(variance: f64) -> f64 {
    if variance < 0.0 { 0.0 } else { variance.sqrt() }
}

/// Decimals that show `u` with `digits` significant digits; 3 where `u` says nothing.
pub fn decimals(u: f64, digits: i32) -> usize {
    if !(u.is_finite() && u > 0.0) {
        return 3;
    }
    // 0.0996 with two digits is 0.10: the exponent is that of the rounded number.
    let exponent = u.log10().floor();
    let step = 10_f64.powf(exponent - f64::from(digits - 1));
    let rounded = (u / step).round() * step;
    let places = f64::from(digits - 1) - (rounded * (1.0 + 1e-12)).log10().floor();
    places.clamp(0.0, 6.0) as usize
}

/// A number with a true minus sign and never a negative zero; a dash for what is no number.
pub fn fixed(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return NONE.to_owned();
    }
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(rest) if rest.chars().all(|c| matches!(c, '0' | '.')) => rest.to_owned(),
        Some(rest) => format!("\u{2212}{rest}"),
        None => text,
    }
}

/// `0.12 ± 0.05 mm (k = 2)` with two digits of the expanded uncertainty (GUM 7.2.6).
pub fn with_expanded(value: f64, expanded: f64, unit: &str) -> String {
    if !(expanded.is_finite() && expanded > 0.0) {
        return format!("{} {unit}", fixed(value, 3));
    }
    let places = decimals(expanded, 2);
    format!("{} ± {} {unit} (k = 2)", fixed(value, places), fixed(expanded, places))
}

/// A dimensionless number with its expanded uncertainty.
pub fn bare_with_expanded(value: f64, expanded: f64) -> String {
    if !(expanded.is_finite() && expanded > 0.0) {
        return fixed(value, 5);
    }
    let places = decimals(expanded, 2);
    format!("{} ± {} (k = 2)", fixed(value, places), fixed(expanded, places))
}

/// Three significant digits, for numbers without an uncertainty of their own.
pub fn plain(value: f64) -> String {
    fixed(value, decimals(value.abs(), 3))
}

/// As [`plain`], without zeros at the end: for what somebody chose.
pub fn trimmed(value: f64) -> String {
    let text = plain(value);
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

/// As [`plain`], or a dash.
pub fn optional(value: Option<f64>) -> String {
    value.map_or_else(|| NONE.to_owned(), plain)
}

/// Two significant digits, for a scatter.
pub fn coarse(value: f64) -> String {
    fixed(value, decimals(value.abs(), 2))
}

/// `1 dot`, `2 dots`.
pub fn count(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}

/// A fraction as a percentage.
pub fn percent(fraction: Option<f64>) -> String {
    fraction.map_or_else(|| NONE.to_owned(), |f| format!("{} %", fixed(100.0 * f, 0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_follow_the_uncertainty() {
        let cases = [
            (0.1234, 0.0512, "0.123 ± 0.051 mm (k = 2)"),
            (-0.1234, 0.0182, "\u{2212}0.123 ± 0.018 mm (k = 2)"),
            (0.0004, 0.31, "0.00 ± 0.31 mm (k = 2)"),
            (12.3456, 0.0996, "12.35 ± 0.10 mm (k = 2)"),
            (0.21, 0.0, "0.210 mm"),
            (1234.5, 24.0, "1234 ± 24 mm (k = 2)"),
        ];
        for (value, expanded, text) in cases {
            assert_eq!(with_expanded(value, expanded, "mm"), text);
        }
    }

    #[test]
    fn there_is_no_negative_zero_and_no_nan() {
        assert_eq!(fixed(-0.0004, 2), "0.00");
        assert_eq!(fixed(f64::NAN, 2), NONE);
        assert_eq!(plain(0.0), "0.000");
        assert_eq!(
            (trimmed(30.0), trimmed(2.5), trimmed(0.0)),
            ("30".into(), "2.5".into(), "0".into())
        );
    }

    #[test]
    fn uncertainties_of_the_angles_are_those_of_finite_differences() {
        use beampose_photogrammetry::rotation::{from_omega_phi_kappa, wxyz};
        let q = from_omega_phi_kappa([0.3, -0.5, 1.1]);
        let sigma = [1e-3, 2e-3, 3e-3];
        let mut covariance = [[0.0; 6]; 6];
        let mut variance = [0.0; 3];
        for axis in 0..3 {
            covariance[3 + axis][3 + axis] = sigma[axis] * sigma[axis];
            let mut small = Vector3::zeros();
            small[axis] = 1e-6;
            let turned = omega_phi_kappa_deg(&(UnitQuaternion::from_scaled_axis(small) * q));
            let before = omega_phi_kappa_deg(&q);
            for i in 0..3 {
                variance[i] += ((turned[i] - before[i]) / 1e-6 * sigma[axis]).powi(2);
            }
        }
        let pose = Pose { position_mm: [0.0; 3], quaternion_wxyz: wxyz(&q), covariance };
        for (u, v) in omega_phi_kappa_u_deg(&pose).into_iter().zip(variance) {
            // One-sided differences of 1e-6 rad are good to about 1e-5 of the derivative.
            assert!((u / v.sqrt() - 1.0).abs() < 1e-4, "{u} {}", v.sqrt());
        }
    }
}
