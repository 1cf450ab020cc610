//! Where the pictures do not label themselves: module poses from patches of grid.
//!
//! A patch in one picture and a patch in another show the same beams under some turn, shear and
//! shift of their cells: rays of equal cells then meet. The dots so found in space fit the fan at
//! one place of the patch in the pattern best. Each such pose is a guess; `guide` tells what it is
//! worth by everything that all pictures show.

use nalgebra::{Rotation3, Vector3};

use super::View;
use super::grid::{Cell, Patch, patches};
use super::guide::{Part, ROUGH, Rays, fit_trimmed, meet};
use crate::pattern::{Order, Pattern};
use crate::pose::Station;

/// Fewest dots in space that a guess is made of: six unknowns, two coordinates each.
const FEWEST: usize = 7;
/// Part of the common cells whose rays must meet: by chance one in ten does, or one in five along
/// epipolar lines; where growth slipped in one patch no more than half of them do.
const MEETING: f64 = 0.4;
/// Correspondences followed for each pair of patches. More than one, since along an epipolar line a
/// shifted row meets as well.
const FOLLOWED: usize = 4;
/// Places in the pattern that are handed on for each set of dots.
const PLACES: usize = 3;

/// Dots in space by the cells of a patch.
pub(super) type DotSet = Vec<(Cell, Vector3<f64>)>;

/// Patches of the first and of the second picture that are held against each other, stage by stage:
/// the most promising first, and the costly ones only if those did not do.
const STAGES: [[usize; 2]; 4] = [[0, 0], [1, 0], [0, 1], [1, 1]];

/// What pairs of pictures agree on.
pub(super) struct Patchwork<'a> {
    rays: &'a [Rays],
    /// Per view the large patches, then the small ones.
    patches: Vec<[Vec<(Patch, Table)>; 2]>,
    /// Per pair of views which dots' rays meet.
    meets: Vec<(usize, usize, Vec<bool>)>,
}

impl<'a> Patchwork<'a> {
    pub fn of(views: &[View], rays: &'a [Rays], pattern: &Pattern) -> Self {
        let widest = pattern.columns.max(pattern.rows) as i32 + STRAY_CELLS;
        let with_table = |patches: Vec<Patch>| -> Vec<(Patch, Table)> {
            patches.into_iter().map(|p| (Table::of(&p), p)).map(|(t, p)| (p, t)).collect()
        };
        let patches = views
            .iter()
            .map(|v| patches(&v.directions, widest))
            .map(|p| [with_table(p.large), with_table(p.small)])
            .collect();
        let pairs = (0..views.len()).flat_map(|a| (a + 1..views.len()).map(move |b| (a, b)));
        let meets = pairs.map(|(a, b)| (a, b, meeting_pairs(&rays[a], &rays[b]))).collect();
        Self { rays, patches, meets }
    }

    /// Sets of dots in space, stage by stage, in each stage the largest first.
    pub fn stages(&self) -> impl Iterator<Item = Vec<DotSet>> + '_ {
        STAGES.iter().map(|[kind_a, kind_b]| {
            let mut sets = Vec::new();
            for (a, b, meets) in &self.meets {
                for (of_a, _) in &self.patches[*a][*kind_a] {
                    for (_, of_b) in &self.patches[*b][*kind_b] {
                        let (rays_a, rays_b) = (&self.rays[*a], &self.rays[*b]);
                        sets.extend(dots_in_space((rays_a, of_a), (rays_b, of_b), meets));
                    }
                }
            }
            sets.sort_by_key(|set: &DotSet| std::cmp::Reverse(set.len()));
            sets.truncate(SETS);
            sets
        })
    }
}

/// Sets that are looked at in one stage.
const SETS: usize = 20;

/// Rows and columns that strays may add to a patch.
const STRAY_CELLS: i32 = 4;

/// A change of cells: `turn` of the first patch's cell, then a shift, is the second's.
#[derive(Clone, Copy)]
struct Change {
    turn: [[i32; 2]; 2],
    shift: Cell,
}

impl Change {
    fn of(&self, (i, j): Cell) -> Cell {
        let [[a, b], [c, d]] = self.turn;
        (a * i + b * j + self.shift.0, c * i + d * j + self.shift.1)
    }
}

/// Turns and shears of a grid onto itself that keep its hand, entries up to one: quarter turns
/// first. A patch whose sides are hidden may have been labelled along a diagonal.
fn turns() -> Vec<[[i32; 2]; 2]> {
    let entry = || -1..=1;
    let mut all: Vec<[[i32; 2]; 2]> = entry()
        .flat_map(|a| entry().flat_map(move |b| entry().map(move |c| (a, b, c))))
        .flat_map(|(a, b, c)| entry().map(move |d| [[a, b], [c, d]]))
        .filter(|[[a, b], [c, d]]| a * d - b * c == 1)
        .collect();
    all.sort_by_key(|t| t.iter().flatten().map(|e| e.abs()).sum::<i32>());
    all
}

