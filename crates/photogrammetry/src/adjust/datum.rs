//! The datum: what fixes position, orientation and scale of the whole, and what does not.
//!
//! Image points and beams stay the same when everything is moved, turned or scaled together. Those
//! seven freedoms must come from controls, held stations and points, or scale bars; a freedom that
//! nothing fixes is named, or, in a free network, fixed by inner constraints: the points as a whole
//! neither move nor turn nor grow against their start values (Meissl 1962, Blaha 1971).

use nalgebra::{DMatrix, SMatrix, SVector, Vector3};

use super::layout::{Block, Layout, PointPlace};
use super::normal::Common;
use super::problem::Problem;
use super::structure::Structure;
use crate::pose::Station;

/// Shifts along, turns about and growth from the world's axes, in units in which each moves the
/// scene by about one.
type Freedom = SVector<f64, 7>;

/// A part of information below this, against the whole, is none.
const NOTHING: f64 = 1e-9;

/// Where freedoms are counted from.
#[derive(Debug, Clone, Copy)]
struct Frame {
    centre: Vector3<f64>,
    size: f64,
}

impl Frame {
    fn of(problem: &Problem, datum: &[Vector3<f64>]) -> Self {
        let mean = |points: &[Vector3<f64>]| {
            points.iter().sum::<Vector3<f64>>() / points.len().max(1) as f64
        };
        let about = if datum.is_empty() { &problem.points } else { datum };
        let (centre, middle) = (mean(about), mean(&problem.points));
        let square: f64 = problem.points.iter().map(|p| (p - middle).norm_squared()).sum();
        let size = (square / problem.points.len().max(1) as f64).sqrt().max(1e-9);
        Self { centre, size }
    }

    /// How a place moves with the freedoms (3 x 7).
    fn moves(&self, place: &Vector3<f64>) -> SMatrix<f64, 3, 7> {
        let arm = (place - self.centre) / self.size;
        let mut moves = SMatrix::<f64, 3, 7>::zeros();
        moves.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        moves.fixed_view_mut::<3, 3>(0, 3).copy_from(&-arm.cross_matrix());
        moves.set_column(6, &arm);
        moves
    }
}

/// The freedoms that nothing fixes, as orthonormal combinations, and the frame they are counted in.
fn free(problem: &Problem, structure: &Structure, layout: &Layout) -> (Vec<Freedom>, Frame) {
    let is_seen = |point: &usize| {
        structure.place[*point].is_some() || layout.points[*point] != PointPlace::Eliminated
    };
    let controls = problem.controls.iter().map(|c| c.point);
    let known: Vec<Vector3<f64>> = controls
        .chain(problem.held_points.iter().copied())
        .filter(is_seen)
        .map(|p| problem.points[p])
        .collect();
    let held = problem.cameras.iter().filter(|c| c.is_held).map(|c| c.station.centre);
    let datum: Vec<Vector3<f64>> = known.iter().copied().chain(held.clone()).collect();
    let frame = Frame::of(problem, &datum);
    let mut fixed = SMatrix::<f64, 7, 7>::zeros();
    for place in &datum {
        let moves = frame.moves(place);
        fixed += moves.transpose() * moves;
    }
    for _ in held {
        // A held camera does not turn either.
        (3..6).for_each(|i| fixed[(i, i)] += 1.0);
    }
    if !problem.scale_bars.is_empty() {
        fixed[(6, 6)] += problem.scale_bars.len() as f64;
    }
    let eigen = fixed.symmetric_eigen();
    let limit = NOTHING * eigen.eigenvalues.max().max(1.0);
    let free = (0..7)
        .filter(|i| eigen.eigenvalues[*i] < limit)
        .map(|i| eigen.eigenvectors.column(i).into_owned())
        .collect();
    (free, frame)
}

