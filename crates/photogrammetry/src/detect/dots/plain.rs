//! The plain ways to a dot's centre, for comparison and for whoever wants them.
//!
//! None of them knows speckle or the picture's noise; their covariances do. Pure functions of the
//! picture and of the dot as it was detected: its rough place, peak, background and size.

use nalgebra::{Matrix2, Matrix4, Vector2, Vector4};

use super::{CentreMethod, NoiseModel};
use crate::detect::{Dot, ImagePoint};
use crate::image::GrayImage;

/// Part of the peak above which a pixel belongs to the dot.
const THRESHOLD: f64 = 0.5;
/// Reach of the centroids from the rough place, in the large standard deviation: the threshold is
/// at 1.18.
const CENTROID_REACH: f64 = 2.5;
/// Likewise of the template.
const TEMPLATE_REACH: f64 = 4.0;
/// Steps of the matching, and the step of the centre that ends it, pixels.
const STEPS: usize = 20;
const CONVERGED: f64 = 1e-4;

/// Takes every dot's centre by another method; a dot for which that fails is dropped.
pub(super) fn replace_centres(
    image: &GrayImage,
    dots: &mut Vec<Dot>,
    method: CentreMethod,
    noise: &NoiseModel,
) {
    dots.retain_mut(|dot| {
        let point = match method {
            CentreMethod::Gaussian => Some(dot.point),
            CentreMethod::GreyCentroid => grey_centroid(image, dot, noise),
            CentreMethod::BinaryCentroid => binary_centroid(image, dot, noise),
            CentreMethod::LeastSquaresMatching => match_template(image, dot, noise),
        };
        point.inspect(|point| dot.point = *point).is_some()
    });
}

/// Centroid of the pixels above half of the peak, all alike. In its covariance a pixel is in or out
/// by the chance of its noise; the rounding to whole pixels evens out around the dot.
fn binary_centroid(image: &GrayImage, dot: &Dot, noise: &NoiseModel) -> Option<ImagePoint> {
    let level = dot.background + THRESHOLD * dot.amplitude;
    let (mut count, mut sum) = (0.0, Vector2::zeros());
    for_pixels(image, dot, CENTROID_REACH, |at, grey| {
        if grey > level {
            count += 1.0;
            sum += at;
        }
    });
    let centre = sum / count;
    let mut covariance = Matrix2::zeros();
    for_pixels(image, dot, CENTROID_REACH, |at, _| {
        let f = model(dot, &at);
        let spread = noise.pixel_variance(f).sqrt();
        let chance = 1.0 / (1.0 + (-1.7 * (f + dot.background - level) / spread).exp());
        covariance += (at - centre) * (at - centre).transpose() * chance * (1.0 - chance);
    });
    point(centre, covariance / (count * count))
}

/// Centroid weighted by the grey value above half of the peak.
fn grey_centroid(image: &GrayImage, dot: &Dot, noise: &NoiseModel) -> Option<ImagePoint> {
    let level = dot.background + THRESHOLD * dot.amplitude;
    let (mut total, mut sum) = (0.0, Vector2::zeros());
    for_pixels(image, dot, CENTROID_REACH, |at, grey| {
        let weight = (grey - level).max(0.0);
        total += weight;
        sum += at * weight;
    });
    let centre = sum / total;
    let mut covariance = Matrix2::zeros();
    for_pixels(image, dot, CENTROID_REACH, |at, grey| {
        if grey > level {
            let offset = at - centre;
            covariance += offset * offset.transpose() * pixel_variance(dot, &at, noise);
        }
    });
    point(centre, covariance / (total * total))
}

/// Least-squares matching: a round Gaussian of the dot's mean size is moved, and its gain and offset
/// changed, until the sum of squared differences is least; every pixel counts alike.
fn match_template(image: &GrayImage, dot: &Dot, noise: &NoiseModel) -> Option<ImagePoint> {
    let variance = dot.sigma[0] * dot.sigma[1];
    let mut centre = dot.point.at;
    let (mut gain, mut offset) = (dot.amplitude, dot.background);
    for _ in 0..STEPS {
        let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
        let mut scatter = Matrix4::zeros();
        for_pixels(image, dot, TEMPLATE_REACH, |at, grey| {
            let away = at - centre;
            let template = (-0.5 * away.norm_squared() / variance).exp();
            let by_place = away * (gain * template / variance);
            let row = Vector4::new(by_place.x, by_place.y, template, 1.0);
            normal += row * row.transpose();
            right += row * (grey - offset - gain * template);
            scatter += row * row.transpose() * pixel_variance(dot, &at, noise);
        });
        let step = normal.cholesky()?.solve(&right);
        centre += step.xy();
        gain += step.z;
        offset += step.w;
        if (centre - dot.point.at).norm() > dot.sigma[0] {
            return None;
        }
        if step.xy().norm() < CONVERGED {
            let inverse = normal.try_inverse()?;
            let covariance = inverse * scatter * inverse;
            return point(centre, covariance.fixed_view::<2, 2>(0, 0).into());
        }
    }
    None
}

