//! Covariances from the normal equations at the solution.
//!
//! The inverse of the reduced normal matrix is the covariance of all that points share; a point's
//! follows by back substitution, `V^-1 + T C T^T` with `T = -V^-1 W^T`, and two points share
//! `T_i C T_j^T`. Nothing is inverted before it is asked for.

use std::sync::OnceLock;

use nalgebra::{DMatrix, Matrix3, Matrix6, SMatrix};

use super::layout::{Block, Layout, PointPlace};
use super::normal::Normal;
use super::reduce::{Reduced, point_inverse, reduce};
use super::structure::Structure;

/// A point's part of the covariance: its own, and how it follows the common unknowns.
#[derive(Debug, Clone, PartialEq)]
pub struct PointCofactor {
    /// Covariance with all common unknowns held, mm squared.
    pub own: Matrix3<f64>,
    /// How the point moves with the common unknowns: (unknown, mm per unit), unknowns ascending.
    pub follows: Vec<(usize, [f64; 3])>,
}

/// The covariance of everything in an adjustment.
#[derive(Debug, Clone)]
pub struct Covariance {
    pub(super) layout: Layout,
    pub(super) structure: Structure,
    pub(super) normal: Normal,
    /// Of a free network: what its inner constraints add (see `datum`).
    pub(super) inner: Option<super::datum::Inner>,
    common: OnceLock<Option<DMatrix<f64>>>,
}

impl Covariance {
    pub(super) fn of(
        normal: Normal,
        layout: Layout,
        structure: Structure,
        inner: Option<super::datum::Inner>,
    ) -> Self {
        Self { layout, structure, normal, inner, common: OnceLock::new() }
    }

    /// Covariance of the common unknowns (cameras, modules, scales, points in the border); `None`
    /// when they are not determined.
    #[must_use]
    pub fn common(&self) -> Option<&DMatrix<f64>> {
        self.common.get_or_init(|| self.inverse()).as_ref()
    }

    fn inverse(&self) -> Option<DMatrix<f64>> {
        let reduced = reduce(&self.normal, &self.layout, &self.structure, 0.0)?;
        let mut inverse = whole(&reduced, &self.layout);
        if let Some(inner) = &self.inner {
            inner.remove(&mut inverse);
        }
        Some(inverse)
    }

    /// Covariance of a camera's pose: centre in mm, then rotation in rad about the world axes. A
    /// held camera has none.
    #[must_use]
    pub fn camera(&self, camera: usize) -> Option<Matrix6<f64>> {
        self.between(*self.layout.cameras.get(camera)?, *self.layout.cameras.get(camera)?)
    }

    /// Covariance of the unknowns of an interior orientation, in their order.
    #[must_use]
    pub fn interior(&self, interior: usize) -> Option<DMatrix<f64>> {
        let block = self.layout.interiors.get(interior)?;
        let size = (block.len, block.len);
        Some(self.common()?.view((block.at, block.at), size).into_owned())
    }

    /// Covariance of a module's pose: position in mm, then rotation in rad about the world axes.
    #[must_use]
    pub fn module(&self, module: usize) -> Option<Matrix6<f64>> {
        self.between_modules(module, module)
    }

    /// Covariance between the poses of two modules, rows of `a`, columns of `b`: position in mm,
    /// then rotation in rad about the world axes.
    #[must_use]
    pub fn between_modules(&self, a: usize, b: usize) -> Option<Matrix6<f64>> {
        let block = |i: usize| self.layout.modules.get(i).copied();
        self.between(block(a), block(b))
    }

    /// Covariance of the shared fan: its scale first (zeros where it is held), then the direction
    /// cosines (x, y) of each beam, as [`super::SharedFan`] has them.
    #[must_use]
    pub fn fan(&self) -> Option<DMatrix<f64>> {
        let common = self.common()?;
        let beams = (self.layout.fan_beams..self.layout.fan_end()).map(Some);
        let places: Vec<Option<usize>> =
            std::iter::once(self.layout.fan_scale).chain(beams).collect();
        let value = |r: usize, c: usize| match (places[r], places[c]) {
            (Some(r), Some(c)) => common[(r, c)],
            _ => 0.0,
        };
        Some(DMatrix::from_fn(places.len(), places.len(), value))
    }

