//! Which dot of the sheet a cell of the grid is: the quarter turn and the shift.
//!
//! With control marks the turn and shift that put them where they are seen; without, by convention:
//! those that hold most cells, among them the turn whose rows run most nearly along the picture's
//! x axis, and the smallest shift. On a plain grid no choice is wrong: it only names the dots.

use nalgebra::{Matrix3, Vector2};

use super::Sheet;
use super::find::Labelled;
use crate::detect::Target;
use crate::identify::Cell;
use crate::pose::homography;

/// How far a mark may be seen from where a placement puts it, in parts of the local step: a
/// homography knows no distortion.
const MARK_WITHIN: f64 = 0.45;

/// Turns cells by quarters and shifts them onto the sheet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Placement {
    turn: u32,
    shift: Cell,
}

impl Placement {
    /// Column and row of a cell; `None` beside the sheet.
    pub(super) fn dot(&self, cell: Cell, sheet: &Sheet) -> Option<(u32, u32)> {
        let (i, j) = turned(cell, self.turn);
        let column = u32::try_from(i + self.shift.0).ok().filter(|c| *c < sheet.columns)?;
        let row = u32::try_from(j + self.shift.1).ok().filter(|r| *r < sheet.rows)?;
        Some((column, row))
    }

    /// The cell, not whole, of a place on the sheet.
    fn cell(&self, on_sheet: &Vector2<f64>, sheet: &Sheet) -> Vector2<f64> {
        let shift = Vector2::new(f64::from(self.shift.0), f64::from(self.shift.1));
        let at = on_sheet / sheet.pitch_mm - shift;
        (0..self.turn).fold(at, |p, _| Vector2::new(p.y, -p.x))
    }
}

/// A quarter turn is (i, j) -> (-j, i).
fn turned(cell: Cell, turn: u32) -> Cell {
    (0..turn).fold(cell, |(i, j), _| (-j, i))
}

/// The placement of a picture's grid.
///
/// # Errors
/// That the marks leave it open, in words for people.
pub(super) fn place(
    dots: &[Labelled],
    sheet: &Sheet,
    marks: &[Target],
) -> Result<Placement, String> {
    let mut candidates = candidates(dots, sheet);
    if sheet.control_marks.is_empty() {
        by_convention(&mut candidates, dots);
        let best = candidates.first().map(|c| c.0);
        return best.ok_or_else(|| "no part of the grid lies on the sheet".to_owned());
    }
    let map = picture_from_cell(dots).ok_or_else(|| "the grid is too small".to_owned())?;
    let seen = |placement: &Placement| marks_in_place(placement, sheet, marks, &map);
    let most = candidates.iter().map(|(placement, _)| seen(placement)).max().unwrap_or(0);
    if most == 0 {
        let codes: Vec<String> = marks.iter().map(|m| m.code.to_string()).collect();
        let codes = if codes.is_empty() { "none".to_owned() } else { codes.join(", ") };
        return Err(format!("no control mark is where the sheet has it (marks read: {codes})"));
    }
    candidates.retain(|(placement, _)| seen(placement) == most);
    match candidates.as_slice() {
        [(only, _)] => Ok(*only),
        several => Err(format!(
            "{} places of the grid go with the control marks that are seen; one mark with its own \
             code off the middle would settle it",
            several.len()
        )),
    }
}

/// Every placement with the number of cells that it puts on the sheet; only those that hold nearly
/// as many as the best: a few strays may stand beside the sheet.
fn candidates(dots: &[Labelled], sheet: &Sheet) -> Vec<(Placement, usize)> {
    let mut all = Vec::new();
    for turn in 0..4 {
        let cells: Vec<Cell> = dots.iter().map(|d| turned(d.cell, turn)).collect();
        let range = |values: &mut dyn Iterator<Item = i32>, size: u32| {
            let (low, high) = values.fold((i32::MAX, i32::MIN), |(l, h), v| (l.min(v), h.max(v)));
            // From "the last cell is the sheet's last" to "the first is the sheet's first", and on
            // both sides what a sheet that is smaller than the grid leaves open.
            let size = i32::try_from(size).unwrap_or(i32::MAX);
            let ends = (size - 1 - high, -low);
            ends.0.min(ends.1)..=ends.0.max(ends.1)
        };
        let across = range(&mut cells.iter().map(|c| c.0), sheet.columns);
        for i in across {
            for j in range(&mut cells.iter().map(|c| c.1), sheet.rows) {
                let placement = Placement { turn, shift: (i, j) };
                let held = dots.iter().filter(|d| placement.dot(d.cell, sheet).is_some()).count();
                all.push((placement, held));
            }
        }
    }
    let most = all.iter().map(|c| c.1).max().unwrap_or(0);
    all.retain(|c| c.1 > 0 && c.1 == most);
    all
}

/// Best first.
fn by_convention(candidates: &mut [(Placement, usize)], dots: &[Labelled]) {
    let along = row_direction(dots);
    let slant = |p: &Placement| {
        // The direction in which the sheet's columns count up.
        let unit = (0..p.turn).fold(Vector2::new(1.0, 0.0), |v, _| Vector2::new(v.y, -v.x));
        let direction = along * unit;
        direction.y.atan2(direction.x).abs()
    };
    candidates.sort_by(|(a, _), (b, _)| {
        let size = |p: &Placement| p.shift.0.abs() + p.shift.1.abs();
        slant(a).total_cmp(&slant(b)).then(size(a).cmp(&size(b))).then(a.shift.cmp(&b.shift))
    });
}

/// Mean steps in the picture along the cells' two axes, as columns.
fn row_direction(dots: &[Labelled]) -> nalgebra::Matrix2<f64> {
    let step = |di: i32, dj: i32| -> Vector2<f64> {
        let next = |d: &Labelled| dots.iter().find(|o| o.cell == (d.cell.0 + di, d.cell.1 + dj));
        dots.iter().filter_map(|d| next(d).map(|o| o.at - d.at)).sum()
    };
    nalgebra::Matrix2::from_columns(&[step(1, 0), step(0, 1)])
}

fn picture_from_cell(dots: &[Labelled]) -> Option<Matrix3<f64>> {
    let cells: Vec<Vector2<f64>> =
        dots.iter().map(|d| Vector2::new(f64::from(d.cell.0), f64::from(d.cell.1))).collect();
    let places: Vec<Vector2<f64>> = dots.iter().map(|d| d.at).collect();
    homography(&cells, &places)
}

/// How many marks are seen where the placement puts them.
fn marks_in_place(
    placement: &Placement,
    sheet: &Sheet,
    marks: &[Target],
    picture_from_cell: &Matrix3<f64>,
) -> usize {
    let picture = |cell: Vector2<f64>| {
        let p = picture_from_cell * cell.push(1.0);
        p.xy() / p.z
    };
    let is_seen = |mark: &&super::ControlMark| {
        let cell = placement.cell(&mark.place(), sheet);
        let at = picture(cell);
        let step = |unit: Vector2<f64>| (picture(cell + unit) - at).norm();
        let step = step(Vector2::x()).min(step(Vector2::y()));
        marks.iter().any(|m| m.code == mark.code && (m.point.at - at).norm() < MARK_WITHIN * step)
    };
    sheet.control_marks.iter().filter(is_seen).count()
}
