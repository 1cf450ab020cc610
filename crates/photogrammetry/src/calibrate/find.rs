//! The sheet in a picture: its discs, the grid they stand in, which dot each is.
//!
//! The grid is grown by `identify::label_grid`; a disc whose place or size does not go with its
//! neighbours' is a stray and left out. Which dot is the first is decided in `place`.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, SMatrix, Vector2, Vector3};

use super::place::{self, Placement};
use super::{Sheet, SheetPoint, View};
use crate::detect::{PlainDisc, Target, TargetOptions, find_plain_discs, find_targets};
use crate::identify::{Cell, label_grid};
use crate::image::GrayImage;

/// How far a disc may be from where its neighbours put it, in parts of the local step.
const MOST_SHIFT: f64 = 0.12;
/// How much its size may differ from its neighbours', as a factor: perspective across one step.
const MOST_GROWTH: f64 = 1.35;
/// Neighbours side by side or corner to corner that a disc is checked by at least: a corner of the
/// sheet has three.
const LEAST_NEIGHBOURS: u32 = 3;
/// Dots of a grid that is worth using.
const LEAST_DOTS: usize = 12;

/// A disc with its cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct Labelled {
    pub(super) cell: Cell,
    pub(super) at: Vector2<f64>,
    size: f64,
}

/// The points of a sheet in a picture.
///
/// # Errors
/// Why there are none, in words for people.
pub fn find_sheet(name: &str, image: &GrayImage, sheet: &Sheet) -> Result<View, String> {
    let options = options(image, sheet);
    let marks = marks(image, sheet, &options);
    let discs = of_one_polarity(find_plain_discs(image, &options), sheet, &marks);
    let dots = in_grid(&discs);
    if dots.len() < LEAST_DOTS {
        let (discs, dots) = (discs.len(), dots.len());
        return Err(format!("no grid of dots: {discs} discs found, {dots} of them in a grid"));
    }
    let placement = place::place(&dots, sheet, &marks)?;
    let points = points(&dots, sheet, &placement);
    if points.len() < LEAST_DOTS {
        return Err(format!("only {} dots of the sheet are seen", points.len()));
    }
    Ok(View { name: name.to_owned(), points })
}

/// A dot can be as large as its share of the picture, and small dots need no code around them.
fn options(image: &GrayImage, sheet: &Sheet) -> TargetOptions {
    let share = image.width.max(image.height) as f64 / f64::from(sheet.rows.min(sheet.columns));
    TargetOptions {
        max_semi_axis: (0.5 * share).max(8.0),
        max_axis_ratio: 3.5,
        ..TargetOptions::default()
    }
}

/// The control marks that are seen.
fn marks(image: &GrayImage, sheet: &Sheet, options: &TargetOptions) -> Vec<Target> {
    if sheet.control_marks.is_empty() {
        return Vec::new();
    }
    let mut found = find_targets(image, options);
    found.retain(|target| sheet.control_marks.iter().any(|mark| mark.code == target.code));
    found
}

/// The discs of the polarity that most have; what lies on a mark is the mark's.
fn of_one_polarity(discs: Vec<PlainDisc>, sheet: &Sheet, marks: &[Target]) -> Vec<PlainDisc> {
    let light = discs.iter().filter(|d| d.contrast > 0.0).count();
    let is_light = 2 * light > discs.len();
    let on_mark = |d: &PlainDisc| marks.iter().any(|m| m.covers(&d.point.at, 3.2));
    let mut kept: Vec<PlainDisc> =
        discs.into_iter().filter(|d| (d.contrast > 0.0) == is_light && !on_mark(d)).collect();
    let contrast = if is_light { 1.0 } else { -1.0 };
    kept.extend(marks.iter().map(|target| {
        let mark = sheet.control_marks.iter().find(|m| m.code == target.code);
        // As large as a dot in its place would be, so that it goes with its neighbours.
        let size = mark.map_or(1.0, |m| sheet.dot_radius_mm() / m.radius_mm);
        PlainDisc { point: target.point, semi_axes: target.semi_axes.map(|a| a * size), contrast }
    }));
    kept
}

/// The discs that stand in one grid, strays left out.
fn in_grid(discs: &[PlainDisc]) -> Vec<Labelled> {
    let places: Vec<Vector2<f64>> = discs.iter().map(|d| d.point.at).collect();
    let cells = label_grid(&places);
    let labelled = discs.iter().zip(cells).filter_map(|(disc, cell)| {
        let size = (disc.semi_axes[0] * disc.semi_axes[1]).sqrt();
        Some(Labelled { cell: cell?, at: disc.point.at, size })
    });
    let mut dots: Vec<Labelled> = labelled.collect();
    // The worst first: a stray spoils the prediction of its neighbours.
    loop {
        let by_cell: BTreeMap<Cell, Labelled> = dots.iter().map(|d| (d.cell, *d)).collect();
        let doubts = dots.iter().map(|dot| doubt(dot, &by_cell)).enumerate();
        match doubts.max_by(|a, b| a.1.total_cmp(&b.1)) {
            Some((worst, doubt)) if doubt > 1.0 => dots.swap_remove(worst),
            _ => break,
        };
    }
    dots.sort_by_key(|d| (d.cell.1, d.cell.0));
    dots
}

/// How far a dot is from what its neighbours say, as a part of what is allowed; endless where too
/// few can say anything.
fn doubt(dot: &Labelled, by_cell: &BTreeMap<Cell, Labelled>) -> f64 {
    let mut normal = Matrix3::<f64>::zeros();
    let mut right = SMatrix::<f64, 3, 2>::zeros();
    let (mut sizes, mut count) = (0.0, 0_u32);
    for (di, dj) in (-2..=2).flat_map(|di| (-2..=2).map(move |dj| (di, dj))) {
        let cell = (dot.cell.0 + di, dot.cell.1 + dj);
        let Some(other) = by_cell.get(&cell).filter(|_| (di, dj) != (0, 0)) else { continue };
        let row = Vector3::new(f64::from(di), f64::from(dj), 1.0);
        let weight = f64::from(di * di + dj * dj).powi(-2);
        normal += row * row.transpose() * weight;
        right += row * other.at.transpose() * weight;
        if di.abs().max(dj.abs()) == 1 {
            sizes += other.size.ln();
            count += 1;
        }
    }
    let is_enough = count >= LEAST_NEIGHBOURS && normal.determinant() > 1e-4;
    let Some(inverse) = normal.try_inverse().filter(|_| is_enough) else { return f64::INFINITY };
    let map = inverse * right;
    let step = map.row(0).norm().min(map.row(1).norm());
    let shift = (map.row(2).transpose() - dot.at).norm() / (MOST_SHIFT * step);
    let growth = (dot.size.ln() - sizes / f64::from(count)).abs() / MOST_GROWTH.ln();
    shift.max(growth)
}

/// The dots of the sheet with their places on it.
fn points(dots: &[Labelled], sheet: &Sheet, placement: &Placement) -> Vec<SheetPoint> {
    dots.iter()
        .filter_map(|dot| {
            let (column, row) = placement.dot(dot.cell, sheet)?;
            let mark = sheet.mark_at(column, row);
            Some(SheetPoint {
                on_sheet: mark.map_or_else(|| sheet.dot(column, row), super::ControlMark::place),
                pixel: dot.at,
                radius_mm: mark.map_or(sheet.dot_radius_mm(), |m| m.radius_mm),
            })
        })
        .collect()
}
