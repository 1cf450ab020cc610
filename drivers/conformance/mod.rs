//! What every driver must do, tried against its own simulator with no word about the driver.
//!
//! A driver that is in the registry is tried by `drivers/tests/conformance.rs`; nothing needs to be
//! wired. Each check gets a device fresh from the factory, on TCP and again on a pty. A check that fails
//! once has failed: none is tried again.

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
    /// Whether it waits for an answer that does not come: then it is tried where that is soon
    /// known, see [`Way`].
    pub waits: bool,
    /// What is wrong, if anything is.
    pub run: fn(&Bench) -> Result<(), String>,
}

const AXES: &[&str] = &["linear_axis", "rotary_axis"];
const LASERS: &[&str] = &["laser"];
const SENSORS: &[&str] = &["sensor"];
const CAMERAS: &[&str] = &["camera"];

/// All of it.
pub const CHECKS: &[Check] = &[
    Check { name: "it says who it is", kinds: &[], waits: false, run: line::identifies },
    Check { name: "its serial port is set as it says", kinds: &[], waits: false, run: line::port },
    Check {
        name: "no answer is a timeout, and the next call works",
        kinds: &[],
        waits: true,
        run: line::silent,
    },
    Check {
        name: "garbage is not taken for an answer",
        kinds: &[],
        waits: true,
        run: line::garbled,
    },
    Check { name: "half an answer is not taken for one", kinds: &[], waits: true, run: line::half },
    Check {
        name: "what nobody asked for is passed over",
        kinds: &[],
        waits: false,
        run: line::chatter,
    },
    Check {
        name: "a late answer is not taken for a later one",
        kinds: &[],
        waits: true,
        run: line::late,
    },
    Check {
        name: "a question that is given up leaves nothing behind",
        kinds: &[],
        waits: true,
        run: line::given_up,
    },
    Check { name: "a cut line is made again", kinds: &[], waits: false, run: line::cut },
    Check {
        name: "a pulled cable is named, and mended by plugging it in",
        kinds: &[],
        waits: false,
        run: line::unplugged,
    },
    Check { name: "two clients at once", kinds: &[], waits: false, run: line::two_clients },
    Check {
        name: "a refusal of the device is an error in words",
        kinds: &[],
        waits: true,
        run: line::refusal,
    },
    Check { name: "it moves, and reads where it is", kinds: AXES, waits: false, run: axis::moves },
    Check { name: "its unit is that of the rig", kinds: AXES, waits: false, run: axis::unit },
    Check {
        name: "beyond its limits is refused and nothing moves",
        kinds: AXES,
        waits: false,
        run: axis::limits,
    },
    Check {
        name: "moved by hand, it is read and does not move by itself",
        kinds: AXES,
        waits: false,
        run: axis::by_hand,
    },
    Check {
        name: "it stops while it moves, and the move says so",
        kinds: AXES,
        waits: false,
        run: axis::stops,
    },
    Check {
        name: "it stops at once, whoever waits for an answer",
        kinds: AXES,
        waits: true,
        run: axis::stops_at_once,
    },
    Check {
        name: "cut in the middle of a move is an error",
        kinds: AXES,
        waits: false,
        run: axis::cut_on_the_way,
    },
    Check {
        name: "after a reboot it is homed before it moves",
        kinds: AXES,
        waits: false,
        run: axis::reboot,
    },
    Check {
        name: "off at connect, whatever was before",
        kinds: LASERS,
        waits: false,
        run: laser::off_at_connect,
    },
    Check {
        name: "light after the delay, off when told",
        kinds: LASERS,
        waits: false,
        run: laser::on_and_off,
    },
    Check { name: "no light before its delay", kinds: LASERS, waits: false, run: laser::delay },
    Check {
        name: "an open interlock is refused and latched",
        kinds: LASERS,
        waits: false,
        run: laser::interlock,
    },
    Check {
        name: "a contact that opens before light is refused and latched",
        kinds: LASERS,
        waits: false,
        run: laser::interlock_meanwhile,
    },
    Check {
        name: "a diode that is not at its temperature is refused",
        kinds: LASERS,
        waits: false,
        run: laser::temperature,
    },
    Check {
        name: "off that does not happen is found",
        kinds: LASERS,
        waits: false,
        run: laser::stuck,
    },
    Check {
        name: "current that flows past off is found",
        kinds: LASERS,
        waits: false,
        run: laser::leaking,
    },
    Check {
        name: "on that nobody commanded is found and ended",
        kinds: LASERS,
        waits: false,
        run: laser::uncommanded,
    },
    Check {
        name: "dropped or given up, it leaves no light",
        kinds: LASERS,
        waits: false,
        run: laser::dropped,
    },
    Check {
        name: "a lost line is unknown, and off when it is back",
        kinds: LASERS,
        waits: false,
        run: laser::lost,
    },
    Check { name: "a reboot leaves it off", kinds: LASERS, waits: false, run: laser::reboot },
    Check {
        name: "a set point above the limit is refused",
        kinds: LASERS,
        waits: false,
        run: laser::above_limit,
    },
    Check {
        name: "off without waiting arrives",
        kinds: LASERS,
        waits: false,
        run: laser::last_resort,
    },
    Check { name: "it reads what is there", kinds: SENSORS, waits: false, run: sensor::reads },
    Check {
        name: "no signal is an error, not a number",
        kinds: SENSORS,
        waits: false,
        run: sensor::no_signal,
    },
    Check {
        name: "each picture is that of its trigger",
        kinds: CAMERAS,
        waits: false,
        run: camera::pictures,
    },
    Check {
        name: "a lost picture is a timeout, and the next is its own",
        kinds: CAMERAS,
        waits: false,
        run: camera::lost,
    },
    Check {
        name: "an armed camera can be disarmed",
        kinds: CAMERAS,
        waits: false,
        run: camera::disarms,
    },
];

/// Why a driver cannot be tried on this machine, as `name (kind), way: why`: for whoever tries to say
/// so. Its checks are then not among those that fail.
#[must_use]
pub fn untried(driver: &'static Driver) -> Vec<String> {
    let lacks = |way: &Way| Some((*way, Bench::new(driver, *way).ok()?.lacks()?));
    let said = |(way, why)| format!("{} ({}), {way}: {why}", driver.name, driver.kind);
    Way::of(driver).iter().filter_map(lacks).map(said).collect()
}

/// Tries everything that concerns a driver. What failed, as `check, way: why`.
#[must_use]
pub fn failures(driver: &'static Driver) -> Vec<String> {
    let mut failed = Vec::new();
    // One whose simulator cannot be made fails in every check.
    let lacks = |way: &Way| Bench::new(driver, *way).is_ok_and(|bench| bench.lacks().is_some());
    for way in Way::of(driver).iter().filter(|way| !lacks(way)) {
        for check in CHECKS.iter().filter(|check| check.concerns(driver, *way)) {
            if let Err(why) = Bench::new(driver, *way).and_then(|bench| (check.run)(&bench)) {
                failed.push(format!(
                    "{} ({}), {way}: {}: {why}",
                    driver.name, driver.kind, check.name
                ));
            }
        }
    }
    failed
}

impl Check {
    fn concerns(&self, driver: &Driver, way: Way) -> bool {
        let of_kind = self.kinds.is_empty() || self.kinds.contains(&driver.kind);
        of_kind && !(self.waits && way == Way::Pty)
    }
}
