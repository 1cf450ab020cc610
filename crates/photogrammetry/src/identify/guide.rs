//! Guided matching: once the module is roughly known, each beam is a line in every picture, and the
//! dot of the beam is where the pictures agree on a depth along it. No wall's shape is assumed, so
//! folds, steps and missing neighbours do not matter here.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::View;
use crate::pattern::Order;
use crate::pose::{RayFit, Station, fit_rays, refine_rays};

/// The dots of one camera as rays in the world.
pub(super) struct Rays {
    pub centre: Vector3<f64>,
    /// Unit vectors.
    pub along: Vec<Vector3<f64>>,
}

impl Rays {
    pub fn of(view: &View) -> Self {
        let ray = |d: &nalgebra::Vector2<f64>| view.station.rotation * d.push(1.0).normalize();
        Self { centre: view.station.centre, along: view.directions.iter().map(ray).collect() }
    }
}

/// A beam found in the pictures.
#[derive(Debug, Clone)]
pub(super) struct Found {
    pub order: Order,
    /// (view, dot), views ascending.
    pub seen: Vec<(usize, usize)>,
    /// Where the cameras' rays meet; beam and ray where only one camera sees the dot.
    pub place: Vector3<f64>,
    /// Root mean square angle by which rays and beam miss the point where they should meet.
    pub miss: f64,
}

/// A labelling with the module that goes with it.
#[derive(Debug, Clone)]
pub(super) struct Guided {
    pub module: Station,
    /// Beams found by at least two cameras.
    pub found: Vec<Found>,
    /// Angle up to which rays counted as meeting.
    pub tolerance: f64,
}

/// Angle, rad, up to which rays count as meeting while the module is only roughly known: ten
/// pixels of a usual camera, a fifth of the way to the next dot or less.
pub(super) const ROUGH: f64 = 3e-3;
/// Least tolerance, a pixel: what calibration and the unadjusted orientation leave open.
const FINE: f64 = 3e-4;
/// Fewest beams that are followed: six unknowns, and as many to see whether they are right.
const FEWEST: usize = 6;

impl Guided {
    /// What the labelling explains: every camera beyond the first counts for each beam, less when
    /// its ray passes by, nothing from the angle `scale` on. Right labels score about one for each.
    pub fn score(&self, scale: f64) -> f64 {
        self.found.iter().map(|f| worth(f.seen.len(), f.miss / scale)).sum()
    }

    /// The labels of all views.
    pub fn labels(&self, views: &[View]) -> Vec<Vec<Option<Order>>> {
        let mut labels: Vec<Vec<Option<Order>>> =
            views.iter().map(|v| vec![None; v.directions.len()]).collect();
        for found in without_lonely(&self.found, &self.module.centre) {
            for (view, dot) in &found.seen {
                labels[*view][*dot] = Some(found.order);
            }
        }
        labels
    }
}

fn worth(views: usize, relative_miss: f64) -> f64 {
    (views as f64 - 1.0) * (1.0 - relative_miss.powi(2)).max(0.0)
}

/// A part of the pattern: lowest and highest order.
pub(super) type Part = (Order, Order);

/// Follows the beams of a module that stands roughly at `start`: matches, fits the module to what
/// was matched, and so on with an ever smaller tolerance. A start that is known from a part of the
/// pattern only is followed there first and a row farther each time, since its error grows with the
/// way. `None` when too little matches.
pub(super) fn follow(
    rays: &[Rays],
    beams: &[(Order, Vector3<f64>)],
    start: &Station,
    part: Option<Part>,
) -> Option<Guided> {
    let mut module = *start;
    if let Some(part) = part {
        let mut before = 0;
        for wider in 0.. {
            let near: Vec<_> = beams.iter().filter(|b| within(b.0, part, wider)).copied().collect();
            if near.len() == beams.len() {
                break;
            }
            if near.len() > before {
                let found = matches(rays, &near, &module, ROUGH);
                if found.len() < FEWEST {
                    return None;
                }
                module = fitted(&found, beams, Some(&module))?.station;
            }
            before = near.len();
        }
    }
    follow_all(rays, beams, module, ROUGH)
}

