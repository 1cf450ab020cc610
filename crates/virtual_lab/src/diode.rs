//! The laser diode: when it emits, how warm it is, and hence its wavelength.

use std::time::Duration;

use crate::config::{DiodeConfig, HopAt, RoomConfig};

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

/// Wavelength in vacuum at a time and a diode temperature, nm (what it would be, where it does not
/// emit): along a mode it follows the temperature, and beyond each hop it is on another mode.
pub(crate) fn wavelength_nm(diode: &DiodeConfig, time: Duration, degc: f64) -> f64 {
    let beyond = |at: HopAt| match at {
        HopAt::TimeS(seconds) => time.as_secs_f64() >= seconds,
        HopAt::DiodeDegc(at) => degc >= at,
    };
    let along = diode.wavelength_nm + diode.tuning_nm_per_degc * (degc - diode.reference_degc);
    diode.mode_hops.iter().filter(|hop| beyond(hop.at)).fold(along, |sum, hop| sum + hop.by_nm)
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
    fn a_diode_hops_at_a_moment_or_at_a_temperature_and_back() {
        let hop = |at, by_nm| crate::config::ModeHop { at, by_nm };
        let hops = vec![hop(HopAt::TimeS(60.0), 0.05), hop(HopAt::DiodeDegc(23.0), -0.2)];
        let diode = DiodeConfig { mode_hops: hops, ..DiodeConfig::default() };
        let plain = DiodeConfig::default();
        let hopped = |seconds, degc| {
            let time = Duration::from_secs(seconds);
            wavelength_nm(&diode, time, degc) - wavelength_nm(&plain, time, degc)
        };
        let cases = [
            (59, 22.9, 0.0),
            (60, 22.9, 0.05),
            (60, 23.0, -0.15),
            (59, 23.1, -0.2),
            (99, 22.0, 0.05),
        ];
        for (seconds, degc, by) in cases {
            assert!((hopped(seconds, degc) - by).abs() < 1e-9, "{seconds} s, {degc} degrees");
        }
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
