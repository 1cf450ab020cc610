//! The pattern: the directions of the beams as the grating sends them out.
//!
//! Beam (m, n): m counts columns from the centre to the right, n rows from the centre downwards,
//! as seen from the module. With the wavelength the direction cosines scale (eq. 4.11,
//! `d sin(theta) = m lambda`), not the angles.

mod angles;
mod file;
mod table;

pub use angles::{AnglePair, angle_between, neighbour_pairs};
pub use file::{PatternFileError, read_pattern, read_pattern_with, write_pattern};
pub use table::read_table;

use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// A beam's order: column m to the right, row n downwards, from the centre.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Order {
    /// Column.
    pub m: i32,
    /// Row.
    pub n: i32,
}

/// One beam: its order and its unit direction in the module frame (x right, y down, z forward).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beam {
    /// The order.
    pub order: Order,
    /// The direction, of unit length.
    pub direction: Vector3<f64>,
}

/// How directions follow from orders, at the reference wavelength.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum PatternModel {
    /// Eq. 4.17: a square grid with a radial term on a plane.
    RadialGrid {
        /// Grid pitch on that plane.
        pitch_mm: f64,
        /// Radial term.
        k1_per_mm2: f64,
        /// Distance of that plane.
        distance_mm: f64,
    },
    /// Each beam's direction, row by row from the top left, as (x, y) on the plane z = 1.
    Table {
        /// `rows * columns` entries.
        tangents: Vec<[f64; 2]>,
    },
}

/// What the pattern's calibration is worth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PatternUncertainty {
    /// Standard uncertainty of one beam alone, per axis, degrees.
    pub angle_deg: f64,
    /// Relative standard uncertainty common to all beams.
    pub common_relative: f64,
}

/// A calibrated pattern.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pattern {
    /// Number of columns, odd.
    pub columns: u32,
    /// Number of rows, odd.
    pub rows: u32,
    /// Wavelength in vacuum at which the model holds.
    pub reference_wavelength_nm: f64,
    /// The model.
    pub model: PatternModel,
    /// Its uncertainty.
    pub u: PatternUncertainty,
    /// How many times brighter the zero order is than its neighbours, if known.
    pub zero_order_relative_intensity: Option<f64>,
}

impl Pattern {
    /// The fan in which every pair of horizontal and vertical neighbours encloses `step_rad`
    /// (appendix E: a net of equal rhombi on the sphere, straight along the middle row and column),
    /// `size` beams a side, uncertainties zero but for `u`.
    #[must_use]
    pub fn equal_angle(size: u32, step_rad: f64, u: PatternUncertainty) -> Self {
        let half = (size / 2) as i32;
        let quadrant = equal_angle_quadrant(half as usize, step_rad);
        let mut tangents = Vec::new();
        for n in -half..=half {
            for m in -half..=half {
                let d = quadrant[n.unsigned_abs() as usize][m.unsigned_abs() as usize];
                let (x, y) = (d.x / d.z, d.y / d.z);
                tangents.push([x * f64::from(m.signum()), y * f64::from(n.signum())]);
            }
        }
        Self {
            columns: size,
            rows: size,
            reference_wavelength_nm: 658.0,
            model: PatternModel::Table { tangents },
            u,
            zero_order_relative_intensity: None,
        }
    }

    /// All orders, row by row from the top left.
    pub fn orders(&self) -> impl Iterator<Item = Order> + use<> {
        let (half_m, half_n) = ((self.columns / 2) as i32, (self.rows / 2) as i32);
        (-half_n..=half_n).flat_map(move |n| (-half_m..=half_m).map(move |m| Order { m, n }))
    }

    /// True where the pattern has this order.
    #[must_use]
    pub fn contains(&self, order: Order) -> bool {
        order.m.unsigned_abs() <= self.columns / 2 && order.n.unsigned_abs() <= self.rows / 2
    }

    /// The place of an order in [`Pattern::orders`].
    #[must_use]
    pub fn index(&self, order: Order) -> Option<usize> {
        let column = usize::try_from(order.m + (self.columns / 2) as i32).ok()?;
        let row = usize::try_from(order.n + (self.rows / 2) as i32).ok()?;
        (self.contains(order)).then_some(row * self.columns as usize + column)
    }

    /// The direction of a beam as (x, y) on the plane z = 1, at the reference wavelength.
    /// `None` for an order that the pattern does not have.
    #[must_use]
    pub fn tangent(&self, order: Order) -> Option<Vector2<f64>> {
        let index = self.index(order)?;
        let (m, n) = (f64::from(order.m), f64::from(order.n));
        match &self.model {
            PatternModel::RadialGrid { pitch_mm, k1_per_mm2, distance_mm } => {
                let at = Vector2::new(m * pitch_mm, n * pitch_mm);
                Some(at * ((1.0 + k1_per_mm2 * at.norm_squared()) / distance_mm))
            }
            PatternModel::Table { tangents } => {
                tangents.get(index).map(|t| Vector2::new(t[0], t[1]))
            }
        }
    }

    /// The unit direction of a beam when the wavelength is `1 + scale` times the reference.
    /// `None` for an order that the pattern does not have or that does not leave the grating.
    #[must_use]
    pub fn direction(&self, order: Order, scale: f64) -> Option<Vector3<f64>> {
        let t = self.tangent(order)?;
        let cosines = t * ((1.0 + scale) / (1.0 + t.norm_squared()).sqrt());
        let z2 = 1.0 - cosines.norm_squared();
        (z2 > 0.0).then(|| Vector3::new(cosines.x, cosines.y, z2.sqrt()))
    }

    /// All beams, row by row from the top left, at `1 + scale` times the reference wavelength.
    #[must_use]
    pub fn beams(&self, scale: f64) -> Vec<Beam> {
        self.orders()
            .filter_map(|order| {
                self.direction(order, scale).map(|direction| Beam { order, direction })
            })
            .collect()
    }

    /// `wavelength / reference - 1`.
    #[must_use]
    pub fn scale_at(&self, wavelength_nm: f64) -> f64 {
        wavelength_nm / self.reference_wavelength_nm - 1.0
    }
}

/// Beams of the lower right quadrant, by row and column: the middle row and column on great
/// circles, each further beam the fourth corner of a rhombus.
fn equal_angle_quadrant(half: usize, step: f64) -> Vec<Vec<Vector3<f64>>> {
    let mut beams = vec![vec![Vector3::z(); half + 1]; half + 1];
    for (k, beam) in beams[0].iter_mut().enumerate() {
        let (sine, cosine) = (k as f64 * step).sin_cos();
        *beam = Vector3::new(sine, 0.0, cosine);
    }
    for (k, row) in beams.iter_mut().enumerate() {
        let (sine, cosine) = (k as f64 * step).sin_cos();
        row[0] = Vector3::new(0.0, sine, cosine);
    }
    for row in 1..=half {
        for column in 1..=half {
            // Half a turn about the middle of the diagonal maps the near corner to the far one.
            let (right, down) = (beams[row - 1][column], beams[row][column - 1]);
            let middle = (right + down).normalize();
            let near = beams[row - 1][column - 1];
            beams[row][column] = middle * (2.0 * middle.dot(&near)) - near;
        }
    }
    beams
}
