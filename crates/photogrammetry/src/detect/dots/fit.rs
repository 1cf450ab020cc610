//! The elliptical Gaussian of a dot, fitted with the weights of the picture's noise.
//!
//! Gauss-Newton in the natural parameters of the exponent, `ln f = a + b.u - u Q u / 2`: the
//! derivatives are then f times 1, u, v, u^2, uv, v^2, so that each pixel adds to a handful of
//! moments and no normal equation is filled pixel by pixel. The variance of a pixel follows from
//! the model, never from the pixel, so that bright noise is not preferred.

use super::components::Candidate;
use super::gaussian::Gaussian;
use super::moments::{Moments, Normal, Step};
use super::weighting::{Clipping, SATURATED, Weighting};
use super::window::Window;
use super::{DotOptions, NoiseModel};
use crate::image::GrayImage;

/// Half the side of the window, in the dot's larger standard deviation.
const WINDOW_SIGMA: f64 = 4.0;
/// Steps before a fit is given up.
const MAX_STEPS: usize = 30;
/// A fit rests when the last step lowered the sum of squares by less than this: by a twentieth of
/// the parameters' standard uncertainty (squared). The next step would be far smaller.
const SETTLED: f64 = 2.5e-3;
/// ... or, after ten steps, when the centre moved by less than this, pixels.
const RESTING: f64 = 0.01;
/// As `SETTLED` where the noise is not known yet.
const ROUGHLY_SETTLED: f64 = 0.5;
/// Part of the full range below which a fitted peak is surely not saturated: the flanks alone give
/// it to a tenth.
const PLAINLY_BELOW: f64 = 0.85;
/// Steps after which half steps are taken: weights that follow the model may swing.
const EAGER_STEPS: usize = 8;

/// What a fit may become.
pub(super) struct FitLimits {
    sigma: [f64; 2],
    axis_ratio: f64,
    contrast_in_noise: f64,
}

impl FitLimits {
    /// From the caller's options.
    pub(super) fn new(options: &DotOptions) -> Self {
        Self {
            sigma: [options.min_sigma, options.max_sigma],
            axis_ratio: options.max_axis_ratio,
            contrast_in_noise: options.threshold_in_noise,
        }
    }

    fn accept(&self, gaussian: &Gaussian, noise: &NoiseModel, image: &GrayImage) -> bool {
        let [large, small] = gaussian.sigma();
        // A dot whose middle the border cuts is no dot: half of its skirt is missing.
        let margin = 1.5 * large;
        let inside = |at: f64, size: usize| at >= margin && at <= size as f64 - 1.0 - margin;
        small >= self.sigma[0]
            && large <= self.sigma[1]
            && large <= self.axis_ratio * small
            && gaussian.amplitude >= self.contrast_in_noise * noise.read_noise
            && gaussian.amplitude < 5000.0
            && inside(gaussian.x, image.width)
            && inside(gaussian.y, image.height)
    }
}

/// A fitted dot.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fit {
    pub(super) gaussian: Gaussian,
    pub(super) window: Window,
    /// Saturated pixels are left out.
    pub(super) is_saturated: bool,
    /// Weighted normal matrix of the last step.
    pub(super) normal: Normal,
}

/// Fits a dot where the scan saw something.
pub(super) fn fit_candidate(
    image: &GrayImage,
    candidate: &Candidate,
    noise: &NoiseModel,
    limits: &FitLimits,
) -> Option<Fit> {
    let gaussian = start(candidate);
    let [large, small] = gaussian.sigma();
    if large > 2.0 * limits.sigma[1] || large > 3.0 * limits.axis_ratio * small {
        return None;
    }
    let window = window_of(image, &gaussian)?;
    let mut fit = Fit { gaussian, window, is_saturated: false, normal: Normal::zeros() };
    fit.is_saturated = has_plateau(image, &fit.window);
    // Twice: the first window comes from a threshold, the second from a fit.
    fit = iterate(image, fit, noise, Clipping::None, Rest::Roughly)?;
    fit.window = window_of(image, &fit.gaussian)?;
    // A full area under a model that stays well below it is a bright speckle grain.
    let peak = fit.gaussian.background + fit.gaussian.amplitude;
    fit.is_saturated &= peak > PLAINLY_BELOW * f64::from(SATURATED);
    fit = iterate(image, fit, noise, Clipping::Skirt, Rest::Roughly)?;
    limits.accept(&fit.gaussian, noise, image).then_some(fit)
}

/// Fits a known dot again under another noise.
pub(super) fn fit_again(
    image: &GrayImage,
    fit: &Fit,
    noise: &NoiseModel,
    limits: &FitLimits,
    rest: Rest,
) -> Option<Fit> {
    let window = window_of(image, &fit.gaussian)?;
    let fit = iterate(image, Fit { window, ..*fit }, noise, Clipping::Skirt, rest)?;
    limits.accept(&fit.gaussian, noise, image).then_some(fit)
}

