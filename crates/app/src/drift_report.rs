//! A stored wavelength drift as the input of its analysis.

use beampose_analysis::wavelength_drift::{DriftLimits, Sample, WavelengthDriftInput, rig_lines};
use beampose_analysis::{WavelengthDrift, wavelength_drift};
use beampose_core::{EventKind, InstrumentName, SessionId, Stamp};
use beampose_photogrammetry::Pattern;
use beampose_plan::{Accept, Analyse, Plan};
use beampose_store::{Store, StoredReading};

/// What of a session the analysis needs.
pub struct Series {
    readings: Vec<StoredReading>,
    /// When light came on.
    light_on: Vec<Stamp>,
}

/// Reads it, where the plan is of a wavelength drift.
///
/// # Errors
/// When the store fails.
pub async fn series(
    store: &Store,
    id: SessionId,
    plan: Option<&Plan>,
) -> anyhow::Result<Option<Series>> {
    let Some(Analyse::WavelengthDrift(_)) = plan.and_then(|plan| plan.analyse.as_ref()) else {
        return Ok(None);
    };
    let events = store.events(id).await?;
    let lit = events.iter().filter(|stored| stored.event.kind == EventKind::LaserOn);
    let light_on = lit.map(|stored| stored.event.at).collect();
    Ok(Some(Series { readings: store.readings(id).await?, light_on }))
}

impl Series {
    /// The plan's analysis of it.
    pub fn analysed(&self, plan: &Plan, pattern: &Pattern) -> Option<WavelengthDrift> {
        let Some(Analyse::WavelengthDrift(asked)) = &plan.analyse else { return None };
        let of = |sensor: &InstrumentName| self.samples(sensor);
        let maybe = |sensor: &Option<beampose_plan::At<InstrumentName>>| {
            sensor.as_ref().map(|sensor| of(&sensor.value)).unwrap_or_default()
        };
        let mut found = wavelength_drift(&WavelengthDriftInput {
            wavelength: of(&asked.wavelength.value),
            diode_temperature: maybe(&asked.diode_temperature),
            room_temperature: maybe(&asked.room_temperature),
            light_on_s: self.light_on.iter().map(|at| at.monotonic.as_secs_f64()).collect(),
            pattern,
            distance: asked.distance,
            measurement: asked.measurement,
            settled_within: asked.settled_within,
            limits: limits(&plan.accept),
        });
        let diode = asked.diode_temperature.as_ref().map(|sensor| sensor.value.as_str());
        let stated = self.samples(&asked.wavelength.value);
        let stated = stated.iter().filter_map(|one| one.standard_uncertainty).reduce(f64::max);
        let line = found.result.temperature.as_ref().zip(diode);
        found.rig_lines = line.map(|(line, diode)| rig_lines(line, diode, stated));
        Some(found)
    }

    fn samples(&self, sensor: &InstrumentName) -> Vec<Sample> {
        let of_sensor = self.readings.iter().filter(|row| row.instrument == *sensor);
        let sample = |row: &StoredReading| Sample {
            at_s: row.reading.at.monotonic.as_secs_f64(),
            value: row.reading.value,
            standard_uncertainty: row.reading.standard_uncertainty,
        };
        let mut samples: Vec<Sample> = of_sensor.map(sample).collect();
        // A step that was done again after an interruption stands where it was first.
        samples.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
        samples
    }
}

fn limits(accept: &Accept) -> DriftLimits {
    let Some(limits) = &accept.drift else { return DriftLimits::default() };
    DriftLimits {
        max_drift_per_hour: limits.max_drift_per_hour,
        max_position_error: limits.max_position_error,
        max_hops: limits.max_hops.map(|hops| hops as usize),
        max_warm_up: limits.max_warm_up,
    }
}
