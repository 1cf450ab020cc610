//! `beampose rig check` and `beampose rig read`.

use std::time::Duration;

use beampose_core::clock::within;
use beampose_core::{Emission, Identity, InstrumentError, InstrumentName, Reading};
use beampose_plan::Instrument;

use super::{Bench, Ended, Which};
use crate::cli::sessions::plain_table;
use crate::output::{Exit, print};

/// How long one instrument may take.
const PATIENCE: Duration = Duration::from_secs(20);

/// Talk to every instrument of a rig, moving and lighting nothing
///
/// Asks each who it is and reads what can be read. Connecting to a laser switches it off. Exit code
/// 4 if one does not answer.
#[derive(clap::Args)]
pub struct Check {
    #[command(flatten)]
    which: Which,
    /// Print one JSON object for each instrument
    #[arg(long)]
    json: bool,
}

/// Read sensors and positions once
#[derive(clap::Args)]
pub struct Read {
    #[command(flatten)]
    which: Which,
    /// Which instruments [default: all that can be read]
    names: Vec<String>,
    /// Print one JSON object for each instrument
    #[arg(long)]
    json: bool,
}

/// What an instrument says.
struct Said {
    name: InstrumentName,
    driver: String,
    address: String,
    identity: Result<Identity, InstrumentError>,
    reads: Option<Result<String, InstrumentError>>,
}

impl Check {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let bench = self.which.open()?;
        let mut all_well = true;
        let mut table = plain_table();
        for (name, instrument) in &bench.rig.instruments {
            let said = bench.drive(Box::pin(ask(&bench, name, instrument))).await;
            all_well &= said.identity.is_ok() && !matches!(said.reads, Some(Err(_)));
            if self.json {
                print(&said.json().to_string());
            } else {
                table.add_row(said.row());
            }
        }
        if !self.json {
            print(&table.to_string());
        }
        Ok(if all_well { Exit::Success } else { Exit::Failed })
    }
}

impl Said {
    fn row(&self) -> [String; 4] {
        let identity = match &self.identity {
            Ok(it) => match &it.serial {
                Some(serial) => format!("{}, serial {serial}", it.model),
                None => it.model.clone(),
            },
            Err(error) => format!("FAILED: {error}"),
        };
        let reads = match &self.reads {
            None => String::new(),
            Some(Ok(text)) => text.clone(),
            Some(Err(error)) => format!("FAILED: {error}"),
        };
        let place = format!("{} {}", self.driver, self.address);
        [self.name.to_string(), place.trim_end().to_owned(), identity, reads]
    }

    fn json(&self) -> serde_json::Value {
        serde_json::json!({
            "instrument": self.name.as_str(),
            "driver": self.driver,
            "address": self.address,
            "model": self.identity.as_ref().ok().map(|it| &it.model),
            "serial": self.identity.as_ref().ok().and_then(|it| it.serial.as_ref()),
            "simulated": self.identity.as_ref().ok().map(|it| it.simulated),
            "error": self.identity.as_ref().err().map(ToString::to_string),
            "reads": self.reads.as_ref().and_then(|it| it.as_ref().ok()),
            "reading_error": self.reads.as_ref().and_then(|it| it.as_ref().err())
                .map(ToString::to_string),
        })
    }
}

async fn ask(bench: &Bench, name: &InstrumentName, instrument: &Instrument) -> Said {
    let it = &bench.laboratory.bench;
    let clock = bench.laboratory.clock.shared();
    let found: Option<&dyn beampose_core::Instrument> = match instrument {
        Instrument::LinearAxis(_) | Instrument::RotaryAxis(_) => {
            it.axes.get(name).map(|it| &**it as _)
        }
        Instrument::Laser(_) => it.lasers.get(name).map(|it| &**it as _),
        Instrument::Sensor(_) => it.sensors.get(name).map(|it| &**it as _),
        Instrument::Camera(_) => it.cameras.get(name).map(|it| &**it as _),
    };
    let identity = match found {
        Some(found) => within(&*clock, PATIENCE, found.identify())
            .await
            .unwrap_or(Err(InstrumentError::Timeout(PATIENCE))),
        None => Err(InstrumentError::Disconnected("it was not made".to_owned())),
    };
    let reads = if identity.is_ok() { reading(bench, name).await } else { None };
    Said {
        name: name.clone(),
        driver: instrument.driver().value.clone(),
        address: instrument.address().map_or_else(String::new, |at| at.value.clone()),
        identity,
        reads,
    }
}