    fn between(&self, a: Option<Block>, b: Option<Block>) -> Option<Matrix6<f64>> {
        Some(self.common()?.fixed_view::<6, 6>(a?.at, b?.at).into_owned())
    }

    /// True for a point that took part as an unknown.
    #[must_use]
    pub fn has_point(&self, point: usize) -> bool {
        match self.layout.points.get(point) {
            Some(PointPlace::Eliminated) => self.structure.place[point].is_some(),
            Some(PointPlace::Border(_)) => true,
            _ => false,
        }
    }

    /// A point's part; `None` for one that took no part.
    #[must_use]
    pub fn point_cofactor(&self, point: usize) -> Option<PointCofactor> {
        let at = match self.layout.points.get(point)? {
            PointPlace::Held => return None,
            PointPlace::Border(at) => {
                let unit = |axis| std::array::from_fn(|i| if i == axis { 1.0 } else { 0.0 });
                let follows = (0..3).map(|axis| (at + axis, unit(axis))).collect();
                return Some(PointCofactor { own: Matrix3::zeros(), follows });
            }
            PointPlace::Eliminated => self.structure.place[point]?,
        };
        let plan = &self.structure.points[at];
        let group = self.structure.group_of(at);
        let sums = &self.normal.groups[group];
        let own = sums.points[at - self.structure.groups[group].points.start].own;
        let own = point_inverse(&own, 0.0)?;
        let coupling = &sums.coupling[plan.coupling..][..3 * plan.width];
        let mut follows = Vec::with_capacity(plan.width);
        for run in &self.structure.runs[plan.runs.clone()] {
            for k in 0..run.len {
                let w = std::array::from_fn(|axis| coupling[axis * plan.width + run.row + k]);
                // The point's step is V^-1 (g - W^T x): it moves against the coupling.
                let along = -(own * nalgebra::Vector3::from(w));
                follows.push((run.at + k, along.into()));
            }
        }
        Some(PointCofactor { own, follows })
    }

    /// Covariance of a point, mm squared.
    #[must_use]
    pub fn point(&self, point: usize) -> Option<Matrix3<f64>> {
        let cofactor = self.point_cofactor(point)?;
        let common = self.common()?;
        let mut sum = cofactor.own;
        for (i, a) in &cofactor.follows {
            let mut along = [0.0; 3];
            for (j, b) in &cofactor.follows {
                let c = common[(*i, *j)];
                along.iter_mut().zip(b).for_each(|(sum, b)| *sum += c * b);
            }
            sum += SMatrix::<f64, 3, 3>::from_fn(|r, s| a[r] * along[s]);
        }
        Some(sum)
    }
}

/// The inverse over border and independent poses.
fn whole(reduced: &Reduced, layout: &Layout) -> DMatrix<f64> {
    let border = reduced.factor.inverse();
    if layout.independent.is_empty() {
        return border;
    }
    let rest = layout.size - layout.border;
    // T^T of all poses side by side: how the poses follow the border, T = -L^-T (E L^-T)^T.
    let mut follow = DMatrix::zeros(layout.border, rest);
    let mut inverse = DMatrix::zeros(layout.size, layout.size);
    for (pose, block) in reduced.poses.iter().zip(&layout.independent) {
        let identity = DMatrix::identity(block.len, block.len);
        let l_inverse = pose.factor.solve_lower_triangular(&identity).unwrap_or(identity);
        let t = -(&pose.scaled * &l_inverse);
        follow.columns_mut(block.at - layout.border, block.len).copy_from(&t);
        let own = l_inverse.tr_mul(&l_inverse);
        inverse.view_mut((block.at, block.at), (block.len, block.len)).copy_from(&own);
    }
    let cross = &border * &follow;
    let own = follow.tr_mul(&cross);
    let n = layout.border;
    inverse.view_mut((0, 0), (n, n)).copy_from(&border);
    inverse.view_mut((0, n), (n, rest)).copy_from(&cross);
    inverse.view_mut((n, 0), (rest, n)).copy_from(&cross.transpose());
    let mut poses = inverse.view_mut((n, n), (rest, rest));
    poses += own;
    inverse
}