/// What a Gaussian must be to show these pixels above the threshold: they fill the ellipse where
/// it exceeds the threshold, whose second moments are `sigma^2 ln(A / t) / 2`.
fn start(candidate: &Candidate) -> Gaussian {
    let ratio = (candidate.peak / candidate.step.max(1.0)).max(1.4).ln();
    let [xx, xy, yy] = candidate.spread;
    let scale = 2.0 / ratio;
    let (xx, xy, yy) = (scale * xx + 0.3, scale * xy, scale * yy + 0.3);
    let determinant = (xx * yy - xy * xy).max(1e-6);
    Gaussian {
        x: candidate.x,
        y: candidate.y,
        amplitude: candidate.peak,
        background: candidate.background,
        q: [yy / determinant, -xy / determinant, xx / determinant],
    }
}

fn window_of(image: &GrayImage, gaussian: &Gaussian) -> Option<Window> {
    let half = (WINDOW_SIGMA * gaussian.sigma()[0]).max(5.0);
    Window::around(image, (gaussian.x, gaussian.y), half)
}

/// Whether a window has a saturated area, rather than single bright grains: a saturated pixel
/// whose eight neighbours are saturated as well.
fn has_plateau(image: &GrayImage, window: &Window) -> bool {
    let [left, right] = window.x;
    let is_bright = |y: usize| {
        image.row(y)[left..right].iter().fold(0, |most, &pixel| most.max(pixel)) >= SATURATED
    };
    let full = |x: usize, y: usize| image.row(y)[x - 1..=x + 1].iter().all(|&p| p >= SATURATED);
    (window.y[0] + 1..window.y[1].saturating_sub(1)).any(|y| {
        is_bright(y)
            && (left + 1..right.saturating_sub(1))
                .any(|x| full(x, y) && full(x, y - 1) && full(x, y + 1))
    })
}

/// How well a fit must rest.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Rest {
    /// The noise is not known yet.
    Roughly,
    /// The result.
    Fully,
}

impl Fit {
    /// The weights under a noise.
    pub(super) fn weighting(&self, noise: &NoiseModel) -> Weighting {
        Weighting::new(&self.gaussian, self.is_saturated, noise, Clipping::Skirt)
    }
}

/// Gauss-Newton until the parameters rest.
fn iterate(
    image: &GrayImage,
    mut fit: Fit,
    noise: &NoiseModel,
    clipping: Clipping,
    rest: Rest,
) -> Option<Fit> {
    let settled = if rest == Rest::Fully { SETTLED } else { ROUGHLY_SETTLED };
    for count in 0..MAX_STEPS {
        let weighting = Weighting::new(&fit.gaussian, fit.is_saturated, noise, clipping);
        let (normal, right) = normal_equations(image, &fit, &weighting);
        fit.normal = normal;
        let step = normal.cholesky()?.solve(&right);
        let before = fit.gaussian;
        let part = if count < EAGER_STEPS { 1.0 } else { 0.5 };
        fit.gaussian = advance(&before, &(step * part))?;
        let reach = fit.window.width() as f64;
        if !(fit.gaussian.x - before.x).is_finite() || fit.gaussian.sigma()[0] > 4.0 * reach {
            return None;
        }
        // A pixel at the limit of clipping may come and go for ever; then the centre alone counts.
        let moved = (fit.gaussian.x - before.x).hypot(fit.gaussian.y - before.y);
        if step.dot(&right) < settled || (count >= 10 && moved < RESTING) {
            return Some(fit);
        }
    }
    None
}

fn normal_equations(image: &GrayImage, fit: &Fit, weighting: &Weighting) -> (Normal, Step) {
    let mut moments = Moments::new();
    fit.window.walk(image, &fit.gaussian, weighting, |row| moments.add(row));
    moments.equations((fit.window.x[0] as f64 - fit.gaussian.x) as f32)
}

/// The Gaussian after a step, shortened where it would turn the spot inside out. The square is
/// completed exactly: `b.u - u Q u / 2` has its maximum at `Q^-1 b`.
fn advance(gaussian: &Gaussian, step: &Step) -> Option<Gaussian> {
    let [xx, xy, yy] = gaussian.q;
    let mut part = 1.0;
    for _ in 0..12 {
        let q = [xx - 2.0 * part * step[3], xy - part * step[4], yy - 2.0 * part * step[5]];
        let determinant = q[0] * q[2] - q[1] * q[1];
        let before = xx * yy - xy * xy;
        let (bx, by) = (part * step[1], part * step[2]);
        let dx = (q[2] * bx - q[1] * by) / determinant;
        let dy = (q[0] * by - q[1] * bx) / determinant;
        let gain = part * step[0] + 0.5 * (bx * dx + by * dy);
        let far = xx * dx * dx + 2.0 * xy * dx * dy + yy * dy * dy;
        let is_sane = q[0] > 0.0 && determinant > 0.1 * before && determinant < 10.0 * before;
        if is_sane && far < 2.0 && gain.abs() < 1.5 {
            return Some(Gaussian {
                x: gaussian.x + dx,
                y: gaussian.y + dy,
                amplitude: gaussian.amplitude * gain.exp(),
                background: gaussian.background + part * step[6],
                q,
            });
        }
        part *= 0.5;
    }
    None
}
