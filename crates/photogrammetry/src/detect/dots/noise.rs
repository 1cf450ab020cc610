//! The noise of a picture from the residuals of its dots.
//!
//! Squared residuals against the model intensity give the variances, products of neighbouring
//! residuals the size of a speckle grain. A fit follows its own noise, more so where a few grains
//! make a dot; that is made good.

use nalgebra::{Matrix3, Vector3};
use rayon::iter::{IntoParallelRefIterator as _, ParallelIterator as _};

use super::fit::Fit;
use super::moments::QuadraticForm;
use super::weighting::SATURATED;
use super::window::{MAX_WINDOW, Row};
use super::{NoiseModel, grains};
use crate::detect::lanes::{LANES, Lanes};
use crate::image::GrayImage;

/// A dot whose relative residuals are so many times the typical (in squares) is no plain dot.
const ROUGHEST: f64 = 3.0;
/// Fewer pixels say nothing about the noise.
const LEAST_PIXELS: f64 = 200.0;
/// Below this part of the amplitude the fitted model's own variance is negligible.
const CORE: f64 = 0.05;
/// Largest part of a pixel's variance that a fit is taken to have followed.
const MOST_TAKEN: f32 = 0.75;
/// Part of the pixels of a class that may be full.
const MOST_FULL: f64 = 0.01;
/// Rounds of reweighting in the regression.
const ROUNDS: usize = 6;

impl NoiseModel {
    /// Whether another model gives practically the same weights and covariances: a variance that
    /// is 4 % wrong makes an uncertainty 2 % wrong.
    pub(super) fn is_near(&self, other: &Self) -> bool {
        let near = |a: f64, b: f64| (a - b).abs() <= 0.04 * b;
        [0.0, 20.0, 50.0, 120.0]
            .iter()
            .all(|&f| near(self.pixel_variance(f), other.pixel_variance(f)))
            && near(self.grain_area, other.grain_area)
    }
}

/// Classes of intensity in which squares are gathered, and their width in grey levels.
const CLASSES: usize = 96;
const CLASS_WIDTH: f32 = 3.0;

/// Squares of residuals of pixels of about one intensity.
#[derive(Clone, Copy, Default)]
struct Class {
    count: f64,
    intensity: f64,
    square: f64,
    /// How many are as bright as the picture can show.
    full: f64,
}

impl Class {
    /// Whether the picture's range cut off enough of the bright pixels to make the rest look calm.
    fn is_cut(&self) -> bool {
        self.full > MOST_FULL * self.count
    }
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
        fits.par_iter().filter_map(|fit| Some((residuals(image, fit, present)?, fit))).collect();
    // Parts of printed patterns among the dots must not pass for speckle.
    let limit = ROUGHEST * median(all.iter().map(|(r, _)| r.roughness).collect()).max(1e-3);
    let good: Vec<&(Residuals, &Fit)> = all.iter().filter(|(r, _)| r.roughness <= limit).collect();
    let mut classes = [Class::default(); CLASSES];
    for (class, other) in good.iter().flat_map(|(r, _)| r.classes.iter().enumerate()) {
        let sum = &mut classes[class];
        sum.count += other.count;
        sum.intensity += other.intensity;
        sum.square += other.square;
        sum.full += other.full;
    }
    if classes.iter().map(|class| class.count).sum::<f64>() < LEAST_PIXELS {
        return *present;
    }
    // From the first class on that the picture's range cuts, nothing is told by brighter ones.
    let usable = classes.iter().position(Class::is_cut).unwrap_or(CLASSES);
    let [n2, p, c2] = variances(&classes[..usable], present);
    let brightest =
        if usable < CLASSES { usable as f64 * f64::from(CLASS_WIDTH) } else { f64::INFINITY };
    let noise = NoiseModel {
        read_noise: n2.max(1.0 / 12.0).sqrt(),
        photon_gain: p,
        speckle_contrast: c2.sqrt(),
        ..*present
    };
    let fits = good.iter().map(|(_, fit)| *fit);
    let grain_area = grains::grain_area(image, fits, [&noise, present], brightest);
    NoiseModel { grain_area, ..noise }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

fn residuals(image: &GrayImage, fit: &Fit, present: &NoiseModel) -> Option<Residuals> {
    let leverage = QuadraticForm::new(&fit.normal.try_inverse()?);
    let mut gathered = Gathered::new(fit, present);
    fit.window.walk(image, &fit.gaussian, &fit.weighting(present), |row| {
        gathered.add(row, &leverage);
    });
    Some(gathered.finish())
}

/// What [`residuals`] sums.
struct Gathered {
    /// From the second class on.
    classes: [Class; CLASSES],
    /// The first class, which holds most pixels: count, intensity, square, full.
    dark: [Lanes; 4],
    excess: Lanes,
    power: Lanes,
    core: Lanes,
    /// Grey levels above the background from which on a pixel is full.
    full: f32,
    /// Present read variance, photon gain, squared contrast.
    variance: [Lanes; 3],
}

impl Gathered {
    fn new(fit: &Fit, present: &NoiseModel) -> Self {
        let variance =
            [present.read_noise.powi(2), present.photon_gain, present.speckle_contrast.powi(2)];
        Self {
            classes: [Class::default(); CLASSES],
            dark: [Lanes::ZERO; 4],
            excess: Lanes::ZERO,
            power: Lanes::ZERO,
            core: Lanes::all((CORE * fit.gaussian.amplitude) as f32),
            full: (f64::from(SATURATED) - fit.gaussian.background) as f32 - 0.01,
            variance: variance.map(|v| Lanes::all(v as f32)),
        }
    }

