//! What a session's instruments read that tells the wavelength, and what a processing uses of it.

use std::collections::BTreeMap;

use beampose_core::{InstrumentName, Quantity, Stamp};
use beampose_photogrammetry::Setup;
use beampose_photogrammetry::wavelength::{Known, Sample, Wavelength, WavelengthUse, wavelength};
use beampose_store::{StoredCapture, StoredReading};

/// The key of a wavelength in a capture's readings where one instrument alone read it, or where the
/// pictures came from elsewhere.
const WAVELENGTH: &str = "wavelength_nm";

/// The wavelengths and temperatures of a session, by time.
#[derive(Debug, Clone, Default)]
pub struct Readings {
    wavelengths: Vec<Sample>,
    diode: Vec<Sample>,
}

impl Readings {
    /// Those of `stored`: one instrument's wavelengths (the first by name, where several read it),
    /// and the temperatures of the thermometer that the setup names.
    pub fn of(setup: &Setup, stored: &[StoredReading]) -> Self {
        let reads = |quantity| move |row: &&StoredReading| row.reading.quantity == quantity;
        let meter = stored.iter().filter(reads(Quantity::Wavelength)).map(|row| &row.instrument);
        let thermometer = setup.wavelength_by_temperature.as_ref();
        let thermometer = thermometer.map(|law| InstrumentName(law.thermometer.clone()));
        let series = |instrument: Option<&InstrumentName>, quantity| {
            let of = stored.iter().filter(|row| Some(&row.instrument) == instrument);
            let mut samples: Vec<Sample> = of
                .filter(reads(quantity))
                .map(|row| Sample { at_s: seconds(&row.reading.at), value: row.reading.value })
                .collect();
            // A step that was done again after an interruption stands where it was first.
            samples.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
            samples
        };
        Self {
            wavelengths: series(meter.min(), Quantity::Wavelength),
            diode: series(thermometer.as_ref(), Quantity::Temperature),
        }
    }

    /// The wavelength at a capture, of what `using` lets be used.
    pub fn at(&self, setup: &Setup, capture: &StoredCapture, using: WavelengthUse) -> Wavelength {
        let thermometer = setup.wavelength_by_temperature.as_ref();
        let diode = thermometer.map(|law| format!("{}_degc", law.thermometer));
        let known = Known {
            at_s: seconds(&capture.triggered),
            wavelength_nm: read_at(&capture.readings),
            diode_degc: diode.and_then(|key| capture.readings.get(&key).copied()),
            wavelengths: &self.wavelengths,
            diode: &self.diode,
        };
        wavelength(setup, &known, using)
    }
}

fn seconds(at: &Stamp) -> f64 {
    at.monotonic.as_secs_f64()
}

/// The wavelength that was read at a capture.
fn read_at(readings: &BTreeMap<String, f64>) -> Option<f64> {
    let suffix = format!("_{}", Quantity::Wavelength.suffix());
    let by_name = || readings.iter().find(|(key, _)| key.ends_with(&suffix)).map(|(_, nm)| nm);
    readings.get(WAVELENGTH).or_else(by_name).copied()
}

/// What the options of a processing say; an earlier version took the reading at the capture alone.
pub fn used(options_json: &str) -> WavelengthUse {
    let options: Option<serde_json::Value> = serde_json::from_str(options_json).ok();
    let named = options.as_ref().and_then(|options| options.get("wavelength")?.as_str());
    named.and_then(WavelengthUse::named).unwrap_or(WavelengthUse::Read)
}
