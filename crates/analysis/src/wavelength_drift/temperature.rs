//! The wavelength over the diode's temperature: a line when both have noise.
//!
//! An ordinary line over a noisy temperature is too flat by the noise's part of the variance of what
//! it read. The line here is that of maximum likelihood where the ratio of the noises is known
//! (Deming; Fuller, Measurement Error Models, 1987, section 1.3), with one offset for each mode.

use super::hops::Step;
use super::hops::modes;
use super::model::Course;
use super::result::TemperatureCoefficient;
use super::series::{Series, correlation};

/// Fewer pairs than this make no line.
const LEAST: usize = 10;
/// The variance that a temperature must have beyond its noise, in units of it.
const BEYOND_NOISE: f64 = 3.0;

/// Sums about the mean of each mode.
struct Sums {
    xx: f64,
    xy: f64,
    yy: f64,
    /// Pairs less modes.
    freedom: f64,
}

/// A pair of a temperature and the wavelength at the same time, in a mode.
struct Pair {
    degc: f64,
    nm: f64,
    mode: usize,
}

/// The coefficient, or why there is none.
pub(super) fn coefficient(
    wavelength: &Series,
    hops: &[Step],
    course: &Course,
    temperature: &Series,
) -> Result<TemperatureCoefficient, String> {
    let noise_degc = temperature.noise();
    let temperature = temperature.without(&temperature.strays(noise_degc));
    let noise_nm = wavelength.noise();
    let pairs = pairs(wavelength, hops, course, &temperature);
    if pairs.len() < LEAST {
        return Err(format!("only {} wavelengths have a temperature", pairs.len()));
    }
    let means = means(&pairs);
    let sums = sums(&pairs, &means);
    let noise = [noise_degc, noise_nm];
    // What the temperature itself varied by.
    let varied = sums.xx / sums.freedom - noise_degc * noise_degc;
    if varied <= BEYOND_NOISE * noise_degc * noise_degc || varied <= 0.0 {
        return Err("the diode's temperature varies hardly more than its sensor's noise".to_owned());
    }
    let slope = deming(&sums, noise);
    let residual = |p: &Pair| {
        let [x, y] = means[p.mode];
        p.nm - y - slope * (p.degc - x)
    };
    let residuals: Vec<f64> = pairs.iter().map(residual).collect();
    let squares: f64 = residuals.iter().map(|r| r * r).sum();
    let scatter = (squares / (sums.freedom - 1.0)).sqrt();
    let (inflation, _) = correlation(&residuals, scatter);
    // Fuller, eq. 1.3.12: what the residuals scatter over what the temperature varied, and what its
    // noise adds.
    let (of_x, of_v) = (noise_degc * noise_degc, (scatter * inflation).powi(2));
    let more = (of_x * of_v - (slope * of_x).powi(2)).max(0.0);
    let variance = (of_v / varied + more / (varied * varied)) / sums.freedom;
    let last = means.len() - 1;
    Ok(TemperatureCoefficient {
        coefficient_nm_per_degc: slope,
        standard_uncertainty_nm_per_degc: variance.sqrt(),
        pairs: pairs.len(),
        ordinary_nm_per_degc: sums.xy / sums.xx,
        attenuation_relative: of_x / (sums.xx / sums.freedom),
        wavelength_noise_nm: noise_nm,
        temperature_noise_degc: noise_degc,
        scatter_nm: scatter,
        temperature_range_degc: range(&pairs),
        at_temperature_degc: means[last][0],
        at_wavelength_nm: means[last][1],
    })
}

/// The line's slope; without noise of the temperature it is the ordinary one.
fn deming(sums: &Sums, [noise_x, noise_y]: [f64; 2]) -> f64 {
    if noise_x <= 0.0 {
        return sums.xy / sums.xx;
    }
    let ratio = (noise_y / noise_x).powi(2);
    let half = sums.yy - ratio * sums.xx;
    let root = (half * half + 4.0 * ratio * sums.xy * sums.xy).sqrt();
    // Two forms of the same root: the one that does not subtract near equals.
    if half < 0.0 { 2.0 * ratio * sums.xy / (root - half) } else { (half + root) / (2.0 * sums.xy) }
}

