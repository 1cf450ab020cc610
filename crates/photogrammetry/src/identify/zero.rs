//! Which of several labellings that differ by a shift: on a wall straight ahead an even fan shifted
//! by an order fits as well from a step aside, unless its rim is seen. The brighter zero order then
//! tells, where the pattern has one; where nothing tells, nothing is chosen.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::View;
use super::guide::{Guided, refitted};
use crate::pattern::{Order, Pattern};

/// Labellings whose sums of squares differ by less than this many variances of a dot fit equally
/// well: five standard deviations.
const EQUAL: f64 = 25.0;
/// How much brighter than its neighbours a dot must be to be taken for the zero order, as a part of
/// the declared excess: a clipped one looks fainter than it is.
const BRIGHT: f64 = 0.45;

/// True where sums of squares over `dots` dots with these root mean squares cannot be told apart.
pub(super) fn equal(a: f64, b: f64, dots: usize) -> bool {
    let redundancy = (2 * dots).saturating_sub(6).max(1) as f64;
    a.max(b).powi(2) < a.min(b).powi(2) * (1.0 + EQUAL / redundancy)
}

/// True where the pattern has a zero order that can be told by its brightness.
pub(super) fn has_bright_zero(pattern: &Pattern) -> bool {
    pattern.zero_order_relative_intensity.is_some_and(|r| r > 1.3)
}

/// The labelling among those that fit equally well which has the zero order where it is bright.
///
/// # Errors
/// That several fit equally well and nothing decides among them.
pub(super) fn decided(
    views: &[View],
    beams: &[(Order, Vector3<f64>)],
    pattern: &Pattern,
    guided: Guided,
) -> Result<Guided, String> {
    let shifts = (-1..=1).flat_map(|m| (-1..=1).map(move |n| Order { m, n }));
    let fits: Vec<(f64, Guided)> = shifts.filter_map(|by| refitted(beams, &guided, by)).collect();
    let least = fits.iter().map(|f| f.0).fold(f64::INFINITY, f64::min);
    let mut alike: Vec<Guided> =
        fits.into_iter().filter(|f| equal(f.0, least, guided.found.len())).map(|f| f.1).collect();
    if alike.len() > 1 {
        alike.retain(|g| zero_is_bright(views, pattern, g));
        if alike.len() != 1 {
            return Err(
                "ambiguous: labels shifted by an order fit as well, and no zero order tells"
                    .to_owned(),
            );
        }
    }
    Ok(alike.pop().unwrap_or(guided))
}

/// Whether in most pictures the dot that is labelled zero outshines its neighbours.
fn zero_is_bright(views: &[View], pattern: &Pattern, guided: &Guided) -> bool {
    let Some(expected) = pattern.zero_order_relative_intensity.filter(|r| *r > 1.3) else {
        return false;
    };
    let mut votes = 0;
    for (view, seen) in views.iter().enumerate() {
        let amplitudes: BTreeMap<Order, f64> = guided
            .found
            .iter()
            .filter_map(|f| {
                let dot = f.seen.iter().find(|s| s.0 == view)?.1;
                Some((f.order, seen.amplitudes[dot]))
            })
            .collect();
        let near = |o: &Order| o.m.abs().max(o.n.abs()) <= 2 && (o.m, o.n) != (0, 0);
        let around: Vec<f64> =
            amplitudes.iter().filter(|(o, _)| near(o)).map(|(_, a)| *a).collect();
        if let (Some(zero), true) = (amplitudes.get(&Order { m: 0, n: 0 }), around.len() > 2) {
            let usual = super::guide::median(around.into_iter());
            let bright = *zero > usual * (1.0 + BRIGHT * (expected - 1.0));
            votes += if bright { 1 } else { -1 };
        }
    }
    votes > 0
}