/// What can be read of an instrument, in words.
async fn reading(bench: &Bench, name: &InstrumentName) -> Option<Result<String, InstrumentError>> {
    let it = &bench.laboratory.bench;
    if let Some(laser) = it.lasers.get(name) {
        let emission = match laser.emission().await {
            Emission::Off => "off",
            Emission::On => "ON",
            Emission::Unknown => "unknown: assume on",
        };
        let interlock = match laser.interlock() {
            None => "",
            Some(contact) => match contact.is_closed().await {
                Ok(true) => ", interlock closed",
                Ok(false) => ", interlock open",
                Err(error) => return Some(Err(error)),
            },
        };
        return Some(Ok(format!("{emission}{interlock}")));
    }
    number(bench, name).await.map(|read| {
        match read {
            // A meter without light has nothing to read; that is no fault of the rig.
            Err(InstrumentError::Refused(why)) => Ok(format!("nothing: {why}")),
            read => read.map(|reading| format!("{} {}", reading.value, unit(&reading))),
        }
    })
}

async fn number(bench: &Bench, name: &InstrumentName) -> Option<Result<Reading, InstrumentError>> {
    let it = &bench.laboratory.bench;
    let clock = bench.laboratory.clock.shared();
    let late = || Err(InstrumentError::Timeout(PATIENCE));
    if let Some(axis) = it.axes.get(name) {
        return Some(within(&*clock, PATIENCE, axis.position()).await.unwrap_or_else(|_| late()));
    }
    let sensor = it.sensors.get(name)?;
    Some(within(&*clock, PATIENCE, sensor.read()).await.unwrap_or_else(|_| late()))
}

pub(super) fn unit(reading: &Reading) -> &'static str {
    match reading.quantity {
        beampose_core::Quantity::Temperature => "degC",
        beampose_core::Quantity::Current => "mA",
        other => other.suffix(),
    }
}

impl Read {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let bench = self.which.open()?;
        let names = if self.names.is_empty() {
            bench.rig.instruments.keys().cloned().collect()
        } else {
            bench.named(&self.names)?
        };
        let mut all_well = true;
        for name in names {
            let Some(read) = bench.drive(Box::pin(number(&bench, &name))).await else {
                if self.names.is_empty() {
                    continue;
                }
                return Err(Ended::input(format!("`{name}` has nothing that can be read")));
            };
            // A meter without light has nothing to read; that is no fault unless it was asked for.
            let nothing = matches!(read, Err(InstrumentError::Refused(_)));
            all_well &= read.is_ok() || (nothing && self.names.is_empty());
            if self.json {
                print(&json(&name, &read).to_string());
                continue;
            }
            match read {
                Ok(reading) => print(&format!("{name}  {} {}", reading.value, unit(&reading))),
                Err(InstrumentError::Refused(why)) => print(&format!("{name}  nothing: {why}")),
                Err(error) => print(&format!("{name}  FAILED: {error}")),
            }
        }
        Ok(if all_well { Exit::Success } else { Exit::Failed })
    }
}

fn json(name: &InstrumentName, read: &Result<Reading, InstrumentError>) -> serde_json::Value {
    match read {
        Ok(reading) => serde_json::json!({
            "instrument": name.as_str(),
            "quantity": reading.quantity.name(),
            "unit": unit(reading),
            "value": reading.value,
            "at": reading.at.utc.to_string(),
        }),
        Err(error) => {
            serde_json::json!({"instrument": name.as_str(), "error": error.to_string()})
        }
    }
}
