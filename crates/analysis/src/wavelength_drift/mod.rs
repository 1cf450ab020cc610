//! The wavelength after the laser was switched on (section 4.2.1.4): how it settles, how it drifts
//! and hops, how it follows the diode's temperature, and what that does to angles and positions.
//!
//! Noise is taken from the readings themselves, not from what the sensors say of themselves: what
//! they share (the meter's bias, a thermometer's) cancels in every change of wavelength, and must
//! not count as scatter. Times are seconds since the light came on, wavelengths nm in vacuum,
//! temperatures degrees Celsius. Does not read plans or stores, and does not know any truth.

mod allan;
mod analyse;
mod effect;
mod hops;
mod judge;
mod model;
mod recommend;
mod result;
mod rig_lines;
mod series;
mod temperature;

use beampose_core::units::{Millimetre, Nanometre, Second};
use beampose_photogrammetry::Pattern;

pub use analyse::{WavelengthDrift, wavelength_drift};
pub use effect::{BeamAngles, Effect};
pub(crate) use judge::{minutes, not_settled};
pub use result::{
    AllanPoint, AllanSegment, DriftLimitsApplied, ModeHop, PointMark, Recommendation, RoomAir,
    SeriesPoint, Settling, SteadyDrift, TemperatureCoefficient, WarmUp, WavelengthDriftResult,
};
pub use rig_lines::rig_lines;

/// One reading of a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// When, seconds of the session's monotonic clock.
    pub at_s: f64,
    /// What it read: nm or degrees Celsius.
    pub value: f64,
    /// What the sensor states of it: standard uncertainty, in the same unit.
    pub standard_uncertainty: Option<f64>,
}

/// What the analysis is given.
#[derive(Debug, Clone)]
pub struct WavelengthDriftInput<'a> {
    /// Readings of the wavelength in vacuum, in order of time.
    pub wavelength: Vec<Sample>,
    /// Readings of the diode's temperature; empty without such a sensor.
    pub diode_temperature: Vec<Sample>,
    /// Readings of the room's temperature; empty without such a sensor.
    pub room_temperature: Vec<Sample>,
    /// When light came on, seconds of the same clock; more than once where the session was
    /// interrupted. The longest stretch of light is analysed.
    pub light_on_s: Vec<f64>,
    /// The fan of beams, for what a change does to its angles.
    pub pattern: &'a Pattern,
    /// How far the module stands from what it shines on.
    pub distance: Millimetre,
    /// How long a measurement lasts that follows the warm-up.
    pub measurement: Second,
    /// By how much the wavelength may change during it.
    pub settled_within: Nanometre,
    /// What the plan asks for.
    pub limits: DriftLimits,
}

/// What the plan asks of the result. An absent limit is not judged.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DriftLimits {
    /// Mean drift in an hour after the recommended warm-up, by amount.
    pub max_drift_per_hour: Option<Nanometre>,
    /// Error of position in a measurement after the recommended warm-up.
    pub max_position_error: Option<Millimetre>,
    /// Number of mode hops.
    pub max_hops: Option<usize>,
    /// The recommended warm-up.
    pub max_warm_up: Option<Second>,
}
