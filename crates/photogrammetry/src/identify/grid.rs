//! Grid growth: integer cells for the dots of one picture, from a seed outwards, each next dot
//! predicted by the affine map of its labelled neighbours. Cells are right-handed in the picture
//! (x right, y down), else arbitrary: origin and quarter turn are chosen later.

use std::collections::{BTreeMap, VecDeque};

use nalgebra::{Matrix2, Matrix3, SMatrix, Vector2, Vector3};

/// A cell of the grid.
pub type Cell = (i32, i32);

/// Nearest neighbours looked at for a seed: enough for a grid foreshortened three to one.
const NEIGHBOURS: usize = 12;
/// How far from its prediction a dot may be, in parts of the local step.
const TOLERANCE: f64 = 0.3;
/// Seeds tried before the largest grid is taken.
const SEEDS: usize = 40;

/// Where growth looks for the next dot. The corners let it pass a diagonal of hidden dots.
const AROUND: [Cell; 8] = [(1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)];

/// Labels `points` (undistorted, any unit) as cells of one grid; `None` for points outside it.
#[must_use]
pub fn label_grid(points: &[Vector2<f64>]) -> Vec<Option<Cell>> {
    let mut best: Vec<Option<Cell>> = vec![None; points.len()];
    let mut best_count = 0;
    for seed in seeds(points, SEEDS) {
        let Some(basis) = basis_at(points, seed) else { continue };
        let labels = grow(points, seed, &basis, i32::MAX);
        let count = labels.iter().flatten().count();
        if count > best_count {
            (best, best_count) = (labels, count);
        }
        if best_count * 10 >= points.len() * 9 {
            break;
        }
    }
    unshear(&mut best);
    best
}

/// Fewest dots that make a patch.
const PATCH: usize = 8;
/// Most patches of a kind taken from one picture.
const PATCHES: usize = 6;
/// Seeds tried for patches, spread over the picture.
const PATCH_SEEDS: usize = 40;
/// How far from its seed a small patch goes, cells: half across a pattern of eleven. Growth slips
/// by a cell now and then where much is hidden or a wall bends; near its seed it seldom does.
const NEAR: i32 = 3;

/// The dots of a patch with their cells.
pub(super) type Patch = Vec<(usize, Cell)>;

/// Grids that hold together by themselves, the largest first: where the pattern is folded over a
/// corner or much of it is hidden, growth ends before the whole is labelled, or errs on the way.
pub(super) struct Patches {
    /// Grown as far as they go, no wider than a given number of cells.
    pub large: Vec<Patch>,
    /// Grown around their seeds only.
    pub small: Vec<Patch>,
}

/// The patches of one picture, at most `widest` cells wide.
pub(super) fn patches(points: &[Vector2<f64>], widest: i32) -> Patches {
    let every = points.len().div_ceil(PATCH_SEEDS).max(1);
    let starts: Vec<(usize, Matrix2<f64>)> = seeds(points, points.len())
        .into_iter()
        .step_by(every)
        .flat_map(|seed| [basis_at(points, seed), voted_basis(points, seed)].map(|b| (seed, b)))
        .filter_map(|(seed, basis)| Some((seed, basis?)))
        .collect();
    let grown = |reach: i32| {
        let all = starts.iter().map(|(seed, basis)| patch(&grow(points, *seed, basis, reach)));
        let fit = |p: &Patch| p.len() >= PATCH && width(p) <= widest;
        chosen(all.filter(fit).collect(), points.len())
    };
    Patches { large: grown(i32::MAX), small: grown(NEAR) }
}

/// Of many patches the largest, and those that have enough dots which the ones before lack.
fn chosen(mut grown: Vec<Patch>, points: usize) -> Vec<Patch> {
    let mut taken = vec![false; points];
    let mut chosen = Vec::new();
    while chosen.len() < PATCHES {
        let news = |p: &Patch| p.iter().filter(|(dot, _)| !taken[*dot]).count();
        grown.retain(|p| news(p) >= PATCH && 2 * news(p) >= p.len());
        // The first of the largest: `max_by_key` takes the last.
        let Some(at) = (0..grown.len()).rev().max_by_key(|i| news(&grown[*i])) else { break };
        let best = grown.swap_remove(at);
        best.iter().for_each(|(dot, _)| taken[*dot] = true);
        chosen.push(best);
    }
    chosen
}

