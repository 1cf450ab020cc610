//! Which unknowns each observation and each point touches: worked out once, used in every
//! iteration.
//!
//! Points are dealt out in groups whose number depends on the problem alone, never on the number of
//! threads, so that sums run in one order.

use std::ops::Range;

use super::layout::{Block, Layout, PointPlace};
use super::problem::Problem;

/// A run of unknowns that an observation touches, with their columns in its Jacobian.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Touch {
    /// Index of the first unknown.
    pub at: usize,
    /// How many.
    pub len: usize,
    /// First column in the observation's Jacobian.
    pub column: usize,
    /// Row of the first unknown in the coupling of the observation's point.
    pub row: usize,
}

/// Most runs that one observation touches: pose, interior orientation (or scale and beam), point.
pub(super) const MOST_TOUCHES: usize = 4;

/// What is observed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Observed {
    Image(usize),
    Beam(usize),
}

/// An observation of two coordinates.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    pub observed: Observed,
    touches: [Touch; MOST_TOUCHES],
    count: usize,
}

impl Row {
    /// The unknowns it touches, ascending.
    pub fn touches(&self) -> &[Touch] {
        &self.touches[..self.count]
    }
}

/// A run of unknowns that a point is coupled to, with its rows in the coupling.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Run {
    pub at: usize,
    pub len: usize,
    pub row: usize,
}

/// An eliminated point.
#[derive(Debug, Clone)]
pub(super) struct Point {
    /// Index in the problem.
    pub index: usize,
    /// Its observations, in `Structure::rows`.
    pub rows: Range<usize>,
    /// Its controls, in `Structure::controls`.
    pub controls: Range<usize>,
    /// Its runs, in `Structure::runs`; those of the border first, ascending.
    pub runs: Range<usize>,
    /// All unknowns that it is coupled to.
    pub width: usize,
    /// The independent pose it is coupled to.
    pub independent: Option<usize>,
    /// Start of its three coupling columns in the group's storage.
    pub coupling: usize,
}

/// A group of points and of observations without an eliminated point, summed by one thread.
#[derive(Debug, Clone, Default)]
pub(super) struct Group {
    /// In `Structure::points`.
    pub points: Range<usize>,
    /// In `Structure::rows`.
    pub direct: Range<usize>,
    /// Length of the coupling storage.
    pub coupling: usize,
}

/// The structure of a problem.
#[derive(Debug, Clone, Default)]
pub(super) struct Structure {
    pub rows: Vec<Row>,
    pub runs: Vec<Run>,
    pub points: Vec<Point>,
    /// Controls of eliminated points (indices in the problem), by point.
    pub controls: Vec<usize>,
    /// Controls of points in the border.
    pub border_controls: Vec<usize>,
    pub groups: Vec<Group>,
    /// Per point of the problem, its place in `points`.
    pub place: Vec<Option<usize>>,
}

/// Points in a group, at least; and the most groups.
const GROUP: usize = 384;
const MOST_GROUPS: usize = 8;

impl Structure {
    pub fn of(problem: &Problem, layout: &Layout) -> Self {
        let mut structure = Self { place: vec![None; problem.points.len()], ..Self::default() };
        let by_point = observations_of_points(problem);
        for (index, place) in layout.points.iter().enumerate() {
            if *place == PointPlace::Eliminated && !by_point.is_empty(index) {
                structure.add_point(problem, layout, index, &by_point);
            }
        }
        let first_direct = structure.rows.len();
        for (index, place) in layout.points.iter().enumerate() {
            if *place != PointPlace::Eliminated {
                let rows = by_point.rows(index).map(|o| row(problem, layout, *o));
                structure.rows.extend(rows);
                if matches!(place, PointPlace::Border(_)) {
                    structure.border_controls.extend(by_point.controls(index));
                }
            }
        }
        structure.deal_out(first_direct);
        structure
    }

    fn add_point(&mut self, problem: &Problem, layout: &Layout, index: usize, by_point: &ByPoint) {
        let first = self.rows.len();
        self.rows.extend(by_point.rows(index).map(|o| row(problem, layout, *o)));
        let first_control = self.controls.len();
        self.controls.extend(by_point.controls(index));
        let has_control = self.controls.len() > first_control;
        let mut blocks: Vec<Block> = self.rows[first..]
            .iter()
            .flat_map(Row::touches)
            .map(|t| Block { at: t.at, len: t.len })
            .chain(layout.artefact_scale.filter(|_| has_control).map(|at| Block { at, len: 1 }))
            .collect();
        blocks.sort_by_key(|b| b.at);
        blocks.dedup();
        let first_run = self.runs.len();
        let mut width = 0;
        for block in &blocks {
            match self.runs[first_run..].last_mut() {
                Some(run) if run.at + run.len == block.at && block.at != layout.border => {
                    run.len += block.len;
                }
                _ => self.runs.push(Run { at: block.at, len: block.len, row: width }),
            }
            width += block.len;
        }
        let runs = &self.runs[first_run..];
        for row in &mut self.rows[first..] {
            for touch in &mut row.touches[..row.count] {
                let run = runs.iter().find(|r| (r.at..r.at + r.len).contains(&touch.at));
                touch.row = run.map_or(0, |r| r.row + touch.at - r.at);
            }
        }
        let last = runs.last().and_then(|r| layout.independent_at(r.at));
        self.place[index] = Some(self.points.len());
        self.points.push(Point {
            index,
            rows: first..self.rows.len(),
            controls: first_control..self.controls.len(),
            runs: first_run..self.runs.len(),
            width,
            independent: last,
            coupling: 0,
        });
    }

