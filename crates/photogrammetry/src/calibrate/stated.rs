//! What a calibration says of its own worth: a section `calibration` below the fields of ROS'
//! `camera_info`, which other readers pass over.

use std::fmt::Write as _;

use serde::Deserialize;

use super::{Interior, SelfCalibration};
use crate::camera::write_camera_info;

/// What a calibration file states beside the interior orientation.
#[derive(Debug, Clone, PartialEq)]
pub struct Stated {
    /// What was estimated.
    pub parameters: Vec<Interior>,
    /// Covariance of the parameters in their order.
    pub covariance: Vec<Vec<f64>>,
}

impl Stated {
    /// Standard deviation of a parameter; `None` where it was held.
    #[must_use]
    pub fn standard_deviation(&self, parameter: Interior) -> Option<f64> {
        let at = self.parameters.iter().position(|p| *p == parameter)?;
        Some(self.covariance[at][at].sqrt())
    }
}

#[derive(Deserialize)]
struct AnyFile {
    calibration: Option<Section>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Section {
    version: u64,
    #[expect(dead_code, reason = "for people")]
    pictures: usize,
    #[expect(dead_code, reason = "for people")]
    points: usize,
    #[expect(dead_code, reason = "for people")]
    rms_px: f64,
    #[expect(dead_code, reason = "for people")]
    sigma0_px: f64,
    parameters: Vec<Interior>,
    #[expect(dead_code, reason = "for people: it is the root of the covariance's diagonal")]
    standard_deviations: Vec<f64>,
    covariance: Vec<Vec<f64>>,
}

/// A `camera_info` file with the section that says what it is worth.
#[must_use]
pub fn write_calibration(name: &str, found: &SelfCalibration) -> String {
    let mut text = write_camera_info(name, &found.camera);
    let names: Vec<&str> = found.unknowns.iter().map(Interior::name).collect();
    let sigmas: Vec<String> =
        found.covariance.diagonal().iter().map(|v| format!("{:e}", v.sqrt())).collect();
    let _ = write!(
        text,
        "# Not ROS': what the calibration is worth, for `beampose calibrate compare`.\n\
         calibration:\n  version: 1\n  pictures: {}\n  points: {}\n  rms_px: {}\n  sigma0_px: {}\n  \
         parameters: [{}]\n  standard_deviations: [{}]\n  covariance:\n",
        found.views.len(),
        found.points(),
        found.rms_px,
        found.sigma0_px,
        names.join(", "),
        sigmas.join(", ")
    );
    for row in found.covariance.row_iter() {
        let row: Vec<String> = row.iter().map(|v| format!("{v:e}")).collect();
        let _ = writeln!(text, "    - [{}]", row.join(", "));
    }
    text
}

/// What a `camera_info` file states of its worth; `None` where it says nothing.
///
/// # Errors
/// What is wrong with the section, for people.
pub fn read_stated(text: &str) -> Result<Option<Stated>, String> {
    let file: AnyFile = serde_yaml::from_str(text).map_err(|error| error.to_string())?;
    let Some(section) = file.calibration else { return Ok(None) };
    if section.version != 1 {
        let version = section.version;
        return Err(format!("calibration.version is {version}, this program reads version 1"));
    }
    let n = section.parameters.len();
    let is_square =
        section.covariance.len() == n && section.covariance.iter().all(|r| r.len() == n);
    let is_positive = || (0..n).all(|i| section.covariance[i][i] > 0.0);
    if !(is_square && is_positive()) {
        return Err(format!(
            "calibration.covariance must be {n} x {n}, as there are parameters, and its diagonal above 0"
        ));
    }
    Ok(Some(Stated { parameters: section.parameters, covariance: section.covariance }))
}
