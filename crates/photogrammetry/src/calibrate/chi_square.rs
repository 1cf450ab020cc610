//! How often chance alone gives a sum of squares this large.

/// Terms of series and fraction: at the arguments of a few dozen that come here, far more than needed.
const TERMS: usize = 500;

/// Probability that chi-square of so many degrees of freedom exceeds `x`.
///
/// The regularised incomplete gamma function Q(k/2, x/2): its series below (Abramowitz and Stegun
/// 6.5.29), its continued fraction above (6.5.31), both where they converge fast.
pub(super) fn exceeds(x: f64, degrees: usize) -> f64 {
    if !x.is_finite() || degrees == 0 {
        return 0.0;
    }
    let (a, x) = (0.5 * degrees as f64, 0.5 * x.max(0.0));
    if x == 0.0 {
        return 1.0;
    }
    let factor = (a * x.ln() - x - ln_gamma_of_half(degrees)).exp();
    if x < a + 1.0 {
        let (mut term, mut sum) = (1.0 / a, 1.0 / a);
        for n in 1..TERMS {
            term *= x / (a + n as f64);
            sum += term;
        }
        return (1.0 - factor * sum).clamp(0.0, 1.0);
    }
    // Q = factor / (x + 1 - a - 1 (1 - a) / (x + 3 - a - 2 (2 - a) / (x + 5 - a - ...))), from within.
    let mut tail = 0.0;
    for n in (1..TERMS).rev() {
        let n = n as f64;
        tail = n * (n - a) / (x + 1.0 - a + 2.0 * n - tail);
    }
    (factor / (x + 1.0 - a - tail)).clamp(0.0, 1.0)
}

/// Logarithm of the gamma function of k/2, by its recurrence from 1/2 or 1.
fn ln_gamma_of_half(k: usize) -> f64 {
    let first = if k % 2 == 1 { 0.5 * std::f64::consts::PI.ln() } else { 0.0 };
    (0..)
        .map(|i| k % 2 + 2 * i)
        .skip_while(|j| *j == 0)
        .take_while(|j| j + 2 <= k)
        .fold(first, |sum, j| sum + (0.5 * j as f64).ln())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tail_is_that_of_the_tables() {
        // Upper quantiles as every table has them, to their five decimals.
        let cases = [
            (3.84146, 1, 0.05),
            (6.63490, 1, 0.01),
            (5.99146, 2, 0.05),
            (18.30704, 10, 0.05),
            (3.94030, 10, 0.95),
            (124.34211, 100, 0.05),
            (0.00393, 1, 0.95),
        ];
        for (x, degrees, tail) in cases {
            assert!((exceeds(x, degrees) - tail).abs() < 2e-4, "{x} {degrees}");
        }
        assert!((exceeds(7.0, 2) - (-3.5f64).exp()).abs() < 1e-14);
        assert!((exceeds(1.0, 2) - (-0.5f64).exp()).abs() < 1e-14);
        assert_eq!(exceeds(0.0, 3), 1.0);
    }
}
