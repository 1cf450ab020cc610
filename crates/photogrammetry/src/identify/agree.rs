//! Brings the labels of several cameras to agree: the turn (and, where the anchor is in doubt, the
//! shift) of each camera's labels for which equal labels are equal points in space.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::guide::meet;
use super::{View, quarter_turn};
use crate::pattern::{Order, Pattern, angle_between};

type Labels = Vec<Option<Order>>;

/// Angular misclosure, rad, up to which rays count as meeting: ten pixels of a usual camera; wrong
/// labels miss by a whole cell, a hundred pixels or so.
const MEET: f64 = 3e-3;

/// Turns and shifts the labels of all views but the fullest one.
///
/// # Errors
/// Which views do not agree.
pub(super) fn agree(
    views: &[View],
    labels: &mut [Labels],
    pattern: &Pattern,
) -> Result<(), String> {
    let count = |l: &Labels| l.iter().flatten().count();
    let mut order: Vec<usize> = (0..views.len()).collect();
    order.sort_by_key(|&i| std::cmp::Reverse(count(&labels[i])));
    let (reference, others) = order.split_first().ok_or("no views")?;
    let mut done = vec![*reference];
    for &view in others {
        if count(&labels[view]) < 4 {
            labels[view].fill(None);
            continue;
        }
        match best_alike(views, labels, &done, view, pattern) {
            Some(best) => {
                labels[view] = best;
                done.push(view);
            }
            None => labels[view].fill(None),
        }
    }
    if done.len() < 2 {
        return Err("the cameras' dots do not meet in space under any labelling".to_owned());
    }
    Ok(())
}

/// The variant of a view's labels under which its rays meet those of the views done so far. No
/// shift is tried before a shift is needed: along an epipolar line a shifted row meets as well.
fn best_alike(
    views: &[View],
    labels: &[Labels],
    done: &[usize],
    view: usize,
    pattern: &Pattern,
) -> Option<Labels> {
    let known = rays_by_order(views, labels, done);
    let reach =
        |limit: i32| (-limit..=limit).flat_map(move |m| (-limit..=limit).map(move |n| (m, n)));
    for limit in [0, 2] {
        let best = (0..4)
            .flat_map(|turn| reach(limit).map(move |shift| (turn, shift)))
            .filter_map(|(turn, shift)| {
                let variant = changed(&labels[view], turn, shift, pattern);
                Some((misclosure(views, &known, view, &variant)?, variant))
            })
            .min_by(|a, b| a.0.total_cmp(&b.0))?;
        if best.0 < MEET {
            return Some(best.1);
        }
    }
    None
}

fn changed(labels: &Labels, turn: usize, (dm, dn): (i32, i32), pattern: &Pattern) -> Labels {
    labels
        .iter()
        .map(|label| {
            let turned = (0..turn).fold((*label)?, |order, _| quarter_turn(order));
            let order = Order { m: turned.m + dm, n: turned.n + dn };
            pattern.contains(order).then_some(order)
        })
        .collect()
}

/// Centres and unit vectors in the world.
type Rays<'a> = BTreeMap<Order, Vec<(&'a Vector3<f64>, Vector3<f64>)>>;

fn rays_by_order<'a>(views: &'a [View], labels: &[Labels], done: &[usize]) -> Rays<'a> {
    let mut rays = Rays::new();
    for &view in done {
        for (label, direction) in labels[view].iter().zip(&views[view].directions) {
            if let Some(order) = label {
                let station = &views[view].station;
                let along = station.rotation * direction.push(1.0).normalize();
                rays.entry(*order).or_default().push((&station.centre, along));
            }
        }
    }
    rays
}

/// Median angle, rad, by which the rays of equal labels miss their common point. `None` when fewer
/// than four labels are common.
fn misclosure(views: &[View], known: &Rays<'_>, view: usize, labels: &Labels) -> Option<f64> {
    let station = &views[view].station;
    let mut misses: Vec<f64> = labels
        .iter()
        .zip(&views[view].directions)
        .filter_map(|(label, direction)| {
            let others = known.get(&(*label)?)?;
            let along = station.rotation * direction.push(1.0).normalize();
            let own = std::iter::once((&station.centre, &along));
            let point = meet(others.iter().map(|(c, d)| (*c, d)).chain(own.clone()))?;
            let rays = others.iter().map(|(c, d)| (*c, d)).chain(own);
            Some(rays.map(|(from, along)| miss(from, along, &point)).fold(0.0, f64::max))
        })
        .collect();
    if misses.len() < 4 {
        return None;
    }
    misses.sort_by(f64::total_cmp);
    Some(misses[misses.len() / 2])
}

/// The angle between a ray and the direction to a point; a point behind misses by half a turn.
fn miss(from: &Vector3<f64>, along: &Vector3<f64>, point: &Vector3<f64>) -> f64 {
    angle_between(along, &(point - from))
}
