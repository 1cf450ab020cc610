//! Real drivers: from what a rig file says of an instrument to the instrument, over its line.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use async_trait::async_trait;
use beampose_core::instrument::{AxisUnit, Homing};
use beampose_core::units::Second;
use beampose_core::{Axis, ByHand, Clock, Identity, InstrumentError, InstrumentName, Reading};
use beampose_drivers::sim::{Host, Hosted, Simulated};
use beampose_drivers::transport::{Address, Line, Recorder, Wire};
use beampose_drivers::{Connected, Driver, Options, Role, Setting, Simulator};
use beampose_engine::Bench;
use beampose_plan::rig::SensorUncertainty;
use beampose_plan::{Faults, Instrument, Rig};
use beampose_virtual_lab::World;

use super::parts;

/// How long an instrument may take to answer, where the rig says nothing.
const DEADLINE: Duration = Duration::from_secs(1);

/// What keeps lines alive: simulators and scratch files. To be held while instruments are used.
#[derive(Default)]
pub struct Wires {
    hosts: BTreeMap<InstrumentName, Arc<Host>>,
    hosted: Vec<Box<dyn Hosted>>,
    lines: BTreeMap<Address, Arc<Line>>,
    scratch: Option<tempfile::TempDir>,
    recorder: Option<Arc<Recorder>>,
}

/// One instrument that a real driver speaks to, checked.
pub struct Wired<'a> {
    name: &'a InstrumentName,
    instrument: &'a Instrument,
    driver: &'static Driver,
    address: Address,
    options: Options,
    role: Role,
}

impl Wired<'_> {
    /// Whether this program is to start its simulator.
    pub fn asks_for_simulator(&self) -> bool {
        matches!(self.address, Address::Simulator { .. })
    }

    /// Name, driver and address.
    pub fn place(&self) -> (String, &'static str, String) {
        (self.name.to_string(), self.driver.name, self.address.to_string())
    }
}

/// The instruments of a rig that real drivers speak to.
///
/// # Errors
/// Every address and option that its driver cannot use, each with its place in the file.
pub fn wired(rig: &Rig) -> Result<Vec<Wired<'_>>, Faults> {
    let mut faults = Faults::default();
    let mut all = Vec::new();
    for (name, instrument) in rig.instruments.iter().filter(|(_, it)| !it.is_simulated()) {
        let named = instrument.driver();
        let Some(driver) = beampose_drivers::find(instrument.kind(), &named.value) else {
            continue;
        };
        let mut fault = |mark, what: String| faults.push(rig.source.error(mark, what));
        let address = match instrument.address() {
            Some(at) => at.value.parse::<Address>().map_err(|error| (at.mark, error.to_string())),
            None => Err((named.mark, format!("`{name}` needs an `address`: where it is"))),
        };
        let written: BTreeMap<String, String> = instrument
            .options()
            .into_iter()
            .flatten()
            .map(|(key, at)| (key.clone(), at.value.0.clone()))
            .collect();
        let options = Options::read(driver.options, &written).map_err(|(key, why)| {
            let at = instrument.options().and_then(|options| options.get(&key));
            (at.map_or(named.mark, |at| at.mark), format!("`{name}`: {why}"))
        });
        match (address, options) {
            (Ok(address), Ok(options)) => {
                let role = role(instrument);
                all.push(Wired { name, instrument, driver, address, options, role });
            }
            (address, options) => {
                for (mark, what) in [address.err(), options.err()].into_iter().flatten() {
                    fault(mark, what);
                }
            }
        }
    }
    if faults.is_empty() { Ok(all) } else { Err(faults) }
}

