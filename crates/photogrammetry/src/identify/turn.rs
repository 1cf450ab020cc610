//! The quarter turn of the labels, chosen after the module was fitted in space.
//!
//! A square pattern fits equally well at four rolls: the one nearest to the prior is taken (rows
//! horizontal, Y up, where there is none) and the ambiguity is reported. Shifts by an order are
//! tried as well; they fit worse, because the fan is not an even grid.

use nalgebra::Vector3;

use super::quarter_turn;
use crate::pattern::{Order, Pattern};
use crate::pose::{RayFit, fit_rays};
use crate::rotation::from_omega_phi_kappa;
use crate::scene::ModulePrior;

/// Labels with the module's pose that goes with them.
#[derive(Debug, Clone, PartialEq)]
pub struct Labelled {
    /// How to change every label: this many quarter turns, then this shift.
    pub turns: usize,
    /// The shift after the turns.
    pub shift: (i32, i32),
    /// The module fitted with the labels so changed.
    pub fit: RayFit,
    /// True where another labelling fits as well and the prior decided.
    pub ambiguous: bool,
}

impl Labelled {
    /// A label changed.
    #[must_use]
    pub fn apply(&self, order: Order) -> Order {
        let turned = (0..self.turns).fold(order, |o, _| quarter_turn(o));
        Order { m: turned.m + self.shift.0, n: turned.n + self.shift.1 }
    }
}

/// A labelling fits "as well" as the best when its rms is within this factor.
const AS_WELL: f64 = 1.05;
/// A shift is believed only if it fits better than the anchored labelling by this factor.
const BETTER: f64 = 0.6;

/// Chooses turn and shift for `dots` (world, mm) labelled `orders`.
///
/// # Errors
/// Why the module cannot be fitted.
pub fn choose_turn(
    dots: &[Vector3<f64>],
    orders: &[Order],
    pattern: &Pattern,
    scale: f64,
    prior: Option<&ModulePrior>,
) -> Result<Labelled, String> {
    let fit = |turns: usize, shift: (i32, i32)| {
        let candidate = |fit| Labelled { turns, shift, fit, ambiguous: false };
        let change = |order: &Order| {
            let turned = (0..turns).fold(*order, |o, _| quarter_turn(o));
            Order { m: turned.m + shift.0, n: turned.n + shift.1 }
        };
        let beams: Option<Vec<_>> =
            orders.iter().map(|o| pattern.direction(change(o), scale)).collect();
        fit_rays(dots, &beams?).map(candidate)
    };
    let unshifted: Vec<Labelled> = (0..4).filter_map(|turns| fit(turns, (0, 0))).collect();
    let anchored = best_rms(&unshifted);
    let shifts = (-1..=1).flat_map(|m| (-1..=1).map(move |n| (m, n))).filter(|s| *s != (0, 0));
    let shifted: Vec<Labelled> =
        shifts.flat_map(|s| (0..4).filter_map(move |turns| fit(turns, s))).collect();
    let mut candidates = if best_rms(&shifted) < BETTER * anchored { shifted } else { unshifted };
    let best = best_rms(&candidates);
    candidates.retain(|c| c.fit.rms_mm <= AS_WELL * best);
    let ambiguous = candidates.len() > 1;
    candidates
        .into_iter()
        .min_by(|a, b| away(&a.fit, prior).total_cmp(&away(&b.fit, prior)))
        .map(|chosen| Labelled { ambiguous, ..chosen })
        .ok_or_else(|| format!("no module pose fits the {} dots found in space", dots.len()))
}

fn best_rms(candidates: &[Labelled]) -> f64 {
    candidates.iter().map(|c| c.fit.rms_mm).fold(f64::INFINITY, f64::min)
}

/// How far a fitted module is turned from the prior, rad; without a prior, how far its rows'
/// normal is from straight down.
fn away(fit: &RayFit, prior: Option<&ModulePrior>) -> f64 {
    match prior {
        Some(prior) => {
            let angles = prior.rotation_omega_phi_kappa_deg.map(f64::to_radians);
            let expected = from_omega_phi_kappa(angles).to_rotation_matrix();
            expected.angle_to(&fit.station.rotation)
        }
        None => (fit.station.rotation * Vector3::y()).angle(&-Vector3::y()),
    }
}
