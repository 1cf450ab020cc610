//! From a rig to instruments: the only place that knows concrete drivers.
//!
//! To add a driver's kind: an arm in `bench`. Real drivers come from the registry of
//! `beampose_drivers`; simulated ones share one [`World`].

mod faults;
mod parts;
pub mod person;
pub mod probe;
mod sight;
mod wires;
mod world;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use beampose_core::clock::BoxFuture;
use beampose_core::{
    Axis, ByHand, Clock, InstrumentName, Look, Quantity, Stamp, StepNumber, UsedFile, VirtualClock,
};
use beampose_engine::{Bench, Earlier, RealClock};
use beampose_photogrammetry::Setup;
use beampose_plan::rig;
use beampose_plan::{Action, ClockKind, Instrument, Rig, Step};
use beampose_virtual_lab::faults::Faults;
use beampose_virtual_lab::{
    HandMoved, History, SimulatedCamera, SimulatedDiodeThermometer, SimulatedLaser, SimulatedRail,
    SimulatedRotation, SimulatedThermometer, SimulatedWavemeter, StageHistory, World, WorldConfig,
};
use jiff::SignedDuration;

pub use beampose_drivers::transport::Recorder;
pub use wires::Wires;

use self::world::world_config;
use crate::calibration;
use crate::input::Checked;

/// The clock of a run.
#[derive(Clone)]
pub enum LabClock {
    /// Of the laboratory.
    Real(Arc<RealClock>),
    /// Of the simulation: waiting takes no time.
    Virtual(VirtualClock),
}

impl LabClock {
    fn of(kind: ClockKind, before: &Before) -> Self {
        let Some((opened, stopped)) = before.times else {
            return match kind {
                ClockKind::Real => Self::Real(Arc::new(RealClock::start())),
                ClockKind::Virtual => {
                    Self::Virtual(VirtualClock::starting_at(jiff::Timestamp::now()))
                }
            };
        };
        match kind {
            ClockKind::Real => {
                // A wall clock that was set back since does not turn the session's time back.
                let passed = jiff::Timestamp::now().duration_since(opened.utc);
                let passed = Duration::try_from(passed).unwrap_or_default();
                let now = (opened.monotonic + passed).max(stopped.monotonic);
                Self::Real(Arc::new(RealClock::resumed(now)))
            }
            // Nobody waited: virtual time stood still.
            ClockKind::Virtual => {
                let start =
                    opened.utc - SignedDuration::try_from(opened.monotonic).unwrap_or_default();
                Self::Virtual(VirtualClock::resumed(start, stopped.monotonic))
            }
        }
    }

    /// As what instruments and engine see.
    pub fn shared(&self) -> Arc<dyn Clock> {
        match self {
            Self::Real(clock) => clock.clone(),
            Self::Virtual(clock) => Arc::new(clock.clone()),
        }
    }

    /// Runs a future on this clock.
    pub async fn drive<'a, T: Send + 'a>(&self, future: BoxFuture<'a, T>) -> T {
        match self {
            Self::Real(_) => future.await,
            Self::Virtual(clock) => clock.drive(future).await,
        }
    }
}

/// A rig as instruments.
pub struct Laboratory {
    /// The instruments.
    pub bench: Bench,
    /// Their clock.
    pub clock: LabClock,
    /// The simulated world, if anything is simulated.
    pub world: Option<Arc<World>>,
    /// What solving is told: calibrations at the size that pictures have.
    pub setup: Setup,
    /// The files that it was read from.
    pub files: Vec<UsedFile>,
    /// What goes wrong on demand.
    pub faults: Option<Arc<Faults>>,
    /// The lines to instruments that real drivers speak to, and their simulators.
    #[expect(dead_code, reason = "held, not read: simulators answer as long as it lives")]
    pub wires: Wires,
}

/// What an earlier run of the session leaves; nothing where there was none.
#[derive(Debug, Clone, Default)]
pub struct Before {
    /// When the session was opened, and when the last thing that is known happened.
    pub times: Option<(Stamp, Stamp)>,
    /// What the simulated world lived through.
    pub history: History,
}