/// What is found when all labels are shifted and the module is fitted and followed anew.
pub(super) fn shifted(
    rays: &[Rays],
    beams: &[(Order, Vector3<f64>)],
    guided: &Guided,
    by: Order,
) -> Option<Guided> {
    let inside = |f: &&Found| direction(beams, moved(f.order, by)).is_some();
    let found = guided.found.iter().filter(inside).cloned().collect();
    let (_, refitted) = refitted(beams, &Guided { found, ..guided.clone() }, by)?;
    follow(rays, beams, &refitted.module, None)
}

fn moved(order: Order, by: Order) -> Order {
    Order { m: order.m + by.m, n: order.n + by.n }
}

/// The labelling with all labels shifted, the module fitted anew, and the root mean square distance
/// of the dots from their beams, mm. `None` when a label would fall outside the pattern.
pub(super) fn refitted(
    beams: &[(Order, Vector3<f64>)],
    guided: &Guided,
    by: Order,
) -> Option<(f64, Guided)> {
    let found: Vec<Found> = guided
        .found
        .iter()
        .map(|f| Found { order: moved(f.order, by), ..f.clone() })
        .map(|f| direction(beams, f.order).map(|_| f))
        .collect::<Option<_>>()?;
    // The beam that a dot had is turned to where the new one points.
    let zero = Order { m: 0, n: 0 };
    let turn =
        Rotation3::rotation_between(&direction(beams, moved(zero, by))?, &direction(beams, zero)?)?;
    let start = Station { rotation: guided.module.rotation * turn, ..guided.module };
    let fit = fitted(&found, beams, Some(&start))?;
    Some((fit.rms_mm, Guided { module: fit.station, found, tolerance: guided.tolerance }))
}

fn direction(beams: &[(Order, Vector3<f64>)], order: Order) -> Option<Vector3<f64>> {
    let at = beams.binary_search_by(|b| (b.0.n, b.0.m).cmp(&(order.n, order.m))).ok()?;
    Some(beams[at].1)
}

fn within(order: Order, (low, high): Part, wider: i32) -> bool {
    (low.m - wider..=high.m + wider).contains(&order.m)
        && (low.n - wider..=high.n + wider).contains(&order.n)
}

/// As [`follow`], from a module that is known so well that rays and beams meet within `tolerance`.
pub(super) fn follow_all(
    rays: &[Rays],
    beams: &[(Order, Vector3<f64>)],
    mut module: Station,
    mut tolerance: f64,
) -> Option<Guided> {
    let mut count = 0;
    for _ in 0..5 {
        let found = matches(rays, beams, &module, tolerance);
        if found.len() < FEWEST {
            return None;
        }
        module = fitted(&found, beams, Some(&module))?.station;
        let settled = found.len() == count;
        count = found.len();
        let finer = (5.0 * median(found.iter().map(|f| f.miss))).clamp(FINE, tolerance);
        if settled && finer > 0.8 * tolerance {
            return Some(Guided { module, found, tolerance });
        }
        tolerance = finer;
    }
    let found = matches(rays, beams, &module, tolerance);
    (found.len() >= FEWEST).then_some(Guided { module, found, tolerance })
}

pub(super) fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    let middle = values.len() / 2;
    if values.is_empty() {
        return 0.0;
    }
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// The module fitted to dots that the cameras found; those that lie far off are left out.
fn fitted(
    found: &[Found],
    beams: &[(Order, Vector3<f64>)],
    start: Option<&Station>,
) -> Option<RayFit> {
    let (places, directions): (Vec<_>, Vec<_>) =
        found.iter().filter_map(|f| Some((f.place, direction(beams, f.order)?))).unzip();
    fit_trimmed(&places, &directions, start)
}

/// Dots farther from their beams than this many medians are left out of a fit.
const FAR: f64 = 4.0;

/// A ray fit without the dots that lie far from their beams.
pub(super) fn fit_trimmed(
    places: &[Vector3<f64>],
    directions: &[Vector3<f64>],
    start: Option<&Station>,
) -> Option<RayFit> {
    let fit = |places: &[Vector3<f64>], directions: &[Vector3<f64>], start: Option<&Station>| {
        start
            .and_then(|s| refine_rays(places, directions, s))
            .or_else(|| fit_rays(places, directions))
    };
    let first = fit(places, directions, start)?;
    let off: Vec<f64> = places
        .iter()
        .zip(directions)
        .map(|(p, d)| (first.station.rotation * d).cross(&(p - first.station.centre)).norm())
        .collect();
    let limit = FAR * median(off.iter().copied());
    let keep = |values: &[Vector3<f64>]| -> Vec<Vector3<f64>> {
        values.iter().zip(&off).filter(|(_, o)| **o <= limit).map(|(v, _)| *v).collect()
    };
    let (near, their) = (keep(places), keep(directions));
    if near.len() == places.len() || near.len() < FEWEST {
        return Some(first);
    }
    fit(&near, &their, Some(&first.station))
}

