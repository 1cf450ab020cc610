//! Which pixels of a dot take part, and with what weight.

use super::NoiseModel;
use super::gaussian::Gaussian;

/// A pixel of this value or more is saturated.
pub(super) const SATURATED: u8 = 254;
/// Residuals beyond so many standard deviations in the skirt are dirt or a neighbour.
const CLIP: f64 = 5.0;
/// The skirt: where the model is below this part of the amplitude.
const SKIRT: f64 = 0.05;

/// What is left out besides pixels of little light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Clipping {
    /// Nothing: the fit is rough still.
    None,
    /// Dirt and neighbours in the skirt.
    Skirt,
}

/// Weights `1 / (n^2 + p f + g C^2 f^2)`; the pixels of a grain count as one.
pub(super) struct Weighting {
    read_variance: f32,
    photon_gain: f32,
    /// `g C^2`.
    effective: f32,
    background: f32,
    skirt: f32,
    clip: f32,
    /// Pixels from this value on are left out.
    ceiling: f32,
    /// And those whose model nearly reaches it: noise alone must not decide.
    model_ceiling: f32,
}

impl Weighting {
    /// The weights for a dot.
    pub(super) fn new(
        gaussian: &Gaussian,
        is_saturated: bool,
        noise: &NoiseModel,
        clipping: Clipping,
    ) -> Self {
        let ceiling = if is_saturated { f64::from(SATURATED) } else { f64::INFINITY };
        let clip = if clipping == Clipping::Skirt { CLIP * CLIP } else { f64::INFINITY };
        Self {
            read_variance: noise.read_noise.powi(2) as f32,
            photon_gain: noise.photon_gain as f32,
            effective: (noise.grain_area * noise.speckle_contrast.powi(2)) as f32,
            background: gaussian.background as f32,
            skirt: (SKIRT * gaussian.amplitude) as f32,
            clip: clip as f32,
            ceiling: ceiling as f32,
            model_ceiling: (ceiling - 3.0 * noise.read_noise) as f32,
        }
    }

    /// Weights of a row; zero where a pixel takes no part.
    pub(super) fn fill(&self, grey: &[f32], f: &[f32], e: &[f32], w: &mut [f32]) {
        for (((w, &grey), &f), &e) in w.iter_mut().zip(grey).zip(f).zip(e) {
            let variance = self.read_variance + f * (self.photon_gain + self.effective * f);
            let is_dirt = (f < self.skirt) & (e * e > self.clip * variance);
            let is_full = (grey >= self.ceiling) | (self.background + f > self.model_ceiling);
            *w = if is_dirt | is_full { 0.0 } else { 1.0 / variance };
        }
    }
}
