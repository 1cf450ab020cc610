//! Is it a Gaussian spot? Chi-square of the fit, and the exponent that would fit better.

use nalgebra::SVector;

use super::fit::{Fit, PARAMETERS, Weighting};
use super::{DotQuality, NoiseModel};
use crate::image::GrayImage;

/// Part of the amplitude below which the shape is left to the skirt.
const CORE: f64 = 0.02;
/// Part of the amplitude above which is the top.
const TOP: f64 = 0.7;

/// Judges a fit: one Gauss-Newton step for the exponent b of `exp(-q^b / 2)` at b = 1, whose
/// derivative is `-f q ln(q) / 2`, beside the seven parameters already fitted.
pub(super) fn judge(image: &GrayImage, fit: &Fit, noise: &NoiseModel) -> Option<DotQuality> {
    let gaussian = &fit.gaussian;
    let weighting = Weighting::new(fit, noise, true);
    let mut mixed = SVector::<f64, PARAMETERS>::zeros();
    let (mut own, mut right, mut chi_square, mut count) = (0.0, 0.0, 0.0, 0.0);
    let mut core = [0.0, 0.0];
    fit.window.walk(image, gaussian, |u, v, pixels, model| {
        for (i, (&pixel, &f)) in pixels.iter().zip(model).enumerate() {
            let pixel = f64::from(pixel);
            let e = pixel - gaussian.background - f;
            let w = weighting.of(pixel, f, e);
            if w == 0.0 {
                continue;
            }
            count += 1.0;
            chi_square += e * e / noise.pixel_variance(f);
            let part = f / gaussian.amplitude;
            if part > TOP {
                core = [core[0] + f + e, core[1] + f];
            }
            if part > CORE && part < 1.0 - 1e-9 {
                let u = u + i as f64;
                let q = -2.0 * part.ln();
                let d = -0.5 * f * q * q.ln();
                let row = [f, f * u, f * v, f * u * u, f * u * v, f * v * v, 1.0];
                mixed += SVector::from(row) * (w * d);
                own += w * d * d;
                right += w * d * e;
            }
        }
    });
    let reduced = own - mixed.dot(&fit.normal.cholesky()?.solve(&mixed));
    let freedom = count - PARAMETERS as f64;
    (reduced > 0.0 && freedom > 0.0).then(|| DotQuality {
        reduced_chi_square: chi_square / freedom,
        shape_exponent: 1.0 + right / reduced,
        shape_sigma: reduced.sqrt().recip(),
        core_ratio: if core[1] > 0.0 { core[0] / core[1] } else { 1.0 },
        is_saturated: fit.is_saturated,
    })
}
