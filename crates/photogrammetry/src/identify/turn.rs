//! The quarter turn of the labels, chosen after the module was fitted in space.
//!
//! A square pattern fits equally well at four rolls: the one nearest to the prior is taken (rows
//! horizontal, Y up, where there is none) and the ambiguity is reported. Shifts by an order are
//! tried as well; they fit worse, because the fan is not an even grid. Where so few dots are left
//! that a shift fits equally well, that is the reason why there is no pose, unless the zero order was
//! told by its brightness (`zero`).

use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use super::quarter_turn;
use super::zero::{equal, has_bright_zero};
use crate::pattern::{Order, Pattern};
use crate::pose::{RayFit, Station, fit_rays, refine_rays};
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
        change(order, self.turns, self.shift)
    }
}

/// Chooses turn and shift for `dots` (world, mm) labelled `orders`.
///
/// # Errors
/// Why the module cannot be fitted, or that a shift of the labels fits as well: the position would
/// depend on it, so nothing is chosen. (A zero order that is brighter was looked at before: labels
/// then stay as they are.)
pub fn choose_turn(
    dots: &[Vector3<f64>],
    orders: &[Order],
    pattern: &Pattern,
    scale: f64,
    prior: Option<&ModulePrior>,
) -> Result<Labelled, String> {
    let field = Field { dots, orders, pattern, scale };
    let nothing = || format!("no module pose fits the {} dots found in space", dots.len());
    let first = (0..4).find_map(|turns| field.fit(turns, (0, 0), None)).ok_or_else(nothing)?;
    let mut turned = field.turned(&first);
    let shifts = (-1..=1).flat_map(|m| (-1..=1).map(move |n| (m, n))).filter(|s| *s != (0, 0));
    let best = turned.iter().min_by(|a, b| rms(a).total_cmp(&rms(b))).ok_or_else(nothing)?;
    let shifted: Vec<Labelled> =
        shifts.filter_map(|shift| field.fit(best.turns, shift, Some(best))).collect();
    if let Some(better) = shifted.iter().min_by(|a, b| rms(a).total_cmp(&rms(b))) {
        let alike = equal(rms(better), rms(best), dots.len());
        if alike && !has_bright_zero(pattern) {
            let (m, n) = better.shift;
            return Err(format!("ambiguous: labels shifted by ({m}, {n}) fit as well"));
        }
        if !alike && rms(better) < rms(best) {
            turned = field.turned(better);
        }
    }
    let least = turned.iter().map(rms).fold(f64::INFINITY, f64::min);
    turned.retain(|c| rms(c) <= AS_WELL * least);
    let ambiguous = turned.len() > 1;
    turned
        .into_iter()
        .min_by(|a, b| away(&a.fit, prior).total_cmp(&away(&b.fit, prior)))
        .map(|chosen| Labelled { ambiguous, ..chosen })
        .ok_or_else(nothing)
}

/// A quarter turn fits "as well" as the best when its rms is within this factor. The position does
/// not depend on the turn of a square pattern: an error here is seen, and costs no accuracy.
const AS_WELL: f64 = 1.05;

fn rms(labelled: &Labelled) -> f64 {
    labelled.fit.rms_mm
}

/// Dots in space with their labels, before turn and shift.
struct Field<'a> {
    dots: &'a [Vector3<f64>],
    orders: &'a [Order],
    pattern: &'a Pattern,
    scale: f64,
}

impl Field<'_> {
    /// The module under turned and shifted labels, from another labelling's module where one is
    /// known. `None` when a label would fall outside the pattern.
    fn fit(&self, turns: usize, shift: (i32, i32), near: Option<&Labelled>) -> Option<Labelled> {
        let beams: Vec<Vector3<f64>> = self
            .orders
            .iter()
            .map(|order| self.pattern.direction(change(*order, turns, shift), self.scale))
            .collect::<Option<_>>()?;
        let start = near.and_then(|near| self.start(turns, shift, near));
        let fit = start
            .and_then(|start| refine_rays(self.dots, &beams, &start))
            .or_else(|| fit_rays(self.dots, &beams))?;
        Some(Labelled { turns, shift, fit, ambiguous: false })
    }

    /// Another labelling's module, turned so that the new beams point where the old ones did.
    fn start(&self, turns: usize, shift: (i32, i32), near: &Labelled) -> Option<Station> {
        let beams = |turns, shift| {
            let of = |m, n| {
                let order = change(Order { m, n }, turns, shift);
                self.pattern.direction(order, self.scale)
            };
            Some((of(0, 0)?, of(0, 1).or_else(|| of(0, -1))?))
        };
        let (new, old) = (beams(turns, shift)?, beams(near.turns, near.shift)?);
        let frame = |(at, next): (Vector3<f64>, Vector3<f64>)| Rotation3::face_towards(&at, &next);
        let turn = frame(old) * frame(new).inverse();
        Some(Station { rotation: near.fit.station.rotation * turn, ..near.fit.station })
    }

    /// A labelling in its four quarter turns, those that the pattern allows.
    fn turned(&self, one: &Labelled) -> Vec<Labelled> {
        (0..4)
            .filter_map(|turns| {
                if turns == one.turns {
                    return Some(one.clone());
                }
                // A shift turns with the labels.
                let more = (turns + 4 - one.turns) % 4;
                let by = Order { m: one.shift.0, n: one.shift.1 };
                let by = (0..more).fold(by, |o, _| quarter_turn(o));
                self.fit(turns, (by.m, by.n), Some(one))
            })
            .collect()
    }
}