fn role(instrument: &Instrument) -> Role {
    let time = |s: Second| s.duration();
    match instrument {
        Instrument::LinearAxis(axis) => Role::Axis {
            unit: AxisUnit::Millimetre,
            limits: [axis.travel.value.from.0, axis.travel.value.to.0],
            speed: axis.speed.0,
        },
        Instrument::RotaryAxis(axis) => Role::Axis {
            unit: AxisUnit::Degree,
            limits: [axis.travel.value.from.0, axis.travel.value.to.0],
            speed: axis.speed.0,
        },
        Instrument::Laser(laser) => Role::Laser {
            current_ma: laser.current.map(|current| current.0),
            emission_delay: time(laser.emission_delay),
        },
        Instrument::Sensor(sensor) => Role::Sensor {
            quantity: sensor.reads,
            u: sensor.u.as_ref().map(|u: &beampose_plan::At<SensorUncertainty>| u.value.number()),
        },
        Instrument::Camera(camera) => Role::Camera {
            exposure: camera.exposure.map(time),
            delivery: camera.delivery.map(time),
        },
    }
}

impl Wires {
    /// No line yet; what goes over them is recorded if somebody wants it.
    pub fn recorded(recorder: Option<Arc<Recorder>>) -> Self {
        Self { recorder, ..Self::default() }
    }

    /// The host of an instrument whose simulator this program runs.
    pub fn host(&self, name: &InstrumentName) -> Option<&Arc<Host>> {
        self.hosts.get(name)
    }

