//! Which wavelength a capture gets, and what it is worth.

use super::*;
use crate::pattern::PatternUncertainty;
use crate::scene::{Artefact, WavelengthByTemperature};

const METER_U_NM: f64 = 0.01;

fn setup(law: bool) -> Setup {
    let u = PatternUncertainty { angle_deg: 0.0013, common_relative: 5e-5 };
    Setup {
        cameras: std::collections::BTreeMap::new(),
        pattern: Pattern::equal_angle(11, 0.05, u),
        artefact: Artefact { targets: Vec::new(), scale_relative_u: 5e-5 },
        tie_targets: None,
        module_prior: None,
        wavelength_u_nm: METER_U_NM,
        wavelength_by_temperature: law.then(|| WavelengthByTemperature {
            thermometer: "diode".to_owned(),
            at_degc: 25.0,
            wavelength_nm: 658.2,
            wavelength_u_nm: 0.012,
            per_degree_nm: 0.3,
            per_degree_u_nm: 0.002,
            temperature_u_degc: 0.02,
        }),
    }
}

fn samples(of: &[(f64, f64)]) -> Vec<Sample> {
    of.iter().map(|&(at_s, value)| Sample { at_s, value }).collect()
}

/// The wavelength at 100 s where nothing was read at the capture itself.
fn at_100_s(law: bool, nm: &[(f64, f64)], degc: &[(f64, f64)], using: WavelengthUse) -> Wavelength {
    let (wavelengths, diode) = (samples(nm), samples(degc));
    let known = Known {
        at_s: 100.0,
        wavelength_nm: None,
        diode_degc: None,
        wavelengths: &wavelengths,
        diode: &diode,
    };
    wavelength(&setup(law), &known, using)
}

#[track_caller]
fn near(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-12 * expected.abs().max(1.0), "{found} {expected}");
}

#[test]
fn a_reading_at_the_capture_is_taken_as_it_is() {
    let nm = samples(&[(90.0, 658.0), (110.0, 658.4)]);
    let known = Known {
        at_s: 100.0,
        wavelength_nm: Some(658.02),
        diode_degc: Some(25.0),
        wavelengths: &nm,
        diode: &[],
    };
    for using in
        [WavelengthUse::Best, WavelengthUse::Live, WavelengthUse::Read, WavelengthUse::Interpolated]
    {
        let found = wavelength(&setup(true), &known, using);
        assert_eq!(found, setup(true).wavelength(Some(658.02)), "{using:?}");
        assert_eq!((found.u_nm(), found.age_s), (METER_U_NM, None));
    }
    let warm = wavelength(&setup(true), &known, WavelengthUse::Temperature);
    assert_eq!((warm.source, warm.nm), (WavelengthSource::FromTemperature, 658.2));
}

#[test]
fn between_two_readings_it_is_linear_in_time_and_their_spread_is_in_its_uncertainty() {
    let nm = [(40.0, 657.0), (80.0, 658.0), (160.0, 658.4), (900.0, 700.0)];
    let found = at_100_s(false, &nm, &[], WavelengthUse::Best);
    assert_eq!(found.source, WavelengthSource::Interpolated);
    near(found.nm, 658.1);
    near(found.own_u_nm, 0.4 * (0.25_f64 * 0.75).sqrt());
    assert_eq!((found.common_u_nm, found.age_s), (METER_U_NM, Some(20.0)));
    // At a reading itself nothing is interpolated.
    let exact = at_100_s(false, &[(100.0, 658.3), (160.0, 658.4)], &[], WavelengthUse::Best);
    assert_eq!((exact.nm, exact.own_u_nm, exact.age_s), (658.3, 0.0, Some(0.0)));
}

#[test]
fn a_wavelength_that_wanders_is_within_the_uncertainty_as_often_as_it_should_be() {
    // A random walk of 0.01 nm a second, read every ten: the truth between, in units of u.
    let mut state = 1_u64;
    let mut normal = || {
        let mut sum = -6.0;
        for _ in 0..12 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            sum += (state >> 11) as f64 / (1_u64 << 53) as f64;
        }
        sum
    };
    let mut walk = vec![658.0];
    for _ in 0..20_000 {
        walk.push(walk.last().copied().unwrap_or(658.0) + 0.01 * normal());
    }
    let read: Vec<Sample> = (0..=2000)
        .map(|i| Sample { at_s: 10.0 * f64::from(i), value: walk[10 * i as usize] })
        .collect();
    let (mut squares, mut stated) = (0.0, 0.0);
    for (second, expected) in walk.iter().enumerate().take(20_000) {
        let known = Known {
            at_s: second as f64,
            wavelength_nm: None,
            diode_degc: None,
            wavelengths: &read,
            diode: &[],
        };
        let found = wavelength(&setup(false), &known, WavelengthUse::Best);
        squares += (found.nm - expected).powi(2);
        stated += found.own_u_nm.powi(2);
    }
    // 2000 steps tell their variance to 3 %.
    assert!((squares / stated - 1.0).abs() < 0.1, "{}", squares / stated);
}

