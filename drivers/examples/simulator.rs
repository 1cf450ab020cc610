//! One driver's simulator as a program of its own, with the simplest world behind it: for other
//! people's clients, in `.ci/peers`.
//!
//! `simulator KIND NAME tcp:127.0.0.1:0 [OPTION=VALUE...]` or `... pty:LINK`; prints the address and
//! serves until its standard input ends. A camera's simulator has its own address, and takes lines:
//! `lose` (the next picture), `releases` (prints how many there were).

use std::collections::BTreeMap;
use std::io::Read as _;
use std::sync::Arc;
use std::time::{Duration, Instant};

use beampose_core::clock::{BoxFuture, ExternalGuard};
use beampose_core::{Clock, Quantity, Stamp};
use beampose_drivers::sim::{
    Host, Part, Simulated, Stage, TestDiode, TestProbe, TestShutter, TestStage,
};
use beampose_drivers::{Moved, Options, Role, Simulator};

/// Simulators only look at the time; nobody here waits on it.
struct WallClock(Instant);

impl Clock for WallClock {
    fn now(&self) -> Stamp {
        Stamp { monotonic: self.0.elapsed(), utc: jiff::Timestamp::now() }
    }

    fn sleep(&self, _: Duration) -> BoxFuture<'_, ()> {
        Box::pin(std::future::pending())
    }

    fn external(&self) -> ExternalGuard {
        ExternalGuard::default()
    }
}

fn main() -> Result<(), String> {
    let mut words = std::env::args().skip(1);
    let mut word = |what: &str| words.next().ok_or_else(|| format!("{what} is missing"));
    let (kind, name, place) = (word("KIND")?, word("NAME")?, word("ADDRESS")?);
    let driver = beampose_drivers::find(&kind, &name).ok_or("no such driver")?;
    let written: BTreeMap<String, String> = words
        .filter_map(|word| word.split_once('=').map(|(key, v)| (key.to_owned(), v.to_owned())))
        .collect();
    let options = Options::read(driver.options, &written).map_err(|(_, why)| why)?;
    let clock: Arc<dyn Clock> = Arc::new(WallClock(Instant::now()));
    let (role, part) = match kind.as_str() {
        "linear_axis" | "rotary_axis" => {
            let (unit, limits) = if kind == "linear_axis" {
                (beampose_core::instrument::AxisUnit::Millimetre, [0.0, 300.0])
            } else {
                (beampose_core::instrument::AxisUnit::Degree, [-180.0, 180.0])
            };
            let stage = TestStage::new(Arc::clone(&clock), limits, 50.0);
            if driver.moved == Moved::ByHand {
                // Somebody pushes it there: it arrives within three seconds.
                stage.go(123.4567)?;
            }
            (Role::Axis { unit, limits, speed: 50.0 }, Part::Stage(Arc::new(stage)))
        }
        "laser" => {
            let role =
                Role::Laser { current_ma: Some(60.0), emission_delay: Duration::from_secs(3) };
            (role, Part::Diode(Arc::new(TestDiode::new(Arc::clone(&clock)))))
        }
        "camera" => {
            let exposure = Some(Duration::from_millis(100));
            let role = Role::Camera { exposure, delivery: Some(Duration::from_millis(200)) };
            (role, Part::Shutter(Arc::new(TestShutter::default())))
        }
        _ => {
            let quantity = driver.reads.unwrap_or(Quantity::Temperature);
            let start = if quantity == Quantity::Wavelength { 658.0 } else { 21.0 };
            let probe = TestProbe::new(start, 0.0);
            (Role::Sensor { quantity, u: None }, Part::Probe(Arc::new(probe)))
        }
    };
    let all = [Simulated { name: "it".to_owned(), options, role, part, clock }];
    let io = |error: std::io::Error| error.to_string();
    let mut until_the_end = Vec::new();
    match driver.simulator {
        Simulator::Device(make) => {
            let device = make(&all)?;
            let host = if let Some(link) = place.strip_prefix("pty:") {
                Host::pty_linked(device, link.into())
            } else {
                let socket = place.strip_prefix("tcp:").unwrap_or(&place);
                Host::tcp(device, socket.parse().map_err(|_| "no tcp:host:port")?)
            };
            let host = host.map_err(io)?;
            println!("{}", host.address());
            std::io::stdin().read_to_end(&mut until_the_end).map_err(io)?;
            drop(host);
        }
        Simulator::Hosted(make) => {
            let hosted = make(&all)?;
            println!("{}", hosted.address("it").ok_or("no address")?);
            for line in std::io::stdin().lines() {
                match line.map_err(io)?.as_str() {
                    "lose" => hosted.lose_next(),
                    "releases" => println!("{}", hosted.releases("it").len()),
                    other => println!("{other:?} is neither lose nor releases"),
                }
            }
            drop(hosted);
        }
    }
    Ok(())
}