    fn deal_out(&mut self, first_direct: usize) {
        let direct = self.rows.len() - first_direct;
        let count = (self.points.len() / GROUP).max(direct / (4 * GROUP)).clamp(1, MOST_GROUPS);
        for i in 0..count {
            let part = |n: usize| n * i / count..n * (i + 1) / count;
            let points = part(self.points.len());
            let direct = part(direct);
            let mut coupling = 0;
            for point in &mut self.points[points.clone()] {
                point.coupling = coupling;
                coupling += 3 * point.width;
            }
            let direct = first_direct + direct.start..first_direct + direct.end;
            self.groups.push(Group { points, direct, coupling });
        }
    }

    /// The group of a point, by its place in `points`.
    pub fn group_of(&self, point: usize) -> usize {
        self.groups.partition_point(|group| group.points.end <= point)
    }
}

fn row(problem: &Problem, layout: &Layout, observed: Observed) -> Row {
    let nothing = Touch { at: 0, len: 0, column: 0, row: 0 };
    let mut row = Row { observed, touches: [nothing; MOST_TOUCHES], count: 0 };
    let mut column = 0;
    let mut touch = |block: Block, columns: usize| {
        if block.len > 0 {
            row.touches[row.count] = Touch { at: block.at, len: block.len, column, row: 0 };
            row.count += 1;
        }
        column += columns;
    };
    let point = match observed {
        Observed::Image(i) => {
            let o = &problem.images[i];
            let interior = layout.interiors[problem.cameras[o.camera].interior];
            touch(layout.cameras[o.camera].unwrap_or(Block { at: 0, len: 0 }), 6);
            touch(interior, interior.len);
            o.point
        }
        Observed::Beam(i) => {
            let o = &problem.beams[i];
            touch(layout.modules[o.module], 7);
            touch(layout.fan_scale.map_or(Block { at: 0, len: 0 }, |at| Block { at, len: 1 }), 1);
            let error = o.shared.map(|beam| Block { at: layout.fan_beams + 2 * beam, len: 2 });
            touch(error.unwrap_or(Block { at: 0, len: 0 }), 2);
            o.point
        }
    };
    if let PointPlace::Border(at) = layout.points[point] {
        touch(Block { at, len: 3 }, 3);
    }
    row.touches[..row.count].sort_by_key(|t| t.at);
    row
}

/// Observations by point, in the order in which they were given: images, then beams.
struct ByPoint {
    rows: Vec<Observed>,
    row_starts: Vec<usize>,
    controls: Vec<usize>,
    control_starts: Vec<usize>,
}

impl ByPoint {
    fn rows(&self, point: usize) -> std::slice::Iter<'_, Observed> {
        self.rows[self.row_starts[point]..self.row_starts[point + 1]].iter()
    }

    fn controls(&self, point: usize) -> impl Iterator<Item = usize> {
        self.controls[self.control_starts[point]..self.control_starts[point + 1]].iter().copied()
    }

    fn is_empty(&self, point: usize) -> bool {
        self.rows(point).len() == 0
    }
}

fn observations_of_points(problem: &Problem) -> ByPoint {
    let n = problem.points.len();
    let images = problem.images.iter().enumerate().map(|(i, o)| (o.point, Observed::Image(i)));
    let beams = problem.beams.iter().enumerate().map(|(i, o)| (o.point, Observed::Beam(i)));
    let (rows, row_starts) = sorted(n, images.chain(beams));
    let controls = problem.controls.iter().enumerate().map(|(i, c)| (c.point, i));
    let (controls, control_starts) = sorted(n, controls);
    ByPoint { rows, row_starts, controls, control_starts }
}

/// Items sorted by point (a counting sort, which keeps their order), and where each point's start.
fn sorted<T: Copy>(
    points: usize,
    items: impl Iterator<Item = (usize, T)> + Clone,
) -> (Vec<T>, Vec<usize>) {
    let mut starts = vec![0; points + 1];
    items.clone().for_each(|(point, _)| starts[point + 1] += 1);
    for i in 0..points {
        starts[i + 1] += starts[i];
    }
    let mut next = starts.clone();
    let mut order: Vec<Option<T>> = vec![None; starts[points]];
    for (point, item) in items {
        order[next[point]] = Some(item);
        next[point] += 1;
    }
    (order.into_iter().flatten().collect(), starts)
}