fn change(order: Order, turns: usize, shift: (i32, i32)) -> Order {
    let turned = (0..turns).fold(order, |o, _| quarter_turn(o));
    Order { m: turned.m + shift.0, n: turned.n + shift.1 }
}

/// How far a fitted module is turned from the prior, rad; without a prior, how far its rows'
/// normal is from straight down.
fn away(fit: &RayFit, prior: Option<&ModulePrior>) -> f64 {
    match prior {
        Some(prior) => {
            let angles = prior.rotation_omega_phi_kappa_deg.map(f64::to_radians);
            let found = UnitQuaternion::from_rotation_matrix(&fit.station.rotation);
            from_omega_phi_kappa(angles).angle_to(&found)
        }
        None => (fit.station.rotation * Vector3::y()).angle(&-Vector3::y()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pattern::{PatternModel, PatternUncertainty};

    fn pattern() -> Pattern {
        let model =
            PatternModel::RadialGrid { pitch_mm: 52.22, k1_per_mm2: 3.5e-8, distance_mm: 1000.0 };
        Pattern {
            columns: 11,
            rows: 11,
            reference_wavelength_nm: 658.0,
            model,
            u: PatternUncertainty { angle_deg: 0.0, common_relative: 0.0 },
            zero_order_relative_intensity: None,
        }
    }

    /// Dots within `half` orders of the centre on a plane 1 m away, tilted by 30 degrees, off by `noise_mm` here
    /// and there, labelled as if they were `shift` orders farther right.
    fn chosen(half: i32, shift: i32, noise_mm: f64) -> Result<Labelled, String> {
        let pattern = pattern();
        let inside = |o: &Order| o.m.abs().max(o.n.abs()) <= half;
        let orders: Vec<Order> = pattern.orders().filter(inside).collect();
        let dot = |(i, order): (usize, &Order)| {
            let d = pattern.direction(*order, 0.0).unwrap();
            let off = |k: usize| noise_mm * ((i * k) as f64).sin();
            let normal = Vector3::new(0.5, 0.0, 0.75_f64.sqrt());
            d * (1000.0 * normal.z / d.dot(&normal)) + Vector3::new(off(7), off(11), off(13))
        };
        let dots: Vec<Vector3<f64>> = orders.iter().enumerate().map(dot).collect();
        let labels: Vec<Order> = orders.iter().map(|o| Order { m: o.m + shift, ..*o }).collect();
        choose_turn(&dots, &labels, &pattern, 0.0, None)
    }

    #[test]
    fn a_square_pattern_leaves_the_turn_to_the_prior_and_says_so() {
        let labelled = chosen(5, 0, 0.1).unwrap();
        assert_eq!(labelled.shift, (0, 0));
        assert!(labelled.ambiguous);
        assert!(labelled.fit.station.centre.norm() < 1.0);
    }

    #[test]
    fn labels_off_by_an_order_are_put_right() {
        let labelled = chosen(4, 1, 0.1).unwrap();
        let back = labelled.apply(Order { m: 1, n: 0 });
        assert_eq!(back, Order { m: 0, n: 0 });
        assert!(labelled.fit.station.centre.norm() < 1.0);
    }

    /// Nine dots, off by 0.1 mm, bend by less than that when their labels are shifted.
    #[test]
    fn too_small_a_part_of_the_pattern_is_refused_as_ambiguous() {
        let reason = chosen(1, 0, 0.1).unwrap_err();
        assert!(reason.contains("ambiguous"), "{reason}");
    }
}
