//! What a stage did: its whole history as a function of time, so that any past moment can be asked.

use std::time::Duration;

#[derive(Debug, Clone, Copy)]
struct Leg {
    start: Duration,
    end: Duration,
    from: f64,
    to: f64,
}

/// The moves of one stage, in its own unit.
#[derive(Debug, Clone)]
pub(crate) struct Motion {
    initial: f64,
    /// Commands of an earlier run.
    earlier: usize,
    legs: Vec<Leg>,
}

impl Motion {
    /// Standing where an earlier run left it after some commands.
    pub(crate) fn resumed(initial: f64, earlier: usize) -> Self {
        Self { initial, earlier, legs: Vec::new() }
    }

    /// Where it was at a time: at rest, or on its way at constant speed.
    pub(crate) fn at(&self, time: Duration) -> f64 {
        let after = self.legs.partition_point(|leg| leg.start <= time);
        let Some(leg) = after.checked_sub(1).and_then(|i| self.legs.get(i)) else {
            return self.initial;
        };
        if time >= leg.end {
            return leg.to;
        }
        let part = (time - leg.start).as_secs_f64() / (leg.end - leg.start).as_secs_f64();
        leg.from + (leg.to - leg.from) * part
    }

    /// Sets off at `start`; returns when it will be there.
    pub(crate) fn go(&mut self, start: Duration, to: f64, speed_per_s: f64) -> Duration {
        let from = self.at(start);
        let seconds = (to - from).abs() / speed_per_s;
        let travel = Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX);
        let end = start.saturating_add(travel);
        self.legs.push(Leg { start, end, from, to });
        end
    }

    /// Stops where it is.
    pub(crate) fn stop(&mut self, time: Duration) {
        let here = self.at(time);
        self.legs.push(Leg { start: time, end: time, from: here, to: here });
    }

    /// Whether it is on its way.
    pub(crate) fn is_under_way(&self, time: Duration) -> bool {
        self.legs.last().is_some_and(|leg| time < leg.end)
    }

    /// How many times it was told to go or to stop.
    pub(crate) fn commands(&self) -> usize {
        self.earlier + self.legs.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_moves_evenly_stops_when_told_and_remembers() {
        let seconds = Duration::from_secs;
        let mut motion = Motion::resumed(10.0, 0);
        assert_eq!(motion.go(seconds(5), 110.0, 10.0), seconds(15));
        assert_eq!(
            [motion.at(seconds(0)), motion.at(seconds(7)), motion.at(seconds(99))],
            [10.0, 30.0, 110.0]
        );
        motion.stop(seconds(9));
        assert_eq!([motion.at(seconds(7)), motion.at(seconds(99))], [30.0, 50.0]);
    }
}
