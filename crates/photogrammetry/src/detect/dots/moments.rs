//! Normal equations of a dot from moments of its window.

use nalgebra::{SMatrix, SVector};

use super::window::{MAX_WINDOW, Row};
use crate::detect::lanes::{LANES, Lanes};

/// Parameters: amplitude, 2 of the centre, 3 of the shape, background.
pub(super) const PARAMETERS: usize = 7;
/// Weighted normal matrix of the fit.
pub(super) type Normal = SMatrix<f64, PARAMETERS, PARAMETERS>;
/// Right-hand side, or a step.
pub(super) type Step = SVector<f64, PARAMETERS>;

/// Powers of u and v of the six functions that multiply f.
pub(super) const POWERS: [(usize, usize); 6] = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)];

/// Sums down each column of a window: w f^2 v^k for k = 0..4; w f v^k and w e f v^k for k = 0..2;
/// w; w e.
const COLUMN_SUMS: usize = 13;

/// Moments of a window: columns are summed as the rows go by, and then with powers of u.
pub(super) struct Moments {
    columns: [[Lanes; MAX_WINDOW / LANES]; COLUMN_SUMS],
    /// How many of the lanes a row fills.
    used: usize,
}

impl Moments {
    /// None yet.
    pub(super) fn new() -> Self {
        Self { columns: [[Lanes::ZERO; MAX_WINDOW / LANES]; COLUMN_SUMS], used: 0 }
    }

    /// Adds a row.
    pub(super) fn add(&mut self, row: &Row) {
        let v = Lanes::all(row.v);
        self.used = row.f.len() / LANES;
        let chunks = row.f.chunks_exact(LANES).zip(row.e.chunks_exact(LANES));
        for (i, ((f, e), w)) in chunks.zip(row.w.chunks_exact(LANES)).enumerate() {
            let [f, e, w] = [f, e, w].map(Lanes::from_slice);
            let wf = w * f;
            let mut power = wf * f;
            for sums in &mut self.columns[..5] {
                sums[i] += power;
                power = power * v;
            }
            let (mut light, mut right) = (wf, wf * e);
            for k in 5..8 {
                self.columns[k][i] += light;
                self.columns[k + 3][i] += right;
                (light, right) = (light * v, right * v);
            }
            self.columns[11][i] += w;
            self.columns[12][i] += w * e;
        }
    }

    /// `sum_columns column[k] u^i`.
    fn sum(&self, k: usize, powers: &[[f32; MAX_WINDOW]; 5], i: usize) -> f64 {
        let power = powers[i].chunks_exact(LANES);
        let mut sum = Lanes::ZERO;
        for (column, power) in self.columns[k][..self.used].iter().zip(power) {
            sum += *column * Lanes::from_slice(power);
        }
        f64::from(sum.total())
    }

    /// Normal matrix and right-hand side in the order f, fu, fv, fu^2, fuv, fv^2, background.
    /// `first` is the offset of the first column from the centre.
    pub(super) fn equations(&self, first: f32) -> (Normal, Step) {
        let mut powers = [[1.0f32; MAX_WINDOW]; 5];
        let u: [f32; MAX_WINDOW] = std::array::from_fn(|i| first + i as f32);
        for k in 1..5 {
            powers[k] = std::array::from_fn(|i| powers[k - 1][i] * u[i]);
        }
        let ff: [[f64; 5]; 5] = std::array::from_fn(|i| {
            std::array::from_fn(|j| if i + j < 5 { self.sum(j, &powers, i) } else { 0.0 })
        });
        let low = |k: usize, i: usize| self.sum(k, &powers, i);
        let mut normal = Normal::zeros();
        let mut right = Step::zeros();
        for (a, &(i, j)) in POWERS.iter().enumerate() {
            for (b, &(k, l)) in POWERS.iter().enumerate() {
                normal[(a, b)] = ff[i + k][j + l];
            }
            normal[(a, 6)] = low(5 + j, i);
            normal[(6, a)] = normal[(a, 6)];
            right[a] = low(8 + j, i);
        }
        normal[(6, 6)] = low(11, 0);
        right[6] = low(12, 0);
        (normal, right)
    }
}

/// `f^2 m' A m + 2 f b.m + c` over the functions m of [`POWERS`]: a quadratic form of a pixel's
/// derivatives, as polynomials in u for one row.
pub(super) struct QuadraticForm {
    /// `[i][j]` goes with u^i v^j.
    quartic: [[f64; 5]; 5],
    linear: Polynomial,
    constant: f64,
}

/// `sum c_ij u^i v^j` up to the second order.
#[derive(Clone, Copy)]
pub(super) struct Polynomial([[f64; 3]; 3]);

impl Polynomial {
    /// From the coefficients in the order of [`POWERS`].
    pub(super) fn new(coefficients: impl Fn(usize) -> f64) -> Self {
        let mut all = [[0.0; 3]; 3];
        for (a, &(i, j)) in POWERS.iter().enumerate() {
            all[i][j] = coefficients(a);
        }
        Self(all)
    }

    /// Coefficients of 1, u, u^2 in a row.
    pub(super) fn row(&self, v: f32) -> [f32; 3] {
        let v = f64::from(v);
        self.0.map(|c| ((c[2] * v + c[1]) * v + c[0]) as f32)
    }
}

impl QuadraticForm {
    /// Of a symmetric matrix over the derivatives.
    pub(super) fn new(matrix: &Normal) -> Self {
        let mut quartic = [[0.0; 5]; 5];
        for (a, &(i, j)) in POWERS.iter().enumerate() {
            for (b, &(k, l)) in POWERS.iter().enumerate() {
                quartic[i + k][j + l] += matrix[(a, b)];
            }
        }
        let linear = Polynomial::new(|a| 2.0 * matrix[(a, 6)]);
        Self { quartic, linear, constant: matrix[(6, 6)] }
    }

    /// Its values along a row.
    pub(super) fn fill(&self, row: &Row, values: &mut [f32]) {
        let v = f64::from(row.v);
        let quartic =
            self.quartic.map(|c| ((((c[4] * v + c[3]) * v + c[2]) * v + c[1]) * v + c[0]) as f32);
        let linear = self.linear.row(row.v);
        let constant = self.constant as f32;
        for ((value, &u), &f) in values.iter_mut().zip(row.u).zip(row.f) {
            let [a, b, c, d, e] = quartic;
            let square = (((e * u + d) * u + c) * u + b) * u + a;
            let mixed = (linear[2] * u + linear[1]) * u + linear[0];
            *value = f * (f * square + mixed) + constant;
        }
    }
}
