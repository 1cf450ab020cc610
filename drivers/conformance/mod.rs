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
    Check {
        name: "moved by hand, it is read and does not move by itself",
        kinds: AXES,
        run: axis::by_hand,
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
    Check {
        name: "a contact that opens before light is refused and latched",
        kinds: LASERS,
        run: laser::interlock_meanwhile,
    },
    Check {
        name: "a diode that is not at its temperature is refused",
        kinds: LASERS,
        run: laser::temperature,
    },
    Check { name: "off that does not happen is found", kinds: LASERS, run: laser::stuck },
    Check { name: "current that flows past off is found", kinds: LASERS, run: laser::leaking },
    Check {
        name: "on that nobody commanded is found and ended",
        kinds: LASERS,
        run: laser::uncommanded,
    },
    Check { name: "dropped or given up, it leaves no light", kinds: LASERS, run: laser::dropped },
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
        for check in CHECKS.iter().filter(|c| c.kinds.is_empty() || c.kinds.contains(&driver.kind))
        {
            let bench = || Bench::new(driver, *way);
            // Bytes have real deadlines: on a busy machine an answer may miss one that is short.
            // What is wrong with a driver is wrong with a long one too.
            let result = bench()
                .and_then(|bench| (check.run)(&bench))
                .or_else(|_| bench().and_then(|bench| (check.run)(&bench.patient())));
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
