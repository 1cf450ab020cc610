//! From signal to grey levels: photon noise, read noise, rounding, clipping.
//!
//! Nine million normal deviates a picture must cost a few milliseconds. Each pixel takes an
//! independent 16-bit number of a counter-based generator (splitmix64 on a counter that never
//! repeats within a picture, from a key of the picture's own ChaCha stream) and looks its deviate
//! up in a table of the 65536 quantiles of N(0, 1): the deviates are independent, only their
//! distribution is discretised (4.2 sigma at most).

use std::sync::LazyLock;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::FRACTION_BITS;
use crate::config::PictureConfig;

const QUANTILES: usize = 1 << 16;
/// Fractional bits of a deviate.
const DEVIATE_BITS: u32 = 11;
/// Fractional bits of a standard deviation in grey levels.
const SIGMA_BITS: u32 = 9;
const SUM_BITS: u32 = DEVIATE_BITS + SIGMA_BITS;
/// Odd, with well-mixed bits: the step of splitmix64 (Steele, Lea, Flood 2014).
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

static DEVIATES: LazyLock<[i16; QUANTILES]> = LazyLock::new(quantiles);

/// The quantiles of N(0, 1) at (i + 1/2) / 65536: integrates dx / dp = 1 / density(x) by
/// Runge-Kutta from the median upwards, eight steps for each entry, and mirrors them.
fn quantiles() -> [i16; QUANTILES] {
    let slope = |x: f64| std::f64::consts::TAU.sqrt() * (x * x / 2.0).exp();
    let advance = |x: f64, h: f64| {
        let a = slope(x);
        let b = slope(x + h / 2.0 * a);
        let c = slope(x + h / 2.0 * b);
        let d = slope(x + h * c);
        x + h / 6.0 * (a + 2.0 * (b + c) + d)
    };
    let entry = 1.0 / QUANTILES as f64;
    let scale = f64::from(1u32 << DEVIATE_BITS);
    let mut table = [0; QUANTILES];
    let mut x = advance(0.0, entry / 2.0);
    for i in QUANTILES / 2..QUANTILES {
        let deviate = (x * scale).round() as i16;
        table[i] = deviate;
        table[QUANTILES - 1 - i] = -deviate;
        for _ in 0..8 {
            x = advance(x, entry / 8.0);
        }
    }
    table
}

