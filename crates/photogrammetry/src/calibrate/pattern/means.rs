//! Repeated angles: each corrected to the reference wavelength, then their mean and scatter.
//!
//! The correction is what the fan itself says: direction cosines scale with the wavelength
//! (eq. 4.11), so a measured turn is changed by the turn that the fan would need at the reference
//! wavelength less the one at the wavelength read. It hardly depends on the fan: one that is wrong by
//! a hundredth corrects 0.4 nm wrong by less than 0.00002 degrees.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::{MeasuredAngle, StageAxis, StageGeometry};
use crate::pattern::Order;

/// The mean of a pair's repetitions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanAngle {
    /// The first beam.
    pub from: Order,
    /// The second.
    pub to: Order,
    /// How the module stood.
    pub axis: StageAxis,
    /// Repetitions.
    pub count: usize,
    /// Mean turn at the reference wavelength, radians.
    pub turn: f64,
    /// Standard deviation of one repetition, radians; none of a single one.
    pub scatter: Option<f64>,
    /// Standard uncertainty of the mean, what all angles share apart, radians.
    pub u: f64,
    /// Mean of the corrections to the reference wavelength, radians.
    pub wavelength_correction: f64,
}

/// How far repetitions scatter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AngleSpread {
    /// Standard deviation of one measurement over all pairs, radians.
    pub sigma: f64,
    /// Degrees of freedom of it.
    pub degrees: usize,
}

/// Pairs in the order in which they first come, with what was measured of each.
pub(super) fn pairs(all: &[MeasuredAngle]) -> Vec<Vec<&MeasuredAngle>> {
    let mut known = BTreeMap::new();
    let mut pairs: Vec<Vec<&MeasuredAngle>> = Vec::new();
    for one in all {
        let at = *known.entry((one.axis, one.from, one.to)).or_insert(pairs.len());
        if at == pairs.len() {
            pairs.push(Vec::new());
        }
        pairs[at].push(one);
    }
    pairs
}

/// The scatter of repetitions about the means of their pairs; `None` where nothing was repeated.
#[must_use]
pub fn spread(means: &[MeanAngle]) -> Option<AngleSpread> {
    let (mut sum, mut degrees) = (0.0, 0);
    for mean in means {
        if let Some(scatter) = mean.scatter {
            sum += scatter * scatter * (mean.count - 1) as f64;
            degrees += mean.count - 1;
        }
    }
    (degrees > 0).then(|| AngleSpread { sigma: (sum / degrees as f64).sqrt(), degrees })
}

/// The means of all pairs, in the order in which they first come. `direction` is the fan by which
/// wavelengths are corrected: a beam at `1 + scale` times the reference wavelength. `u` is what an
/// angle is worth that does not say so itself; without it, their scatter says.
///
/// `None` where a beam does not exist, or nothing tells what an angle is worth.
#[must_use]
pub fn mean_angles(
    all: &[MeasuredAngle],
    direction: &dyn Fn(Order, f64) -> Option<Vector3<f64>>,
    geometry: &StageGeometry,
    reference_nm: f64,
    u: Option<f64>,
) -> Option<Vec<MeanAngle>> {
    let turn = |a: &MeasuredAngle, scale: f64| {
        let (from, to) = (direction(a.from, scale)?, direction(a.to, scale)?);
        geometry.turn(&from, &to, a.axis).map(f64::abs)
    };
    let mut means = Vec::new();
    for pair in pairs(all) {
        let first = *pair.first()?;
        let at_reference = turn(first, 0.0)?;
        let (mut corrected, mut of_readings) = (Vec::new(), 0.0);
        for a in &pair {
            let scale = a.wavelength_nm.map_or(0.0, |nm| nm / reference_nm - 1.0);
            corrected.push(a.angle + at_reference - turn(a, scale)?);
            // A turn goes nearly as the wavelength.
            of_readings += (at_reference * a.u_wavelength_nm / reference_nm).powi(2);
        }
        let count = pair.len();
        let mean = corrected.iter().sum::<f64>() / count as f64;
        let squares: f64 = corrected.iter().map(|c| (c - mean).powi(2)).sum();
        let stated: Option<f64> = pair.iter().map(|a| a.u.or(u).map(|u| u * u)).sum();
        means.push(MeanAngle {
            from: first.from,
            to: first.to,
            axis: first.axis,
            count,
            turn: mean,
            scatter: (count > 1).then(|| (squares / (count - 1) as f64).sqrt()),
            u: stated.map_or(f64::NAN, |sum| (sum + of_readings).sqrt() / count as f64),
            wavelength_correction: mean - pair.iter().map(|a| a.angle).sum::<f64>() / count as f64,
        });
    }
    let of_scatter = spread(&means).map(|s| s.sigma).filter(|sigma| *sigma > 0.0);
    for mean in means.iter_mut().filter(|m| m.u.is_nan()) {
        mean.u = of_scatter? / (mean.count as f64).sqrt();
    }
    Some(means)
}