fn width(patch: &Patch) -> i32 {
    let span = |axis: fn(&Cell) -> i32| {
        let values = || patch.iter().map(|(_, cell)| axis(cell));
        values().max().unwrap_or(0) - values().min().unwrap_or(0) + 1
    };
    span(|c| c.0).max(span(|c| c.1))
}

fn patch(labels: &[Option<Cell>]) -> Patch {
    let mut labels = labels.to_vec();
    unshear(&mut labels);
    labels.iter().enumerate().filter_map(|(dot, cell)| Some((dot, (*cell)?))).collect()
}

/// Undoes a shear: beside a hidden dot the seed may have taken a diagonal for a side. The whole
/// pattern is a rectangle, so the labels that fill the smallest one are the right ones.
fn unshear(labels: &mut [Option<Cell>]) {
    let shears = [-2, -1, 1, 2].map(|k| [(k, 0), (0, k)]).concat();
    loop {
        let now = bounding_area(labels.iter().flatten().copied());
        let sheared = |(a, b): (i32, i32)| move |(i, j): Cell| (i + a * j, j + b * i);
        let best = shears
            .iter()
            .map(|s| (bounding_area(labels.iter().flatten().copied().map(sheared(*s))), *s))
            .min();
        match best {
            Some((area, shear)) if area < now => {
                labels.iter_mut().flatten().for_each(|cell| *cell = sheared(shear)(*cell));
            }
            _ => return,
        }
    }
}

/// Cells of the smallest rectangle around some cells; a row or column of one cell, which may be a
/// stray, does not count.
fn bounding_area(cells: impl Iterator<Item = Cell>) -> i64 {
    let (mut rows, mut columns) = (BTreeMap::<i32, u32>::new(), BTreeMap::<i32, u32>::new());
    for (i, j) in cells {
        *columns.entry(i).or_default() += 1;
        *rows.entry(j).or_default() += 1;
    }
    let span = |counts: &BTreeMap<i32, u32>| {
        let mut full = counts.iter().filter(|(_, n)| **n > 1).map(|(at, _)| i64::from(*at));
        let first = full.next();
        first.map_or(0, |first| full.next_back().unwrap_or(first) - first + 1)
    };
    span(&rows) * span(&columns)
}

/// Points in order of their distance from the middle: there a grid is whole and even.
fn seeds(points: &[Vector2<f64>], most: usize) -> Vec<usize> {
    let middle = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|p| p[axis]).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or_default()
    };
    let centre = Vector2::new(middle(0), middle(1));
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&a, &b| {
        (points[a] - centre).norm_squared().total_cmp(&(points[b] - centre).norm_squared())
    });
    order.truncate(most);
    order
}

/// The two steps of the grid at a point: the shortest pair of neighbours that both have an opposite
/// and span a cell whose far corner is there too.
fn basis_at(points: &[Vector2<f64>], seed: usize) -> Option<Matrix2<f64>> {
    let origin = points[seed];
    let mut near: Vec<Vector2<f64>> =
        points.iter().enumerate().filter(|(i, _)| *i != seed).map(|(_, p)| p - origin).collect();
    near.sort_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
    near.truncate(NEIGHBOURS);
    let there = |at: Vector2<f64>, size: f64| near.iter().any(|p| (p - at).norm() < 0.25 * size);
    for (i, a) in near.iter().enumerate() {
        for b in &near[..i] {
            let sine = (a.x * b.y - a.y * b.x) / (a.norm() * b.norm());
            let size = a.norm().min(b.norm());
            let whole = there(-a, size) && there(-b, size) && there(a + b, size);
            if sine.abs() > 0.5 && whole {
                let (u, v) = if sine > 0.0 { (a, b) } else { (b, a) };
                return Some(Matrix2::from_columns(&[*u, *v]));
            }
        }
    }
    None
}

/// Dots around a seed whose differences are counted.
const VOTERS: usize = 14;
/// A difference is a step of the grid when as many others are like it as this part of the most
/// frequent one has.
const FREQUENT: f64 = 0.5;