#[test]
fn live_the_last_reading_is_held_and_worth_less_with_its_age() {
    let nm = [(40.0, 657.9), (64.0, 658.0), (160.0, 658.4)];
    let found = at_100_s(false, &nm, &[], WavelengthUse::Live);
    assert_eq!((found.source, found.nm, found.age_s), (WavelengthSource::Held, 658.0, Some(36.0)));
    near(found.own_u_nm, 0.1_f64.sqrt() * UNREAD * 658.0);
    // What comes later changes nothing.
    assert_eq!(found, at_100_s(false, &nm[..2], &[], WavelengthUse::Live));
    assert_eq!(found, at_100_s(false, &nm[..2], &[], WavelengthUse::Best), "nothing behind it");
    let old = at_100_s(false, &[(-5000.0, 658.1)], &[], WavelengthUse::Live);
    near(old.own_u_nm, UNREAD * 658.0);
    let next = at_100_s(false, &[(136.0, 658.4)], &[], WavelengthUse::Best);
    assert_eq!((next.source, next.nm, next.age_s), (WavelengthSource::Held, 658.4, Some(36.0)));
}

#[test]
fn the_temperature_tells_the_wavelength_with_all_that_is_not_known_of_the_line() {
    let found = at_100_s(true, &[], &[(90.0, 26.0), (110.0, 26.0)], WavelengthUse::Temperature);
    assert_eq!(found.source, WavelengthSource::FromTemperature);
    near(found.nm, 658.5);
    near(found.common_u_nm, 0.012_f64.hypot(0.002).hypot(0.3 * 0.02));
    assert_eq!((found.own_u_nm, found.age_s), (0.0, Some(10.0)));
    let wanders = at_100_s(true, &[], &[(90.0, 26.0), (110.0, 27.0)], WavelengthUse::Temperature);
    near(wanders.nm, 658.65);
    near(wanders.own_u_nm, 0.3 * 0.5);
    let none = at_100_s(false, &[], &[(90.0, 26.0), (110.0, 26.0)], WavelengthUse::Temperature);
    assert_eq!(none, setup(false).wavelength(None), "without a line it tells nothing");
}

#[test]
fn of_readings_and_temperature_the_less_uncertain_is_the_best() {
    let warm = [(95.0, 26.0), (105.0, 26.0)];
    let close = at_100_s(true, &[(99.0, 658.49), (101.0, 658.49)], &warm, WavelengthUse::Best);
    assert_eq!(close.source, WavelengthSource::Interpolated);
    let far = at_100_s(true, &[(0.0, 658.0), (200.0, 658.6)], &warm, WavelengthUse::Best);
    assert_eq!(far.source, WavelengthSource::FromTemperature);
    let kept = at_100_s(true, &[(0.0, 658.0), (200.0, 658.6)], &warm, WavelengthUse::Interpolated);
    assert_eq!(kept.source, WavelengthSource::Interpolated);
}

#[test]
fn where_nothing_is_read_or_nothing_is_to_be_used_it_is_that_of_the_reference() {
    for using in WavelengthUse::ALL {
        let found = at_100_s(false, &[], &[], using);
        let expected = match using {
            WavelengthUse::Nominal => (WavelengthSource::Nominal, 0.0),
            _ => (WavelengthSource::Estimated, UNREAD * 658.0),
        };
        assert_eq!((found.source, found.u_nm(), found.nm), (expected.0, expected.1, 658.0));
        assert_eq!(WavelengthUse::named(using.name()), Some(using));
    }
    let nominal = at_100_s(true, &[(99.0, 659.0)], &[(99.0, 30.0)], WavelengthUse::Nominal);
    assert_eq!(nominal.fan_scale(&setup(true).pattern), (0.0, 5e-5));
}
