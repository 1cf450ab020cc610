//! From the rig as written to the rig as understood.

use std::collections::BTreeMap;

use beampose_core::{InstrumentName, Quantity};

use super::instruments::{Instrument, Sensor};
use super::measurement::{Goniometer, Measurement};
use super::simulation::{FaultKind, SimulatedModule, Simulation};
use super::{ClockKind, RIG_VERSION, Rig, RigFile, SIMULATED};
use crate::fault::{At, Mark};
use crate::reader::{Maybe, Reader};
use crate::suggest;

/// Number of sectors of a coded target.
const CODE_BITS: u32 = 12;
/// Three targets define a frame; fewer leave it open.
const LEAST_TARGETS: usize = 3;

type Instruments = BTreeMap<String, At<Instrument>>;

/// The rig, or `None` where a part of it is missing; faults are noted.
pub(super) fn rig(file: RigFile, reader: &mut Reader) -> Option<Rig> {
    crate::reader::expect_version(&file.version, RIG_VERSION, reader);
    let none = At { value: Instruments::new(), mark: Mark::default() };
    let instruments = file.instruments.0.as_ref().unwrap_or(&none);
    for instrument in instruments.value.values() {
        instrument_itself(&instrument.value, &instruments.value, reader);
    }
    if let Some(clock) = &file.clock.0 {
        virtual_time_needs_simulation(clock, &instruments.value, reader);
    }
    let mut codes = BTreeMap::new();
    if let Some(measurement) = &file.measurement.0 {
        artefact(measurement, &mut codes, reader);
        if let Some(law) = &measurement.wavelength_from_temperature {
            thermometer_on_the_diode(&law.of, &instruments.value, reader);
        }
        if let Some(goniometer) = &measurement.goniometer {
            goniometer_of(goniometer, &instruments.value, reader);
        }
    }
    if let Maybe::Given(simulation) = &file.simulation {
        simulated_world(&simulation.value, &instruments.value, reader);
        faults_of(&simulation.value, &instruments.value, reader);
        tie_targets(&simulation.value, file.measurement.0.as_ref(), &mut codes, reader);
    }
    simulation_if_needed(&file, reader);
    let named = |(name, at): (String, At<Instrument>)| (InstrumentName(name), at.value);
    Some(Rig {
        source: reader.source.clone(),
        title: file.title.0?,
        clock: file.clock.0?.value,
        instruments: file.instruments.0?.value.into_iter().map(named).collect(),
        measurement: file.measurement.0?,
        simulation: match file.simulation {
            Maybe::Given(simulation) => Some(simulation.value),
            Maybe::Absent | Maybe::Broken => None,
        },
    })
}

fn instrument_itself(instrument: &Instrument, all: &Instruments, reader: &mut Reader) {
    match instrument {
        Instrument::LinearAxis(axis) => {
            let (from, to) = (axis.travel.value.from, axis.travel.value.to);
            upwards(from.0, to.0, axis.travel.mark, reader);
        }
        Instrument::RotaryAxis(axis) => {
            let (from, to) = (axis.travel.value.from, axis.travel.value.to);
            upwards(from.0, to.0, axis.travel.mark, reader);
        }
        Instrument::Sensor(sensor) => {
            sensor_unit(sensor, reader);
            sensor_of(sensor, all, reader);
        }
        Instrument::Laser(_) | Instrument::Camera(_) => {}
    }
}

/// A number that stands in for a broken one is NaN: it compares as neither.
fn upwards(from: f64, to: f64, mark: Mark, reader: &mut Reader) {
    if from >= to {
        reader.fault(mark, format!("`travel` must go upwards, found {from} to {to}"));
    }
}

fn sensor_unit(sensor: &Sensor, reader: &mut Reader) {
    if let Some(u) = sensor.u.as_ref().filter(|u| u.value.quantity() != sensor.reads) {
        let (reads, of) = (sensor.reads.name(), u.value.quantity().name());
        reader.fault(u.mark, format!("the sensor reads a {reads}, its `u` is of a {of}"));
    }
}

/// What a sensor is of is one of the rig's lasers.
fn sensor_of(sensor: &Sensor, instruments: &Instruments, reader: &mut Reader) {
    let Some(of) = &sensor.of else { return };
    let is_laser = |at: &At<Instrument>| matches!(at.value, Instrument::Laser(_));
    named_instrument(of, "laser", &is_laser, instruments, reader);
}

/// What tells the wavelength by its temperature is a thermometer on a laser.
fn thermometer_on_the_diode(
    named: &At<InstrumentName>,
    instruments: &Instruments,
    reader: &mut Reader,
) {
    let fits = |at: &At<Instrument>| match &at.value {
        Instrument::Sensor(sensor) => sensor.reads == Quantity::Temperature && sensor.of.is_some(),
        _ => false,
    };
    named_instrument(named, "thermometer of a laser", &fits, instruments, reader);
}

