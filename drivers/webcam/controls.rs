//! Takes a camera's decisions from it: automatics off, values set, all read back. Pure, but for what
//! [`Controls`] does.

use std::collections::BTreeMap;
use std::time::Duration;

use beampose_core::InstrumentError;

/// Controls by their numbers: linux/v4l2-controls.h.
const AUTO_WHITE_BALANCE: u32 = 0x0098_090c;
const AUTO_GAIN: u32 = 0x0098_0912;
const GAIN: u32 = 0x0098_0913;
const WHITE_BALANCE: u32 = 0x0098_091a;
const EXPOSURE_MODE: u32 = 0x009a_0901;
const EXPOSURE: u32 = 0x009a_0902;
const FRAME_RATE_GIVES_WAY: u32 = 0x009a_0903;
const FOCUS: u32 = 0x009a_090a;
const AUTO_FOCUS: u32 = 0x009a_090c;

/// What decides by itself, and the value with which it does not. Exposure: 1 is manual.
const AUTOMATIC: [(u32, &str, i64); 5] = [
    (EXPOSURE_MODE, "automatic exposure", 1),
    (FRAME_RATE_GIVES_WAY, "a frame rate that gives way to the exposure", 0),
    (AUTO_GAIN, "automatic gain", 0),
    (AUTO_WHITE_BALANCE, "automatic white balance", 0),
    (AUTO_FOCUS, "automatic focus", 0),
];

/// The unit of [`EXPOSURE`].
const EXPOSURE_UNIT: Duration = Duration::from_micros(100);

/// The controls of a camera.
pub(super) trait Controls {
    /// The value; `None` where the camera has no such control.
    fn get(&self, id: u32) -> Result<Option<i64>, String>;
    /// Sets it; the camera may round.
    fn set(&self, id: u32, value: i64) -> Result<(), String>;
}

/// What the rig wants; `None` for as it stands.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Wanted {
    pub(super) exposure: Option<Duration>,
    pub(super) gain: Option<i64>,
    pub(super) focus: Option<i64>,
}

/// The values that must stay, by control.
pub(super) type Locked = BTreeMap<u32, (&'static str, i64)>;

/// Locks all that the camera has.
///
/// # Errors
/// [`InstrumentError::Refused`] where it does not give an automatic up, or does not take a value.
pub(super) fn lock(camera: &dyn Controls, wanted: Wanted) -> Result<Locked, InstrumentError> {
    let mut locked = Locked::new();
    for (id, name, off) in AUTOMATIC {
        if get(camera, id, name)?.is_none() {
            continue;
        }
        // Some refuse what they are already; what it then says decides.
        let said = camera.set(id, off);
        if get(camera, id, name)? != Some(off) {
            let why = said.err().unwrap_or_else(|| "it switches itself on again".to_owned());
            let why = format!("{name} cannot be switched off: {why}; it cannot measure");
            return Err(InstrumentError::Refused(why));
        }
        locked.insert(id, (name, off));
    }
    let exposure = wanted.exposure.map(|exposure| {
        (exposure.as_secs_f64() / EXPOSURE_UNIT.as_secs_f64()).round().max(1.0) as i64
    });
    for (id, name, value) in [
        (EXPOSURE, "exposure (in 0.1 ms)", exposure),
        (GAIN, "gain", wanted.gain),
        (FOCUS, "focus", wanted.focus),
        (WHITE_BALANCE, "white balance", None),
    ] {
        let there = get(camera, id, name)?;
        match (there, value) {
            (None, None) => {}
            (None, Some(_)) => {
                let why = format!("it has no control for {name}, which the rig sets");
                return Err(InstrumentError::Refused(why));
            }
            (Some(stands), None) => drop(locked.insert(id, (name, stands))),
            (Some(_), Some(value)) => {
                let said = camera.set(id, value);
                let found = get(camera, id, name)?;
                if found != Some(value) {
                    let why = said.err().unwrap_or_default();
                    let found = found.map_or_else(String::new, |found| found.to_string());
                    let why = format!("{name} does not become {value}, it stays {found} {why}");
                    return Err(InstrumentError::Refused(why.trim_end().to_owned()));
                }
                locked.insert(id, (name, value));
            }
        }
    }
    Ok(locked)
}

/// Whether all is as it was locked: other programs can turn it.
///
/// # Errors
/// [`InstrumentError::Fault`] with what it was and what it is.
pub(super) fn check(camera: &dyn Controls, locked: &Locked) -> Result<(), InstrumentError> {
    for (id, (name, value)) in locked {
        let found = get(camera, *id, name)?;
        if found != Some(*value) {
            let found = found.map_or_else(|| "gone".to_owned(), |found| found.to_string());
            let why = format!("{name} was set to {value} and is {found}: did another program?");
            return Err(InstrumentError::Fault(why));
        }
    }
    Ok(())
}

fn get(camera: &dyn Controls, id: u32, name: &str) -> Result<Option<i64>, InstrumentError> {
    camera.get(id).map_err(|why| InstrumentError::Disconnected(format!("{name}: {why}")))
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use super::*;

    /// Controls with what each takes.
    struct Camera(RefCell<BTreeMap<u32, i64>>, fn(u32, i64) -> i64);

    impl Controls for Camera {
        fn get(&self, id: u32) -> Result<Option<i64>, String> {
            Ok(self.0.borrow().get(&id).copied())
        }

        fn set(&self, id: u32, value: i64) -> Result<(), String> {
            self.0.borrow_mut().insert(id, (self.1)(id, value));
            Ok(())
        }
    }

    fn camera(takes: fn(u32, i64) -> i64) -> Camera {
        let all = [(EXPOSURE_MODE, 3), (EXPOSURE, 156), (AUTO_GAIN, 1), (GAIN, 40), (FOCUS, 7)];
        Camera(RefCell::new(BTreeMap::from(all)), takes)
    }

    #[test]
    fn automatics_go_off_and_values_stay() {
        let camera = camera(|_, value| value);
        let exposure = Some(Duration::from_millis(10));
        let locked = lock(&camera, Wanted { exposure, gain: Some(20), focus: None }).unwrap();
        let expected =
            [(AUTO_GAIN, 0), (GAIN, 20), (EXPOSURE_MODE, 1), (EXPOSURE, 100), (FOCUS, 7)];
        let found: Vec<(u32, i64)> = locked.iter().map(|(id, (_, value))| (*id, *value)).collect();
        assert_eq!(found, expected);
        assert_eq!(check(&camera, &locked), Ok(()));
        camera.set(GAIN, 21).unwrap();
        let error = check(&camera, &locked).unwrap_err().to_string();
        assert!(error.contains("gain was set to 20 and is 21"), "{error}");
    }

    #[test]
    fn what_it_does_not_take_is_refused() {
        type Takes = fn(u32, i64) -> i64;
        let stays: Takes = |id, value| if id == EXPOSURE_MODE { 3 } else { value };
        let clamps: Takes = |_, value| value.min(64);
        let all = [
            (stays, Wanted::default(), "automatic exposure cannot be switched off"),
            (clamps, Wanted { gain: Some(99), ..Wanted::default() }, "become 99, it stays 64"),
        ];
        for (takes, wanted, part) in all {
            let error = lock(&camera(takes), wanted).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
        let none = Camera(RefCell::default(), |_, value| value);
        let wanted = Wanted { exposure: Some(Duration::from_millis(1)), ..Wanted::default() };
        let error = lock(&none, wanted).unwrap_err().to_string();
        assert!(error.contains("no control for exposure"), "{error}");
    }
}