fn range(pairs: &[Pair]) -> [f64; 2] {
    pairs.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], p| {
        [low.min(p.degc), high.max(p.degc)]
    })
}

/// Each temperature with the wavelength that was read nearest to it, moved to the same time along
/// the course: sensors answer one after another. No reading counts twice, so noise stays independent.
fn pairs(wavelength: &Series, hops: &[Step], course: &Course, degc: &Series) -> Vec<Pair> {
    let modes = modes(wavelength.len(), hops);
    let mut pairs = Vec::new();
    let mut next = 0;
    for (i, at) in wavelength.at_s.iter().enumerate() {
        let away = |k: usize| (degc.at_s[k] - at).abs();
        while next + 1 < degc.len() && away(next + 1) <= away(next) {
            next += 1;
        }
        if next >= degc.len() {
            break;
        }
        // Another wavelength is nearer.
        let nearest = i + 1 >= wavelength.len()
            || (degc.at_s[next] - wavelength.at_s[i + 1]).abs() > away(next);
        if nearest && away(next) <= wavelength.interval(i) {
            let moved = course.slope(*at) * (degc.at_s[next] - at);
            let nm = wavelength.value[i] + moved;
            pairs.push(Pair { degc: degc.value[next], nm, mode: modes[i] });
            next += 1;
        }
    }
    // Modes without a pair have no offset.
    let mut used: Vec<usize> = pairs.iter().map(|p| p.mode).collect();
    used.dedup();
    for pair in &mut pairs {
        pair.mode = used.iter().position(|mode| *mode == pair.mode).unwrap_or(0);
    }
    pairs
}

fn means(pairs: &[Pair]) -> Vec<[f64; 2]> {
    let modes = pairs.iter().map(|p| p.mode).max().map_or(0, |m| m + 1);
    let mean = |mode: usize| {
        let of: Vec<&Pair> = pairs.iter().filter(|p| p.mode == mode).collect();
        let n = of.len().max(1) as f64;
        // About the first, so that hundreds of nm do not cost digits.
        let first = of.first().map_or([0.0; 2], |p| [p.degc, p.nm]);
        [
            first[0] + of.iter().map(|p| p.degc - first[0]).sum::<f64>() / n,
            first[1] + of.iter().map(|p| p.nm - first[1]).sum::<f64>() / n,
        ]
    };
    (0..modes).map(mean).collect()
}

fn sums(pairs: &[Pair], means: &[[f64; 2]]) -> Sums {
    let freedom = (pairs.len() as f64 - means.len() as f64).max(1.0);
    let mut sums = Sums { xx: 0.0, xy: 0.0, yy: 0.0, freedom };
    for pair in pairs {
        let [x, y] = [pair.degc - means[pair.mode][0], pair.nm - means[pair.mode][1]];
        sums.xx += x * x;
        sums.xy += x * y;
        sums.yy += y * y;
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slope_is_that_of_either_ordinary_line_where_only_one_side_has_noise() {
        let sums = Sums { xx: 10.0, xy: 3.1, yy: 1.2, freedom: 9.0 };
        assert!((deming(&sums, [0.0, 0.1]) - 0.31).abs() < 1e-12);
        assert!((deming(&sums, [1e-6, 10.0]) - 0.31).abs() < 1e-6);
        assert!((deming(&sums, [10.0, 1e-6]) - 1.2 / 3.1).abs() < 1e-6);
    }

    #[test]
    fn a_falling_line_falls() {
        let sums = Sums { xx: 10.0, xy: -3.0, yy: 1.0, freedom: 9.0 };
        assert!((deming(&sums, [0.01, 0.1]) + 0.3).abs() < 0.01);
    }
}
