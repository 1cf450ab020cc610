//! The noise of a picture from the residuals of its dots.
//!
//! Squared residuals against the model intensity give the variances, products of neighbouring
//! residuals the size of a speckle grain. A fit follows its own noise, more so where a few grains
//! make a dot; that is made good.

use nalgebra::{Matrix3, Vector3};

use super::fit::{Fit, PARAMETERS, Weighting};
use super::{NoiseModel, grains};
use crate::image::GrayImage;

/// A dot whose relative residuals are so many times the typical (in squares) is no plain dot.
const ROUGHEST: f64 = 3.0;
/// Fewer pixels say nothing about the noise.
const LEAST_PIXELS: f64 = 200.0;
/// Below this part of the amplitude the fitted model's own variance is negligible.
const CORE: f64 = 0.05;
/// Largest part of a pixel's variance that a fit is taken to have followed.
const MOST_TAKEN: f64 = 0.75;
/// Rounds of reweighting in the regression.
const ROUNDS: usize = 6;

impl NoiseModel {
    /// Whether another model gives practically the same weights.
    pub(super) fn is_near(&self, other: &Self) -> bool {
        let near = |a: f64, b: f64, least: f64| (a - b).abs() <= 0.02 * b.abs() + least;
        near(self.read_noise, other.read_noise, 0.01)
            && near(self.speckle_contrast, other.speckle_contrast, 0.005)
            && near(self.photon_gain, other.photon_gain, 0.02)
            && near(self.grain_area, other.grain_area, 0.1)
    }
}

/// Classes of intensity in which squares are gathered, and their width in grey levels.
const CLASSES: usize = 96;
const CLASS_WIDTH: f64 = 3.0;

/// Squares of residuals of pixels of about one intensity.
#[derive(Clone, Copy, Default)]
struct Class {
    count: f64,
    intensity: f64,
    square: f64,
}

/// Residuals of one dot.
struct Residuals {
    classes: [Class; CLASSES],
    /// Excess of the squares over white noise relative to f^2, a rough squared contrast.
    roughness: f64,
}

/// Estimates the noise from fits that were made under `present`.
pub(super) fn estimate(image: &GrayImage, fits: &[Fit], present: &NoiseModel) -> NoiseModel {
    let all: Vec<(Residuals, &Fit)> =
        fits.iter().filter_map(|fit| Some((residuals(image, fit, present)?, fit))).collect();
    // Parts of printed patterns among the dots must not pass for speckle.
    let limit = ROUGHEST * median(all.iter().map(|(r, _)| r.roughness).collect()).max(1e-3);
    let good: Vec<&(Residuals, &Fit)> = all.iter().filter(|(r, _)| r.roughness <= limit).collect();
    let mut classes = [Class::default(); CLASSES];
    for (class, other) in good.iter().flat_map(|(r, _)| r.classes.iter().enumerate()) {
        let sum = &mut classes[class];
        sum.count += other.count;
        sum.intensity += other.intensity;
        sum.square += other.square;
    }
    if classes.iter().map(|class| class.count).sum::<f64>() < LEAST_PIXELS {
        return *present;
    }
    let [n2, p, c2] = variances(&classes, present);
    let noise = NoiseModel {
        read_noise: n2.max(1.0 / 12.0).sqrt(),
        photon_gain: p,
        speckle_contrast: c2.sqrt(),
        ..*present
    };
    let grain_area = grains::grain_area(image, good.iter().map(|(_, fit)| *fit), &noise, present);
    NoiseModel { grain_area, ..noise }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Factor of a normal matrix: the variance of the fitted model at a pixel.
pub(super) struct Leverage {
    /// Lower triangle, the diagonal inverted.
    factor: [[f64; PARAMETERS]; PARAMETERS],
}

impl Leverage {
    /// Of a fit.
    pub(super) fn new(fit: &Fit) -> Option<Self> {
        let lower = fit.normal.cholesky()?.unpack();
        let entry = |i: usize, j: usize| if i == j { 1.0 / lower[(i, i)] } else { lower[(i, j)] };
        Some(Self { factor: std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j))) })
    }

    /// `L^-1 j`; the product of two is the covariance of the model at two pixels.
    pub(super) fn of(&self, f: f64, u: f64, v: f64) -> [f64; PARAMETERS] {
        let mut row = [f, f * u, f * v, f * u * u, f * u * v, f * v * v, 1.0];
        for i in 0..PARAMETERS {
            let known: f64 = (0..i).map(|j| self.factor[i][j] * row[j]).sum();
            row[i] = (row[i] - known) * self.factor[i][i];
        }
        row
    }
}