/// The two steps of the grid around a point by vote: the shortest of the differences between dots
/// that occur often. It needs no dot's neighbours to be complete, and strays have no followers.
fn voted_basis(points: &[Vector2<f64>], seed: usize) -> Option<Matrix2<f64>> {
    let mut near: Vec<&Vector2<f64>> = points.iter().collect();
    let from_seed = |p: &Vector2<f64>| (p - points[seed]).norm_squared();
    near.sort_by(|a, b| from_seed(a).total_cmp(&from_seed(b)));
    near.truncate(VOTERS);
    let mut steps: Vec<Vector2<f64>> = Vec::new();
    for (i, a) in near.iter().enumerate() {
        // Of a difference and its opposite, the one that points right.
        steps.extend(near[..i].iter().map(|b| *a - *b).map(|d| if d.x < 0.0 { -d } else { d }));
    }
    let alike =
        |s: &Vector2<f64>, t: &Vector2<f64>| (s - t).norm().min((s + t).norm()) < 0.15 * s.norm();
    let votes: Vec<usize> =
        steps.iter().map(|s| steps.iter().filter(|t| alike(s, t)).count()).collect();
    let enough = FREQUENT * votes.iter().copied().max()? as f64;
    let mut frequent: Vec<Vector2<f64>> =
        steps.iter().zip(&votes).filter(|(_, n)| **n as f64 >= enough).map(|(s, _)| *s).collect();
    frequent.sort_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
    let u = *frequent.first()?;
    let sine = |v: &Vector2<f64>| (u.x * v.y - u.y * v.x) / (u.norm() * v.norm());
    let v = *frequent.iter().find(|v| sine(v).abs() > 0.5)?;
    Some(if sine(&v) > 0.0 {
        Matrix2::from_columns(&[u, v])
    } else {
        Matrix2::from_columns(&[v, u])
    })
}

/// How far from its seed a grid may reach, cells: across a pattern of 81 from its rim.
const REACH: i32 = 84;

/// The dot of each cell, looked up many times for each that is added: a table around the seed.
struct Cells {
    dots: Vec<Option<usize>>,
    /// The cells that are filled, in the order in which they were.
    order: Vec<Cell>,
}

impl Cells {
    fn new(cell: Cell, dot: usize) -> Self {
        let side = (2 * REACH + 1) as usize;
        let mut cells = Self { dots: vec![None; side * side], order: Vec::new() };
        cells.insert(cell, dot);
        cells
    }

    fn index((i, j): Cell) -> Option<usize> {
        let inside = i.abs().max(j.abs()) <= REACH;
        inside.then(|| ((j + REACH) * (2 * REACH + 1) + i + REACH) as usize)
    }

    fn get(&self, cell: Cell) -> Option<usize> {
        self.dots[Self::index(cell)?]
    }

    /// False for a cell out of reach.
    fn insert(&mut self, cell: Cell, dot: usize) -> bool {
        let Some(index) = Self::index(cell) else { return false };
        self.dots[index] = Some(dot);
        self.order.push(cell);
        true
    }
}

/// Cells of the dots that can be reached from a seed, no farther than `reach` cells from it.
fn grow(
    points: &[Vector2<f64>],
    seed: usize,
    basis: &Matrix2<f64>,
    reach: i32,
) -> Vec<Option<Cell>> {
    let mut labels = vec![None; points.len()];
    let mut cells = Cells::new((0, 0), seed);
    labels[seed] = Some((0, 0));
    // A cell that could not be reached from one side may be from another: until nothing is added.
    loop {
        let before = cells.order.len();
        sweep(points, &mut labels, &mut cells, basis, reach);
        if cells.order.len() == before {
            return labels;
        }
    }
}

fn sweep(
    points: &[Vector2<f64>],
    labels: &mut [Option<Cell>],
    cells: &mut Cells,
    basis: &Matrix2<f64>,
    reach: i32,
) {
    let mut queue: VecDeque<Cell> = cells.order.iter().copied().collect();
    while let Some(cell) = queue.pop_front() {
        for (di, dj) in AROUND {
            let next = (cell.0 + di, cell.1 + dj);
            if next.0.abs().max(next.1.abs()) > reach || cells.get(next).is_some() {
                continue;
            }
            let Some((at, step)) = predict(points, cells, cell, next, basis) else { continue };
            let Some(found) = nearest_free(points, labels, at, TOLERANCE * step) else { continue };
            if !cells.insert(next, found) {
                continue;
            }
            labels[found] = Some(next);
            queue.push_back(next);
        }
    }
}

