//! Laser dots: smooth Gaussian spots brighter than what is around them.
//!
//! One streaming pass finds the places ([`scan`]); an elliptical Gaussian is fitted at each
//! ([`fit`], by [`moments`] of a [`window`] with the weights of [`weighting`]); the noise of the picture comes from the residuals of all fits together ([`noise`]);
//! every dot is then fitted again under that noise and gets its covariance ([`covariance`]). Which
//! beam made a dot is not asked here, and stray reflections are returned like any other dot.

mod components;
mod covariance;
mod fit;
mod gaussian;
mod grains;
mod moments;
mod noise;
mod plain;
mod rough;
mod scan;
mod shape;
#[cfg(test)]
mod speckle_tests;
#[cfg(test)]
mod tests;
mod weighting;
mod window;

use rayon::iter::{IntoParallelRefIterator as _, ParallelIterator as _};
use serde::{Deserialize, Serialize};

use super::{Dot, DotQuality, ImagePoint, Target, bands};
use crate::image::GrayImage;
use components::Candidate;
use fit::{Fit, FitLimits, Rest};
pub(super) use scan::DotScan;

/// Rounds of noise and fits in turns; two do for clean pictures, speckle needs more.
const ROUNDS: usize = 4;
/// All rounds but the last go over every so many dots of a picture, the strong and the faint alike,
/// where these are at least so many.
const SAMPLED: usize = 3;
const LEAST_SAMPLED: usize = 24;

/// What counts as a dot.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DotOptions {
    /// Smallest standard deviation of the spot, pixels. Default 0.8: a dot of 1 px with its
    /// uncertainty.
    pub min_sigma: f64,
    /// Largest standard deviation of the spot, pixels. Default 9: a dot of 8 px likewise.
    pub max_sigma: f64,
    /// Largest ratio of the two standard deviations. Default 4: a wall seen at 75 degrees.
    pub max_axis_ratio: f64,
    /// A pixel is of interest when it exceeds the local background by so many standard deviations
    /// of the noise. Default 5: one false pixel in 3.5 million.
    pub threshold_in_noise: f64,
    /// ... and by at least so many grey levels. Default 4: what compression leaves in a flat area.
    pub min_contrast: f64,
    /// Largest departure of the shape exponent from that of the picture's dots, beyond four of its
    /// standard uncertainties. Default 0.12: discs with sharp edges lie above.
    pub max_shape_departure: f64,
    /// Largest reduced chi-square. Default 3: a spot that is overlaid by something else, or a disc,
    /// has more.
    pub max_reduced_chi_square: f64,
    /// Smallest ratio of what is seen in the middle to what was fitted. Default 0.6: a flat top
    /// stays below its Gaussian.
    pub min_core_ratio: f64,
    /// How the centre is taken. Default: the fitted Gaussian.
    pub centre: CentreMethod,
    /// The noise where it is known; `None` (the default) estimates it from the picture.
    pub noise: Option<NoiseModel>,
}

/// How the centre of a dot is taken from its pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CentreMethod {
    /// The elliptical Gaussian, weighted by the picture's noise.
    #[default]
    Gaussian,
    /// Centroid weighted by the grey value above half of the peak.
    GreyCentroid,
    /// Centroid of the pixels above half of the peak.
    BinaryCentroid,
    /// Least-squares matching of a round template: place, gain and offset, all pixels alike.
    LeastSquaresMatching,
}

impl DotOptions {
    /// What solving takes.
    pub const USUAL: Self = Self {
        min_sigma: 0.8,
        max_sigma: 9.0,
        max_axis_ratio: 4.0,
        threshold_in_noise: 5.0,
        min_contrast: 4.0,
        max_shape_departure: 0.12,
        max_reduced_chi_square: 3.0,
        min_core_ratio: 0.6,
        centre: CentreMethod::Gaussian,
        noise: None,
    };
}

impl Default for DotOptions {
    fn default() -> Self {
        Self::USUAL
    }
}

