//! The blurred edge of a disc, fitted to the pixels around it: the maximum-likelihood centre under
//! white noise, and its covariance.
//!
//! Model: `(1 + g.u) (ground + (disc - ground) Phi(-d / blur))` with u the offset from the centre,
//! d the distance from the ellipse to first order and Phi the normal distribution function. The
//! light may change across the target (g); without it the slope would move the centre.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

use super::ellipse::Ellipse;
use crate::image::GrayImage;

/// Centre 2, shape 3, disc, ground, blur, slope of the light 2.
const PARAMETERS: usize = 10;
type Normal = SMatrix<f64, PARAMETERS, PARAMETERS>;
type Vector = SVector<f64, PARAMETERS>;

/// Steps before a fit is given up.
const MAX_STEPS: usize = 25;
/// Largest rms residual as a part of the contrast: noise 4 at a contrast of 20, or half an edge that
/// is no ellipse.
const MOST_MISFIT: f64 = 0.2;
/// Steps in which the band of pixels follows the ellipse.
const BAND_STEPS: usize = 3;
/// A centre that moves less than this is final, pixels.
const CONVERGED: f64 = 1e-3;

/// Grey levels of a target and the light on it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Levels {
    /// Grey value of the disc at the centre.
    pub(super) disc: f64,
    /// Grey value of the ground at the centre.
    pub(super) ground: f64,
    /// Relative change of the light per pixel.
    pub(super) slope: Vector2<f64>,
}

impl Levels {
    /// Difference of disc and ground, grey levels.
    pub(super) fn contrast(&self) -> f64 {
        (self.disc - self.ground).abs()
    }
}

/// A measured disc.
#[derive(Debug, Clone, Copy)]
pub(super) struct EdgeFit {
    pub(super) ellipse: Ellipse,
    pub(super) levels: Levels,
    /// Of the centre, square pixels.
    pub(super) covariance: Matrix2<f64>,
}

/// The state of the fit.
#[derive(Clone, Copy)]
struct Model {
    ellipse: Ellipse,
    levels: Levels,
    blur: f64,
}

/// Fits the edge, starting from a rough ellipse.
pub(super) fn fit(image: &GrayImage, rough: &Ellipse) -> Option<EdgeFit> {
    let mut model = start(image, rough)?;
    let mut band = *rough;
    for count in 0..MAX_STEPS {
        // Then the band stands still: a pixel that comes and goes with it would never let go.
        if count < BAND_STEPS {
            band = model.ellipse;
        }
        let sums = accumulate(image, &model, &band)?;
        let step = sums.normal.cholesky()?.solve(&sums.right);
        let next = model.advance(&step)?;
        let moved = (next.ellipse.centre - model.ellipse.centre).norm();
        model = next;
        if moved < CONVERGED && step[7].abs() < 0.01 {
            return finish(image, &model, &band, rough);
        }
    }
    None
}

/// Levels from inside and outside of the rough ellipse.
fn start(image: &GrayImage, rough: &Ellipse) -> Option<Model> {
    let (mut disc, mut ground) = ([0.0, 0.0], [0.0, 0.0]);
    let clear = 0.6 * half_band(rough);
    for_band(image, rough, &mut |at, pixel| {
        let radius = rough.radius(&at);
        if radius < 1.0 - clear {
            disc = [disc[0] + pixel, disc[1] + 1.0];
        } else if radius > 1.0 + clear {
            ground = [ground[0] + pixel, ground[1] + 1.0];
        }
    });
    let levels =
        Levels { disc: disc[0] / disc[1], ground: ground[0] / ground[1], slope: Vector2::zeros() };
    levels.contrast().is_finite().then_some(Model { ellipse: *rough, levels, blur: 0.8 })
}

/// Half the width of the band around an ellipse, in radii: 4.5 pixels, within disc and quiet zone.
fn half_band(ellipse: &Ellipse) -> f64 {
    (4.5 / ellipse.semi_axes()[1]).clamp(0.25, 0.55)
}

/// Calls `each` for the pixels of the band around an ellipse: the edge, and enough of disc and
/// quiet zone for their levels.
fn for_band(image: &GrayImage, ellipse: &Ellipse, each: &mut impl FnMut(Vector2<f64>, f64)) {
    let half = half_band(ellipse);
    let inverse = ellipse.shape.try_inverse().unwrap_or_else(Matrix2::zeros);
    let reach = Vector2::new(inverse[(0, 0)].sqrt(), inverse[(1, 1)].sqrt()) * (1.0 + half);
    let range = |centre: f64, reach: f64, size: usize| {
        let first = (centre - reach).ceil().max(0.0) as usize;
        first..((centre + reach).floor().max(-1.0) + 1.0).min(size as f64) as usize
    };
    let squares = (1.0 - half).powi(2)..(1.0 + half).powi(2);
    for y in range(ellipse.centre.y, reach.y, image.height) {
        let row = image.row(y);
        for x in range(ellipse.centre.x, reach.x, image.width) {
            let at = Vector2::new(x as f64, y as f64);
            if squares.contains(&ellipse.square_radius(&at)) {
                each(at, f64::from(row[x]));
            }
        }
    }
}

/// Sums of the normal equations; of outer products the lower triangle only.
struct Sums {
    normal: Normal,
    right: Vector,
    count: f64,
    squares: f64,
}

fn add_lower(sum: &mut Normal, row: &Vector, weight: f64) {
    for j in 0..PARAMETERS {
        let factor = weight * row[j];
        for i in j..PARAMETERS {
            sum[(i, j)] += factor * row[i];
        }
    }
}