/// What the simulated world lived through, as far as steps are done: moves, readings, and
/// `pictures` (the camera of each). A move that is repeated counts as not yet made: it then ends
/// where it ended.
pub fn history<'a>(
    checked: &Checked,
    earlier: &Earlier,
    looks: &BTreeMap<StepNumber, Vec<Look>>,
    restored: &[Step],
    pictures: impl Iterator<Item = &'a str>,
) -> History {
    let mut history = History::default();
    for step in checked.summary.steps.iter().filter(|s| earlier.done.contains(&s.number)) {
        if let Action::Move { axis, target, .. } = &step.action
            && let Some(stage) = stage_of(&mut history, checked, axis)
        {
            stage.moves += 1;
            stage.target = Some(*target);
        }
        if let (Action::Align { axis, camera, .. }, Some(looks)) =
            (&step.action, looks.get(&step.number))
        {
            if let Some(stage) = stage_of(&mut history, checked, axis) {
                stage.moves += looks.len();
                stage.target = looks.last().map(|look| look.commanded);
                // The last reading and the last picture are counted with all others.
                stage.reads += looks.len().saturating_sub(1) as u64;
            }
            let triggers = history.triggers.entry(camera.as_str().to_owned()).or_default();
            *triggers += looks.len().saturating_sub(1) as u64;
        }
        for (name, reading) in earlier.readings.get(&step.number).into_iter().flatten() {
            match reading.quantity {
                Quantity::Wavelength => history.wavelength_reads += 1,
                Quantity::Temperature if is_of_a_laser(&checked.rig, name) => {
                    history.diode_temperature_reads += 1;
                }
                Quantity::Temperature => history.temperature_reads += 1,
                _ => {
                    if let Some(stage) = stage_of(&mut history, checked, name) {
                        stage.reads += 1;
                    }
                }
            }
        }
    }
    for step in restored {
        if let Action::Move { axis, .. } = &step.action
            && let Some(stage) = stage_of(&mut history, checked, axis)
        {
            stage.moves = stage.moves.saturating_sub(1);
            stage.reads = stage.reads.saturating_sub(1);
        }
    }
    let done = checked.summary.steps.iter().filter(|s| earlier.done.contains(&s.number));
    history.roll_deg = person::roll_deg(&checked.rig, done);
    for camera in pictures {
        *history.triggers.entry(camera.to_owned()).or_default() += 1;
    }
    history
}

/// Whether a sensor is on a laser, not in the room.
fn is_of_a_laser(rig: &Rig, name: &InstrumentName) -> bool {
    matches!(rig.instruments.get(name), Some(Instrument::Sensor(sensor)) if sensor.of.is_some())
}

/// The history of the stage that this axis is in the simulated world.
fn stage_of<'a>(
    history: &'a mut History,
    checked: &Checked,
    axis: &InstrumentName,
) -> Option<&'a mut StageHistory> {
    let module = &checked.rig.simulation.as_ref()?.module;
    if module.axis.as_ref().is_some_and(|it| it.value == *axis) {
        return Some(&mut history.rail);
    }
    let turntable = module.turntable.as_ref()?;
    (turntable.axis.value == *axis).then_some(&mut history.rotation)
}

/// Builds the instruments of a rig.
///
/// # Errors
/// Which file is at fault, or which instrument cannot be built, and why, for people.
pub fn laboratory(
    rig: &Rig,
    folder: &Path,
    before: &Before,
    recorder: Option<Arc<Recorder>>,
) -> Result<Laboratory, String> {
    // Calibrations at full picture size.
    let calibration::MeasuredWith { setup, files } = calibration::setup(rig, folder)?;
    let unknown = rig.unknown_drivers(beampose_drivers::known);
    if !unknown.is_empty() {
        return Err(unknown.to_string());
    }
    let mut wired = wires::wired(rig).map_err(|faults| faults.to_string())?;
    let clock = LabClock::of(rig.clock, before);
    let world = world(rig, folder, &setup, before)?;
    let setup = match &world {
        Some(world) => Setup { cameras: world.calibrations(), ..setup },
        None => setup,
    };
    let mut bench = bench(rig, world.as_ref(), &clock.shared())?;
    let mut wires = Wires::recorded(recorder);
    wires.simulate(rig, &mut wired, world.as_ref(), &clock.shared())?;
    wires.connect(wired, folder, &clock.shared(), &mut bench)?;
    let tolerance =
        |(name, it): (&InstrumentName, &Instrument)| Some((name.clone(), it.tolerance()?));
    let scale = rig.simulation.as_ref().map_or(1.0, |simulation| simulation.picture.scale);
    bench.sight = Some(Arc::new(sight::PatternSight::new(setup.pattern.clone(), scale)));
    bench.tolerances = rig.instruments.iter().filter_map(tolerance).collect();
    let faults = faults::faults(rig, &clock.shared(), &bench.under_way, &wires);
    if let Some(faults) = &faults {
        bench = faults::faulty(bench, faults);
    }
    Ok(Laboratory { bench, clock, world, setup, files, faults, wires })
}

