//! Axes: ranges, ticks at round numbers, and where a value lies on paper.

use crate::numbers::fixed;

/// One axis of a plot, from data to drawing units.
#[derive(Debug, Clone)]
pub struct Axis {
    /// What is plotted, with its unit.
    pub label: String,
    lo: f64,
    hi: f64,
    step: f64,
    /// Whether ends and places are logarithms to the base of ten.
    decades: bool,
}

impl Axis {
    /// An axis that shows all of `values`, with about `target` ticks at round numbers. With
    /// [`Ends::AtTicks`] it begins and ends at a tick.
    pub fn over(
        label: impl Into<String>,
        values: impl IntoIterator<Item = f64>,
        target: f64,
        ends: Ends,
    ) -> Self {
        let finite = values.into_iter().filter(|v| v.is_finite());
        let (mut lo, mut hi) =
            finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)));
        if lo > hi {
            (lo, hi) = (0.0, 1.0);
        }
        // Nothing measured here varies by less than a billionth of itself.
        let least = (lo.abs().max(hi.abs()) * 1e-9).max(1e-9);
        if hi - lo < least {
            let pad = (lo.abs() * 1e-3).max(0.5);
            (lo, hi) = (lo - pad, hi + pad);
        }
        // A step that gives a few ticks more than asked for is better than one that gives half.
        let step = nice_step(0.8 * (hi - lo) / target);
        match ends {
            Ends::AtTicks => {
                let pad = 0.02 * (hi - lo);
                lo = ((lo - pad) / step).floor() * step;
                hi = ((hi + pad) / step).ceil() * step;
            }
            Ends::Padded => {
                let pad = 0.04 * (hi - lo);
                (lo, hi) = (lo - pad, hi + pad);
            }
        }
        Self { label: label.into(), lo, hi, step, decades: false }
    }

    /// A logarithmic axis over all of `values` that are above zero, a tick at each power of ten; at
    /// twice and five times as much too where they are few.
    pub fn decades(label: impl Into<String>, values: impl IntoIterator<Item = f64>) -> Self {
        let logs = values.into_iter().filter(|v| v.is_finite() && *v > 0.0).map(f64::log10);
        let (lo, hi) =
            logs.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)));
        let (lo, hi) = if lo > hi { (0.0, 1.0) } else { (lo - 0.06, (hi + 0.06).max(lo + 0.3)) };
        Self { label: label.into(), lo, hi, step: 1.0, decades: true }
    }

    /// Where `value` lies between `from` (the axis' lower end) and `to`.
    pub fn place(&self, value: f64, from: f64, to: f64) -> f64 {
        let value = if self.decades { value.log10() } else { value };
        from + (value - self.lo) / (self.hi - self.lo) * (to - from)
    }

    /// True where the axis shows `value`.
    pub fn shows(&self, value: f64) -> bool {
        let value = if self.decades { value.log10() } else { value };
        (self.lo..=self.hi).contains(&value)
    }

    /// The nearest value that the axis shows.
    pub fn clamp(&self, value: f64) -> f64 {
        if self.decades {
            return 10_f64.powf(value.max(f64::MIN_POSITIVE).log10().clamp(self.lo, self.hi));
        }
        value.clamp(self.lo, self.hi)
    }

    /// Ticks with their text.
    pub fn ticks(&self) -> Vec<(f64, String)> {
        if self.decades {
            return self.ticks_of_decades();
        }
        let decimals = (-self.step.log10().floor()).clamp(0.0, 9.0) as usize;
        let first = (self.lo / self.step - 1e-9).ceil() as i64;
        let last = (self.hi / self.step + 1e-9).floor() as i64;
        (first..=last)
            .map(|i| i as f64 * self.step)
            .map(|value| (value, fixed(value, decimals)))
            .collect()
    }
}

impl Axis {
    fn ticks_of_decades(&self) -> Vec<(f64, String)> {
        /// With more decades than this, powers of ten are enough.
        const FEW: f64 = 2.5;
        let factors: &[f64] = if self.hi - self.lo < FEW { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let powers = self.lo.floor() as i32..=self.hi.ceil() as i32;
        powers
            .flat_map(|power| {
                let decimals = usize::try_from(-power).unwrap_or(0);
                let at = move |factor: &f64| factor * 10_f64.powi(power);
                factors.iter().map(move |factor| (at(factor), fixed(at(factor), decimals)))
            })
            .filter(|(value, _)| self.shows(*value))
            .collect()
    }
}

/// How an axis ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ends {
    /// At the next tick beyond the data.
    AtTicks,
    /// A little beyond the data.
    Padded,
}

/// The smallest of 1, 2, 5 times a power of ten that is not below `rough`.
pub fn nice_step(rough: f64) -> f64 {
    let power = 10_f64.powf(rough.log10().floor());
    let factor = [1.0, 2.0, 5.0].into_iter().find(|f| f * power >= rough * (1.0 - 1e-9));
    factor.unwrap_or(10.0) * power
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(values: &[f64], expect: &[&str]) {
        let axis = Axis::over("x / mm", values.iter().copied(), 5.0, Ends::AtTicks);
        let text: Vec<String> = axis.ticks().into_iter().map(|t| t.1).collect();
        assert_eq!(text, expect);
    }

    #[test]
    fn ticks_stand_at_round_numbers_and_span_the_data() {
        check(&[0.0, 900.0], &["\u{2212}200", "0", "200", "400", "600", "800", "1000"]);
        check(&[-0.31, 0.42], &["\u{2212}0.4", "\u{2212}0.2", "0.0", "0.2", "0.4", "0.6"]);
        check(
            &[658.02, 658.04],
            &["658.015", "658.020", "658.025", "658.030", "658.035", "658.040", "658.045"],
        );
    }

    #[test]
    fn a_logarithmic_axis_has_equal_ways_from_decade_to_decade() {
        let axis = Axis::decades("tau / s", [1.0, 1000.0]);
        let text: Vec<String> = axis.ticks().into_iter().map(|t| t.1).collect();
        assert_eq!(text, ["1", "10", "100", "1000"]);
        let way = |value| axis.place(value, 0.0, 300.0);
        assert!((way(100.0) - way(10.0) - (way(10.0) - way(1.0))).abs() < 1e-9);
        let few: Vec<String> =
            Axis::decades("", [0.002, 0.01]).ticks().into_iter().map(|t| t.1).collect();
        assert_eq!(few, ["0.002", "0.005", "0.01"]);
        assert!(Axis::decades("", [f64::NAN, -1.0]).ticks().len() > 1);
    }

    #[test]
    fn an_axis_over_nothing_one_value_or_no_number_still_has_a_range() {
        for values in [vec![], vec![5.0], vec![f64::NAN, f64::INFINITY], vec![0.0, 0.0]] {
            let axis = Axis::over("", values, 5.0, Ends::Padded);
            assert!(axis.place(5.0, 0.0, 100.0).is_finite() && axis.ticks().len() > 1);
        }
    }
}