fn mixed(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The noise of one picture.
pub(super) struct Noise {
    key: u64,
    /// Standard deviation by grey level of the signal; empty without any noise.
    sigma: Vec<u16>,
}

impl Noise {
    pub(super) fn new(picture: &PictureConfig, mut rng: ChaCha8Rng) -> Self {
        let (photon, read) = (picture.photon_noise_grey, picture.read_noise_grey);
        let sigma = |level: u32| {
            let sigma = (photon * (f64::from(level) + 0.5) + read * read).sqrt();
            (sigma * f64::from(1u32 << SIGMA_BITS)).round().min(f64::from(i16::MAX)) as u16
        };
        let levels = 0..=(u16::MAX >> FRACTION_BITS);
        let quiet = photon == 0.0 && read == 0.0;
        let sigma = if quiet { Vec::new() } else { levels.map(|l| sigma(l.into())).collect() };
        Self { key: rng.random(), sigma }
    }

    /// Turns row `y` of signals into grey levels.
    pub(super) fn expose(&self, y: usize, signal: &[u16], out: &mut [u8]) {
        if self.sigma.is_empty() {
            for (grey, &s) in out.iter_mut().zip(signal) {
                *grey =
                    ((u32::from(s) + (1 << (FRACTION_BITS - 1))) >> FRACTION_BITS).min(255) as u8;
            }
            return;
        }
        let deviates = &*DEVIATES;
        let mut counter = self.key.wrapping_add(((y as u64) << 32).wrapping_mul(GOLDEN));
        for (greys, signals) in out.chunks_mut(4).zip(signal.chunks(4)) {
            let mut bits = mixed(counter);
            counter = counter.wrapping_add(GOLDEN);
            for (grey, &s) in greys.iter_mut().zip(signals) {
                let deviate = deviates[usize::from(bits as u16)];
                bits >>= 16;
                *grey = self.grey(s, deviate);
            }
        }
    }

    /// At most 2^16 * 2^14 of signal and 4.3 * 2^11 * 2^15 of noise: 32 bits hold the sum.
    fn grey(&self, signal: u16, deviate: i16) -> u8 {
        let sigma = self.sigma[usize::from(signal >> FRACTION_BITS)];
        let noise = i32::from(deviate) * i32::from(sigma);
        let sum = (i32::from(signal) << (SUM_BITS - FRACTION_BITS)) + noise;
        ((sum + (1 << (SUM_BITS - 1))) >> SUM_BITS).clamp(0, 255) as u8
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;
    use crate::render::to_signal;

    const SIDE: usize = 512;

    /// `SIDE` rows of constant signal, as deviations from it.
    fn field(level: f64, picture: &PictureConfig, seed: u64) -> Vec<f64> {
        let noise = Noise::new(picture, ChaCha8Rng::seed_from_u64(seed));
        let (signal, mut out) = (vec![to_signal(level); SIDE], vec![0; SIDE]);
        let mut all = Vec::new();
        for y in 0..SIDE {
            noise.expose(y, &signal, &mut out);
            all.extend(out.iter().map(|&g| f64::from(g) - level));
        }
        all
    }

    fn picture() -> PictureConfig {
        PictureConfig { photon_noise_grey: 0.05, read_noise_grey: 2.0, ..PictureConfig::default() }
    }

    fn mean_product(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>() / a.len().min(b.len()) as f64
    }

    #[test]
    fn the_table_is_a_unit_normal_distribution() {
        let unit = f64::from(1u32 << DEVIATE_BITS);
        let moment = |k: i32| {
            DEVIATES.iter().map(|&d| (f64::from(d) / unit).powi(k)).sum::<f64>() / QUANTILES as f64
        };
        assert_eq!(moment(1), 0.0);
        // Quantiles at interval centres lose the spread within the outermost intervals.
        assert!((moment(2) - 1.0).abs() < 3e-4, "{}", moment(2));
        assert!((moment(4) - 3.0).abs() < 1e-2, "{}", moment(4));
    }

    #[test]
    fn mean_and_variance_are_those_of_photons_read_noise_and_rounding() {
        for level in [40.0, 100.3, 180.0] {
            let field = field(level, &picture(), 1);
            let n = field.len() as f64;
            let variance = 0.05 * (f64::floor(level) + 0.5) + 4.0 + 1.0 / 12.0;
            let mean = field.iter().sum::<f64>() / n;
            // Standard errors of mean and variance: five of them; 1/128 is the signal's rounding.
            assert!(
                mean.abs() < 5.0 * (variance / n).sqrt() + 1.0 / 128.0,
                "mean {mean} at {level}"
            );
            let found = mean_product(&field, &field);
            let error = 5.0 * variance * (2.0 / n).sqrt() + 5e-4 * variance;
            assert!((found - variance).abs() < error, "variance {found}, not {variance}");
        }
    }

    #[test]
    fn neighbours_rows_and_captures_are_not_correlated() {
        let (one, other) = (field(100.0, &picture(), 1), field(100.0, &picture(), 2));
        let n = one.len() as f64;
        let variance = mean_product(&one, &one);
        let check = |name: &str, a: &[f64], b: &[f64]| {
            let correlation = mean_product(a, b) / variance;
            assert!(correlation.abs() < 5.0 / n.sqrt(), "{name}: {correlation}");
        };
        for lag in [1, 2, 3, 4, 8, 16, 64, SIDE, 2 * SIDE, 5 * SIDE, SIDE + 1, SIDE - 1, SIDE - 4] {
            check(&format!("lag {lag}"), &one[lag..], &one);
        }
        check("captures", &one, &other);
    }

    #[test]
    fn brighter_than_white_is_white_and_darker_than_black_is_black() {
        let noise = Noise::new(&picture(), ChaCha8Rng::seed_from_u64(1));
        let mut out = [7; 8];
        noise.expose(0, &[to_signal(450.0); 8], &mut out);
        assert_eq!(out, [255; 8]);
        noise.expose(0, &[0; 8], &mut out);
        assert!(out.iter().all(|&g| g < 20) && out.contains(&0));
    }
}