/// The noise of a picture: a pixel of the dot's intensity f above the background has the variance
/// `read_noise^2 + photon_gain f + (speckle_contrast f)^2`; its last part is common to the pixels
/// of one speckle grain.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct NoiseModel {
    /// Standard deviation in the background (the photon noise of the background included), grey
    /// levels.
    pub read_noise: f64,
    /// Variance that each grey level of signal adds, grey levels.
    pub photon_gain: f64,
    /// Standard deviation of the intensity over its mean.
    pub speckle_contrast: f64,
    /// Area of a speckle grain: the sum of its autocorrelation over all lags, square pixels; at
    /// least 1, which says that pixels are independent.
    pub grain_area: f64,
    /// Variance of the background's noise in areas as large as a dot, over that of independent
    /// pixels: below 1 after JPEG compression, which keeps coarse noise truer than fine noise and
    /// adds only the latter; above 1 on a rough wall.
    pub background_correlation: f64,
}

impl NoiseModel {
    /// Noise that is the same everywhere.
    #[must_use]
    pub fn white(read_noise: f64) -> Self {
        Self {
            read_noise,
            photon_gain: 0.0,
            speckle_contrast: 0.0,
            grain_area: 1.0,
            background_correlation: 1.0,
        }
    }

    /// Variance of one pixel of intensity f, square grey levels.
    #[must_use]
    pub fn pixel_variance(&self, f: f64) -> f64 {
        self.read_noise.powi(2) + f * (self.photon_gain + self.speckle_contrast.powi(2) * f)
    }
}

/// The dots of a picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DotsFound {
    /// From the brightest (by its integral) to the faintest.
    pub dots: Vec<Dot>,
    /// What was found or assumed about the noise.
    pub noise: NoiseModel,
}

/// Finds the laser dots of a picture and measures their centres.
#[must_use]
pub fn find_dots(image: &GrayImage, options: &DotOptions) -> DotsFound {
    let mut scan = DotScan::new(image, options);
    bands(image).for_each(|band| scan.look(band));
    measure_dots(scan, image, options)
}

/// Measures the centres of what a pass found.
pub(super) fn measure_dots(
    scan: DotScan<'_>,
    image: &GrayImage,
    options: &DotOptions,
) -> DotsFound {
    let scanned = scan.finish();
    let start = options
        .noise
        .unwrap_or(NoiseModel { speckle_contrast: 0.1, ..NoiseModel::white(scanned.noise) });
    let limits = FitLimits::new(options);
    let mut fits = first_fits(image, &scanned.candidates, &start, &limits);
    let noise = match options.noise {
        Some(known) => {
            fits = refit(image, &fits, &known, &limits, Rest::Fully);
            known
        }
        None => refine_noise(image, &mut fits, &start, &limits),
    };
    let mut dots: Vec<Dot> =
        fits.par_iter().filter_map(|fit| measure(image, fit, &noise)).collect();
    keep_gaussian(&mut dots, options, &noise);
    if options.centre != CentreMethod::Gaussian {
        plain::replace_centres(image, &mut dots, options.centre, &noise);
    }
    DotsFound { dots, noise }
}

/// Removes the dots that lie on a coded target: parts of its printed pattern that look like one,
/// or laser dots that its edges disturb.
pub fn drop_dots_on_targets(dots: &mut Vec<Dot>, targets: &[Target]) {
    dots.retain(|dot| !targets.iter().any(|target| target.covers(&dot.point.at, 3.2)));
}

/// Fits every candidate, the strongest first; what lies inside a dot already found is a part of it
/// (speckle makes several of one).
fn first_fits(
    image: &GrayImage,
    candidates: &[Candidate],
    noise: &NoiseModel,
    limits: &FitLimits,
) -> Vec<Fit> {
    let mut fits: Vec<Fit> = Vec::new();
    for candidate in candidates {
        if fits.iter().any(|fit| fit.gaussian.square_radius(candidate.x, candidate.y) < 16.0) {
            continue;
        }
        let Some(fit) = fit::fit_candidate(image, candidate, noise, limits) else { continue };
        let centre = (fit.gaussian.x, fit.gaussian.y);
        if !fits.iter().any(|known| known.gaussian.square_radius(centre.0, centre.1) < 16.0) {
            fits.push(fit);
        }
    }
    fits
}

