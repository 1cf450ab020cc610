//! Which dot is which beam.
//!
//! In each picture the dots are labelled as a grid (`grid`), anchored at the brighter zero order or
//! by the pattern's extent (`anchor`); the cameras' labels are brought to agree by triangulation
//! (`agree`). What comes out is a first guess of the module's pose, from which every beam is
//! followed into every picture (`guide`): that decides. Where the guess explains too little, as on
//! the two walls of a corner, others are made of patches of grid (`hypothesis`). Where a shift of the
//! labels fits as well, the zero order decides (`zero`). The quarter turn,
//! which a square pattern leaves open, is chosen nearest to the prior after the module was fitted in
//! space (`turn`). Nothing here knows a wall's shape.

mod agree;
mod anchor;
mod grid;
mod guide;
mod hypothesis;
mod turn;
mod zero;

pub use grid::{Cell, label_grid};
pub use turn::{Labelled, choose_turn};

use nalgebra::{Vector2, Vector3};

use self::guide::{Guided, ROUGH, Rays, follow, follow_all};
use crate::pattern::{Order, Pattern};
use crate::pose::Station;

/// What one camera saw of the dots.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Where the camera stands.
    pub station: Station,
    /// Undistorted normalised coordinates (x/z, y/z) of its dots.
    pub directions: Vec<Vector2<f64>>,
    /// Fitted amplitude of each dot.
    pub amplitudes: Vec<f64>,
}

/// A first guess that explains this part of the dots of the second-fullest picture needs no other.
const ENOUGH: f64 = 0.85;

/// The beam of each dot of each view, up to one quarter turn and mirror-free, the same turn for all
/// views; `None` for dots of no beam. `Err` says why nothing could be labelled.
///
/// # Errors
/// A reason in words: too few dots, views that cannot be brought to agree, or two labellings that
/// explain the pictures equally well.
pub fn label_views(views: &[View], pattern: &Pattern) -> Result<Vec<Vec<Option<Order>>>, String> {
    let rays: Vec<Rays> = views.iter().map(Rays::of).collect();
    let beams: Vec<(Order, Vector3<f64>)> =
        pattern.beams(0.0).iter().map(|b| (b.order, b.direction)).collect();
    let most = second_most(views) as f64;
    let first = from_whole_grids(views, &rays, &beams, pattern)
        .map(|guided| settled(&rays, &beams, guided));
    let labels = |guided| Ok(zero::decided(views, &beams, pattern, guided)?.labels(views));
    if let Ok(guided) = &first
        && guided.found.len() as f64 >= ENOUGH * most
    {
        return labels(guided.clone());
    }
    let mut candidates: Vec<Guided> = first.as_ref().ok().cloned().into_iter().collect();
    for sets in hypothesis::Patchwork::of(views, &rays, pattern).stages() {
        for set in sets {
            for (guess, part) in hypothesis::places_in_pattern(&set, pattern) {
                if !candidates.iter().any(|c| same_place(&c.module, &guess)) {
                    let guided = follow(&rays, &beams, &guess, Some(part));
                    candidates.extend(guided.map(|g| settled(&rays, &beams, g)));
                }
            }
            if candidates.iter().any(|c| is_tight(c) && c.score(TIGHT) > CONVINCING * most) {
                return best(candidates, views, None).and_then(labels);
            }
        }
    }
    best(candidates, views, first.err()).and_then(labels)
}

/// The labelling shifted by an order or two to where rays and beams meet best: a guess may be off by an order, and most beams still find dots near by.
fn settled(rays: &[Rays], beams: &[(Order, Vector3<f64>)], mut guided: Guided) -> Guided {
    let shifts = || (-2..=2).flat_map(|m| (-2..=2).map(move |n| Order { m, n }));
    while guided.tolerance > LOOSE && guided.score(ROUGH) >= WORTH_SETTLING {
        let better = shifts()
            .filter_map(|by| guide::shifted(rays, beams, &guided, by))
            .filter(|g| g.score(TIGHT) > 1.1 * guided.score(TIGHT))
            .max_by(|a, b| a.score(TIGHT).total_cmp(&b.score(TIGHT)));
        match better {
            Some(better) => guided = better,
            None => break,
        }
    }
    guided
}

