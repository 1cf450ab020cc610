//! The laser diode: when it emits, how warm it is, and hence its wavelength.

use std::time::Duration;

use crate::config::{DiodeConfig, RoomConfig};

/// When light began and ended, as a history: any past moment can be asked.
#[derive(Debug, Clone, Default)]
pub(crate) struct Switches(Vec<(Duration, bool)>);

impl Switches {
    /// Light from `time` on. A pending change after `time` is cancelled.
    pub(crate) fn light(&mut self, time: Duration) {
        self.set(time, true);
    }

    /// Darkness from `time` on. A pending change after `time` is cancelled.
    pub(crate) fn dark(&mut self, time: Duration) {
        self.set(time, false);
    }

    fn set(&mut self, time: Duration, on: bool) {
        self.0.retain(|&(at, _)| at <= time);
        self.0.push((time, on));
    }

    /// True while light comes out.
    pub(crate) fn emitting(&self, time: Duration) -> bool {
        self.0.iter().rev().find(|&&(at, _)| at <= time).is_some_and(|&(_, on)| on)
    }

    /// True if the last command was to emit, light or not yet.
    pub(crate) fn commanded(&self) -> bool {
        self.0.last().is_some_and(|&(_, on)| on)
    }

    /// Self-heating as a part of its final value: first-order warming and cooling (0 to 1).
    fn warmth(&self, time: Duration, time_constant_s: f64) -> f64 {
        let (mut warmth, mut on, mut since) = (0.0, false, Duration::ZERO);
        let end = std::iter::once((time, false));
        for (at, next) in self.0.iter().copied().filter(|&(at, _)| at < time).chain(end) {
            let target = if on { 1.0 } else { 0.0 };
            let passed = (at - since).as_secs_f64();
            warmth = target + (warmth - target) * (-passed / time_constant_s).exp();
            (on, since) = (next, at);
        }
        warmth
    }
}

/// Room temperature, degrees Celsius.
pub(crate) fn room_degc(room: &RoomConfig, time: Duration) -> f64 {
    room.temperature_degc + room.drift_degc_per_hour * time.as_secs_f64() / 3600.0
}

/// Diode temperature, degrees Celsius.
pub(crate) fn diode_degc(
    diode: &DiodeConfig,
    room: &RoomConfig,
    switches: &Switches,
    time: Duration,
) -> f64 {
    room_degc(room, time) + diode.self_heating_degc * switches.warmth(time, diode.time_constant_s)
}

/// Wavelength in vacuum at a diode temperature, nm (what it would be, where it does not emit).
pub(crate) fn wavelength_nm(diode: &DiodeConfig, degc: f64) -> f64 {
    diode.wavelength_nm + diode.tuning_nm_per_degc * (degc - diode.reference_degc)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_diode_warms_up_and_cools_down() {
        let minutes = |m: u64| Duration::from_secs(60 * m);
        let mut switches = Switches::default();
        assert_eq!(switches.warmth(minutes(10), 600.0), 0.0);
        switches.light(minutes(10));
        assert!((switches.warmth(minutes(20), 600.0) - (1.0 - (-1.0_f64).exp())).abs() < 1e-12);
        switches.dark(minutes(110));
        let cold = (1.0 - (-10.0_f64).exp()) * (-3.0_f64).exp();
        assert!((switches.warmth(minutes(140), 600.0) - cold).abs() < 1e-12);
    }

    #[test]
    fn switching_off_cancels_light_that_is_on_its_way() {
        let seconds = Duration::from_secs;
        let mut switches = Switches::default();
        switches.light(seconds(10));
        assert!(switches.commanded() && !switches.emitting(seconds(9)));
        switches.dark(seconds(9));
        assert!(!switches.commanded() && !switches.emitting(seconds(11)));
    }
}
