//! Dots in space with their covariance, and the fan that made them: what the module is found from.

use nalgebra::{DMatrix, Matrix3, Vector3};

use crate::pattern::{Order, Pattern};

/// The fan of beams as it shone.
#[derive(Debug, Clone, Copy)]
pub struct Fan<'a> {
    /// The calibrated pattern; `u.angle_deg` of it is the uncertainty of each beam alone.
    pub pattern: &'a Pattern,
    /// Relative scale: wavelength over reference wavelength, minus one.
    pub scale: f64,
    /// Its standard uncertainty, wavelength and calibration together.
    pub scale_sigma: f64,
}

impl Fan<'_> {
    /// Standard uncertainty of one beam's direction per axis, radians.
    #[must_use]
    pub fn beam_sigma(&self) -> f64 {
        self.pattern.u.angle_deg.to_radians()
    }

    /// A beam's unit direction and its derivative by the scale. `None` for an order that the
    /// pattern does not have or that does not leave the grating.
    #[must_use]
    pub fn beam(&self, order: Order) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let d = self.pattern.direction(order, self.scale)?;
        let s = 1.0 + self.scale;
        let slope = Vector3::new(d.x / s, d.y / s, -(d.x * d.x + d.y * d.y) / (s * d.z));
        Some((d, slope))
    }
}

/// Dots in space. Their covariance is `diag(own) + common common^T`: what each has alone (its image
/// points), and what all follow together (cameras, artefact).
#[derive(Debug, Clone, PartialEq)]
pub struct DotField {
    /// The beam of each dot.
    pub orders: Vec<Order>,
    /// Its place, world, mm.
    pub places: Vec<Vector3<f64>>,
    /// Its own covariance, mm squared.
    pub own: Vec<Matrix3<f64>>,
    /// Three rows a dot, one column for each common error of standard deviation one, mm.
    pub common: DMatrix<f64>,
}

impl DotField {
    /// Dots of equal uncorrelated coordinates of standard deviation `sigma`, mm.
    #[must_use]
    pub fn uniform(orders: Vec<Order>, places: Vec<Vector3<f64>>, sigma: f64) -> Self {
        let own = vec![Matrix3::identity() * (sigma * sigma); places.len()];
        let common = DMatrix::zeros(3 * places.len(), 0);
        Self { orders, places, own, common }
    }

    /// How dot `i` follows the common errors: 3 rows.
    pub(super) fn follows(&self, i: usize) -> nalgebra::DMatrixView<'_, f64> {
        self.common.view((3 * i, 0), (3, self.common.ncols()))
    }
}
