//! The elliptical Gaussian of a dot, fitted with the weights of the picture's noise.
//!
//! Gauss-Newton in the natural parameters of the exponent, `ln f = a + b.u - u Q u / 2`: the
//! derivatives are then f times 1, u, v, u^2, uv, v^2, so that each pixel adds to a handful of
//! moments and no normal equation is filled pixel by pixel. The variance of a pixel follows from
//! the model, never from the pixel, so that bright noise is not preferred.

use nalgebra::{SMatrix, SVector};

use super::components::Candidate;
use super::gaussian::{Gaussian, Window};
use super::{DotOptions, NoiseModel};
use crate::image::GrayImage;

/// Parameters: amplitude, 2 of the centre, 3 of the shape, background.
pub(super) const PARAMETERS: usize = 7;
/// Weighted normal matrix of the fit.
pub(super) type Normal = SMatrix<f64, PARAMETERS, PARAMETERS>;
type Step = SVector<f64, PARAMETERS>;

/// A pixel of this value or more is saturated.
pub(super) const SATURATED: u8 = 254;
/// Half the side of the window, in the dot's larger standard deviation.
const WINDOW_SIGMA: f64 = 4.0;
/// Residuals beyond so many standard deviations in the skirt are dirt or a neighbour.
const CLIP: f64 = 5.0;
/// The skirt: where the model is below this part of the amplitude.
const SKIRT: f64 = 0.05;
/// Steps before a fit is given up.
const MAX_STEPS: usize = 30;
/// A step of the centre below this is the last, pixels: the next would be far smaller.
const CONVERGED: f64 = 1e-3;
/// Likewise where the noise is not known yet.
const ROUGHLY_CONVERGED: f64 = 0.03;

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

/// Which pixels take part, and with what weight.
pub(super) struct Weighting {
    noise: NoiseModel,
    effective_contrast: f64,
    skirt: f64,
    clip: f64,
    /// Pixels from this value on are left out, and those whose model nearly reaches it: noise alone
    /// must not decide.
    ceiling: f64,
}

impl Weighting {
    /// The weights for a fit: `1 / (n^2 + p f + g C^2 f^2)`; the pixels of a grain count as one.
    pub(super) fn new(fit: &Fit, noise: &NoiseModel, clips: bool) -> Self {
        Self {
            noise: *noise,
            effective_contrast: noise.grain_area * noise.speckle_contrast.powi(2),
            skirt: SKIRT * fit.gaussian.amplitude,
            clip: if clips { CLIP * CLIP } else { f64::INFINITY },
            ceiling: if fit.is_saturated { f64::from(SATURATED) } else { f64::INFINITY },
        }
    }

    /// Weight of a pixel of value `pixel`, model `f` above the background, residual `e`; zero if it
    /// takes no part.
    pub(super) fn of(&self, pixel: f64, f: f64, e: f64) -> f64 {
        let variance = self.noise.read_noise * self.noise.read_noise
            + f * (self.noise.photon_gain + self.effective_contrast * f);
        let is_dirt = f < self.skirt && e * e > self.clip * variance;
        if is_dirt
            || pixel >= self.ceiling
            || pixel - e > self.ceiling - 3.0 * self.noise.read_noise
        {
            0.0
        } else {
            1.0 / variance
        }
    }
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
    fit = iterate(image, fit, noise, Stage::First)?;
    fit.window = window_of(image, &fit.gaussian)?;
    fit = iterate(image, fit, noise, Stage::Second)?;
    limits.accept(&fit.gaussian, noise, image).then_some(fit)
}

/// Fits a known dot again under another noise.
pub(super) fn fit_again(
    image: &GrayImage,
    fit: &Fit,
    noise: &NoiseModel,
    limits: &FitLimits,
) -> Option<Fit> {
    let window = window_of(image, &fit.gaussian)?;
    let fit = iterate(image, Fit { window, ..*fit }, noise, Stage::Final)?;
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
    let full = |x: usize, y: usize| image.row(y)[x - 1..=x + 1].iter().all(|&p| p >= SATURATED);
    (window.y[0] + 1..window.y[1].saturating_sub(1)).any(|y| {
        (window.x[0] + 1..window.x[1].saturating_sub(1))
            .any(|x| full(x, y) && full(x, y - 1) && full(x, y + 1))
    })
}

/// How far a fit has come.
#[derive(Clone, Copy, PartialEq)]
enum Stage {
    /// From the scan; nothing is clipped yet.
    First,
    /// In a window of the right size.
    Second,
    /// Under the noise of the picture.
    Final,
}