/// Where `next` should be, and the shorter of the local steps: by the affine map fitted to the
/// labelled cells around it, else one seed step from `cell`.
fn predict(
    points: &[Vector2<f64>],
    cells: &Cells,
    cell: Cell,
    next: Cell,
    basis: &Matrix2<f64>,
) -> Option<(Vector2<f64>, f64)> {
    let mut normal = Matrix3::<f64>::zeros();
    let mut right = SMatrix::<f64, 3, 2>::zeros();
    for di in -2..=2 {
        for dj in -2..=2 {
            if let Some(i) = cells.get((next.0 + di, next.1 + dj)) {
                let row = Vector3::new(f64::from(di), f64::from(dj), 1.0);
                // Near cells count most: the map is affine only nearby.
                let weight = f64::from(di * di + dj * dj).powi(-2);
                normal += row * row.transpose() * weight;
                right += row * points[i].transpose() * weight;
            }
        }
    }
    // Three cells that are not on a line determine the map; on a line the determinant is zero but
    // for rounding.
    if normal.determinant() > 1e-4 {
        let map = normal.try_inverse()? * right;
        let step = map.row(0).norm().min(map.row(1).norm());
        return Some((map.row(2).transpose(), step));
    }
    let from = points[cells.get(cell)?];
    let offset = Vector2::new(f64::from(next.0 - cell.0), f64::from(next.1 - cell.1));
    let step = basis.column(0).norm().min(basis.column(1).norm());
    Some((from + basis * offset, step))
}

fn nearest_free(
    points: &[Vector2<f64>],
    labels: &[Option<Cell>],
    at: Vector2<f64>,
    within: f64,
) -> Option<usize> {
    let (mut best, mut least) = (None, within * within);
    for (i, point) in points.iter().enumerate() {
        let squared = (point - at).norm_squared();
        if squared <= least && labels[i].is_none() {
            (best, least) = (Some(i), squared);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An 11x11 grid in perspective, turned by `degrees`, with some dots hidden and strays added.
    fn picture(
        degrees: f64,
        hide_every: usize,
        strays: usize,
    ) -> (Vec<Vector2<f64>>, Vec<Option<Cell>>) {
        let (s, c) = degrees.to_radians().sin_cos();
        let mut points = Vec::new();
        let mut truth = Vec::new();
        for j in -5..=5 {
            for i in -5..=5 {
                if hide_every > 0 && points.len() % hide_every == 1 {
                    truth.push(None);
                    points.push(Vector2::new(9e3 + f64::from(i * 37), f64::from(j * 91)));
                    continue;
                }
                let (x, y) = (f64::from(i), f64::from(j));
                let (u, v) = (c * x - s * y, s * x + c * y);
                let w = 1.0 + 0.03 * u + 0.02 * v;
                points.push(Vector2::new(u / w, v / w) * 80.0);
                truth.push(Some((i, j)));
            }
        }
        points.retain(|p| p.x < 5e3);
        truth.retain(Option::is_some);
        for k in 0..strays {
            let k = k as f64;
            points.push(Vector2::new((k * 97.3) % 700.0 - 350.0, (k * 41.7) % 700.0 - 350.0));
            truth.push(None);
        }
        (points, truth)
    }

    /// Labels agree with the truth up to a shift and a quarter turn.
    #[track_caller]
    fn check(points: &[Vector2<f64>], truth: &[Option<Cell>], expect_at_least: usize) {
        let labels = label_grid(points);
        let best = (0..4)
            .map(|turn| {
                let turned = |(i, j): Cell| (0..turn).fold((i, j), |(i, j), _| (-j, i));
                let mut shifts = BTreeMap::<Cell, usize>::new();
                for (label, truth) in labels.iter().zip(truth) {
                    if let (Some(l), Some(t)) = (label, truth) {
                        let t = turned(*t);
                        *shifts.entry((l.0 - t.0, l.1 - t.1)).or_default() += 1;
                    }
                }
                shifts.values().copied().max().unwrap_or(0)
            })
            .max()
            .unwrap();
        assert!(best >= expect_at_least, "{best} of {}", points.len());
    }

    #[test]
    fn a_whole_grid_is_labelled_at_any_angle() {
        for degrees in (0..360).step_by(7) {
            let (points, truth) = picture(f64::from(degrees), 0, 0);
            check(&points, &truth, 121);
        }
    }

    #[test]
    fn hidden_dots_and_strays_are_survived() {
        let (points, truth) = picture(23.0, 4, 15);
        check(&points, &truth, 85);
    }

    #[test]
    fn a_sheared_labelling_is_undone() {
        let square = || (-5..=5).flat_map(|j| (-5..=5).map(move |i| (i, j)));
        let mut labels: Vec<Option<Cell>> = square().map(|(i, j)| Some((i, j + i))).collect();
        unshear(&mut labels);
        assert_eq!(labels, square().map(Some).collect::<Vec<_>>());
    }

    #[test]
    fn no_grid_no_labels() {
        assert!(label_grid(&[]).is_empty());
        assert_eq!(label_grid(&[Vector2::zeros()]), vec![None]);
    }
}
