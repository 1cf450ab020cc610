//! The result of a wavelength drift, as it is stored and printed; and its series.

use serde::{Deserialize, Serialize};

use super::effect::{BeamAngles, Effect};
use crate::verdict::Verdict;

/// The result of a wavelength drift.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WavelengthDriftResult {
    /// `wavelength-drift`.
    pub experiment: String,
    /// The most serious verdict over the limits.
    pub verdict: Verdict,
    /// Why, one sentence each.
    pub reasons: Vec<String>,
    /// Wavelength readings that were analysed.
    pub readings: usize,
    /// When the first and the last of them were taken, after the light came on.
    pub span_s: [f64; 2],
    /// Standard deviation of one reading about a smooth course, from the readings themselves.
    pub noise_nm: f64,
    /// Readings that jump and come back; they are left out.
    pub stray_readings: usize,
    /// What the sensor states of one reading, its bias included; absent where it states nothing.
    pub stated_standard_uncertainty_nm: Option<f64>,
    /// How the wavelength settles; absent where no settling can be told from a steady drift.
    pub warm_up: Option<WarmUp>,
    /// The steady drift beside the settling; absent where there is no course.
    pub steady_drift: Option<SteadyDrift>,
    /// The recommended warm-up and what is left after it; absent where it does not settle in time.
    pub recommendation: Option<Recommendation>,
    /// The wavelength over the diode's temperature; absent where that was not read or does not vary.
    pub temperature: Option<TemperatureCoefficient>,
    /// The room.
    pub room: Option<RoomAir>,
    /// Mode hops in order of time.
    pub hops: Vec<ModeHop>,
    /// Allan deviations of the evenly sampled parts, hops stepped over.
    pub allan: Vec<AllanSegment>,
    /// Angles of the fan that is held against the drift.
    pub beams: Option<BeamAngles>,
    /// What the change over the whole test does.
    pub whole_test: Option<Effect>,
    /// What the largest change in a measurement after the recommended warm-up does.
    pub after_warm_up: Option<Effect>,
    /// The distance for which positions are stated.
    pub distance_mm: f64,
    /// What was asked for.
    pub settling: Settling,
    /// The limits that were applied.
    pub limits: DriftLimitsApplied,
    /// k of every expanded uncertainty.
    pub coverage_factor: f64,
    /// What was left out, and why.
    pub notes: Vec<String>,
}

/// What counts as settled.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settling {
    /// By how much the wavelength may change in a measurement.
    pub settled_within_nm: f64,
    /// How long a measurement lasts.
    pub measurement_s: f64,
}

/// The limits as applied, in numbers; absent ones are not judged.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DriftLimitsApplied {
    /// Mean drift after the recommended warm-up.
    pub max_drift_nm_per_hour: Option<f64>,
    /// Error of position in a measurement after the recommended warm-up.
    pub max_position_error_mm: Option<f64>,
    /// Number of mode hops.
    pub max_hops: Option<usize>,
    /// The recommended warm-up.
    pub max_warm_up_s: Option<f64>,
}

/// An exponential settling.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WarmUp {
    /// After this time 63 % of it are done.
    pub time_constant_s: f64,
    /// Standard uncertainty of that.
    pub time_constant_standard_uncertainty_s: f64,
    /// By how much the wavelength grows by settling alone.
    pub rise_nm: f64,
    /// Standard uncertainty of that.
    pub rise_standard_uncertainty_nm: f64,
}

/// What is left when the settling is taken away.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SteadyDrift {
    /// The drift, hops aside.
    pub drift_nm_per_hour: f64,
    /// Its standard uncertainty.
    pub standard_uncertainty_nm_per_hour: f64,
    /// Root mean square of what the fitted course leaves beyond noise.
    pub misfit_nm: f64,
}