fn fill_upper(sum: &mut Normal) {
    *sum = Normal::from_fn(|i, j| sum[(i.max(j), i.min(j))]);
}

fn accumulate(image: &GrayImage, model: &Model, band: &Ellipse) -> Option<Sums> {
    let mut sums =
        Sums { normal: Normal::zeros(), right: Vector::zeros(), count: 0.0, squares: 0.0 };
    for_band(image, band, &mut |at, pixel| {
        let (value, row) = model.at(&at);
        let e = pixel - value;
        add_lower(&mut sums.normal, &row, 1.0);
        sums.right += row * e;
        sums.count += 1.0;
        sums.squares += e * e;
    });
    fill_upper(&mut sums.normal);
    (sums.count > 3.0 * PARAMETERS as f64).then_some(sums)
}

/// The covariance from the scatter of the residuals where they are, since dark and light pixels
/// differ in noise (White's estimator).
fn finish(image: &GrayImage, model: &Model, band: &Ellipse, rough: &Ellipse) -> Option<EdgeFit> {
    let sums = accumulate(image, model, band)?;
    let inverse = sums.normal.try_inverse()?;
    let mut scatter = Normal::zeros();
    for_band(image, band, &mut |at, pixel| {
        let (value, row) = model.at(&at);
        add_lower(&mut scatter, &row, (pixel - value).powi(2));
    });
    fill_upper(&mut scatter);
    let freedom = sums.count / (sums.count - PARAMETERS as f64);
    let covariance = (inverse * scatter * inverse).fixed_view::<2, 2>(0, 0) * freedom;
    let noise = (sums.squares / sums.count * freedom).sqrt();
    let [_, small] = rough.semi_axes();
    let moved = (model.ellipse.centre - rough.centre).norm();
    let is_disc = noise < MOST_MISFIT * model.levels.contrast() && moved < 0.3 * small + 0.5;
    (is_disc && covariance.trace() > 0.0).then_some(EdgeFit {
        ellipse: model.ellipse,
        levels: model.levels,
        covariance: 0.5 * (covariance + covariance.transpose()),
    })
}

impl Model {
    /// Grey value at a place and its derivatives.
    fn at(&self, at: &Vector2<f64>) -> (f64, Vector) {
        let u = at - self.ellipse.centre;
        let gradient = self.ellipse.shape * u;
        let radius = u.dot(&gradient).max(1e-12).sqrt();
        let steepness = gradient.norm() / radius;
        let distance = (radius - 1.0) / steepness;
        let t = distance / self.blur;
        let bell = if t.abs() < 7.0 { (-0.5 * t * t).exp() } else { 0.0 };
        let part = upper_tail(t, bell);
        let density = bell / (std::f64::consts::TAU.sqrt() * self.blur);
        let light = 1.0 + self.levels.slope.dot(&u);
        let difference = self.levels.disc - self.levels.ground;
        let plain = self.levels.ground + difference * part;
        // By the radius: d part / d radius; the change of the steepness is of second order.
        let by_radius = -density / steepness * light * difference;
        let by_shape = by_radius / (2.0 * radius);
        let shift = -gradient / radius * by_radius;
        let row = Vector::from([
            shift.x,
            shift.y,
            by_shape * u.x * u.x,
            by_shape * 2.0 * u.x * u.y,
            by_shape * u.y * u.y,
            light * part,
            light * (1.0 - part),
            density * t * light * difference,
            plain * u.x,
            plain * u.y,
        ]);
        (light * plain, row)
    }

    /// The model after a step; `None` where it leaves what a disc can be.
    fn advance(&self, step: &Vector) -> Option<Self> {
        let mut part: f64 = 1.0;
        for _ in 0..10 {
            let change = Matrix2::new(step[2], step[3], step[3], step[4]) * part;
            let shape = self.ellipse.shape + change;
            let ratio = shape.determinant() / self.ellipse.shape.determinant();
            let shift = Vector2::new(step[0], step[1]) * part;
            let is_small = self.ellipse.radius(&(self.ellipse.centre + shift)) < 0.5;
            if let Some(ellipse) = Ellipse::valid(self.ellipse.centre + shift, shape)
                && (0.4..2.5).contains(&ratio)
                && is_small
            {
                let levels = Levels {
                    disc: self.levels.disc + part * step[5],
                    ground: self.levels.ground + part * step[6],
                    slope: self.levels.slope + Vector2::new(step[8], step[9]) * part,
                };
                let blur = (self.blur + part * step[7])
                    .clamp(0.5 * self.blur, 2.0 * self.blur)
                    .clamp(0.2, 12.0);
                return Some(Self { ellipse, levels, blur });
            }
            part *= 0.5;
        }
        None
    }
}

/// Part of a normal distribution above t, error below 1.5e-7 (Abramowitz and Stegun 7.1.26);
/// `bell` is `exp(-t^2 / 2)`.
fn upper_tail(t: f64, bell: f64) -> f64 {
    let z = t.abs() * std::f64::consts::FRAC_1_SQRT_2;
    let r = 1.0 / (1.0 + 0.327_591_1 * z);
    let series = [1.061_405_429, -1.453_152_027, 1.421_413_741, -0.284_496_736, 0.254_829_592];
    let polynomial = series.iter().fold(0.0, |sum, c| sum * r + c) * r;
    let tail = 0.5 * polynomial * bell;
    if t >= 0.0 { tail } else { 1.0 - tail }
}
