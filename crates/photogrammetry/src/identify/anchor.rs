//! Which cell is the zero order: by the pattern's extent where all of it is seen, else by the
//! brighter zero order, else the middle of what is seen.

use std::collections::BTreeMap;

use super::grid::Cell;
use crate::pattern::{Order, Pattern};

/// How much brighter than its neighbours a dot must be to be taken for the zero order, as a part
/// of the declared ratio.
const BRIGHT: f64 = 0.55;

/// Orders from cells; cells outside the pattern get none.
pub(super) fn anchor(
    cells: &[Option<Cell>],
    amplitudes: &[f64],
    pattern: &Pattern,
) -> Vec<Option<Order>> {
    let Some(zero) = zero_cell(cells, amplitudes, pattern) else {
        return vec![None; cells.len()];
    };
    cells
        .iter()
        .map(|cell| {
            let (i, j) = (*cell)?;
            let order = Order { m: i - zero.0, n: j - zero.1 };
            pattern.contains(order).then_some(order)
        })
        .collect()
}

fn zero_cell(cells: &[Option<Cell>], amplitudes: &[f64], pattern: &Pattern) -> Option<Cell> {
    let (low_i, high_i) = extent(cells.iter().flatten().map(|c| c.0))?;
    let (low_j, high_j) = extent(cells.iter().flatten().map(|c| c.1))?;
    let whole = (high_i - low_i + 1) as u32 == pattern.columns.max(pattern.rows)
        && (high_j - low_j + 1) as u32 == pattern.columns.min(pattern.rows)
        || (high_i - low_i + 1) as u32 == pattern.columns.min(pattern.rows)
            && (high_j - low_j + 1) as u32 == pattern.columns.max(pattern.rows);
    let middle = (i32::midpoint(low_i, high_i), i32::midpoint(low_j, high_j));
    if whole {
        return Some(middle);
    }
    brightest(cells, amplitudes, pattern).or(Some(middle))
}

/// Lowest and highest index that at least three dots have: one stray at the rim extends nothing.
fn extent(values: impl Iterator<Item = i32>) -> Option<(i32, i32)> {
    let mut counts = BTreeMap::<i32, usize>::new();
    for value in values {
        *counts.entry(value).or_default() += 1;
    }
    let mut full = counts.into_iter().filter(|(_, n)| *n >= 3).map(|(v, _)| v);
    let first = full.next()?;
    Some((first, full.next_back().unwrap_or(first)))
}

/// The cell whose dot outshines its neighbours most, if it does so enough.
fn brightest(cells: &[Option<Cell>], amplitudes: &[f64], pattern: &Pattern) -> Option<Cell> {
    let expected = pattern.zero_order_relative_intensity.filter(|r| *r > 1.3)?;
    let by_cell: BTreeMap<Cell, f64> =
        cells.iter().zip(amplitudes).filter_map(|(c, a)| Some(((*c)?, *a))).collect();
    by_cell
        .iter()
        .filter_map(|(&(i, j), &amplitude)| {
            let mut around: Vec<f64> = (-1..=1)
                .flat_map(|di| (-1..=1).map(move |dj| (i + di, j + dj)))
                .filter(|c| *c != (i, j))
                .filter_map(|c| by_cell.get(&c).copied())
                .collect();
            around.sort_by(f64::total_cmp);
            let median = *around.get(around.len() / 2)?;
            (around.len() >= 3 && median > 0.0).then_some(((i, j), amplitude / median))
        })
        .max_by(|a, b| a.1.total_cmp(&b.1))
        // A clipped zero order looks fainter than it is: part of the declared ratio is enough.
        .filter(|(_, ratio)| *ratio > 1.0 + (expected - 1.0) * (1.0 - BRIGHT))
        .map(|(cell, _)| cell)
}
