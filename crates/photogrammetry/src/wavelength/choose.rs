//! The wavelength at a capture from what was read around it.
//!
//! Between two readings the wavelength is taken as a Brownian bridge whose variance the step between
//! them tells: linear in time, with a standard uncertainty of `|step| sqrt(f (1 - f))` at the
//! fraction f of the time between. Beside a single reading nothing tells its steps: it is taken to
//! walk as far as a diode that warms up, 0.4 nm in six minutes (section 4.2), the variance in
//! proportion to the time.

use super::{UNREAD, Wavelength, WavelengthSource, WavelengthUse};
use crate::scene::{Setup, WavelengthByTemperature};

/// In so many seconds a diode may have moved by all that is not known of an unread one.
const FORGOTTEN_AFTER_S: f64 = 360.0;

/// One reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// When, seconds of the session's clock.
    pub at_s: f64,
    /// What was read, in the unit of its quantity.
    pub value: f64,
}

/// What a session's instruments read, around one capture.
#[derive(Debug, Clone, Copy)]
pub struct Known<'a> {
    /// When the capture was taken, seconds of the session's clock.
    pub at_s: f64,
    /// The wavelength read at it, nanometres.
    pub wavelength_nm: Option<f64>,
    /// The diode's temperature read at it, degrees Celsius.
    pub diode_degc: Option<f64>,
    /// All wavelengths of the session by one instrument, nanometres, in the order of their times.
    pub wavelengths: &'a [Sample],
    /// All temperatures of the diode, degrees Celsius, in the order of their times.
    pub diode: &'a [Sample],
}

/// The wavelength at a capture, of what `using` lets be used.
#[must_use]
pub fn wavelength(setup: &Setup, known: &Known<'_>, using: WavelengthUse) -> Wavelength {
    let unread = setup.wavelength(None);
    let own = || known.wavelength_nm.map(|nm| setup.wavelength(Some(nm)));
    let past = using == WavelengthUse::Live;
    match using {
        WavelengthUse::Nominal => {
            Wavelength { source: WavelengthSource::Nominal, own_u_nm: 0.0, ..unread }
        }
        WavelengthUse::Read => own().unwrap_or(unread),
        WavelengthUse::Interpolated => {
            own().or_else(|| in_time(setup, known, past)).unwrap_or(unread)
        }
        WavelengthUse::Temperature => from_temperature(setup, known, past).unwrap_or(unread),
        WavelengthUse::Best | WavelengthUse::Live => own()
            .or_else(|| {
                let (read, warm) =
                    (in_time(setup, known, past), from_temperature(setup, known, past));
                match (read, warm) {
                    (Some(read), Some(warm)) if warm.u_nm() < read.u_nm() => Some(warm),
                    (read, warm) => read.or(warm),
                }
            })
            .unwrap_or(unread),
    }
}

/// From the readings before and after.
fn in_time(setup: &Setup, known: &Known<'_>, past: bool) -> Option<Wavelength> {
    let found = around(known.wavelengths, known.at_s, past)?;
    let (source, own_u_nm) = match found.u {
        Doubt::Spread(nm) => (WavelengthSource::Interpolated, nm),
        Doubt::Age(part) => (WavelengthSource::Held, part * unread_nm(setup)),
    };
    let (nm, common_u_nm, age_s) = (found.value, setup.wavelength_u_nm, Some(found.age_s));
    Some(Wavelength { source, nm, own_u_nm, common_u_nm, age_s })
}

fn from_temperature(setup: &Setup, known: &Known<'_>, past: bool) -> Option<Wavelength> {
    let law = setup.wavelength_by_temperature.as_ref()?;
    let (degc, own_u_nm, age_s) = match known.diode_degc {
        Some(degc) => (degc, 0.0, None),
        None => {
            let found = around(known.diode, known.at_s, past)?;
            let own = match found.u {
                Doubt::Spread(degc) => law.per_degree_nm.abs() * degc,
                Doubt::Age(part) => part * unread_nm(setup),
            };
            (found.value, own, Some(found.age_s))
        }
    };
    let (nm, common_u_nm) = law.at(degc);
    Some(Wavelength { source: WavelengthSource::FromTemperature, nm, own_u_nm, common_u_nm, age_s })
}

fn unread_nm(setup: &Setup) -> f64 {
    UNREAD * setup.pattern.reference_wavelength_nm
}

impl WavelengthByTemperature {
    /// The wavelength at a temperature, and its standard uncertainty: that of the reference point,
    /// of the coefficient over the way from it, and of the thermometer. Nanometres.
    #[must_use]
    pub fn at(&self, degc: f64) -> (f64, f64) {
        let away = degc - self.at_degc;
        let of_coefficient = away * self.per_degree_u_nm;
        let of_thermometer = self.per_degree_nm * self.temperature_u_degc;
        let u = self.wavelength_u_nm.hypot(of_coefficient).hypot(of_thermometer);
        (self.wavelength_nm + self.per_degree_nm * away, u)
    }
}

/// What a series says of a moment.
struct Around {
    value: f64,
    u: Doubt,
    age_s: f64,
}

enum Doubt {
    /// Between two readings: standard uncertainty, in their unit.
    Spread(f64),
    /// Beside one: which part of all that is not known without it.
    Age(f64),
}

/// A series at a moment; only what was read until then, where `past`.
fn around(samples: &[Sample], at_s: f64, past: bool) -> Option<Around> {
    let behind = samples.partition_point(|sample| sample.at_s <= at_s);
    let before = behind.checked_sub(1).and_then(|i| samples.get(i));
    let after = samples.get(behind).filter(|_| !past);
    match (before, after) {
        (Some(before), Some(after)) => {
            let part = (at_s - before.at_s) / (after.at_s - before.at_s);
            let step = after.value - before.value;
            Some(Around {
                value: before.value + part * step,
                u: Doubt::Spread(step.abs() * (part * (1.0 - part)).sqrt()),
                age_s: (at_s - before.at_s).min(after.at_s - at_s),
            })
        }
        (Some(one), None) | (None, Some(one)) => {
            let age_s = (at_s - one.at_s).abs();
            let u = Doubt::Age((age_s / FORGOTTEN_AFTER_S).min(1.0).sqrt());
            Some(Around { value: one.value, u, age_s })
        }
        (None, None) => None,
    }
}