/// Product of two results of [`Leverage::of`].
pub(super) fn dot(a: &[f64; PARAMETERS], b: &[f64; PARAMETERS]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn residuals(image: &GrayImage, fit: &Fit, present: &NoiseModel) -> Option<Residuals> {
    let gaussian = &fit.gaussian;
    let weighting = Weighting::new(fit, present, true);
    let leverage = Leverage::new(fit)?;
    let mut classes = [Class::default(); CLASSES];
    let (mut excess, mut power) = (0.0, 0.0);
    fit.window.walk(image, gaussian, |u, v, pixels, model| {
        for (i, (&pixel, &f)) in pixels.iter().zip(model).enumerate() {
            let pixel = f64::from(pixel);
            let e = pixel - gaussian.background - f;
            if weighting.of(pixel, f, e) == 0.0 {
                continue;
            }
            let mut square = e * e;
            if f > CORE * gaussian.amplitude {
                // E[e^2] is the pixel's variance less that of the fitted model.
                let row = leverage.of(f, u + i as f64, v);
                let taken = dot(&row, &row) / present.pixel_variance(f);
                square /= 1.0 - taken.min(MOST_TAKEN);
            }
            excess += square - present.read_noise * present.read_noise;
            power += f * f;
            let class = &mut classes[((f / CLASS_WIDTH) as usize).min(CLASSES - 1)];
            class.count += 1.0;
            class.intensity += f;
            class.square += square;
        }
    });
    Some(Residuals { classes, roughness: excess / power })
}

/// Read variance, photon gain and squared contrast, none negative, by weighted regression.
fn variances(classes: &[Class], present: &NoiseModel) -> [f64; 3] {
    let mut model =
        [present.read_noise.powi(2), present.photon_gain, present.speckle_contrast.powi(2)];
    for _ in 0..ROUNDS {
        let mut normal = Matrix3::zeros();
        let mut right = Vector3::zeros();
        for class in classes.iter().filter(|class| class.count > 0.0) {
            let f = class.intensity / class.count;
            let row = Vector3::new(1.0, f, f * f);
            let expected = model[0] + f * (model[1] + model[2] * f);
            let weight = 1.0 / (expected * expected);
            normal += row * row.transpose() * (weight * class.count);
            right += row * (class.square * weight);
        }
        model = non_negative(&normal, &right);
    }
    model
}

/// Least squares with the second and third unknown not negative: the better of the allowed cases.
fn non_negative(normal: &Matrix3<f64>, right: &Vector3<f64>) -> [f64; 3] {
    let cases = [[true, true], [true, false], [false, true], [false, false]];
    let mut best = ([1.0, 0.0, 0.0], f64::INFINITY);
    for [photon, speckle] in cases {
        let (mut n, mut r) = (*normal, *right);
        for (index, used) in [(1, photon), (2, speckle)] {
            if !used {
                n.fill_row(index, 0.0);
                n.fill_column(index, 0.0);
                n[(index, index)] = 1.0;
                r[index] = 0.0;
            }
        }
        let Some(x) = n.lu().solve(&r) else { continue };
        let cost = x.dot(&(normal * x)) - 2.0 * x.dot(right);
        if x[0] > 0.0 && x[1] >= 0.0 && x[2] >= 0.0 && cost < best.1 {
            best = ([x[0], x[1], x[2]], cost);
        }
    }
    best.0
}