/// Gauss-Newton until the centre rests.
fn iterate(image: &GrayImage, mut fit: Fit, noise: &NoiseModel, stage: Stage) -> Option<Fit> {
    let converged = if stage == Stage::Final { CONVERGED } else { ROUGHLY_CONVERGED };
    for count in 0..MAX_STEPS {
        let weighting = Weighting::new(&fit, noise, stage != Stage::First);
        let (normal, right) = normal_equations(image, &fit, &weighting);
        fit.normal = normal;
        let step = normal.cholesky()?.solve(&right);
        let before = fit.gaussian;
        fit.gaussian = advance(&before, &step)?;
        let moved = (fit.gaussian.x - before.x).hypot(fit.gaussian.y - before.y);
        let grown = (fit.gaussian.amplitude / before.amplitude - 1.0).abs();
        let reach = fit.window.width() as f64;
        if !(fit.gaussian.x - before.x).is_finite() || fit.gaussian.sigma()[0] > 4.0 * reach {
            return None;
        }
        // A pixel at the limit of clipping may come and go for ever; what it moves is far below the
        // uncertainty.
        let slack = if count < 10 { 1.0 } else { 10.0 };
        if moved < slack * converged && grown < slack * converged {
            return Some(fit);
        }
    }
    None
}

/// Normal matrix and right-hand side in the order f, fu, fv, fu^2, fuv, fv^2, background.
fn normal_equations(image: &GrayImage, fit: &Fit, weighting: &Weighting) -> (Normal, Step) {
    let mut m = Moments::default();
    fit.window.walk(image, &fit.gaussian, |u, v, pixels, model| {
        m.add_row(v, &row_moments(u, pixels, model, fit.gaussian.background, weighting));
    });
    m.equations()
}

/// Sums over a row: w f^2 u^k for k = 0..4; w f u^k and w r f u^k for k = 0..2; w; w r.
#[derive(Default)]
struct RowMoments {
    ff: [f64; 5],
    f: [f64; 3],
    rf: [f64; 3],
    one: f64,
    r: f64,
}

fn row_moments(
    mut u: f64,
    pixels: &[u8],
    model: &[f64],
    background: f64,
    weighting: &Weighting,
) -> RowMoments {
    let mut sums = RowMoments::default();
    for (&pixel, &f) in pixels.iter().zip(model) {
        let pixel = f64::from(pixel);
        let e = pixel - background - f;
        let w = weighting.of(pixel, f, e);
        let wf = w * f;
        let (wff, wfe) = (wf * f, wf * e);
        let uu = u * u;
        sums.ff[0] += wff;
        sums.ff[1] += wff * u;
        sums.ff[2] += wff * uu;
        sums.ff[3] += wff * u * uu;
        sums.ff[4] += wff * uu * uu;
        sums.f[0] += wf;
        sums.f[1] += wf * u;
        sums.f[2] += wf * uu;
        sums.rf[0] += wfe;
        sums.rf[1] += wfe * u;
        sums.rf[2] += wfe * uu;
        sums.one += w;
        sums.r += w * e;
        u += 1.0;
    }
    sums
}

/// Powers of u and v of the six functions that multiply f.
const POWERS: [(usize, usize); 6] = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)];

/// Sums over the window: `[i][j]` goes with u^i v^j.
#[derive(Default)]
struct Moments {
    ff: [[f64; 5]; 5],
    f: [[f64; 3]; 3],
    rf: [[f64; 3]; 3],
    one: f64,
    r: f64,
}

impl Moments {
    fn add_row(&mut self, v: f64, row: &RowMoments) {
        let powers = [1.0, v, v * v, v * v * v, v * v * v * v];
        for (i, sums) in self.ff.iter_mut().enumerate() {
            for (j, sum) in sums.iter_mut().enumerate().take(5 - i) {
                *sum += row.ff[i] * powers[j];
            }
        }
        for i in 0..3 {
            for (j, power) in powers.iter().enumerate().take(3 - i) {
                self.f[i][j] += row.f[i] * power;
                self.rf[i][j] += row.rf[i] * power;
            }
        }
        self.one += row.one;
        self.r += row.r;
    }

    fn equations(&self) -> (Normal, Step) {
        let mut normal = Normal::zeros();
        let mut right = Step::zeros();
        for (a, &(i, j)) in POWERS.iter().enumerate() {
            for (b, &(k, l)) in POWERS.iter().enumerate() {
                normal[(a, b)] = self.ff[i + k][j + l];
            }
            normal[(a, 6)] = self.f[i][j];
            normal[(6, a)] = self.f[i][j];
            right[a] = self.rf[i][j];
        }
        normal[(6, 6)] = self.one;
        right[6] = self.r;
        (normal, right)
    }
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
