//! How the directions of the beams follow from a few parameters.

use nalgebra::{Rotation3, Vector2, Vector3};

use crate::pattern::Order;

/// A model of the fan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum FanModel {
    /// Eq. 4.17: a square grid with a radial term on a plane.
    RadialGrid,
    /// A crossed grating (eq. 4.2 in two directions): a period along each, the angle between them,
    /// its tilt against the incoming beam, and a radial term for what the projecting optics add.
    Grating,
}

/// A parameter of a model, as people read it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FanParameter {
    /// Its name, with the unit as a suffix.
    pub name: &'static str,
    /// What one unit inside is in the unit of the name, for a plane at a distance in mm and a
    /// wavelength in nm; periods go as its inverse.
    pub value: f64,
    /// The derivative of what people read by what is estimated.
    pub slope: f64,
}

impl FanModel {
    /// Every model, the simplest first.
    pub const ALL: [Self; 2] = [Self::RadialGrid, Self::Grating];

    /// The name in files and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::RadialGrid => "radial-grid",
            Self::Grating => "grating",
        }
    }

    /// Number of parameters.
    #[must_use]
    pub const fn count(self) -> usize {
        match self {
            Self::RadialGrid => 2,
            Self::Grating => 6,
        }
    }

    /// The names of the parameters.
    #[must_use]
    pub const fn names(self) -> &'static [&'static str] {
        match self {
            Self::RadialGrid => &["pitch_mm", "k1_per_mm2"],
            Self::Grating => &[
                "period_x_um",
                "period_y_um",
                "non_orthogonality_deg",
                "tilt_x_deg",
                "tilt_y_deg",
                "radial",
            ],
        }
    }

    /// Start values for neighbours that enclose `step` radians.
    #[must_use]
    pub fn start(self, step: f64) -> Vec<f64> {
        match self {
            Self::RadialGrid => vec![step.tan(), 0.0],
            Self::Grating => vec![step.sin(), step.sin(), 0.0, 0.0, 0.0, 0.0],
        }
    }

    /// The direction of a beam as (x, y) on the plane z = 1 at the reference wavelength; `None` for
    /// an order that does not leave the grating.
    ///
    /// Parameters of the radial grid: pitch over distance, and the radial term times the square of
    /// the distance. Of the grating: wavelength over period along x and along y, how far the second
    /// direction leans towards the first, tilt about x and about y (radians), radial term.
    #[must_use]
    pub fn tangent(self, parameters: &[f64], order: Order) -> Option<Vector2<f64>> {
        let (m, n) = (f64::from(order.m), f64::from(order.n));
        match (self, parameters) {
            (Self::RadialGrid, &[pitch, radial]) => {
                let at = Vector2::new(m * pitch, n * pitch);
                Some(at * (1.0 + radial * at.norm_squared()))
            }
            (Self::Grating, &[sx, sy, lean, tilt_x, tilt_y, radial]) => {
                let module_from_grating =
                    Rotation3::from_scaled_axis(Vector3::new(tilt_x, tilt_y, 0.0));
                // What comes in is what the zero order leaves as: the module's axis.
                let incoming = module_from_grating.inverse() * Vector3::z();
                let across =
                    incoming.xy() + Vector2::new(m * sx + n * sy * lean.sin(), n * sy * lean.cos());
                let z2 = 1.0 - across.norm_squared();
                let out = module_from_grating * across.push(z2.max(0.0).sqrt());
                let at = out.xy() / out.z;
                (z2 > 0.0 && out.z > 0.0).then(|| at * (1.0 + radial * at.norm_squared()))
            }
            _ => None,
        }
    }

    /// The direction of a beam when the wavelength is `1 + scale` times the reference: direction
    /// cosines scale (eq. 4.11), for both models as [`crate::Pattern::direction`] has it.
    #[must_use]
    pub fn direction(self, parameters: &[f64], order: Order, scale: f64) -> Option<Vector3<f64>> {
        let t = self.tangent(parameters, order)?;
        let cosines = t * ((1.0 + scale) / (1.0 + t.norm_squared()).sqrt());
        let z2 = 1.0 - cosines.norm_squared();
        (z2 > 0.0).then(|| cosines.push(z2.sqrt()))
    }

    /// The parameters as people read them: of the radial grid on a plane at `distance` mm, of the
    /// grating at the reference wavelength.
    #[must_use]
    pub fn read(self, parameters: &[f64], distance: f64, wavelength_nm: f64) -> Vec<FanParameter> {
        let degrees = 1f64.to_degrees();
        let one = |(i, name): (usize, &&'static str)| {
            let p = parameters.get(i).copied().unwrap_or(f64::NAN);
            let (value, slope) = match (self, i) {
                (Self::RadialGrid, 0) => (p * distance, distance),
                (Self::RadialGrid, _) => (p / distance.powi(2), distance.powi(-2)),
                (Self::Grating, 0 | 1) => {
                    let micrometres = wavelength_nm * 1e-3;
                    (micrometres / p, -micrometres / (p * p))
                }
                (Self::Grating, 2..=4) => (p * degrees, degrees),
                (Self::Grating, _) => (p, 1.0),
            };
            FanParameter { name, value, slope }
        };
        self.names().iter().enumerate().map(one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grating_follows_its_equation_and_its_zero_order_is_the_axis() {
        let tilt = 0.02;
        let parameters = [0.05, 0.05, 0.0, 0.0, tilt, 0.0];
        let tangent = |m, n| FanModel::Grating.tangent(&parameters, Order { m, n }).unwrap();
        assert!(tangent(0, 0).norm() < 1e-15);
        // Eq. 4.2 about the normal of the grating: the sines of both sides differ by m lambda / d.
        let out = tangent(3, 0).x.atan();
        assert!(((out - tilt).sin() - (-tilt).sin() - 0.15).abs() < 1e-15);
        assert!(tangent(3, 0).y.abs() < 1e-15);
    }

    #[test]
    fn what_people_read_has_the_stated_slope() {
        for model in FanModel::ALL {
            let at: Vec<f64> = (0..model.count()).map(|i| 0.05 + 0.01 * i as f64).collect();
            let here = model.read(&at, 1000.0, 658.0);
            for i in 0..model.count() {
                let mut next = at.clone();
                next[i] += 1e-7;
                let there = model.read(&next, 1000.0, 658.0)[i].value;
                let slope = (there - here[i].value) / 1e-7;
                assert!((slope / here[i].slope - 1.0).abs() < 1e-4, "{}", here[i].name);
            }
        }
    }
}
