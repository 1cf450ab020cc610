//! Image -> observations: laser dots and ring-coded targets, each with its covariance.
//!
//! What a picture shows, not what it means: which beam a dot is and where a target stands is
//! decided elsewhere, and so are lens distortion and the eccentricity of circle images.

mod background;
mod dots;
mod lanes;
mod targets;
#[cfg(test)]
mod testing;

use std::ops::Range;

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use crate::image::GrayImage;

pub use dots::{CentreMethod, DotOptions, DotsFound, NoiseModel, drop_dots_on_targets, find_dots};
pub(crate) use targets::{PlainDisc, find_plain_discs};
pub use targets::{TargetOptions, find_targets, is_usable_code, usable_codes};

/// Rows of a picture that are looked at together: they stay in the cache meanwhile.
const BAND_ROWS: usize = 16;

/// The bands of a picture, from top to bottom.
fn bands(image: &GrayImage) -> impl Iterator<Item = Range<usize>> {
    let height = image.height;
    (0..height).step_by(BAND_ROWS).map(move |first| first..(first + BAND_ROWS).min(height))
}

/// Finds dots and targets in one pass over a picture: the same as by [`find_dots`] and
/// [`find_targets`].
#[must_use]
pub fn find_dots_and_targets(
    image: &GrayImage,
    dot_options: &DotOptions,
    target_options: &TargetOptions,
) -> (DotsFound, Vec<Target>) {
    let mut dots = dots::DotScan::new(image, dot_options);
    let noise = dots.background().noise_of_fewer_rows();
    let mut targets = targets::TargetScan::new(image, noise, target_options);
    for band in bands(image) {
        dots.look(band.clone());
        targets.look(band);
    }
    (dots::measure_dots(dots, image, dot_options), targets.finish())
}

/// A measured image point.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ImagePoint {
    /// Where, pixels.
    pub at: Vector2<f64>,
    /// Covariance, square pixels.
    pub covariance: Matrix2<f64>,
}

/// A laser dot (or what looks like one).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Dot {
    /// Its centre.
    pub point: ImagePoint,
    /// Fitted peak above the background, grey levels (may exceed 255 where saturated).
    pub amplitude: f64,
    /// Local background, grey levels.
    pub background: f64,
    /// Standard deviations of the fitted Gaussian along its principal axes (large, small), pixels.
    pub sigma: [f64; 2],
    /// How well the Gaussian fits.
    pub quality: DotQuality,
}

/// How far a dot is from a Gaussian spot under the noise of its picture.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct DotQuality {
    /// Sum of the squared standardised residuals over the degrees of freedom; 1 is expected.
    pub reduced_chi_square: f64,
    /// Exponent b of `exp(-q^b / 2)` that would fit better, to first order; a Gaussian has 1, a
    /// disc with sharp edges far more.
    pub shape_exponent: f64,
    /// Standard uncertainty of the exponent.
    pub shape_sigma: f64,
    /// Light seen where the fit has more than 70 % of its peak, over that fitted; 1 is expected,
    /// and is stated where all of it is saturated.
    pub core_ratio: f64,
    /// Pixels in the middle were saturated and took no part in the fit.
    pub is_saturated: bool,
}

/// A ring-coded target whose code was read without doubt.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// Its code, canonical.
    pub code: u16,
    /// The centre of the image of its centre disc's circle (the ellipse centre; the eccentricity
    /// against the projected centre is corrected where the geometry is known).
    pub point: ImagePoint,
    /// Semi-axes of the centre disc's image (large, small), pixels.
    pub semi_axes: [f64; 2],
    /// Direction of the large semi-axis from x towards y, radians.
    pub angle: f64,
}