/// The dots of one patch by their cells.
struct Table {
    low: Cell,
    size: (i32, i32),
    dots: Vec<Option<usize>>,
}

impl Table {
    fn of(patch: &Patch) -> Self {
        let span = |axis: fn(&Cell) -> i32| {
            let values = || patch.iter().map(|(_, cell)| axis(cell));
            let low = values().min().unwrap_or(0);
            (low, values().max().unwrap_or(0) - low + 1)
        };
        let ((low_i, size_i), (low_j, size_j)) = (span(|c| c.0), span(|c| c.1));
        let mut table = Self {
            low: (low_i, low_j),
            size: (size_i, size_j),
            dots: vec![None; (size_i * size_j) as usize],
        };
        for (dot, cell) in patch {
            if let Some(index) = table.index(*cell) {
                table.dots[index] = Some(*dot);
            }
        }
        table
    }

    fn index(&self, cell: Cell) -> Option<usize> {
        let (i, j) = (cell.0 - self.low.0, cell.1 - self.low.1);
        let inside = (0..self.size.0).contains(&i) && (0..self.size.1).contains(&j);
        inside.then(|| (j * self.size.0 + i) as usize)
    }

    fn dot(&self, cell: Cell) -> Option<usize> {
        self.dots[self.index(cell)?]
    }
}

/// Sets of dots in space, each by cells of the first patch, one for each correspondence that is
/// worth following.
fn dots_in_space(
    (rays_a, patch_a): (&Rays, &Patch),
    (rays_b, table): (&Rays, &Table),
    meets: &[bool],
) -> Vec<DotSet> {
    let meets = |a: usize, b: usize| meets[a * rays_b.along.len() + b];
    let mut changes: Vec<(f64, Change)> = Vec::new();
    for turn in turns() {
        for shift in shifts(patch_a, table, turn) {
            let change = Change { turn, shift };
            let (mut common, mut meeting) = (0_usize, 0_usize);
            for (dot, cell) in patch_a {
                if let Some(other) = table.dot(change.of(*cell)) {
                    common += 1;
                    meeting += usize::from(meets(*dot, other));
                }
            }
            if meeting >= FEWEST && meeting as f64 >= MEETING * common as f64 {
                changes.push(((meeting * meeting) as f64 / common as f64, change));
            }
        }
    }
    changes.sort_by(|a, b| b.0.total_cmp(&a.0));
    changes.truncate(FOLLOWED);
    let in_space = |(_, change): (f64, Change)| -> DotSet {
        let pair = |(dot, cell): &(usize, Cell)| {
            let other = table.dot(change.of(*cell)).filter(|other| meets(*dot, *other))?;
            let lines = [(rays_a, *dot), (rays_b, other)];
            Some((*cell, meet(lines.iter().map(|(r, d)| (&r.centre, &r.along[*d])))?))
        };
        patch_a.iter().filter_map(pair).collect()
    };
    changes.into_iter().map(in_space).filter(|set| set.len() >= FEWEST).collect()
}

/// Shifts under which the turned patch overlaps the other's table.
fn shifts(patch: &Patch, table: &Table, turn: [[i32; 2]; 2]) -> Vec<Cell> {
    let turned = Change { turn, shift: (0, 0) };
    let range = |axis: fn(&Cell) -> i32, low: i32, size: i32| {
        let values = || patch.iter().map(|(_, cell)| axis(&turned.of(*cell)));
        let (least, most) = (values().min().unwrap_or(0), values().max().unwrap_or(0));
        low - most..=low + size - 1 - least
    };
    let across = range(|c| c.0, table.low.0, table.size.0);
    let down = range(|c| c.1, table.low.1, table.size.1);
    across.flat_map(|i| down.clone().map(move |j| (i, j))).collect()
}

/// For each dot of one camera and each of the other, row by row, whether their rays meet ahead.
fn meeting_pairs(a: &Rays, b: &Rays) -> Vec<bool> {
    let base = b.centre - a.centre;
    let mut pairs = Vec::with_capacity(a.along.len() * b.along.len());
    for ray_a in &a.along {
        let normal = base.cross(ray_a).normalize();
        for ray_b in &b.along {
            let near = ray_b.dot(&normal).abs() < ROUGH;
            // Ahead of both: the rays lie on the same side of the base and converge.
            let cross = ray_a.cross(ray_b);
            let ahead =
                || base.cross(ray_b).dot(&cross) > 0.0 && base.cross(ray_a).dot(&cross) > 0.0;
            pairs.push(near && ahead());
        }
    }
    pairs
}

