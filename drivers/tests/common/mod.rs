//! What tests of drivers from outside have in common: an instrument on a line, and the simplest
//! world behind its simulator.

use std::collections::BTreeMap;
use std::future::Future;
use std::sync::Arc;
use std::time::Duration;

use beampose_core::instrument::AxisUnit;
use beampose_core::transport::Transport;
use beampose_core::{Clock, InstrumentError, Quantity, VirtualClock};
use beampose_drivers::sim::{
    Device, Part, Simulated, TestDiode, TestProbe, TestShutter, TestStage,
};
use beampose_drivers::transport::{Address, Line};
use beampose_drivers::{Connected, Driver, Options, Role, Setting, Simulator, Value};

/// How long an answer may take.
pub const DEADLINE: Duration = Duration::from_millis(400);

/// A clock that only runs while somebody waits on it.
pub fn clock() -> VirtualClock {
    VirtualClock::starting_at(jiff::Timestamp::UNIX_EPOCH)
}

/// Runs to the end, in virtual time.
pub fn run<'a, T: Send + 'a>(
    clock: &'a VirtualClock,
    future: impl Future<Output = T> + Send + 'a,
) -> T {
    futures::executor::block_on(clock.drive(Box::pin(future)))
}

/// The options as written, with an example for each that must be there and is not.
pub fn options(driver: &'static Driver, written: &[(&str, &str)]) -> Options {
    let mut all: BTreeMap<String, String> =
        written.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
    for spec in driver.options.iter().filter(|spec| spec.default.is_none()) {
        let example = match spec.example {
            Value::Number(x) => x.to_string(),
            Value::Text(x) => x.to_owned(),
            Value::Switch(x) => x.to_string(),
        };
        all.entry(spec.name.to_owned()).or_insert(example);
    }
    Options::read(driver.options, &all).unwrap()
}

/// What a rig may say of an instrument of that driver.
pub fn role(driver: &Driver) -> Role {
    match driver.kind {
        "linear_axis" => {
            Role::Axis { unit: AxisUnit::Millimetre, limits: [0.0, 300.0], speed: 50.0 }
        }
        "rotary_axis" => Role::Axis { unit: AxisUnit::Degree, limits: [-90.0, 90.0], speed: 20.0 },
        "laser" => Role::Laser { current_ma: Some(60.0), emission_delay: Duration::from_secs(3) },
        "camera" => {
            let exposure = Some(Duration::from_millis(100));
            Role::Camera { exposure, delivery: Some(Duration::from_millis(200)) }
        }
        _ => Role::Sensor { quantity: driver.reads.unwrap_or(Quantity::Temperature), u: None },
    }
}

/// Its part of the world.
pub fn part(role: Role, clock: &VirtualClock) -> Part {
    let clock: Arc<dyn Clock> = Arc::new(clock.clone());
    match role {
        Role::Axis { limits, speed, .. } => {
            Part::Stage(Arc::new(TestStage::new(clock, limits, speed)))
        }
        Role::Laser { .. } => Part::Diode(Arc::new(TestDiode::new(clock))),
        Role::Camera { .. } => Part::Shutter(Arc::new(TestShutter::default())),
        Role::Sensor { quantity: Quantity::Wavelength, .. } => {
            Part::Probe(Arc::new(TestProbe::new(658.0, 0.125)))
        }
        Role::Sensor { .. } => Part::Probe(Arc::new(TestProbe::new(21.0, 0.25))),
    }
}

/// Its simulator; `None` where it brings its own sockets or files.
pub fn device(
    driver: &'static Driver,
    options: Options,
    part: Part,
    clock: &VirtualClock,
) -> Option<Box<dyn Device>> {
    let Simulator::Device(make) = driver.simulator else { return None };
    let clock: Arc<dyn Clock> = Arc::new(clock.clone());
    let name = "it".to_owned();
    let all = [Simulated { name, options, role: role(driver), part, clock }];
    Some(make(&all).unwrap())
}

/// The instrument at the other end of a line.
pub fn connect(
    driver: &'static Driver,
    options: Options,
    transport: Arc<dyn Transport>,
    clock: &VirtualClock,
) -> Result<Connected, InstrumentError> {
    let setting = Setting {
        name: "it".to_owned(),
        address: Address::Simulator { pty: false, device: None },
        line: Some(Arc::new(Line::new(transport, DEADLINE))),
        clock: Arc::new(clock.clone()),
        options,
        role: role(driver),
        deadline: DEADLINE,
        simulated: true,
        scratch: std::env::temp_dir(),
    };
    (driver.connect)(setting)
}

/// Who it is, and what it reads three times; of lasers and cameras the identity only.
pub async fn interview(connected: &Connected) -> Vec<Result<String, InstrumentError>> {
    let mut said = Vec::new();
    for _ in 0..3 {
        let identity = match connected {
            Connected::Axis(it) => it.identify().await,
            Connected::Sensor(it) => it.identify().await,
            Connected::Laser(it) => it.identify().await,
            Connected::Camera(it) => it.identify().await,
        };
        said.push(identity.map(|it| format!("{it:?}")));
        let reading = match connected {
            Connected::Axis(it) => it.position().await,
            Connected::Sensor(it) => it.read().await,
            _ => continue,
        };
        said.push(reading.map(|it| format!("{} {}", it.quantity, it.value)));
    }
    said
}