/// The simulated world of a rig that has one.
fn world(
    rig: &Rig,
    folder: &Path,
    setup: &Setup,
    before: &Before,
) -> Result<Option<Arc<World>>, String> {
    let Some(simulation) = &rig.simulation else { return Ok(None) };
    let fan = calibration::simulated_fan(rig, folder)?;
    let pattern = fan.unwrap_or_else(|| setup.pattern.clone());
    let config = WorldConfig { pattern, ..world_config(rig, simulation, setup)? };
    World::after(config, simulation.seed, before.history.clone())
        .map(|world| Some(Arc::new(world)))
        .map_err(|error| format!("{}: simulation: {error}", rig.source.name()))
}

/// Simulators that run on their own, in real time.
pub struct Simulators {
    addresses: Vec<(String, &'static str, String)>,
    _wires: Wires,
}

impl Simulators {
    /// Name, driver and address of each.
    pub fn addresses(&self) -> &[(String, &'static str, String)] {
        &self.addresses
    }
}

/// Starts the simulators of a rig, all in one world.
///
/// # Errors
/// Which file is at fault, or which simulator cannot be had, and why, for people.
pub fn simulators(rig: &Rig, folder: &Path) -> Result<Simulators, String> {
    let setup = calibration::setup(rig, folder)?.setup;
    let mut wired = wires::wired(rig).map_err(|faults| faults.to_string())?;
    wired.retain(wires::Wired::asks_for_simulator);
    let world = world(rig, folder, &setup, &Before::default())?;
    let clock: Arc<dyn Clock> = Arc::new(RealClock::start());
    let mut wires = Wires::default();
    wires.simulate(rig, &mut wired, world.as_ref(), &clock)?;
    let addresses = wired.iter().map(wires::Wired::place).collect();
    Ok(Simulators { addresses, _wires: wires })
}

fn bench(rig: &Rig, world: Option<&Arc<World>>, clock: &Arc<dyn Clock>) -> Result<Bench, String> {
    let mut bench = Bench::default();
    for (name, instrument) in rig.instruments.iter().filter(|(_, it)| it.is_simulated()) {
        let world =
            world.ok_or_else(|| format!("{name} is simulated, but the rig has no `simulation`"))?;
        add_simulated(&mut bench, name, instrument, world, clock)
            .map_err(|error| format!("{name}: {error}"))?;
    }
    Ok(bench)
}

fn add_simulated(
    bench: &mut Bench,
    name: &InstrumentName,
    instrument: &Instrument,
    world: &Arc<World>,
    clock: &Arc<dyn Clock>,
) -> Result<(), String> {
    let (world, clock, name) = (world.clone(), clock.clone(), name.clone());
    let in_words = |error: beampose_virtual_lab::WorldError| error.to_string();
    match instrument {
        Instrument::LinearAxis(_) => {
            let rail = SimulatedRail::new(world, clock).map_err(in_words)?;
            bench.axes.insert(name, moved(instrument, Arc::new(rail)));
        }
        Instrument::RotaryAxis(_) => {
            let stage = SimulatedRotation::new(world, clock).map_err(in_words)?;
            bench.axes.insert(name, moved(instrument, Arc::new(stage)));
        }
        Instrument::Laser(_) => {
            bench.lasers.insert(name, Arc::new(SimulatedLaser::new(world, clock)));
        }
        Instrument::Sensor(sensor) => match sensor.reads {
            Quantity::Wavelength => {
                bench.sensors.insert(name, Arc::new(SimulatedWavemeter::new(world, clock)));
            }
            Quantity::Temperature if sensor.of.is_some() => {
                bench.sensors.insert(name, Arc::new(SimulatedDiodeThermometer::new(world, clock)));
            }
            Quantity::Temperature => {
                bench.sensors.insert(name, Arc::new(SimulatedThermometer::new(world, clock)));
            }
            other => return Err(format!("the simulated world has no {} to read", other.name())),
        },
        Instrument::Camera(_) => {
            let camera = SimulatedCamera::new(world, clock, name.as_str()).map_err(in_words)?;
            bench.cameras.insert(name, Arc::new(camera));
        }
    }
    Ok(())
}

/// The stage as the rig has it: with a motor, or moved by hand.
fn moved(instrument: &Instrument, stage: Arc<dyn Axis>) -> Arc<dyn Axis> {
    match (instrument.still_for(), instrument.tolerance()) {
        (Some(still_for), Some(tolerance)) => {
            let by_hand = ByHand { tolerance, still_for: still_for.duration() };
            Arc::new(HandMoved::new(stage, by_hand))
        }
        _ => stage,
    }
}

/// The seed of a simulated rig.
pub fn seed(rig: &Rig) -> Option<u64> {
    rig.simulation.as_ref().map(|s: &rig::Simulation| s.seed)
}
