//! What every driver must do, tried against its own simulator with no word about the driver.
//!
//! A driver that is in the registry is tried by `drivers/tests/conformance.rs`; nothing needs to be
//! wired. Each check gets a device fresh from the factory, on TCP and again on a pty.

mod axis;
mod bench;
mod camera;
mod laser;
mod line;
mod sensor;

use crate::registry::Driver;

pub use bench::{Bench, Way};

/// One thing that is tried.
#[derive(Debug, Clone, Copy)]
pub struct Check {
    /// As in a report: "a late answer is not taken for a later one".
    pub name: &'static str,
    /// Which kinds of instruments must pass it; empty for all.
    pub kinds: &'static [&'static str],
    /// What is wrong, if anything is.
    pub run: fn(&Bench) -> Result<(), String>,
}

const AXES: &[&str] = &["linear_axis", "rotary_axis"];
const LASERS: &[&str] = &["laser"];
const SENSORS: &[&str] = &["sensor"];
const CAMERAS: &[&str] = &["camera"];

/// All of it.
pub const CHECKS: &[Check] = &[
    Check { name: "it says who it is", kinds: &[], run: line::identifies },
    Check { name: "its serial port is set as it says", kinds: &[], run: line::port },
    Check {
        name: "no answer is a timeout, and the next call works",
        kinds: &[],
        run: line::silent,
    },
    Check { name: "garbage is not taken for an answer", kinds: &[], run: line::garbled },
    Check { name: "half an answer is not taken for one", kinds: &[], run: line::half },
    Check { name: "what nobody asked for is passed over", kinds: &[], run: line::chatter },
    Check { name: "a late answer is not taken for a later one", kinds: &[], run: line::late },
    Check {
        name: "a question that is given up leaves nothing behind",
        kinds: &[],
        run: line::given_up,
    },
    Check { name: "a cut line is made again", kinds: &[], run: line::cut },
    Check {
        name: "a pulled cable is named, and mended by plugging it in",
        kinds: &[],
        run: line::unplugged,
    },
    Check { name: "two clients at once", kinds: &[], run: line::two_clients },
    Check { name: "a refusal of the device is an error in words", kinds: &[], run: line::refusal },
    Check { name: "it moves, and reads where it is", kinds: AXES, run: axis::moves },
    Check { name: "its unit is that of the rig", kinds: AXES, run: axis::unit },
    Check {
        name: "beyond its limits is refused and nothing moves",
        kinds: AXES,
        run: axis::limits,
    },
    Check { name: "it stops while it moves, and the move says so", kinds: AXES, run: axis::stops },
    Check {
        name: "cut in the middle of a move is an error",
        kinds: AXES,
        run: axis::cut_on_the_way,
    },
    Check { name: "after a reboot it is homed before it moves", kinds: AXES, run: axis::reboot },
    Check {
        name: "off at connect, whatever was before",
        kinds: LASERS,
        run: laser::off_at_connect,
    },
    Check { name: "light after the delay, off when told", kinds: LASERS, run: laser::on_and_off },
    Check { name: "no light before its delay", kinds: LASERS, run: laser::delay },
    Check {
        name: "an open interlock is refused and latched",
        kinds: LASERS,
        run: laser::interlock,
    },
    Check { name: "off that does not happen is found", kinds: LASERS, run: laser::stuck },
    Check {
        name: "a lost line is unknown, and off when it is back",
        kinds: LASERS,
        run: laser::lost,
    },
    Check { name: "a reboot leaves it off", kinds: LASERS, run: laser::reboot },
    Check {
        name: "a set point above the limit is refused",
        kinds: LASERS,
        run: laser::above_limit,
    },
    Check { name: "off without waiting arrives", kinds: LASERS, run: laser::last_resort },
    Check { name: "it reads what is there", kinds: SENSORS, run: sensor::reads },
    Check { name: "no signal is an error, not a number", kinds: SENSORS, run: sensor::no_signal },
    Check { name: "each picture is that of its trigger", kinds: CAMERAS, run: camera::pictures },
    Check {
        name: "a lost picture is a timeout, and the next is its own",
        kinds: CAMERAS,
        run: camera::lost,
    },
    Check { name: "an armed camera can be disarmed", kinds: CAMERAS, run: camera::disarms },
];

/// Tries everything that concerns a driver. What failed, as `check, way: why`.
#[must_use]
pub fn failures(driver: &'static Driver) -> Vec<String> {
    let mut failed = Vec::new();
    for way in Way::of(driver) {
        for check in CHECKS.iter().filter(|c| c.kinds.is_empty() || c.kinds.contains(&driver.kind))
        {
            let result = Bench::new(driver, *way).and_then(|bench| (check.run)(&bench));
            if let Err(why) = result {
                failed.push(format!(
                    "{} ({}), {way}: {}: {why}",
                    driver.name, driver.kind, check.name
                ));
            }
        }
    }
    failed
}