/// Rays and beams that miss each other by more than two pixels, rad, may do so because the labels
/// are shifted.
const LOOSE: f64 = 6e-4;
/// With fewer beams than this a labelling is an accident, shifted or not.
const WORTH_SETTLING: f64 = 25.0;
/// Rays and beams of a right labelling pass each other nearer than this, three pixels or so, rad;
/// those of one shifted by an order at several times that.
const TIGHT: f64 = 8e-4;

/// Dots in the picture that has the second most: no more beams can be found by two cameras.
fn second_most(views: &[View]) -> usize {
    let mut counts: Vec<usize> = views.iter().map(|v| v.directions.len()).collect();
    counts.sort_unstable();
    counts.iter().rev().nth(1).copied().unwrap_or(0)
}

fn from_whole_grids(
    views: &[View],
    rays: &[Rays],
    beams: &[(Order, Vector3<f64>)],
    pattern: &Pattern,
) -> Result<Guided, String> {
    let mut labels: Vec<Vec<Option<Order>>> = views
        .iter()
        .map(|view| {
            let cells = label_grid(&view.directions);
            anchor::anchor(&cells, &view.amplitudes, pattern)
        })
        .collect();
    let count = |l: &Vec<Option<Order>>| l.iter().flatten().count();
    if labels.iter().filter(|l| count(l) >= 9).count() < 2 {
        let counts: Vec<String> = labels.iter().map(|l| count(l).to_string()).collect();
        return Err(format!(
            "fewer than two cameras see a grid of dots (dots in a grid: {})",
            counts.join(", ")
        ));
    }
    agree::agree(views, &mut labels, pattern)?;
    let module = guide::module_of(rays, &labels, beams)
        .ok_or("no module pose fits the dots that the cameras' grids have in common")?;
    // Whole grids fix the module well; where they were labelled wrong in part it may not be so.
    follow_all(rays, beams, module, TIGHT)
        .or_else(|| follow(rays, beams, &module, None))
        .ok_or_else(|| "the beams of the module do not meet the dots".to_owned())
}

/// Modules nearer than this, mm, are the same guess.
const SAME: f64 = 1.0;
/// A labelling explains "as much" as the best from this part of its score on.
const AS_MUCH: f64 = 0.9;
/// Part of the dots of the second-fullest picture that a labelling must explain to be believed: by
/// chance a few beams always find dots on their lines.
const BELIEVED: f64 = 0.38;

/// Part of the dots of the second-fullest picture from which on no other guess is looked at: where
/// each of two cameras sees another six tenths of the beams beside twenty strays it is 0.46.
const CONVINCING: f64 = 0.4;

/// True where half of all rays and beams pass each other at a fifth of what is tight or nearer: by
/// chance they do so anywhere within the rough tolerance.
fn is_tight(guided: &Guided) -> bool {
    guided.tolerance <= TIGHT
}

fn same_place(a: &Station, b: &Station) -> bool {
    (a.centre - b.centre).norm() < SAME
}

/// The labelling that explains most.
fn best(
    mut candidates: Vec<Guided>,
    views: &[View],
    reason: Option<String>,
) -> Result<Guided, String> {
    let score = |c: &Guided| c.score(TIGHT);
    candidates.retain(is_tight);
    candidates.sort_by(|a, b| score(b).total_cmp(&score(a)));
    let nothing = || "no labelling of the dots fits the pattern in two pictures".to_owned();
    let Some(best) = candidates.first() else { return Err(reason.unwrap_or_else(nothing)) };
    if score(best) < BELIEVED * second_most(views) as f64 {
        return Err("no labelling of the dots explains enough of them".to_owned());
    }
    let rival = candidates[1..]
        .iter()
        .find(|c| !same_place(&c.module, &best.module) && score(c) > AS_MUCH * score(best));
    match rival {
        Some(rival) => {
            let apart = (rival.module.centre - best.module.centre).norm();
            Err(format!(
                "ambiguous: two labellings fit the dots, with the module {apart:.1} mm apart"
            ))
        }
        None => Ok(best.clone()),
    }
}

/// A quarter turn of the labels, clockwise as the module sees it.
#[must_use]
pub fn quarter_turn(order: Order) -> Order {
    Order { m: -order.n, n: order.m }
}