/// Noise from residuals and fits under that noise, in turns: two for clean pictures, more where
/// speckle makes the one depend on the other. All but the last go over some of the dots: what these
/// were wrong by, the last leaves a fifth of.
fn refine_noise(
    image: &GrayImage,
    fits: &mut Vec<Fit>,
    start: &NoiseModel,
    limits: &FitLimits,
) -> NoiseModel {
    let mut some: Vec<Fit> = fits.iter().step_by(SAMPLED).copied().collect();
    let noise = if some.len() < LEAST_SAMPLED {
        in_turns(image, fits, start, limits, ROUNDS)
    } else {
        let noise = in_turns(image, &mut some, start, limits, ROUNDS - 1);
        *fits = refit(image, fits, &noise, limits, Rest::Roughly);
        noise::estimate(image, fits, &noise)
    };
    *fits = refit(image, fits, &noise, limits, Rest::Fully);
    NoiseModel {
        background_correlation: rough::background_correlation(image, fits, &noise),
        ..noise
    }
}

/// Noise and fits in turns, until the noise rests.
fn in_turns(
    image: &GrayImage,
    fits: &mut Vec<Fit>,
    start: &NoiseModel,
    limits: &FitLimits,
    rounds: usize,
) -> NoiseModel {
    let mut noise = *start;
    for round in 0..rounds {
        let next = noise::estimate(image, fits, &noise);
        let is_settled = round > 0 && next.is_near(&noise);
        noise = next;
        if is_settled {
            break;
        }
        *fits = refit(image, fits, &noise, limits, Rest::Roughly);
    }
    noise
}

fn refit(
    image: &GrayImage,
    fits: &[Fit],
    noise: &NoiseModel,
    limits: &FitLimits,
    rest: Rest,
) -> Vec<Fit> {
    fits.par_iter().filter_map(|fit| fit::fit_again(image, fit, noise, limits, rest)).collect()
}

/// The dot of a fit, unless its centre is worth nothing.
fn measure(image: &GrayImage, fit: &Fit, noise: &NoiseModel) -> Option<Dot> {
    let quality = shape::judge(image, fit, noise)?;
    let covariance = covariance::of_centre(image, fit, noise)?;
    let sigma = fit.gaussian.sigma();
    let is_measured = covariance.determinant() > 0.0 && covariance.trace().sqrt() < sigma[0];
    is_measured.then(|| Dot {
        point: ImagePoint {
            at: nalgebra::Vector2::new(fit.gaussian.x, fit.gaussian.y),
            covariance,
        },
        amplitude: fit.gaussian.amplitude,
        background: fit.gaussian.background,
        sigma,
        quality,
    })
}

/// Drops what is no Gaussian spot. The dots of a picture are alike: where they are many, their
/// common departure from a Gaussian (compression, blur) is not held against one.
fn keep_gaussian(dots: &mut Vec<Dot>, options: &DotOptions, noise: &NoiseModel) {
    let mut exponents: Vec<f64> = dots.iter().map(|dot| dot.quality.shape_exponent).collect();
    exponents.sort_by(f64::total_cmp);
    let usual =
        if exponents.len() < 9 { 1.0 } else { exponents[exponents.len() / 2].clamp(0.7, 1.4) };
    dots.retain(|dot| {
        let quality = &dot.quality;
        (quality.shape_exponent - usual).abs()
            <= options.max_shape_departure + 4.0 * quality.shape_sigma
            && quality.reduced_chi_square <= options.max_reduced_chi_square
            && 1.0 - quality.core_ratio
                <= (1.0 - options.min_core_ratio).max(3.0 * core_sigma(dot, noise))
    });
}

/// Standard deviation of the light in a dot's middle that a few speckle grains make: there, above
/// 70 % of the peak, is an area of `-2 pi ln(0.7)` times the product of the standard deviations.
fn core_sigma(dot: &Dot, noise: &NoiseModel) -> f64 {
    let area = 2.24 * dot.sigma[0] * dot.sigma[1];
    noise.speckle_contrast * (noise.grain_area / area).min(1.0).sqrt()
}
