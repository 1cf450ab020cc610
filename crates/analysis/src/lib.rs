//! Poses and readings -> results per experiment -> report text.
//!
//! Pure: the caller gives poses, readings and decoded pictures; results, CSV, JSON and one
//! self-contained HTML page come back. No files, no clocks, no hardware. Numbers are in
//! millimetres and radians; every field that leaves as text has its unit as a suffix.
//!
//! To add an experiment's analysis: a module beside [`mod@translation`] and [`mod@wavelength_drift`] with its input, its
//! serialisable result and a verdict, a field in [`ReportInput`], a section in `report`.

pub mod beam_angles;
mod calibration_export;
pub mod compare;
mod export;
mod fan_export;
mod fit;
mod numbers;
pub mod report;
pub mod score;
pub mod side_by_side;
pub mod translation;
mod verdict;
pub mod wavelength_drift;

pub use beam_angles::{BeamAngleLimits, BeamAngles, BeamAnglesInput, beam_angles};
pub use calibration_export::{calibration_json, stability_json};
pub use compare::{Comparison, Side, compare};
pub use export::{json, poses_csv, positions_csv, series_csv};
pub use fan_export::{fan_json, nearest_grid, nearest_grid_covariance, session_fan_json};
pub use fit::LineFit;
pub use report::{
    CalibrationReport, FanReport, InputFile, LeftOut, ReportInput, SessionFanReport,
    calibration_html, fan_html, html, session_fan_html, stability_html, stability_verdict,
};
pub use score::{FanScore, score_fan};
pub use score::{MethodScore, ScoredCapture, Truth, score};
pub use side_by_side::{Evaluation, side_by_side_csv};
pub use translation::{
    DistanceRule, JointCovariance, StatedScale, TranslationInput, TranslationResult, TravelCapture,
    translation,
};
pub use verdict::{Decision, Limits, Verdict};
pub use wavelength_drift::{
    DriftLimits, Sample, WavelengthDrift, WavelengthDriftInput, WavelengthDriftResult,
    wavelength_drift,
};

/// Coverage factor of every expanded uncertainty in this crate: U = 2 u (GUM, section 6.3).
pub const COVERAGE_FACTOR: f64 = 2.0;
