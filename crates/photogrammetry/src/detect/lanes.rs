//! Single-precision arithmetic on whole arrays, in a form that the compiler does several at a time.
//!
//! Own functions rather than the system's: they vectorise, and give the same bits on every machine.
//! Sums run in [`LANES`] fixed lanes, so their order never depends on who calls.

use std::ops::{Add, AddAssign, Div, Mul, Sub};

use wide::f32x8;

/// Numbers that are summed side by side.
pub(super) const LANES: usize = 8;

/// `exp(x)` for x from -87 to 87 (beyond, the value there), relative error below 3e-7.
#[inline]
pub(super) fn exp(x: f32) -> f32 {
    // 1.5 * 2^23: adding it rounds to a whole number, whose bits are then in the mantissa.
    const ROUND: f32 = 12_582_912.0;
    let t = x.clamp(-87.0, 87.0) * std::f32::consts::LOG2_E;
    let rounded = t + ROUND;
    // ln(2) times the rest, from -0.35 to 0.35: seven terms of the series leave 1.3e-7.
    let r = (t - (rounded - ROUND)) * std::f32::consts::LN_2;
    let series = 1.0 / 720.0;
    let series = series * r + 1.0 / 120.0;
    let series = series * r + 1.0 / 24.0;
    let series = series * r + 1.0 / 6.0;
    let series = series * r + 0.5;
    let series = (series * r + 1.0) * r + 1.0;
    let exponent = rounded.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127);
    series * f32::from_bits(exponent << 23)
}

/// `ln(x)` for normal positive x, absolute error below 2e-7 next to 1, relative elsewhere.
#[inline]
pub(super) fn ln(x: f32) -> f32 {
    // Mantissa from sqrt(1/2) to sqrt(2), so that the series in z = (m - 1) / (m + 1) is short.
    const HALF_ROOT: u32 = 0x3f35_04f3;
    let shifted = x.to_bits().wrapping_sub(HALF_ROOT) as i32;
    let exponent = (shifted >> 23) as f32;
    let m = f32::from_bits(((shifted as u32) & 0x007f_ffff).wrapping_add(HALF_ROOT));
    let z = (m - 1.0) / (m + 1.0);
    let zz = z * z;
    let series = ((zz * (1.0 / 9.0) + 1.0 / 7.0) * zz + 0.2) * zz + 1.0 / 3.0;
    2.0 * z * (1.0 + zz * series) + exponent * std::f32::consts::LN_2
}

/// Numbers side by side. Explicitly so: left to itself, the compiler transposes sums that stand
/// beside each other, which costs more than it saves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lanes(f32x8);

impl Lanes {
    /// All zero.
    pub(super) const ZERO: Self = Self(f32x8::ZERO);

    /// These numbers.
    #[inline]
    pub(super) fn new(values: [f32; LANES]) -> Self {
        Self(f32x8::from(values))
    }

    /// The same number in all lanes.
    #[inline]
    pub(super) fn all(value: f32) -> Self {
        Self(f32x8::splat(value))
    }

    /// From a slice of [`LANES`] numbers; zeros from a shorter one.
    #[inline]
    pub(super) fn from_slice(values: &[f32]) -> Self {
        values.try_into().map_or(Self::ZERO, Self::new)
    }

    /// The numbers.
    #[inline]
    pub(super) fn values(&self) -> [f32; LANES] {
        self.0.to_array()
    }

    /// This where a number lies between two others, ends excluded, and zero elsewhere.
    #[inline]
    pub(super) fn where_between(self, low: Self, number: Self, high: Self) -> Self {
        Self(low.0.simd_lt(number.0) & number.0.simd_lt(high.0) & self.0)
    }

    /// The smaller of two, neither of which may be NaN.
    #[inline]
    pub(super) fn min(self, other: Self) -> Self {
        Self(self.0.fast_min(other.0))
    }

    /// Sum of the lanes.
    #[inline]
    pub(super) fn total(&self) -> f32 {
        let [a, b, c, d, e, f, g, h] = self.values();
        ((a + e) + (b + f)) + ((c + g) + (d + h))
    }
}

impl Add for Lanes {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }
}

impl Sub for Lanes {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        Self(self.0 - other.0)
    }
}

impl Mul for Lanes {
    type Output = Self;
    #[inline]
    fn mul(self, other: Self) -> Self {
        Self(self.0 * other.0)
    }
}

impl Div for Lanes {
    type Output = Self;
    #[inline]
    fn div(self, other: Self) -> Self {
        Self(self.0 / other.0)
    }
}

impl AddAssign for Lanes {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

/// Sums of products of an array with several others of the same length, a multiple of [`LANES`].
#[inline]
pub(super) fn dots<const N: usize>(a: &[f32], others: [&[f32]; N]) -> [f32; N] {
    let mut sums = [Lanes::ZERO; N];
    let others = others.map(|b| &b[..a.len()]);
    for at in (0..a.len() / LANES).map(|i| i * LANES) {
        let here = Lanes::from_slice(&a[at..at + LANES]);
        for (sum, b) in sums.iter_mut().zip(others) {
            *sum += here * Lanes::from_slice(&b[at..at + LANES]);
        }
    }
    sums.map(|sum| sum.total())
}

/// Sum of products of two arrays of the same length, a multiple of [`LANES`].
#[inline]
pub(super) fn dot(a: &[f32], b: &[f32]) -> f32 {
    let [sum] = dots(a, [b]);
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponential_and_logarithm_are_those_of_the_library() {
        for i in -8600..8600 {
            let x = 0.01 * i as f32;
            let expected = f64::from(x).exp();
            // The argument's own rounding is multiplied by x.
            let allowed = 3e-7 + 1.2e-7 * f64::from(x.abs());
            assert!((f64::from(exp(x)) / expected - 1.0).abs() < allowed, "exp {x}");
            let y = (0.01 * f64::from(x)).exp() as f32;
            let expected = f64::from(y).ln();
            assert!((f64::from(ln(y)) - expected).abs() < 2e-7 * (1.0 + expected.abs()), "ln {y}");
        }
        assert!(exp(-1e9) > 0.0 && exp(-1e9) < 1e-37 && exp(1e9).is_finite());
    }

    #[test]
    fn products_are_summed_over_all_lanes() {
        let a: Vec<f32> = (0..24).map(|i| i as f32).collect();
        assert_eq!(dot(&a, &a), 4324.0);
        let ones = vec![1.0; 24];
        assert_eq!(dots(&a, [&ones, &a, &ones[..24]]), [276.0, 4324.0, 276.0]);
    }
}