    /// Starts the simulators of those instruments whose address asks for one, and says where they
    /// are.
    ///
    /// # Errors
    /// For people: which instrument, and what its simulator lacks.
    pub fn simulate(
        &mut self,
        rig: &Rig,
        wired: &mut [Wired<'_>],
        world: Option<&Arc<World>>,
        clock: &Arc<dyn Clock>,
    ) -> Result<(), String> {
        // Instruments that share a device, in the order of their names.
        let mut devices: BTreeMap<(&str, String), Vec<usize>> = BTreeMap::new();
        for (i, it) in wired.iter().enumerate() {
            if let Address::Simulator { device, .. } = &it.address {
                let device = device.clone().unwrap_or_else(|| format!("only {}", it.name));
                devices.entry((it.driver.name, device)).or_default().push(i);
            }
        }
        for indices in devices.into_values() {
            let mut all = Vec::new();
            for &i in &indices {
                let it = &wired[i];
                let world = world.ok_or_else(|| {
                    format!("{}: a simulator needs the rig's `simulation`", it.name)
                })?;
                let part = parts::part(rig, it.name, it.instrument, world, clock)
                    .map_err(|why| format!("{}: {why}", it.name))?;
                all.push(Simulated {
                    name: it.name.to_string(),
                    options: it.options.clone(),
                    role: it.role,
                    part,
                    clock: clock.clone(),
                });
            }
            let first = &wired[indices[0]];
            let (driver, name) = (first.driver, first.name.clone());
            let pty = matches!(first.address, Address::Simulator { pty: true, .. });
            let in_words = |why: String| format!("{name}: its simulator: {why}");
            match driver.simulator {
                Simulator::Device(make) => {
                    let device = make(&all).map_err(in_words)?;
                    let any = std::net::SocketAddr::from((std::net::Ipv4Addr::LOCALHOST, 0));
                    let host = if pty { Host::pty(device) } else { Host::tcp(device, any) };
                    let host = Arc::new(host.map_err(|error| in_words(error.to_string()))?);
                    for i in indices {
                        wired[i].address = host.address().clone();
                        self.hosts.insert(wired[i].name.clone(), host.clone());
                    }
                }
                Simulator::Hosted(make) => {
                    let hosted = make(&all).map_err(in_words)?;
                    for i in indices {
                        let found = hosted.address(wired[i].name.as_str());
                        wired[i].address =
                            found.ok_or_else(|| in_words("no address".to_owned()))?;
                    }
                    self.hosted.push(hosted);
                }
            }
        }
        Ok(())
    }

    /// Makes the instruments and puts them on the bench. Nothing is sent yet.
    ///
    /// # Errors
    /// For people: which instrument, and why not.
    pub fn connect(
        &mut self,
        wired: Vec<Wired<'_>>,
        folder: &Path,
        clock: &Arc<dyn Clock>,
        bench: &mut Bench,
    ) -> Result<(), String> {
        for it in wired {
            let name = it.name.clone();
            let simulated = self.hosts.contains_key(&name)
                || it.instrument.address().is_some_and(|at| at.value.starts_with("simulator:"));
            let port = it.driver.port_settings(&it.options);
            let port = port.map_err(|error| format!("{name}: {error}"))?;
            let line = port.map(|port| self.line(&it, port, clock));
            let setting = Setting {
                name: name.to_string(),
                address: relative_to(folder, it.address),
                line,
                clock: clock.clone(),
                options: it.options,
                role: it.role,
                deadline: deadline(it.instrument),
                simulated,
                scratch: self.scratch().map_err(|error| format!("{name}: {error}"))?,
            };
            let made = (it.driver.connect)(setting).map_err(|error| format!("{name}: {error}"))?;
            match made {
                Connected::Axis(axis) => {
                    bench.axes.insert(name, with_habits(it.instrument, axis, clock));
                }
                Connected::Laser(laser) => drop(bench.lasers.insert(name, laser)),
                Connected::Sensor(sensor) => drop(bench.sensors.insert(name, sensor)),
                Connected::Camera(camera) => drop(bench.cameras.insert(name, camera)),
            }
        }
        Ok(())
    }

    fn line(
        &mut self,
        it: &Wired<'_>,
        port: beampose_drivers::transport::PortSettings,
        clock: &Arc<dyn Clock>,
    ) -> Arc<Line> {
        let recorder = self.recorder.clone();
        let make = || {
            let wire =
                Wire::new(it.name.as_str(), it.address.clone(), port, clock.clone(), recorder);
            Arc::new(Line::new(Arc::new(wire), deadline(it.instrument)))
        };
        self.lines.entry(it.address.clone()).or_insert_with(make).clone()
    }

    fn scratch(&mut self) -> std::io::Result<PathBuf> {
        if self.scratch.is_none() {
            self.scratch = Some(tempfile::Builder::new().prefix("beampose-").tempdir()?);
        }
        Ok(self.scratch.as_ref().map(|folder| folder.path().to_path_buf()).unwrap_or_default())
    }
}

fn deadline(instrument: &Instrument) -> Duration {
    instrument.deadline().map_or(DEADLINE, |time| time.duration())
}

fn relative_to(folder: &Path, address: Address) -> Address {
    match address {
        Address::Folder(path) => Address::Folder(folder.join(path)),
        other => other,
    }
}

/// The stage as the rig has it: it settles after a move, or is moved by hand.
fn with_habits(
    instrument: &Instrument,
    axis: Arc<dyn Axis>,
    clock: &Arc<dyn Clock>,
) -> Arc<dyn Axis> {
    let by_hand = instrument
        .still_for()
        .zip(instrument.tolerance())
        .map(|(still_for, tolerance)| ByHand { tolerance, still_for: still_for.duration() });
    let settle = match instrument {
        Instrument::LinearAxis(axis) => axis.settle.duration(),
        Instrument::RotaryAxis(axis) => axis.settle.duration(),
        _ => Duration::ZERO,
    };
    Arc::new(Settled { axis, clock: clock.clone(), settle, by_hand })
}

/// An axis that stands still for a while before a move counts as done.
struct Settled {
    axis: Arc<dyn Axis>,
    clock: Arc<dyn Clock>,
    settle: Duration,
    by_hand: Option<ByHand>,
}

#[async_trait]
impl beampose_core::Instrument for Settled {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        self.axis.identify().await
    }
}

#[async_trait]
impl Axis for Settled {
    async fn move_to(&self, target: f64) -> Result<(), InstrumentError> {
        self.axis.move_to(target).await?;
        if self.by_hand.is_none() {
            self.clock.sleep(self.settle).await;
        }
        Ok(())
    }

    async fn position(&self) -> Result<Reading, InstrumentError> {
        self.axis.position().await
    }

    async fn stop(&self) -> Result<(), InstrumentError> {
        self.axis.stop().await
    }

    fn unit(&self) -> AxisUnit {
        self.axis.unit()
    }

    fn by_hand(&self) -> Option<ByHand> {
        self.by_hand
    }

    fn homing(&self) -> Option<&dyn Homing> {
        self.axis.homing()
    }
}
