//! The overlapping Allan deviation, NIST SP 1065 (Riley 2008), section 5.2.3.
//!
//! Of a wavelength in nm: half the mean squared difference of neighbouring means over a time tau. White noise
//! of the meter falls as tau^-1/2, a drift rises as tau.

use super::result::AllanPoint;

/// Fewer differences than this are no statistics.
const LEAST: usize = 3;

/// The deviation at averaging times of 1, 2, 4, ... intervals.
pub(super) fn overlapping(values: &[f64], interval_s: f64) -> Vec<AllanPoint> {
    let sums = sums(values);
    let octaves = std::iter::successors(Some(1_usize), |m| m.checked_mul(2));
    octaves.map_while(|m| point(&sums, m, interval_s)).collect()
}

/// Sums of the first 0, 1, 2, ... values, counted from the first value: they keep their digits.
fn sums(values: &[f64]) -> Vec<f64> {
    let origin = values.first().copied().unwrap_or(0.0);
    let mut sums = vec![0.0];
    let mut sum = 0.0;
    for value in values {
        sum += value - origin;
        sums.push(sum);
    }
    sums
}

/// The deviation over `m` intervals, where enough differences are there.
fn point(sums: &[f64], m: usize, interval_s: f64) -> Option<AllanPoint> {
    let count = sums.len().checked_sub(2 * m).filter(|count| *count >= LEAST)?;
    let mean = |i: usize| (sums[i + m] - sums[i]) / m as f64;
    let squares: f64 = (0..count).map(|i| (mean(i + m) - mean(i)).powi(2)).sum();
    let deviation_nm = (squares / (2.0 * count as f64)).sqrt();
    Some(AllanPoint {
        tau_s: m as f64 * interval_s,
        deviation_nm,
        standard_uncertainty_nm: deviation_nm / (2.0 * freedom(sums.len(), m)).sqrt(),
        differences: count,
    })
}

/// Equivalent degrees of freedom for white noise of what is averaged (white FM there), from `n`
/// phase points: SP 1065, table 5.
fn freedom(n: usize, m: usize) -> f64 {
    let (n, m) = (n as f64, m as f64);
    let edf =
        (3.0 * (n - 1.0) / (2.0 * m) - 2.0 * (n - 2.0) / n) * 4.0 * m * m / (4.0 * m * m + 5.0);
    edf.max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The thousand-point series of NIST SP 1065, section 12.4 (a multiplicative congruential
    /// generator), and its overlapping Allan deviations as printed there in table 31.
    #[test]
    fn the_deviations_of_nist_sp_1065_are_reproduced() {
        let mut state = 1_234_567_890_u64;
        let values: Vec<f64> = (0..1000)
            .map(|_| {
                let value = state as f64 / 2_147_483_647.0;
                state = 16_807 * state % 2_147_483_647;
                value
            })
            .collect();
        let sums = sums(&values);
        for (m, printed) in [(1, 2.922_319e-1), (10, 9.159_953e-2), (100, 3.241_343e-2)] {
            let found = point(&sums, m, 1.0).unwrap().deviation_nm;
            assert!((found / printed - 1.0).abs() < 2e-7 / printed, "{m}: {found}");
        }
    }

    #[test]
    fn a_straight_drift_rises_with_tau() {
        let values: Vec<f64> = (0..100).map(|i| 658.0 + 0.01 * f64::from(i)).collect();
        for point in overlapping(&values, 10.0) {
            // The means differ by the drift over tau: over the root of two.
            let expected = 0.001 * point.tau_s / 2.0_f64.sqrt();
            assert!((point.deviation_nm / expected - 1.0).abs() < 1e-9, "{point:?}");
        }
    }
}
