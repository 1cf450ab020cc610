//! A wavelength drift as written to one as understood: its sensors are among those that are read.
//!
//! What the sensors read, the rig says: see [`crate::expand`].

use beampose_core::InstrumentName;

use super::WavelengthDrift;
use super::file::{AcceptFile, AnalyseFile, WavelengthDriftFile};
use super::validate::Scope;
use crate::fault::At;
use crate::reader::Reader;
use crate::suggest;

/// What is said of an experiment without its analysis, and what helps.
pub(super) const NEEDED: (&str, &str) = (
    "a wavelength drift needs `analyse`",
    "as in `analyse: {wavelength-drift: {wavelength: wavemeter, distance: 900 mm, \
     measurement: 30 min, settled_within: 0.05 nm}}`",
);

/// The analysis; faults are noted.
pub(super) fn analysis(
    file: &WavelengthDriftFile,
    scope: &Scope,
    reader: &mut Reader,
) -> WavelengthDrift {
    let drift = WavelengthDrift {
        wavelength: file.wavelength.clone(),
        diode_temperature: file.diode_temperature.clone(),
        room_temperature: file.room_temperature.clone(),
        distance: file.distance,
        measurement: file.measurement,
        settled_within: file.settled_within,
    };
    for sensor in drift.sensors() {
        is_read(sensor, scope, reader);
    }
    if let (Some(diode), Some(room)) = (&drift.diode_temperature, &drift.room_temperature)
        && diode.value == room.value
    {
        let message = format!("`{}` cannot be both of the diode and of the room", room.value);
        reader.fault(room.mark, message);
    }
    drift
}

pub(super) fn is_read(sensor: &At<InstrumentName>, scope: &Scope, reader: &mut Reader) {
    let name = sensor.value.as_str();
    // An empty name stands in for a broken one.
    if name.is_empty() || scope.read.contains(&sensor.value) {
        return;
    }
    let mut known: Vec<&str> = scope.read.iter().map(InstrumentName::as_str).collect();
    known.sort_unstable();
    known.dedup();
    let help = suggest::help(name, known);
    reader.fault_help(sensor.mark, format!("no step reads `{name}`"), help);
}

/// Limits of a drift without its analysis judge nothing.
pub(super) fn limits_belong(
    accept: &AcceptFile,
    analyse: Option<&At<AnalyseFile>>,
    reader: &mut Reader,
) {
    let analysed = analyse.is_some_and(|a| matches!(a.value, AnalyseFile::WavelengthDrift(_)));
    let has_angles = analyse.is_some_and(|a| matches!(a.value, AnalyseFile::BeamAngles(_)));
    if let Some(limits) = accept.beam_angles.as_ref().filter(|_| !has_angles) {
        let help = Some("add `analyse: {beam-angle-calibration: {}}`".to_owned());
        let message = "limits for beam angles, which are not analysed".to_owned();
        reader.fault_help(limits.mark, message, help);
    }
    if let Some(limits) = accept.wavelength_drift.as_ref().filter(|_| !analysed) {
        let help = Some("add `analyse: {wavelength-drift: {...}}`".to_owned());
        let message = "limits for the wavelength's drift, which is not analysed".to_owned();
        reader.fault_help(limits.mark, message, help);
    }
}

impl WavelengthDrift {
    /// The sensors that it names.
    pub fn sensors(&self) -> impl Iterator<Item = &At<InstrumentName>> {
        let temperatures = [&self.diode_temperature, &self.room_temperature];
        std::iter::once(&self.wavelength).chain(temperatures.into_iter().flatten())
    }
}
