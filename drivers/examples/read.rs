//! One driver as a program of its own, at a real address and in real time: says who answers there
//! and what it reads. For other people's devices and simulators, in `.ci/peers`, and for whoever
//! has just plugged something in.
//!
//! `read KIND NAME ADDRESS [OPTION=VALUE...] [TIMES]`; prints the identity or why there is none, and
//! the reading as many times as asked for.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use beampose_core::clock::{BoxFuture, ExternalGuard};
use beampose_core::instrument::AxisUnit;
use beampose_core::{Clock, Quantity, Stamp};
use beampose_drivers::transport::{Address, Line, Wire};
use beampose_drivers::{Connected, Driver, Options, Role, Setting};

struct WallClock(Instant);

impl Clock for WallClock {
    fn now(&self) -> Stamp {
        Stamp { monotonic: self.0.elapsed(), utc: jiff::Timestamp::now() }
    }

    fn sleep(&self, duration: Duration) -> BoxFuture<'_, ()> {
        // One instrument, one thread: nobody else is kept waiting.
        Box::pin(async move { std::thread::sleep(duration) })
    }

    fn external(&self) -> ExternalGuard {
        ExternalGuard::default()
    }
}

fn role(driver: &Driver) -> Result<Role, String> {
    match driver.kind {
        "linear_axis" => {
            Ok(Role::Axis { unit: AxisUnit::Millimetre, limits: [0.0, 1000.0], speed: 1.0 })
        }
        "rotary_axis" => {
            Ok(Role::Axis { unit: AxisUnit::Degree, limits: [-360.0, 360.0], speed: 1.0 })
        }
        "sensor" => {
            let quantity = driver.reads.unwrap_or(Quantity::Temperature);
            Ok(Role::Sensor { quantity, u: None })
        }
        other => Err(format!("a {other} has nothing to read")),
    }
}

fn main() -> Result<(), String> {
    let mut words = std::env::args().skip(1);
    let mut word = |what: &str| words.next().ok_or_else(|| format!("{what} is missing"));
    let (kind, name, place) = (word("KIND")?, word("NAME")?, word("ADDRESS")?);
    let driver = beampose_drivers::find(&kind, &name).ok_or("no such driver")?;
    let (written, rest): (Vec<String>, Vec<String>) = words.partition(|word| word.contains('='));
    let written: BTreeMap<String, String> = written
        .iter()
        .filter_map(|word| word.split_once('=').map(|(key, v)| (key.to_owned(), v.to_owned())))
        .collect();
    let options = Options::read(driver.options, &written).map_err(|(_, why)| why)?;
    let times: u32 = rest.first().map_or(Ok(1), |word| word.parse().map_err(|_| "no number"))?;
    let address: Address = place.parse().map_err(|error| format!("{error}"))?;
    let clock: Arc<dyn Clock> = Arc::new(WallClock(Instant::now()));
    let deadline = Duration::from_secs(2);
    let port = driver.port_settings(&options).map_err(|error| error.to_string())?;
    let line = port.map(|port| {
        let wire = Wire::new("it", address.clone(), port, Arc::clone(&clock), None);
        Arc::new(Line::new(Arc::new(wire), deadline))
    });
    let setting = Setting {
        name: "it".to_owned(),
        address,
        line,
        clock,
        options,
        role: role(driver)?,
        deadline,
        simulated: false,
        scratch: std::env::temp_dir(),
    };
    let connected = (driver.connect)(setting).map_err(|error| error.to_string())?;
    futures::executor::block_on(ask(&connected, times))
}

async fn ask(connected: &Connected, times: u32) -> Result<(), String> {
    let identity = match connected {
        Connected::Axis(it) => it.identify().await,
        Connected::Sensor(it) => it.identify().await,
        Connected::Laser(it) => it.identify().await,
        Connected::Camera(it) => it.identify().await,
    };
    match identity {
        Ok(it) => println!("{}, serial number {}", it.model, it.serial.as_deref().unwrap_or("-")),
        Err(error) => println!("no identity: {error}"),
    }
    for _ in 0..times {
        let reading = match connected {
            Connected::Axis(it) => it.position().await,
            Connected::Sensor(it) => it.read().await,
            _ => return Ok(()),
        };
        let reading = reading.map_err(|error| error.to_string())?;
        println!("{} {}", reading.quantity, reading.value);
    }
    Ok(())
}