/// The Gaussian of a dot above its background, taken as round.
fn model(dot: &Dot, at: &Vector2<f64>) -> f64 {
    let square = (at - dot.point.at).norm_squared() / (dot.sigma[0] * dot.sigma[1]);
    dot.amplitude * (-0.5 * square).exp()
}

/// Variance of a pixel, the grains' pixels as one.
fn pixel_variance(dot: &Dot, at: &Vector2<f64>, noise: &NoiseModel) -> f64 {
    let f = model(dot, at);
    let speckle = noise.grain_area * (noise.speckle_contrast * f).powi(2);
    noise.read_noise.powi(2) * noise.background_correlation + noise.photon_gain * f + speckle
}

fn point(at: Vector2<f64>, covariance: Matrix2<f64>) -> Option<ImagePoint> {
    (at.norm().is_finite() && covariance.determinant() > 0.0)
        .then_some(ImagePoint { at, covariance })
}

/// Calls `each(place, grey value)` for the pixels within a square around the rough place.
fn for_pixels(image: &GrayImage, dot: &Dot, reach: f64, mut each: impl FnMut(Vector2<f64>, f64)) {
    let half = reach * dot.sigma[0];
    let range = |centre: f64, size: usize| {
        let first = (centre - half).ceil().max(0.0) as usize;
        first..((centre + half).floor().max(-1.0) + 1.0).min(size as f64) as usize
    };
    for y in range(dot.point.at.y, image.height) {
        let row = image.row(y);
        for x in range(dot.point.at.x, image.width) {
            each(Vector2::new(x as f64, y as f64), f64::from(row[x]));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::testing::speckle_cell;
    use crate::detect::{DotOptions, find_dots};

    /// The rms error of a coordinate, and the mean squared standardised error (2 is expected), on
    /// 121 clean dots of amplitude 150, noise 4, standard deviation 3 px.
    fn errors(centre: CentreMethod) -> (f64, f64) {
        let (image, spots) = speckle_cell(0.0, 0.5, 11, 5);
        let dots = find_dots(&image, &DotOptions { centre, ..DotOptions::default() }).dots;
        assert_eq!(dots.len(), spots.len());
        let (mut squares, mut standardised) = (0.0, 0.0);
        for spot in &spots {
            let error = |dot: &Dot| dot.point.at - Vector2::from(spot.at);
            let dot = dots.iter().find(|dot| error(dot).norm() < 2.0).unwrap();
            let e = error(dot);
            squares += e.norm_squared();
            standardised += (e.transpose() * dot.point.covariance.try_inverse().unwrap() * e)[0];
        }
        let count = spots.len() as f64;
        ((squares / (2.0 * count)).sqrt(), standardised / count)
    }

    #[test]
    fn the_plain_methods_are_worse_in_their_known_order_and_say_by_how_much() {
        let (gaussian, _) = errors(CentreMethod::Gaussian);
        let (matching, nees) = errors(CentreMethod::LeastSquaresMatching);
        // Cramer-Rao: sqrt(2 / pi) n / A = 0.0213, told to 5 % (three of them) by 242 errors.
        assert!((matching / 0.0213 - 1.0).abs() < 0.15 && matching < 1.1 * gaussian, "{matching}");
        assert!((nees - 2.0).abs() < 0.55, "matching {nees}");
        let (grey, nees) = errors(CentreMethod::GreyCentroid);
        assert!(grey > 1.15 * gaussian, "{grey} against {gaussian}");
        assert!((nees - 2.0).abs() < 0.55, "grey {nees}");
        let (binary, nees) = errors(CentreMethod::BinaryCentroid);
        assert!(binary > 1.15 * grey, "{binary} against {grey}");
        // The rounding to whole pixels is left out, and chances are not normal: within 40 %.
        assert!((1.2..2.8).contains(&nees), "binary {nees}");
    }
}