fn virtual_time_needs_simulation(
    clock: &At<ClockKind>,
    instruments: &Instruments,
    reader: &mut Reader,
) {
    let is_real = |at: &At<Instrument>| {
        !at.value.is_of_simulated_world() && !at.value.driver().value.is_empty()
    };
    let real = instruments.iter().find(|(_, at)| is_real(at));
    if let (ClockKind::Virtual, Some((name, _))) = (clock.value, real) {
        let message = format!("virtual time, but `{name}` is not simulated");
        reader.fault_help(clock.mark, message, Some("is it `clock: real`?".to_owned()));
    }
}

fn artefact(measurement: &Measurement, codes: &mut BTreeMap<u16, u32>, reader: &mut Reader) {
    let Some(artefact) = &measurement.artefact else { return };
    let targets = &artefact.targets;
    // Targets that hold a fault are left out: then nothing can be said of their number.
    if targets.value.len() < LEAST_TARGETS && reader.faults.is_empty() {
        let found = targets.value.len();
        reader.fault(
            targets.mark,
            format!("expected at least {LEAST_TARGETS} targets to define the frame, found {found}"),
        );
    }
    for target in &targets.value {
        target_code(&target.value.code, codes, reader);
    }
}

/// A code must be the smallest of its rotations, have some change in its ring, and stand once.
fn target_code(code: &At<u16>, codes: &mut BTreeMap<u16, u32>, reader: &mut Reader) {
    if code.mark == Mark::default() {
        // It stands in for a missing one.
        return;
    }
    let (value, all) = (u32::from(code.value), (1u32 << CODE_BITS) - 1);
    if value == 0 || value >= all {
        reader.fault(code.mark, format!("a code is from 1 to {}, found `{value}`", all - 1));
        return;
    }
    let turned = |by| ((value << by) | (value >> (CODE_BITS - by))) & all;
    let smallest = (0..CODE_BITS).map(turned).min().unwrap_or(value);
    if smallest != value {
        let message = format!("code {value} is not the smallest of its rotations");
        reader.fault_help(code.mark, message, Some(format!("the same ring reads `{smallest}`")));
    }
    if let Some(line) = codes.insert(code.value, code.mark.line) {
        reader.fault(code.mark, format!("code {value} repeats; it was first in line {line}"));
    }
}

fn tie_targets(
    simulation: &Simulation,
    measurement: Option<&Measurement>,
    codes: &mut BTreeMap<u16, u32>,
    reader: &mut Reader,
) {
    let placed = simulation.tie_targets.as_deref().unwrap_or_default();
    for target in placed {
        target_code(&target.value.code, codes, reader);
    }
    let known = measurement.is_none_or(|m| m.tie_targets.is_some());
    if let Some(target) = placed.first().filter(|_| !known) {
        let message = "tie targets on the walls, but `measurement` has no `tie_targets`";
        reader.fault(target.mark, message);
    }
}

fn simulation_if_needed(file: &RigFile, reader: &mut Reader) {
    let Some(instruments) = &file.instruments.0 else { return };
    let simulated = instruments.value.iter().find(|(_, at)| at.value.is_of_simulated_world());
    match (simulated, &file.simulation) {
        (Some((name, _)), Maybe::Absent) => {
            reader.fault(
                instruments.mark,
                format!("`{name}` is simulated; missing key `simulation`"),
            );
        }
        (None, Maybe::Given(simulation)) => {
            let message = format!("no instrument has the driver `{SIMULATED}`");
            reader.fault(simulation.mark, message);
        }
        _ => {}
    }
}

fn simulated_world(simulation: &Simulation, instruments: &Instruments, reader: &mut Reader) {
    carrying_axis(&simulation.module, instruments, reader);
    let is_camera = |at: &At<Instrument>| {
        matches!(at.value, Instrument::Camera(_)) && at.value.is_of_simulated_world()
    };
    for (name, instrument) in instruments.iter().filter(|(_, at)| is_camera(at)) {
        // Without any, the whole key is missing or empty, which is noted already.
        if !simulation.cameras.is_empty() && !simulation.cameras.contains_key(name) {
            let message = format!("`simulation: cameras:` does not say where `{name}` stands");
            reader.fault(instrument.mark, message);
        }
    }
    for (name, camera) in &simulation.cameras {
        if !instruments.get(name).is_some_and(is_camera) {
            let known = instruments.iter().filter(|(_, at)| is_camera(at)).map(|(n, _)| n.as_str());
            let help = suggest::help(name, known);
            reader.fault_help(camera.mark, format!("no simulated camera `{name}`"), help);
        }
        if camera.value.position == camera.value.look_at.value {
            reader.fault(camera.value.look_at.mark, "a camera cannot look at where it stands");
        }
    }
    let normals = simulation.walls.iter().map(|wall| &wall.value.normal);
    let turntable = simulation.module.turntable.iter().map(|turntable| &turntable.direction);
    let mirrors = simulation.mirrors.iter().flatten().map(|mirror| &mirror.value.normal);
    let normals = normals.chain(mirrors);
    for direction in normals.chain([&simulation.module.direction]).chain(turntable) {
        if direction.value == [0.0; 3] {
            reader.fault(direction.mark, "a direction must not be zero");
        }
    }
}