    /// Adds a row: `E[e^2]` is the pixel's variance less that of the fitted model.
    fn add(&mut self, row: &Row, leverage: &QuadraticForm) {
        let mut taken = [0.0f32; MAX_WINDOW];
        let mut squares = [0.0f32; MAX_WINDOW];
        leverage.fill(row, &mut taken);
        for at in (0..row.f.len()).step_by(LANES) {
            let lanes = |values: &[f32]| Lanes::from_slice(&values[at..at + LANES]);
            let [f, e, w, taken] = [row.f, row.e, row.w, &taken[..]].map(lanes);
            let square = self.add_lanes(f, e, w, taken);
            squares[at..at + LANES].copy_from_slice(&square.values());
        }
        for (((&square, &f), &e), &w) in squares.iter().zip(row.f).zip(row.e).zip(row.w) {
            if f >= CLASS_WIDTH && w > 0.0 {
                let class = &mut self.classes[((f / CLASS_WIDTH) as usize).min(CLASSES - 1)];
                class.count += 1.0;
                class.intensity += f64::from(f);
                class.square += f64::from(square);
                class.full += f64::from(u8::from(f + e >= self.full));
            }
        }
    }

    /// Adds some pixels to all sums but those of bright classes; their squared residuals, made good.
    fn add_lanes(&mut self, f: Lanes, e: Lanes, w: Lanes, taken: Lanes) -> Lanes {
        let [n2, p, c2] = self.variance;
        let (one, infinity) = (Lanes::all(1.0), Lanes::all(f32::INFINITY));
        let part = (taken / (n2 + f * (p + c2 * f))).min(Lanes::all(MOST_TAKEN));
        let square = e * e / (one - part.where_between(self.core, f, infinity));
        let used = one.where_between(Lanes::ZERO, w, infinity);
        self.excess += used * (square - n2);
        self.power += used * f * f;
        let dark = used.where_between(Lanes::all(-1.0), f, Lanes::all(CLASS_WIDTH));
        let full = dark.where_between(Lanes::all(self.full - 1e-3), f + e, infinity);
        let sums = [dark, dark * f, dark * square, full];
        self.dark.iter_mut().zip(sums).for_each(|(all, sum)| *all += sum);
        square
    }

    fn finish(mut self) -> Residuals {
        let [count, intensity, square, full] = self.dark.map(|sum| f64::from(sum.total()));
        self.classes[0] = Class { count, intensity, square, full };
        let roughness = f64::from(self.excess.total()) / f64::from(self.power.total());
        Residuals { classes: self.classes, roughness }
    }
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
