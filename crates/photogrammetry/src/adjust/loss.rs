//! Robust losses: how much a large residual counts.

/// What a squared residual s (in units of its variance) adds to the sum. The limits are in standard
/// deviations; below them the squares count as they are.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Loss {
    /// s: least squares.
    #[default]
    Squares,
    /// `2 k sqrt(s) - k^2` beyond `s = k^2` (Huber 1964).
    Huber(f64),
    /// `k^2 ln(1 + s / k^2)` (Cauchy).
    Cauchy(f64),
}

impl Loss {
    /// The loss at s, and its slope: the factor by which the observation's weight is multiplied.
    #[must_use]
    pub fn at(self, s: f64) -> (f64, f64) {
        match self {
            Self::Huber(k) if s > k * k => (2.0 * k * s.sqrt() - k * k, k / s.sqrt()),
            Self::Cauchy(k) => {
                let ratio = s / (k * k);
                (k * k * ratio.ln_1p(), 1.0 / (1.0 + ratio))
            }
            Self::Squares | Self::Huber(_) => (s, 1.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_agree_with_finite_differences_and_small_residuals_count_as_squares() {
        for loss in [Loss::Squares, Loss::Huber(1.5), Loss::Cauchy(2.0)] {
            for s in [0.01, 1.0, 2.2, 2.3, 9.0, 400.0] {
                let h = 1e-6 * s;
                let slope = (loss.at(s + h).0 - loss.at(s - h).0) / (2.0 * h);
                assert!((slope - loss.at(s).1).abs() < 1e-5, "{loss:?} at {s}");
            }
            assert!((loss.at(1e-9).0 / 1e-9 - 1.0).abs() < 1e-6);
        }
    }
}
