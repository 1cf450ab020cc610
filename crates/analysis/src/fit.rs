//! A straight line through points by ordinary least squares, with its standard errors.

use serde::{Deserialize, Serialize};

/// `y = slope * x + offset`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LineFit {
    /// Slope.
    pub slope: f64,
    /// Standard error of the slope from the scatter about the line; absent with two points.
    pub slope_error: Option<f64>,
    /// Value at x = 0.
    pub offset: f64,
    /// Standard error of the offset; absent with two points.
    pub offset_error: Option<f64>,
    /// Standard deviation of the points about the line (n - 2 degrees of freedom).
    pub scatter: Option<f64>,
}

impl LineFit {
    /// The line's value at `x`.
    #[must_use]
    pub fn at(&self, x: f64) -> f64 {
        self.slope * x + self.offset
    }

    /// The line through `points` (x, y). `None` with fewer than two distinct x.
    #[must_use]
    pub fn through(points: &[(f64, f64)]) -> Option<Self> {
        let n = points.len() as f64;
        let mean_x = points.iter().map(|p| p.0).sum::<f64>() / n;
        let mean_y = points.iter().map(|p| p.1).sum::<f64>() / n;
        let sxx: f64 = points.iter().map(|p| (p.0 - mean_x).powi(2)).sum();
        let sxy: f64 = points.iter().map(|p| (p.0 - mean_x) * (p.1 - mean_y)).sum();
        if !(sxx > 0.0 && sxy.is_finite()) {
            return None;
        }
        let slope = sxy / sxx;
        let offset = mean_y - slope * mean_x;
        let scatter = (points.len() > 2).then(|| {
            let squares: f64 = points.iter().map(|p| (p.1 - slope * p.0 - offset).powi(2)).sum();
            (squares / (n - 2.0)).sqrt()
        });
        Some(Self {
            slope,
            slope_error: scatter.map(|s| s / sxx.sqrt()),
            offset,
            offset_error: scatter.map(|s| s * (1.0 / n + mean_x * mean_x / sxx).sqrt()),
            scatter,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// NIST StRD "Norris" (linear regression): certified to 15 digits.
    #[test]
    fn the_certified_line_of_nist_norris_is_reproduced() {
        let y = [
            0.1, 338.8, 118.1, 888.0, 9.2, 228.1, 668.5, 998.5, 449.1, 778.9, 559.2, 0.3, 0.1,
            778.1, 668.8, 339.3, 448.9, 10.8, 557.7, 228.3, 998.0, 888.8, 119.6, 0.3, 0.6, 557.6,
            339.3, 888.0, 998.5, 778.9, 10.2, 117.6, 228.9, 668.4, 449.2, 0.2,
        ];
        let x = [
            0.2, 337.4, 118.2, 884.6, 10.1, 226.5, 666.3, 996.3, 448.6, 777.0, 558.2, 0.4, 0.6,
            775.5, 666.9, 338.0, 447.5, 11.6, 556.0, 228.1, 995.8, 887.6, 120.2, 0.3, 0.3, 556.8,
            339.1, 887.2, 999.0, 779.0, 11.1, 118.3, 229.2, 669.1, 448.9, 0.5,
        ];
        let points: Vec<_> = x.into_iter().zip(y).collect();
        let fit = LineFit::through(&points).unwrap();
        let close = |got: f64, certified: f64| (got / certified - 1.0).abs() < 1e-10;
        assert!(close(fit.slope, 1.002_116_818_020_45), "{fit:?}");
        assert!(close(fit.offset, -0.262_323_073_774_029), "{fit:?}");
        assert!(close(fit.slope_error.unwrap(), 0.429_796_848_199_937e-3), "{fit:?}");
        assert!(close(fit.offset_error.unwrap(), 0.232_818_234_301_152), "{fit:?}");
        assert!(close(fit.scatter.unwrap(), 0.884_796_396_144_373), "{fit:?}");
    }

    #[test]
    fn a_line_needs_two_places_and_three_points_for_an_error() {
        assert_eq!(LineFit::through(&[]), None);
        assert_eq!(LineFit::through(&[(1.0, 2.0), (1.0, 3.0)]), None);
        let two = LineFit::through(&[(0.0, 1.0), (2.0, 5.0)]).unwrap();
        assert_eq!((two.slope, two.offset, two.slope_error), (2.0, 1.0, None));
    }
}