/// A dot near the line of a beam in one picture.
#[derive(Clone, Copy)]
struct Candidate {
    view: usize,
    dot: usize,
    /// Depth along the beam where the dot's ray passes it.
    depth: f64,
}

/// The beams that at least two cameras find, each dot given to one beam only.
pub(super) fn matches(
    rays: &[Rays],
    beams: &[(Order, Vector3<f64>)],
    module: &Station,
    tolerance: f64,
) -> Vec<Found> {
    let mut all: Vec<Found> = Vec::with_capacity(beams.len());
    let mut candidates = Vec::new();
    for (order, direction) in beams {
        let along = module.rotation * direction;
        candidates.clear();
        for (view, rays) in rays.iter().enumerate() {
            near_line(rays, view, &module.centre, &along, tolerance, &mut candidates);
        }
        all.extend(agreed(rays, &candidates, *order, &module.centre, &along, tolerance));
    }
    exclusive(all, rays)
}

/// Keeps of the beams that claim the same dot the one that most cameras see, and see best.
fn exclusive(mut all: Vec<Found>, rays: &[Rays]) -> Vec<Found> {
    all.sort_by(|a, b| {
        b.seen.len().cmp(&a.seen.len()).then(a.miss.total_cmp(&b.miss)).then(a.order.cmp(&b.order))
    });
    let mut taken: Vec<Vec<bool>> = rays.iter().map(|r| vec![false; r.along.len()]).collect();
    all.retain(|found| {
        let free = found.seen.iter().all(|(view, dot)| !taken[*view][*dot]);
        if free {
            found.seen.iter().for_each(|(view, dot)| taken[*view][*dot] = true);
        }
        free
    });
    all.sort_by_key(|f| (f.order.n, f.order.m));
    all
}

/// How much farther than its neighbour a dot may be from the module, as a part: walls bend and
/// slope, by a tenth from beam to beam where they are seen at sixty degrees.
const ALIKE: f64 = 0.2;
/// With fewer neighbours than this nothing is said of a dot.
const NEIGHBOURS: usize = 3;

/// Leaves out dots that are at the distance of none of their neighbours: two strays that happen to
/// lie on a beam's lines. Beside a step in the wall there are neighbours on either side.
fn without_lonely<'a>(found: &'a [Found], module: &Vector3<f64>) -> Vec<&'a Found> {
    let by_order: BTreeMap<Order, f64> =
        found.iter().map(|f| (f.order, (f.place - module).norm())).collect();
    let has_company = |f: &&Found| {
        let around = (-2..=2).flat_map(|m| (-2..=2).map(move |n| (m, n)));
        let distances: Vec<f64> = around
            .filter(|by| *by != (0, 0))
            .filter_map(|(m, n)| by_order.get(&Order { m: f.order.m + m, n: f.order.n + n }))
            .copied()
            .collect();
        let own = by_order.get(&f.order).copied().unwrap_or_default();
        distances.len() < NEIGHBOURS || distances.iter().any(|d| (d - own).abs() < ALIKE * own)
    };
    found.iter().filter(has_company).collect()
}

fn near_line(
    rays: &Rays,
    view: usize,
    module: &Vector3<f64>,
    beam: &Vector3<f64>,
    tolerance: f64,
    candidates: &mut Vec<Candidate>,
) {
    let base = module - rays.centre;
    let normal = base.cross(beam).normalize();
    for (dot, ray) in rays.along.iter().enumerate() {
        if ray.dot(&normal).abs() > tolerance {
            continue;
        }
        let cosine = ray.dot(beam);
        let depth = (cosine * ray.dot(&base) - beam.dot(&base)) / (1.0 - cosine * cosine);
        if depth > 0.0 && ray.dot(&(base + beam * depth)) > 0.0 {
            candidates.push(Candidate { view, dot, depth });
        }
    }
}