/// How long to warm up, and what is left then.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recommendation {
    /// From light to the first measurement.
    pub warm_up_s: f64,
    /// Standard uncertainty of that; absent where a hop ends the warm-up.
    pub warm_up_standard_uncertainty_s: Option<f64>,
    /// The largest change of wavelength in any measurement that begins later, within the test.
    pub largest_change_nm: f64,
    /// Standard uncertainty of that, the course's misfit included.
    pub largest_change_standard_uncertainty_nm: f64,
    /// Mean drift from the end of the warm-up to the end of the test, hops aside.
    pub drift_nm_per_hour: f64,
    /// Standard uncertainty of that.
    pub drift_standard_uncertainty_nm_per_hour: f64,
    /// The wavelengths between which it stays from then on, noise aside.
    pub band_nm: [f64; 2],
}

/// The wavelength over the diode's temperature.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TemperatureCoefficient {
    /// The coefficient, with the temperature's noise accounted for.
    pub coefficient_nm_per_degc: f64,
    /// Its standard uncertainty, from the scatter about the line. A scale error of the thermometer
    /// is not in it.
    pub standard_uncertainty_nm_per_degc: f64,
    /// Pairs of a wavelength and a temperature.
    pub pairs: usize,
    /// The slope that an ordinary line would give.
    pub ordinary_nm_per_degc: f64,
    /// By what part noise of the temperature makes the ordinary line too flat.
    pub attenuation_relative: f64,
    /// Standard deviation of one wavelength, from the readings.
    pub wavelength_noise_nm: f64,
    /// Standard deviation of one temperature, from the readings.
    pub temperature_noise_degc: f64,
    /// Standard deviation of the wavelengths about the line, noise of both.
    pub scatter_nm: f64,
    /// The lowest and the highest temperature.
    pub temperature_range_degc: [f64; 2],
    /// Mean temperature in the last mode: a point of the line.
    pub at_temperature_degc: f64,
    /// The wavelength there.
    pub at_wavelength_nm: f64,
}

/// The room's temperature.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RoomAir {
    /// Mean.
    pub mean_degc: f64,
    /// Drift by a straight line.
    pub drift_degc_per_hour: f64,
    /// Standard uncertainty of the drift.
    pub drift_standard_uncertainty_degc_per_hour: f64,
}

/// A mode hop.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModeHop {
    /// When, after the light came on: between two readings.
    pub at_s: f64,
    /// Standard uncertainty of that: anywhere between them.
    pub at_standard_uncertainty_s: f64,
    /// By how much the wavelength was longer then.
    pub by_nm: f64,
    /// Standard uncertainty of that.
    pub by_standard_uncertainty_nm: f64,
    /// The size in units of its standard uncertainty.
    pub significance: f64,
}

/// Allan deviations of one evenly sampled part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AllanSegment {
    /// From one reading to the next.
    pub interval_s: f64,
    /// Readings.
    pub readings: usize,
    /// The deviations, by octaves of the averaging time.
    pub points: Vec<AllanPoint>,
}

/// One Allan deviation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AllanPoint {
    /// Averaging time.
    pub tau_s: f64,
    /// Overlapping Allan deviation of the wavelength.
    pub deviation_nm: f64,
    /// Its standard uncertainty, as for white noise.
    pub standard_uncertainty_nm: f64,
    /// Differences that it is the mean of.
    pub differences: usize,
}

/// One wavelength reading with what was made of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeriesPoint {
    /// When, after the light came on, s.
    pub at_s: f64,
    /// What was read, nm.
    pub wavelength_nm: f64,
    /// The fitted course, nm; NaN where there is none.
    pub fitted_nm: f64,
    /// The diode's temperature read at the same time, degrees Celsius.
    pub diode_degc: Option<f64>,
    /// The room's temperature read at the same time, degrees Celsius.
    pub room_degc: Option<f64>,
    /// How many hops came before it.
    pub mode: usize,
    /// What it is.
    pub mark: PointMark,
}

/// What a reading is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PointMark {
    /// While the laser warms up.
    WarmingUp,
    /// After the recommended warm-up.
    Settled,
    /// The first one after a mode hop.
    Hop,
    /// It jumps and comes back: left out.
    Stray,
}

impl PointMark {
    /// The word in CSV.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::WarmingUp => "warming_up",
            Self::Settled => "settled",
            Self::Hop => "hop",
            Self::Stray => "stray",
        }
    }
}
