//! Who answers where: each driver's own question, asked at each address.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use beampose_core::instrument::AxisUnit;
use beampose_core::{Clock, Quantity};
use beampose_drivers::transport::{Address, Line, Wire, attached_ports};
use beampose_drivers::{Connected, Driver, Options, REGISTRY, Role, Setting, Value};
use beampose_engine::RealClock;

/// How long an answer may take: most instruments answer in a tenth of it.
const DEADLINE: Duration = Duration::from_millis(400);
/// How long one driver may try.
const PATIENCE: Duration = Duration::from_secs(4);

/// An address where somebody may answer.
pub struct Place {
    /// As for a rig file.
    pub address: String,
    /// What the USB device says of itself.
    pub about: Option<String>,
    /// Who answered.
    pub candidates: Vec<Candidate>,
}

/// An instrument that answered as one driver expects.
pub struct Candidate {
    /// The kind of instrument.
    pub kind: &'static str,
    /// The driver's name.
    pub driver: &'static str,
    /// What it said it is.
    pub identity: String,
    /// What it reads, if it is a sensor of one thing.
    pub reads: Option<Quantity>,
    /// Options that the rig file must have, with examples.
    pub options: Vec<String>,
}

/// Asks everywhere.
///
/// # Errors
/// An address or the name of a driver that is none.
pub async fn found(
    addresses: &[String],
    only: bool,
    drivers: &[String],
) -> Result<Vec<Place>, String> {
    if let Some(unknown) = drivers.iter().find(|name| REGISTRY.iter().all(|d| d.name != **name)) {
        let mut known: Vec<&str> = REGISTRY.iter().map(|driver| driver.name).collect();
        known.sort_unstable();
        known.dedup();
        return Err(format!("there is no driver `{unknown}`; there are {}", known.join(", ")));
    }
    let mut places = Vec::new();
    for text in addresses {
        text.parse::<Address>().map_err(|error| error.to_string())?;
        places.push(Place { address: text.clone(), about: None, candidates: Vec::new() });
    }
    if !only {
        places.extend(attached_ports().into_iter().map(|port| Place {
            address: port.path,
            about: port.about,
            candidates: Vec::new(),
        }));
    }
    let wanted = |driver: &&Driver| drivers.is_empty() || drivers.iter().any(|n| n == driver.name);
    for place in &mut places {
        let Ok(address) = place.address.parse::<Address>() else { continue };
        for driver in REGISTRY.iter().filter(wanted) {
            // What one family answers for a rail it answers for a rotation stage.
            let again = place.candidates.iter().any(|it| it.driver == driver.name);
            if let Some(identity) = ask(driver, &address).await.filter(|_| !again) {
                place.candidates.push(Candidate {
                    kind: driver.kind,
                    driver: driver.name,
                    identity,
                    reads: driver.reads,
                    options: needed(driver),
                });
            }
        }
    }
    Ok(places)
}

fn text(value: Value) -> String {
    match value {
        Value::Number(number) => number.to_string(),
        Value::Text(text) => text.to_owned(),
        Value::Switch(it) => it.to_string(),
    }
}

fn needed(driver: &Driver) -> Vec<String> {
    let needed = driver.options.iter().filter(|spec| spec.default.is_none());
    needed.map(|spec| format!("{}: {}", spec.name, text(spec.example))).collect()
}

async fn ask(driver: &'static Driver, address: &Address) -> Option<String> {
    // Instruments without a line are asked by other means than bytes.
    driver.port?;
    let needed = driver.options.iter().filter(|spec| spec.default.is_none());
    let written: BTreeMap<String, String> =
        needed.map(|spec| (spec.name.to_owned(), text(spec.example))).collect();
    let options = Options::read(driver.options, &written).ok()?;
    let port = driver.port_settings(&options).ok()??;
    let clock: Arc<dyn Clock> = Arc::new(RealClock::start());
    let wire = Wire::new("probe", address.clone(), port, clock.clone(), None);
    let setting = Setting {
        name: "probe".to_owned(),
        address: address.clone(),
        line: Some(Arc::new(Line::new(Arc::new(wire), DEADLINE))),
        clock,
        options,
        role: role(driver),
        deadline: DEADLINE,
        simulated: false,
        scratch: std::env::temp_dir(),
    };
    let made = (driver.connect)(setting).ok()?;
    let asked = async {
        match &made {
            Connected::Axis(it) => it.identify().await,
            Connected::Laser(it) => it.identify().await,
            Connected::Sensor(it) => it.identify().await,
            Connected::Camera(it) => it.identify().await,
        }
    };
    let identity = tokio::time::timeout(PATIENCE, asked).await.ok()?.ok()?;
    Some(match identity.serial {
        Some(serial) => format!("{}, serial {serial}", identity.model),
        None => identity.model,
    })
}

fn role(driver: &Driver) -> Role {
    let (limits, speed) = ([0.0, 0.0], 1.0);
    match driver.kind {
        "linear_axis" => Role::Axis { unit: AxisUnit::Millimetre, limits, speed },
        "rotary_axis" => Role::Axis { unit: AxisUnit::Degree, limits, speed },
        "laser" => Role::Laser { current_ma: None, emission_delay: Duration::from_secs(3) },
        "camera" => Role::Camera { exposure: None, delivery: None },
        _ => Role::Sensor { quantity: driver.reads.unwrap_or(Quantity::Temperature), u: None },
    }
}
