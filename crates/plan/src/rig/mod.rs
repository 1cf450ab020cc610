//! The rig: as written in [`RigFile`], as understood in [`Rig`]. Only [`read_rig`] makes one.

pub mod instruments;
pub mod measurement;
pub mod simulation;
mod validate;

use std::collections::BTreeMap;

use beampose_core::InstrumentName;

pub use instruments::{Instrument, SIMULATED, SensorUncertainty};
pub use measurement::{FanTurns, Goniometer, Measurement};
pub use simulation::{FaultKind, SimulatedFault, Simulation};

use crate::fault::{AsRead, At, Faults, Source};
use crate::reader::{Maybe, Needed};

/// The version of the rig format that this program reads.
pub const RIG_VERSION: u32 = 1;

record! {
    /// A rig: with which instruments, and what is known of the setup.
    pub struct RigFile {
        /// The version of this format: 1.
        version: Needed<At<u32>>,
        /// What the report calls it.
        title: Needed<String>,
        /// Whether time passes by itself or only when everybody waits for it.
        clock: Needed<At<ClockKind>>,
        /// The instruments, by the names that plans use.
        instruments: Needed<At<BTreeMap<String, At<Instrument>>>>,
        /// What solving is told beside pictures and readings.
        measurement: Needed<Measurement>,
        /// The simulated world, if there are simulated instruments.
        simulation: Maybe<At<Simulation>>,
    }
}

words! {
    /// The clock of a session.
    pub enum ClockKind ("a clock") {
        /// That of the machine.
        "real" => Real,
        /// In virtual time a wait takes none: for simulated instruments only.
        "virtual" => Virtual,
    }
}

/// A valid rig.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    /// The file it was read from.
    pub source: Source,
    /// What the report calls it.
    pub title: String,
    /// The clock of its sessions.
    pub clock: ClockKind,
    /// The instruments, by the names that plans use.
    pub instruments: BTreeMap<InstrumentName, Instrument>,
    /// What solving is told beside pictures and readings.
    pub measurement: Measurement,
    /// The simulated world, if there are simulated instruments.
    pub simulation: Option<Simulation>,
}

impl Rig {
    /// The cameras, in the order of their names.
    pub fn cameras(&self) -> impl Iterator<Item = (&InstrumentName, &instruments::Camera)> {
        self.instruments.iter().filter_map(|(name, instrument)| match instrument {
            Instrument::Camera(camera) => Some((name, camera)),
            _ => None,
        })
    }

    /// The lasers, in the order of their names.
    pub fn lasers(&self) -> impl Iterator<Item = (&InstrumentName, &instruments::Laser)> {
        self.instruments.iter().filter_map(|(name, instrument)| match instrument {
            Instrument::Laser(laser) => Some((name, laser)),
            _ => None,
        })
    }

    /// The sensors, in the order of their names.
    pub fn sensors(&self) -> impl Iterator<Item = (&InstrumentName, &instruments::Sensor)> {
        self.instruments.iter().filter_map(|(name, instrument)| match instrument {
            Instrument::Sensor(sensor) => Some((name, sensor)),
            _ => None,
        })
    }

    /// The faults of drivers that nobody has. `known` gives the drivers' names for a kind of
    /// instrument (`linear_axis`); `simulated` always counts as known.
    #[must_use]
    pub fn unknown_drivers(&self, known: impl Fn(&str) -> Vec<&'static str>) -> Faults {
        let mut faults = Faults::default();
        for instrument in self.instruments.values() {
            let driver = instrument.driver();
            let mut names = known(instrument.kind());
            names.push(SIMULATED);
            if !names.contains(&driver.value.as_str()) {
                let what = format!("no driver `{}` for a `{}`", driver.value, instrument.kind());
                let help = crate::suggest::help(&driver.value, names);
                faults.push(self.source.error(driver.mark, what).maybe_help(help));
            }
        }
        faults
    }
}

/// Reads a rig. `name` is how the file is called in faults.
///
/// # Errors
/// Every fault that the text has.
pub fn read_rig(name: &str, bytes: &[u8]) -> Result<Rig, Faults> {
    let AsRead { value, faults } = read_rig_as_it_is(name, bytes);
    faults.into_result(value, name)
}

/// Reads a rig as far as it can be understood, as [`crate::plan::read_plan_as_it_is`] a plan.
#[must_use]
pub fn read_rig_as_it_is(name: &str, bytes: &[u8]) -> AsRead<Rig> {
    let read = crate::source::utf8(name, bytes)
        .map_err(Faults::from)
        .and_then(|source| crate::reader::document::<RigFile>(&source));
    match read {
        Ok((file, mut reader)) => {
            let value = file.and_then(|file| validate::rig(file, &mut reader));
            AsRead { value, faults: reader.faults }
        }
        Err(faults) => AsRead { value: None, faults },
    }
}