/// How much farther apart than the tolerance two rays may be before the point where all meet is
/// known: each candidate's depth has an error of its own.
const BEFORE: f64 = 3.0;

/// The dots on a beam's line on whose depth most cameras agree.
fn agreed(
    rays: &[Rays],
    candidates: &[Candidate],
    order: Order,
    module: &Vector3<f64>,
    beam: &Vector3<f64>,
    tolerance: f64,
) -> Option<Found> {
    let mut best: Option<Found> = None;
    for seed in candidates {
        let at = module + beam * seed.depth;
        let seen: Vec<(usize, usize)> = (0..rays.len())
            .filter_map(|view| {
                if view == seed.view {
                    return Some((view, seed.dot));
                }
                let here = candidates.iter().filter(|c| c.view == view);
                let angle = |c: &Candidate| off(&rays[view], c.dot, &at);
                here.map(|c| (angle(c), c.dot))
                    .min_by(|a, b| a.0.total_cmp(&b.0))
                    .filter(|(angle, _)| *angle <= BEFORE * tolerance)
                    .map(|(_, dot)| (view, dot))
            })
            .collect();
        if seen.len() < 2 {
            continue;
        }
        let Some(found) = meeting(rays, seen, order, module, beam, tolerance) else { continue };
        let better =
            best.as_ref().is_none_or(|b| (found.seen.len(), -found.miss) > (b.seen.len(), -b.miss));
        if better {
            best = Some(found);
        }
    }
    best
}

/// The angle by which a dot's ray misses a point.
fn off(rays: &Rays, dot: usize, point: &Vector3<f64>) -> f64 {
    let arm = point - rays.centre;
    rays.along[dot].cross(&arm).norm() / arm.norm()
}

fn meeting(
    rays: &[Rays],
    seen: Vec<(usize, usize)>,
    order: Order,
    module: &Vector3<f64>,
    beam: &Vector3<f64>,
    tolerance: f64,
) -> Option<Found> {
    let of_cameras = seen.iter().map(|(v, d)| (&rays[*v].centre, &rays[*v].along[*d]));
    let place = meet(of_cameras.clone())?;
    let with_beam = meet(of_cameras.chain(std::iter::once((module, beam))))?;
    let arm = with_beam - module;
    let mut squares = (beam.cross(&arm).norm() / arm.norm()).powi(2);
    squares += seen.iter().map(|(v, d)| off(&rays[*v], *d, &with_beam).powi(2)).sum::<f64>();
    let miss = (squares / (seen.len() as f64 + 1.0)).sqrt();
    (miss <= tolerance).then_some(Found { order, seen, place, miss })
}

/// The point nearest to some lines. `None` when they are parallel.
pub(super) fn meet<'a>(
    lines: impl Iterator<Item = (&'a Vector3<f64>, &'a Vector3<f64>)>,
) -> Option<Vector3<f64>> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (from, along) in lines {
        let across = Matrix3::identity() - along * along.transpose();
        normal += across;
        right += across * from;
    }
    // Two rays at an angle a: the smallest eigenvalue is a^2 / 2 or so, the others one and two.
    (normal.determinant() > 1e-6).then(|| normal.cholesky().map(|c| c.solve(&right)))?
}

/// The module from labels: dots that two cameras or more label alike, in space, then fitted.
pub(super) fn module_of(
    rays: &[Rays],
    labels: &[Vec<Option<Order>>],
    beams: &[(Order, Vector3<f64>)],
) -> Option<Station> {
    let mut seen: BTreeMap<(i32, i32), Vec<(usize, usize)>> = BTreeMap::new();
    for (view, labels) in labels.iter().enumerate() {
        for (dot, label) in labels.iter().enumerate() {
            if let Some(order) = label {
                seen.entry((order.n, order.m)).or_default().push((view, dot));
            }
        }
    }
    let found: Vec<Found> = seen
        .into_iter()
        .filter(|(_, seen)| seen.len() > 1)
        .filter_map(|((n, m), seen)| {
            let place = meet(seen.iter().map(|(v, d)| (&rays[*v].centre, &rays[*v].along[*d])))?;
            Some(Found { order: Order { m, n }, seen, place, miss: 0.0 })
        })
        .collect();
    Some(fitted(&found, beams, None)?.station)
}