/// What is not fixed, in words; `None` when all is.
pub(super) fn defect(problem: &Problem, structure: &Structure, layout: &Layout) -> Option<String> {
    let (free, _) = free(problem, structure, layout);
    if free.is_empty() {
        return None;
    }
    let part = |range: std::ops::Range<usize>| -> f64 {
        free.iter().map(|f| range.clone().map(|i| f[i] * f[i]).sum::<f64>()).sum()
    };
    let mut undetermined = Vec::new();
    for (range, name) in [(0..3, "position"), (3..6, "orientation"), (6..7, "scale")] {
        if part(range) > 1e-6 {
            undetermined.push(name);
        }
    }
    let controls = problem.controls.len() + problem.held_points.len();
    let cause = match (undetermined.as_slice(), controls) {
        (["scale"], _) => "no scale bar and no control".to_owned(),
        (["orientation"], _) => "the control points lie on a line".to_owned(),
        (_, 0) => {
            "no control point, no held camera".to_owned()
                + if problem.scale_bars.is_empty() { " and no scale bar" } else { "" }
        }
        (_, n) => format!("only {n} control point{}", if n == 1 { "" } else { "s" }),
    };
    let verb = if undetermined.len() == 1 { "is" } else { "are" };
    Some(format!("{} {verb} undetermined: {cause}", listed(&undetermined)))
}

fn listed(names: &[&str]) -> String {
    match names {
        [] => String::new(),
        [only] => (*only).to_owned(),
        [rest @ .., last] => format!("{} and {last}", rest.join(", ")),
    }
}

/// Inner constraints on the freedoms that nothing fixes.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Inner {
    /// How all unknowns move with the free freedoms.
    moves: DMatrix<f64>,
    /// The same, of the points alone: those whose mean movement is to vanish (border by freedoms).
    constraints: DMatrix<f64>,
    weight: f64,
}

impl Inner {
    /// `None` where nothing is free.
    pub fn of(problem: &Problem, structure: &Structure, layout: &Layout) -> Option<Self> {
        let (free, frame) = free(problem, structure, layout);
        if free.is_empty() {
            return None;
        }
        let basis = SMatrix::<f64, 7, 7>::from_fn(|r, c| free.get(c).map_or(0.0, |f| f[r]));
        let basis = basis.columns(0, free.len()).into_owned();
        let mut moves = DMatrix::zeros(layout.size, free.len());
        let mut constraints = DMatrix::zeros(layout.border, free.len());
        for (place, at) in problem.points.iter().zip(&layout.points) {
            if let PointPlace::Border(at) = at {
                let shift = frame.moves(place) * &basis;
                moves.view_mut((*at, 0), (3, free.len())).copy_from(&shift);
                constraints.view_mut((*at, 0), (3, free.len())).copy_from(&shift);
            }
        }
        let turns = basis.rows(3, 3).into_owned() / frame.size;
        let mut add = |station: &Station, block: Block| {
            let shift = frame.moves(&station.centre) * &basis;
            moves.view_mut((block.at, 0), (3, free.len())).copy_from(&shift);
            moves.view_mut((block.at + 3, 0), (3, free.len())).copy_from(&turns);
        };
        for (camera, block) in problem.cameras.iter().zip(&layout.cameras) {
            block.iter().for_each(|block| add(&camera.station, *block));
        }
        for (module, block) in problem.modules.iter().zip(&layout.modules) {
            add(&module.station, *block);
        }
        Some(Self { moves, constraints, weight: 1.0 })
    }

    /// Number of freedoms.
    pub fn count(&self) -> usize {
        self.constraints.ncols()
    }

    /// Adds the constraints to the normal equations.
    pub fn add(&self, common: &mut Common) {
        common.border.gemm(self.weight, &self.constraints, &self.constraints.transpose(), 1.0);
    }

    /// The same, about as heavy as these normal equations are.
    pub fn weighing(mut self, common: &Common) -> Self {
        self.weight = common.border.diagonal().sum() / common.border.nrows().max(1) as f64;
        self
    }

    /// Takes from an inverse what the weight of the constraints put there:
    /// `Q = (N + w B B^T)^-1 - G (B^T G)^-1 (G^T B)^-1 G^T / w`.
    pub fn remove(&self, inverse: &mut DMatrix<f64>) {
        let product = self.constraints.tr_mul(&self.constraints);
        if let Some(inner) = product.cholesky().map(|c| c.inverse()) {
            let scaled = &self.moves * inner;
            inverse.gemm(-1.0 / self.weight, &scaled, &scaled.transpose(), 1.0);
        }
    }
}