/// Poses of the module for the places in the pattern at which a set of dots fits best.
///
/// The patch starts in the middle and walks through the pattern as long as it fits better. Where its
/// cells may be sheared, every shear is tried.
pub(super) fn places_in_pattern(
    set: &[(Cell, Vector3<f64>)],
    pattern: &Pattern,
) -> Vec<(Station, Part)> {
    let mut best: Option<Place> = None;
    for turn in turns().into_iter().filter(is_new) {
        let turned = Change { turn, shift: (0, 0) };
        let middle = |axis: fn(&Cell) -> i32| {
            let values = || set.iter().map(|(cell, _)| axis(&turned.of(*cell)));
            i32::midpoint(values().min().unwrap_or(0), values().max().unwrap_or(0))
        };
        let change = Change { turn, shift: (-middle(|c| c.0), -middle(|c| c.1)) };
        let place = fitted(set, pattern, change, None);
        best = [best, place].into_iter().flatten().min_by(|a, b| a.rms.total_cmp(&b.rms));
        if best.is_some_and(|b| b.rms < PLAUSIBLE * mean_distance(set, &b.station)) {
            break;
        }
    }
    let Some(start) = best else { return Vec::new() };
    let mut seen = walk(set, pattern, start);
    seen.sort_by(|a, b| a.rms.total_cmp(&b.rms));
    seen.truncate(PLACES);
    seen.into_iter().map(|place| (place.station, part(set, &place.change))).collect()
}

/// The part of the pattern that a set of dots takes up.
fn part(set: &[(Cell, Vector3<f64>)], change: &Change) -> Part {
    let orders = || set.iter().map(|(cell, _)| change.of(*cell));
    let least = |axis: fn(Cell) -> i32| orders().map(axis).min().unwrap_or(0);
    let most = |axis: fn(Cell) -> i32| orders().map(axis).max().unwrap_or(0);
    (Order { m: least(|c| c.0), n: least(|c| c.1) }, Order { m: most(|c| c.0), n: most(|c| c.1) })
}

/// A grid that is not sheared fits within this part of the distance at the middle of the pattern,
/// wherever in it it belongs.
const PLAUSIBLE: f64 = 0.01;

fn mean_distance(set: &[(Cell, Vector3<f64>)], station: &Station) -> f64 {
    set.iter().map(|(_, p)| (p - station.centre).norm()).sum::<f64>() / set.len() as f64
}

/// A set of dots at a place in the pattern.
#[derive(Clone, Copy)]
struct Place {
    rms: f64,
    change: Change,
    station: Station,
}

/// Of the four quarter turns of each shear one is enough: the others turn the module.
fn is_new(turn: &[[i32; 2]; 2]) -> bool {
    let [[a, b], [c, d]] = *turn;
    let quarter = |[[a, b], [c, d]]: [[i32; 2]; 2]| [[-c, -d], [a, b]];
    let mut other = [[a, b], [c, d]];
    (0..3).all(|_| {
        other = quarter(other);
        *turn >= other
    })
}

/// From place to neighbouring place, while the dots fit the fan better there.
fn walk(set: &[(Cell, Vector3<f64>)], pattern: &Pattern, start: Place) -> Vec<Place> {
    let mut tried = vec![start];
    let mut here = start;
    loop {
        let mut next = here;
        for (di, dj) in (-1..=1).flat_map(|i| (-1..=1).map(move |j| (i, j))) {
            let (i, j) = here.change.shift;
            let change = Change { shift: (i + di, j + dj), ..here.change };
            if tried.iter().any(|t| t.change.shift == change.shift) {
                continue;
            }
            if let Some(place) = fitted(set, pattern, change, Some(&here)) {
                tried.push(place);
                if place.rms < next.rms {
                    next = place;
                }
            }
        }
        if next.change.shift == here.change.shift {
            return tried;
        }
        here = next;
    }
}

/// The module fitted to a set of dots at a place in the pattern; `None` where a tenth of them or
/// more would be outside.
fn fitted(
    set: &[(Cell, Vector3<f64>)],
    pattern: &Pattern,
    change: Change,
    near: Option<&Place>,
) -> Option<Place> {
    let beam = |change: &Change, cell: Cell| {
        let (m, n) = change.of(cell);
        pattern.direction(Order { m, n }, 0.0)
    };
    let (places, directions): (Vec<_>, Vec<_>) =
        set.iter().filter_map(|(cell, place)| Some((*place, beam(&change, *cell)?))).unzip();
    if 10 * places.len() < 9 * set.len() {
        return None;
    }
    // A shift of the labels turns the module by about one step of the fan.
    let start = near.and_then(|near| {
        let cell = set[set.len() / 2].0;
        let (from, to) = (beam(&change, cell)?, beam(&near.change, cell)?);
        let turn = Rotation3::rotation_between(&from, &to)?;
        Some(Station { rotation: near.station.rotation * turn, ..near.station })
    });
    let fit = fit_trimmed(&places, &directions, start.as_ref())?;
    Some(Place { rms: fit.rms_mm, change, station: fit.station })
}
