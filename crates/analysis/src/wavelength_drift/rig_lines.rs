//! The lines of a rig that let a processing take the wavelength from the diode's temperature.

use super::result::TemperatureCoefficient;

/// What to paste below `measurement:` in the rig. `thermometer` is the sensor on the diode;
/// `meter_u_nm` is what the wavelength meter states of a reading, which all readings share.
#[must_use]
pub fn rig_lines(
    line: &TemperatureCoefficient,
    thermometer: &str,
    meter_u_nm: Option<f64>,
) -> String {
    let of_mean = line.scatter_nm / (line.pairs.max(1) as f64).sqrt();
    let u = meter_u_nm.unwrap_or(line.wavelength_noise_nm).hypot(of_mean);
    let (at, nm) = (line.at_temperature_degc, line.at_wavelength_nm);
    let (by, by_u) = (line.coefficient_nm_per_degc, line.standard_uncertainty_nm_per_degc);
    format!(
        "  wavelength_from_temperature:\n    of: {thermometer}\n    at: {at:.4} degC\n    \
         wavelength: {nm:.5} nm\n    wavelength_u: {u:.5} nm\n    per_degree: {by:.6} nm\n    \
         per_degree_u: {by_u:.6} nm\n"
    )
}
