//! A series of readings: its noise, its stray readings, its evenly sampled parts.

use super::Sample;

/// A normal deviate's median amount, inverted: from a median to a standard deviation.
const MAD_TO_SIGMA: f64 = 1.4826;
/// Departures beyond this many standard deviations are of hops and stray readings.
const USUAL: f64 = 4.0;
/// A reading this many standard deviations off both its neighbours, which agree, is a stray one.
const STRAY: f64 = 6.0;
/// Intervals that differ by less than this part are alike.
const EVEN: f64 = 0.1;

/// Readings in order of time.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Series {
    /// Seconds since the light came on.
    pub at_s: Vec<f64>,
    /// nm or degrees Celsius.
    pub value: Vec<f64>,
}

impl Series {
    /// The readings from `from_s` until before `to_s`, counted from `from_s`; what is no number is
    /// left out.
    pub(super) fn between(samples: &[Sample], from_s: f64, to_s: f64) -> Self {
        let within = |s: &&Sample| s.at_s >= from_s && s.at_s < to_s && s.value.is_finite();
        let (at_s, value) =
            samples.iter().filter(within).map(|s| (s.at_s - from_s, s.value)).unzip();
        Self { at_s, value }
    }

    pub(super) fn len(&self) -> usize {
        self.at_s.len()
    }

    /// How much a reading differs from what its neighbours say by interpolation, and by how much
    /// that scatters against a single reading: free of any drift that is straight over two
    /// intervals.
    fn departure(&self, i: usize) -> Option<(f64, f64)> {
        let (before, after) = (i.checked_sub(1)?, i + 1);
        let (t, y) = (&self.at_s, &self.value);
        let span = *t.get(after)? - t[before];
        if span <= 0.0 {
            return None;
        }
        let weight = (t[after] - t[i]) / span;
        let expected = weight * y[before] + (1.0 - weight) * y[after];
        Some((y[i] - expected, (1.0 + weight * weight + (1.0 - weight).powi(2)).sqrt()))
    }

    /// Standard deviation of one reading about a smooth course, from its departures from its
    /// neighbours; by the median, hops and stray readings are kept out. 0 where all agree.
    pub(super) fn noise(&self) -> f64 {
        let departures = (0..self.len()).filter_map(|i| self.departure(i));
        let mut scaled: Vec<f64> = departures.map(|(e, scale)| (e / scale).abs()).collect();
        let robust = MAD_TO_SIGMA * median(&mut scaled);
        // With a coarse display most readings equal their neighbours: then all count.
        let limit = if robust > 0.0 { USUAL * robust } else { f64::INFINITY };
        // Of what is not far out the mean square is the better estimate.
        let usual: Vec<f64> = scaled.into_iter().filter(|e| *e <= limit).collect();
        let squares: f64 = usual.iter().map(|e| e * e).sum();
        (squares / usual.len().max(1) as f64).sqrt()
    }

    /// Single readings that jump and come back: they say nothing of the wavelength.
    pub(super) fn strays(&self, noise: f64) -> Vec<usize> {
        let is_stray = |i: &usize| {
            let Some((e, scale)) = self.departure(*i) else { return false };
            let around = (self.value[i + 1] - self.value[i - 1]).abs();
            e.abs() > STRAY * scale * noise && around < STRAY * noise * 2.0_f64.sqrt()
        };
        (0..self.len()).filter(is_stray).collect()
    }

    /// This series without some of its readings (sorted indices).
    pub(super) fn without(&self, left_out: &[usize]) -> Self {
        let kept = (0..self.len()).filter(|i| left_out.binary_search(i).is_err());
        let (at_s, value) = kept.map(|i| (self.at_s[i], self.value[i])).unzip();
        Self { at_s, value }
    }

    /// The parts of at least `least` readings whose intervals are alike, as ranges of indices.
    pub(super) fn even_parts(&self, least: usize) -> Vec<std::ops::Range<usize>> {
        let mut parts = Vec::new();
        let mut begin = 0;
        for i in 1..self.len() {
            let first = self.at_s.get(begin + 1).map_or(0.0, |t| t - self.at_s[begin]);
            let this = self.at_s[i] - self.at_s[i - 1];
            if (this - first).abs() > EVEN * first {
                parts.push(begin..i);
                begin = i - 1;
            }
        }
        parts.push(begin..self.len());
        parts.retain(|part| part.len() >= least);
        parts
    }

    /// The interval from a reading to the next, or from the one before the last to it.
    pub(super) fn interval(&self, i: usize) -> f64 {
        let i = i.min(self.len().saturating_sub(2));
        match (self.at_s.get(i), self.at_s.get(i + 1)) {
            (Some(a), Some(b)) => b - a,
            _ => 0.0,
        }
    }
}

/// The middle one; 0 of none.
pub(super) fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// How much more the means of runs of residuals scatter than those of independent ones would, as a
/// factor of standard uncertainties, at least 1; and the root mean square of what is more.
pub(super) fn correlation(residuals: &[f64], sigma: f64) -> (f64, f64) {
    /// Long enough to show slow scatter, short enough for many runs.
    const RUN: usize = 20;
    let runs: Vec<f64> =
        residuals.chunks_exact(RUN).map(|r| r.iter().sum::<f64>() / RUN as f64).collect();
    if runs.len() < 4 || sigma <= 0.0 {
        return (1.0, 0.0);
    }
    let found = runs.iter().map(|m| m * m).sum::<f64>() / runs.len() as f64;
    let expected = sigma * sigma / RUN as f64;
    ((found / expected).max(1.0).sqrt(), (found - expected).max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(value: impl Fn(usize) -> f64, n: usize) -> Series {
        Series { at_s: (0..n).map(|i| i as f64).collect(), value: (0..n).map(value).collect() }
    }

    #[test]
    fn noise_is_that_of_readings_whatever_they_drift_and_hop() {
        // Alternating by one: each reading departs by 2 from its neighbours, sqrt(1.5) at most.
        let zigzag = |i: usize| if i.is_multiple_of(2) { 1.0 } else { -1.0 };
        let plain = series(zigzag, 101).noise();
        let drifting =
            series(|i| zigzag(i) + 0.3 * i as f64 + if i > 50 { 100.0 } else { 0.0 }, 101);
        assert!((drifting.noise() - plain).abs() < 1e-9, "{} {plain}", drifting.noise());
        assert!(series(|_| 5.0, 10).noise() == 0.0);
    }

    #[test]
    fn a_reading_that_jumps_and_comes_back_is_stray_and_a_step_is_not() {
        let zigzag = |i: usize| 0.01 * (i as f64 * 2.4).sin();
        let glitch = series(|i| zigzag(i) + if i == 40 { 0.3 } else { 0.0 }, 80);
        assert_eq!(glitch.strays(glitch.noise()), [40]);
        let step = series(|i| zigzag(i) + if i >= 40 { 0.3 } else { 0.0 }, 80);
        assert!(step.strays(step.noise()).is_empty());
        assert_eq!(glitch.without(&[40]).len(), 79);
    }

    #[test]
    fn even_parts_end_where_the_interval_changes() {
        let mut at_s: Vec<f64> = (0..30).map(f64::from).collect();
        at_s.extend((1..20).map(|i| 29.0 + 10.0 * f64::from(i)));
        let value = vec![0.0; at_s.len()];
        let series = Series { at_s, value };
        assert_eq!(series.even_parts(16), [0..30, 29..49]);
        assert_eq!(series.even_parts(25).first(), Some(&(0..30)));
        assert_eq!(series.even_parts(25).len(), 1);
    }
}
