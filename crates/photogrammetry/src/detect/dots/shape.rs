//! Is it a Gaussian spot? Chi-square of the fit, and the exponent that would fit better.

use nalgebra::SVector;

use super::fit::Fit;
use super::moments::{PARAMETERS, POWERS};
use super::window::Row;
use super::{DotQuality, NoiseModel};
use crate::detect::lanes::{self, LANES, Lanes};
use crate::image::GrayImage;

/// Part of the amplitude below which the shape is left to the skirt.
const CORE: f32 = 0.02;
/// Part of the amplitude above which is the top.
const TOP: f32 = 0.7;

/// Sums over a window, in this order: w d f u^k for k = 0..2, w d, w d d, w d e, chi-square, count,
/// and seen and fitted light of the top.
type Sums = [f32; SUMS];
const SUMS: usize = 10;

/// Judges a fit: one Gauss-Newton step for the exponent b of `exp(-q^b / 2)` at b = 1, whose
/// derivative d is `-f q ln(q) / 2`, beside the seven parameters already fitted.
pub(super) fn judge(image: &GrayImage, fit: &Fit, noise: &NoiseModel) -> Option<DotQuality> {
    let amplitude = fit.gaussian.amplitude as f32;
    let weighting = fit.weighting(noise);
    let mut mixed = SVector::<f64, PARAMETERS>::zeros();
    let mut all = [0.0; SUMS];
    fit.window.walk(image, &fit.gaussian, &weighting, |row| {
        let sums = row_sums(row, amplitude, noise).map(f64::from);
        let v = f64::from(row.v);
        for (a, &(i, j)) in POWERS.iter().enumerate() {
            mixed[a] += sums[i] * [1.0, v, v * v][j];
        }
        mixed[6] += sums[3];
        all.iter_mut().zip(sums).for_each(|(all, sum)| *all += sum);
    });
    let [_, _, _, _, own, right, chi_square, count, seen, fitted] = all;
    let reduced = own - mixed.dot(&fit.normal.cholesky()?.solve(&mixed));
    let freedom = count - PARAMETERS as f64;
    (reduced > 0.0 && freedom > 0.0).then(|| DotQuality {
        reduced_chi_square: chi_square / freedom,
        shape_exponent: 1.0 + right / reduced,
        shape_sigma: reduced.sqrt().recip(),
        core_ratio: if fitted > 0.0 { seen / fitted } else { 1.0 },
        is_saturated: fit.is_saturated,
    })
}

fn row_sums(row: &Row, amplitude: f32, noise: &NoiseModel) -> Sums {
    let mut sums = [[0.0f32; LANES]; SUMS];
    let (n2, c2) = (noise.read_noise.powi(2) as f32, noise.speckle_contrast.powi(2) as f32);
    let p = noise.photon_gain as f32;
    let (u, f) = (row.u.chunks_exact(LANES), row.f.chunks_exact(LANES));
    let (e, w) = (row.e.chunks_exact(LANES), row.w.chunks_exact(LANES));
    for (((u, f), e), w) in u.zip(f).zip(e).zip(w) {
        for l in 0..LANES {
            let used = if w[l] > 0.0 { 1.0 } else { 0.0 };
            let part = f[l] / amplitude;
            let is_core = (part > CORE) & (part < 1.0 - 1e-6);
            let q = -2.0 * lanes::ln(part.clamp(1e-6, 1.0 - 1e-6));
            let d = if is_core { -0.5 * f[l] * q * lanes::ln(q) } else { 0.0 };
            let (wd, top) = (w[l] * d, if part > TOP { used } else { 0.0 });
            sums[0][l] += wd * f[l];
            sums[1][l] += wd * f[l] * u[l];
            sums[2][l] += wd * f[l] * u[l] * u[l];
            sums[3][l] += wd;
            sums[4][l] += wd * d;
            sums[5][l] += wd * e[l];
            sums[6][l] += used * e[l] * e[l] / (n2 + f[l] * (p + c2 * f[l]));
            sums[7][l] += used;
            sums[8][l] += top * (f[l] + e[l]);
            sums[9][l] += top * f[l];
        }
    }
    std::array::from_fn(|i| Lanes::new(sums[i]).total())
}
