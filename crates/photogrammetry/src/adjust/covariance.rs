//! Covariances from the normal equations at the solution.
//!
//! The inverse of the reduced normal matrix is the covariance of all poses and scales; a point's
//! follows by back substitution, `V^-1 + T C T^T` with `T = V^-1 W^T`, and two points share
//! `T_i C T_j^T`.

use nalgebra::{DMatrix, Matrix3, Matrix6, SMatrix};

use super::linearise::Normal;
use super::problem::Layout;
use super::solver::{point_inverse, reduce};

/// A point's part of the covariance: its own, and how it follows the common unknowns.
#[derive(Debug, Clone, PartialEq)]
pub struct PointCofactor {
    /// Covariance with all common unknowns held, mm squared.
    pub own: Matrix3<f64>,
    /// How the point moves with the common unknowns: (unknown, mm per unit), unknowns ascending.
    pub follows: Vec<(usize, [f64; 3])>,
}

/// The covariance of everything in an adjustment.
#[derive(Debug, Clone, PartialEq)]
pub struct Covariance {
    layout: Layout,
    /// Of the common unknowns; `None` when they are not determined.
    common: Option<DMatrix<f64>>,
    points: Vec<Option<PointCofactor>>,
}

impl Covariance {
    pub(super) fn of(normal: &Normal, layout: &Layout) -> Self {
        let common =
            reduce(normal, 0.0).and_then(|(h, _)| h.cholesky()).map(|factor| factor.inverse());
        let points = normal.points.iter().map(|block| cofactor(block, layout.size)).collect();
        Self { layout: layout.clone(), common, points }
    }

    /// Covariance of the common unknowns (cameras, modules, scales).
    #[must_use]
    pub fn common(&self) -> Option<&DMatrix<f64>> {
        self.common.as_ref()
    }

    /// Covariance of a camera's pose: centre in mm, then rotation in rad about the world axes.
    #[must_use]
    pub fn camera(&self, camera: usize) -> Option<Matrix6<f64>> {
        self.pose_block(self.layout.cameras.get(camera)?.0)
    }

    /// Covariance between the poses of two modules, rows of `a`, columns of `b`: position in mm,
    /// then rotation in rad about the world axes.
    #[must_use]
    pub fn between_modules(&self, a: usize, b: usize) -> Option<Matrix6<f64>> {
        let (a, b) = (self.layout.modules.get(a)?.0, self.layout.modules.get(b)?.0);
        Some(self.common.as_ref()?.fixed_view::<6, 6>(a, b).into_owned())
    }

    /// Covariance of a module's pose: position in mm, then rotation in rad about the world axes.
    #[must_use]
    pub fn module(&self, module: usize) -> Option<Matrix6<f64>> {
        self.pose_block(self.layout.modules.get(module)?.0)
    }

    fn pose_block(&self, at: usize) -> Option<Matrix6<f64>> {
        Some(self.common.as_ref()?.fixed_view::<6, 6>(at, at).into_owned())
    }

    /// A point's part.
    #[must_use]
    pub fn point_cofactor(&self, point: usize) -> Option<&PointCofactor> {
        self.points.get(point)?.as_ref()
    }

    /// Covariance of a point, mm squared.
    #[must_use]
    pub fn point(&self, point: usize) -> Option<Matrix3<f64>> {
        let cofactor = self.point_cofactor(point)?;
        let common = self.common.as_ref()?;
        let mut sum = cofactor.own;
        for (i, a) in &cofactor.follows {
            for (j, b) in &cofactor.follows {
                let c = common[(*i, *j)];
                sum += SMatrix::<f64, 3, 3>::from_fn(|r, s| a[r] * c * b[s]);
            }
        }
        Some(sum)
    }
}

fn cofactor(block: &super::linearise::PointBlock, size: usize) -> Option<PointCofactor> {
    if block.own == Matrix3::zeros() {
        return None;
    }
    let own = point_inverse(&block.own, 0.0)?;
    let mut follows = vec![[0.0; 3]; size];
    let mut touched = vec![false; size];
    for (i, w) in &block.coupling {
        // The point's step is V^-1 (g - W^T x): it moves against the coupling.
        let along = own * w;
        touched[*i] = true;
        for (sum, value) in follows[*i].iter_mut().zip(along.iter()) {
            *sum -= value;
        }
    }
    let follows = (0..size).filter(|i| touched[*i]).map(|i| (i, follows[i])).collect();
    Some(PointCofactor { own, follows })
}
