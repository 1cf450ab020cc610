//! What goes wrong on demand, as the rig declares it.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::AtomicU32;
use std::time::Duration;

use async_trait::async_trait;
use beampose_core::{Clock, InstrumentName, SessionId, SinkError, StepNumber};
use beampose_drivers::sim::Fault as OfBytes;
use beampose_engine::Bench;
use beampose_plan::rig::{FaultKind as Declared, SimulatedFault};
use beampose_plan::{Instrument, Rig};
use beampose_store::Store;
use beampose_virtual_lab::faults::{
    Fault, FaultKind, Faults, FaultyAxis, FaultyCamera, FaultyClock, FaultyLaser, FaultySensor,
    FaultySink, Spoil,
};

use super::{Laboratory, Wires};

/// The faults of a rig; `None` of one that has none.
pub fn faults(
    rig: &Rig,
    clock: &Arc<dyn Clock>,
    step: &Arc<AtomicU32>,
    wires: &Wires,
) -> Option<Arc<Faults>> {
    let simulation = rig.simulation.as_ref()?;
    let declared = simulation.faults.as_ref()?;
    let simulated = |name: &str| {
        let found = rig.instruments.get(&InstrumentName::from(name));
        found.is_none_or(Instrument::is_of_simulated_world)
    };
    let faults = declared.iter().map(|at| fault(&at.value));
    let faults = faults.filter(|fault| simulated(&fault.instrument));
    // What a line of bytes does, its simulator does to the bytes; the rest is done to the calls.
    let on_a_line = |fault: &Fault| {
        let name = InstrumentName::from(fault.instrument.as_str());
        FaultKind::LINE.contains(&fault.kind) && wires.host(&name).is_some()
    };
    let (of_lines, of_calls): (Vec<_>, Vec<_>) = faults.partition(on_a_line);
    let made = |faults| Faults::new(faults, simulation.seed, clock.clone(), step.clone());
    let lines: BTreeSet<String> = of_lines.iter().map(|it| it.instrument.clone()).collect();
    let of_lines = made(of_lines);
    for line in lines {
        if let Some(host) = wires.host(&InstrumentName::from(line.as_str())) {
            let faults = of_lines.clone();
            host.trouble().from(move || faults.on_the_line(&line).and_then(of_bytes));
        }
    }
    Some(made(of_calls))
}

/// What a fault of a line is to its bytes.
const fn of_bytes(kind: FaultKind) -> Option<OfBytes> {
    Some(match kind {
        FaultKind::NoAnswer => OfBytes::Silent,
        FaultKind::LateAnswer => OfBytes::Late(LATE),
        FaultKind::Garbled => OfBytes::Garbled,
        FaultKind::Disconnect => OfBytes::Cut,
        FaultKind::Refused => OfBytes::Refused,
        FaultKind::Reboot => OfBytes::Reboot,
        _ => return None,
    })
}

/// Later than any driver waits. Real time.
const LATE: Duration = Duration::from_millis(1500);

fn fault(declared: &SimulatedFault) -> Fault {
    Fault {
        instrument: declared.of.value.clone(),
        kind: kind(declared.fault.value),
        at_step: declared.at_step,
        after: declared.after.map(|time| time.duration()),
        lasts: declared.lasts.map(|time| time.duration()),
        probability: declared.probability.unwrap_or(1.0),
        times: declared.times.unwrap_or(u32::MAX),
    }
}

const fn kind(declared: Declared) -> FaultKind {
    match declared {
        Declared::NoAnswer => FaultKind::NoAnswer,
        Declared::LateAnswer => FaultKind::LateAnswer,
        Declared::Garbled => FaultKind::Garbled,
        Declared::Disconnect => FaultKind::Disconnect,
        Declared::Refused => FaultKind::Refused,
        Declared::Reboot => FaultKind::Reboot,
        Declared::WrongReadback => FaultKind::WrongReadback,
        Declared::Stall => FaultKind::Stall,
        Declared::Overshoot => FaultKind::Overshoot,
        Declared::DroppedFrame => FaultKind::DroppedFrame,
        Declared::TruncatedFrame => FaultKind::TruncatedFrame,
        Declared::BlackFrame => FaultKind::BlackFrame,
        Declared::CameraHangs => FaultKind::CameraHangs,
        Declared::InterlockTrip => FaultKind::InterlockTrip,
        Declared::WavelengthHop => FaultKind::WavelengthHop,
        Declared::DiskFull => FaultKind::DiskFull,
        Declared::DatabaseBusy => FaultKind::DatabaseBusy,
        Declared::CorruptBlob => FaultKind::CorruptBlob,
        Declared::ClockJump => FaultKind::ClockJump,
    }
}

impl Laboratory {
    /// The clock that the run goes by, with its faults.
    pub fn run_clock(&self) -> Arc<dyn Clock> {
        let clock = self.clock.shared();
        match &self.faults {
            Some(faults) => Arc::new(FaultyClock::new(clock, faults.clone())),
            None => clock,
        }
    }

    /// What goes wrong when the run stores, if anything is to.
    pub fn faulty_sink<'a>(&self, store: &'a Store) -> Option<FaultySink<'a>> {
        Some(FaultySink::new(store, Disk(store), self.faults.clone()?))
    }
}

/// The disk that the store is on.
struct Disk<'a>(&'a Store);

#[async_trait]
impl Spoil for Disk<'_> {
    async fn spoil(&self, session: SessionId, step: StepNumber) -> Result<(), SinkError> {
        let spoiled = self.0.spoil_picture(session, step).await;
        spoiled.map_err(|e| SinkError { what: format!("step {step}"), reason: e.to_string() })
    }
}

/// The bench, each instrument with its faults.
pub fn faulty(bench: Bench, faults: &Arc<Faults>) -> Bench {
    macro_rules! wrap {
        ($map:expr, $faulty:ident) => {
            $map.into_iter()
                .map(|(name, it)| {
                    let faulty = $faulty::new(it, name.as_str(), faults.clone());
                    (name, Arc::new(faulty) as _)
                })
                .collect()
        };
    }
    Bench {
        axes: wrap!(bench.axes, FaultyAxis),
        lasers: wrap!(bench.lasers, FaultyLaser),
        sensors: wrap!(bench.sensors, FaultySensor),
        cameras: wrap!(bench.cameras, FaultyCamera),
        sight: bench.sight,
        tolerances: bench.tolerances,
        under_way: bench.under_way,
    }
}
