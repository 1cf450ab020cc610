//! The blurred edge of a disc, fitted to the pixels around it: the maximum-likelihood centre under
//! white noise, and its covariance.
//!
//! Model: `(1 + g.u) (ground + (disc - ground) Phi(-d / blur))` with u the offset from the centre,
//! d the distance from the ellipse to first order and Phi the normal distribution function. The
//! light may change across the target (g); without it the slope would move the centre.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

use super::band::Band;
use super::ellipse::Ellipse;
use crate::image::GrayImage;

/// Centre 2, shape 3, disc, ground, blur, slope of the light 2.
pub(super) const PARAMETERS: usize = 10;
pub(super) type Normal = SMatrix<f64, PARAMETERS, PARAMETERS>;
pub(super) type Vector = SVector<f64, PARAMETERS>;

/// Steps before a fit is given up.
const MAX_STEPS: usize = 25;
/// Largest rms residual as a part of the contrast: noise 4 at a contrast of 20, or half an edge that
/// is no ellipse.
const MOST_MISFIT: f64 = 0.2;
/// Steps in which the band of pixels follows the ellipse.
const BAND_STEPS: usize = 2;
/// A centre that moves less than this is final, pixels: the next step would be a tenth of it, and
/// the best centres are good to 0.01.
const CONVERGED: f64 = 4e-3;
/// Likewise of the blur.
const BLUR_CONVERGED: f64 = 0.03;

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
    /// Standard deviation of the edge's blur, pixels.
    pub(super) blur: f64,
    /// Rms residual, grey levels.
    pub(super) misfit: f64,
    /// Of the centre, square pixels.
    pub(super) covariance: Matrix2<f64>,
}

/// The state of the fit.
#[derive(Clone, Copy)]
pub(super) struct Model {
    pub(super) ellipse: Ellipse,
    pub(super) levels: Levels,
    pub(super) blur: f64,
}

/// Fits the edge, starting from a rough ellipse.
pub(super) fn fit(image: &GrayImage, rough: &Ellipse) -> Option<EdgeFit> {
    let mut band = Band::around(image, rough);
    let mut model = start(&band, rough)?;
    for count in 0..MAX_STEPS {
        // Then the band stands still: a pixel that comes and goes with it would never let go.
        if (1..BAND_STEPS).contains(&count) {
            band = Band::around(image, &model.ellipse);
        }
        let sums = band.sums(&model)?;
        let step = sums.normal.cholesky()?.solve(&sums.right);
        let next = model.advance(&step)?;
        let moved = (next.ellipse.centre - model.ellipse.centre).norm();
        model = next;
        if moved < CONVERGED && step[7].abs() < BLUR_CONVERGED {
            return finish(&band, &model, rough);
        }
    }
    None
}

/// Levels from inside and outside of the rough ellipse.
fn start(band: &Band, rough: &Ellipse) -> Option<Model> {
    let (mut disc, mut ground) = ([0.0, 0.0], [0.0, 0.0]);
    let clear = 0.6 * half_band(rough);
    let [x, y, grey] = &band.pixels;
    for ((&x, &y), &grey) in x.iter().zip(y).zip(grey).take(band.count) {
        let at = band.origin + Vector2::new(f64::from(x), f64::from(y));
        let (radius, grey) = (rough.radius(&at), f64::from(grey));
        if radius < 1.0 - clear {
            disc = [disc[0] + grey, disc[1] + 1.0];
        } else if radius > 1.0 + clear {
            ground = [ground[0] + grey, ground[1] + 1.0];
        }
    }
    let levels =
        Levels { disc: disc[0] / disc[1], ground: ground[0] / ground[1], slope: Vector2::zeros() };
    levels.contrast().is_finite().then_some(Model { ellipse: *rough, levels, blur: 0.8 })
}

/// Half the width of the band around an ellipse, in radii: 4.5 pixels, within disc and quiet zone.
pub(super) fn half_band(ellipse: &Ellipse) -> f64 {
    (4.5 / ellipse.semi_axes()[1]).clamp(0.25, 0.55)
}

/// The covariance from the scatter of the residuals where they are, since dark and light pixels
/// differ in noise (White's estimator).
fn finish(band: &Band, model: &Model, rough: &Ellipse) -> Option<EdgeFit> {
    let (sums, scatter) = band.sums_and_scatter(model)?;
    let inverse = sums.normal.try_inverse()?;
    let freedom = sums.count / (sums.count - PARAMETERS as f64);
    let covariance = (inverse * scatter * inverse).fixed_view::<2, 2>(0, 0) * freedom;
    let noise = (sums.squares / sums.count * freedom).sqrt();
    let [_, small] = rough.semi_axes();
    let moved = (model.ellipse.centre - rough.centre).norm();
    let is_disc = noise < MOST_MISFIT * model.levels.contrast() && moved < 0.3 * small + 0.5;
    (is_disc && covariance.trace() > 0.0).then_some(EdgeFit {
        ellipse: model.ellipse,
        levels: model.levels,
        blur: model.blur,
        misfit: noise,
        covariance: 0.5 * (covariance + covariance.transpose()),
    })
}

impl Model {
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