fn carrying_axis(module: &SimulatedModule, instruments: &Instruments, reader: &mut Reader) {
    let is_linear = |at: &At<Instrument>| matches!(at.value, Instrument::LinearAxis(_));
    let is_rotary = |at: &At<Instrument>| matches!(at.value, Instrument::RotaryAxis(_));
    if let Some(axis) = &module.axis {
        named_instrument(axis, "linear axis", &is_linear, instruments, reader);
    }
    if let Some(turntable) = &module.turntable {
        named_instrument(&turntable.axis, "rotary axis", &is_rotary, instruments, reader);
    }
}

fn named_instrument(
    named: &At<InstrumentName>,
    kind: &str,
    fits: &dyn Fn(&At<Instrument>) -> bool,
    instruments: &Instruments,
    reader: &mut Reader,
) {
    let name = named.value.as_str();
    if !name.is_empty() && !instruments.get(name).is_some_and(fits) {
        let fitting = instruments.iter().filter(|(_, at)| fits(at)).map(|(name, _)| name.as_str());
        let help = suggest::help(name, fitting);
        reader.fault_help(named.mark, format!("no {kind} `{name}`"), help);
    }
}

fn goniometer_of(goniometer: &Goniometer, instruments: &Instruments, reader: &mut Reader) {
    let is_rotary = |at: &At<Instrument>| matches!(at.value, Instrument::RotaryAxis(_));
    let is_camera = |at: &At<Instrument>| matches!(at.value, Instrument::Camera(_));
    named_instrument(&goniometer.axis, "rotary axis", &is_rotary, instruments, reader);
    named_instrument(&goniometer.camera, "camera", &is_camera, instruments, reader);
    let [x, y] = goniometer.px_per_degree;
    if x.0 == 0.0 && y.0 == 0.0 {
        reader.fault(goniometer.axis.mark, "`px_per_degree` must not be zero");
    }
}

/// Every fault is of something that there is, and that can have it.
fn faults_of(simulation: &Simulation, instruments: &Instruments, reader: &mut Reader) {
    for fault in simulation.faults.iter().flatten() {
        let (of, kind) = (&fault.value.of, &fault.value.fault);
        let role = match (of.value.as_str(), instruments.get(&of.value)) {
            ("store", _) => "store",
            ("clock", _) => "clock",
            (_, Some(instrument)) => instrument.value.kind(),
            (name, None) => {
                let names = instruments.keys().map(String::as_str).chain(["store", "clock"]);
                let help = suggest::help(name, names);
                reader.fault_help(of.mark, format!("there is no instrument `{name}`"), help);
                continue;
            }
        };
        if !can_have(role, kind.value) {
            let message = format!("a {role} cannot have the fault `{}`", kind.value.as_str());
            reader.fault(kind.mark, message);
        }
    }
}

/// Which faults a kind of instrument can have.
fn can_have(role: &str, kind: FaultKind) -> bool {
    match kind {
        FaultKind::NoAnswer
        | FaultKind::LateAnswer
        | FaultKind::Garbled
        | FaultKind::Disconnect
        | FaultKind::Reboot
        | FaultKind::Refused => !matches!(role, "store" | "clock"),
        FaultKind::WrongReadback => {
            matches!(role, "linear_axis" | "rotary_axis" | "sensor" | "laser")
        }
        FaultKind::Stall | FaultKind::Overshoot => matches!(role, "linear_axis" | "rotary_axis"),
        FaultKind::DroppedFrame
        | FaultKind::TruncatedFrame
        | FaultKind::BlackFrame
        | FaultKind::CameraHangs => role == "camera",
        FaultKind::InterlockTrip => role == "laser",
        FaultKind::WavelengthHop => role == "sensor",
        FaultKind::DiskFull | FaultKind::DatabaseBusy | FaultKind::CorruptBlob => role == "store",
        FaultKind::ClockJump => role == "clock",
    }
}
