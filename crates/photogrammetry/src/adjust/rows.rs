//! Residuals and Jacobians of each kind of observation.
//!
//! Jacobians are of the computed value by the unknowns; a residual is observed minus computed.

use nalgebra::{Matrix2, Matrix2x3, Matrix3, SMatrix, Vector2, Vector3};

use super::problem::{
    BeamObservation, ImageObservation, InteriorParameter, InteriorUnknown, Problem,
};
use super::structure::Observed;
use crate::camera::Camera;
use crate::pose::Station;

/// Most columns of an observation's Jacobian: pose, ten numbers of the interior orientation, point.
pub(super) const COLUMNS: usize = 19;

/// One linearised observation of two coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Linear {
    pub residual: Vector2<f64>,
    pub information: Matrix2<f64>,
    pub by_point: Matrix2x3<f64>,
    /// By the pose (6 columns), then of a camera by the unknowns of its interior orientation; of a
    /// module by its scale, the fan's scale and the beam's error (2). Then by the point again.
    pub by_rest: SMatrix<f64, 2, COLUMNS>,
}

impl Linear {
    /// Nothing yet: rows are written over and over in one place.
    pub fn new() -> Self {
        Self {
            residual: Vector2::zeros(),
            information: Matrix2::zeros(),
            by_point: Matrix2x3::zeros(),
            by_rest: SMatrix::zeros(),
        }
    }

    /// Weighted square of the residual.
    #[inline]
    pub fn square(&self) -> f64 {
        (self.residual.transpose() * self.information * self.residual).x
    }

    /// Sets the columns of the pose, and those of the point from `columns` on.
    #[inline]
    fn set_place(&mut self, by_point: &Matrix2x3<f64>, arm: &Vector3<f64>, columns: usize) {
        self.by_point = *by_point;
        self.by_rest.fixed_view_mut::<2, 3>(0, 0).copy_from(&-by_point);
        self.by_rest.fixed_view_mut::<2, 3>(0, 3).copy_from(&turning(by_point, arm));
        self.by_rest.fixed_view_mut::<2, 3>(0, columns).copy_from(by_point);
    }
}

/// `by_point [arm]x`: how the computed value follows a small rotation about the world axes.
#[inline]
fn turning(by_point: &Matrix2x3<f64>, arm: &Vector3<f64>) -> Matrix2x3<f64> {
    let row = |r: usize| {
        let p = Vector3::new(by_point[(r, 0)], by_point[(r, 1)], by_point[(r, 2)]);
        p.cross(arm).transpose()
    };
    Matrix2x3::from_rows(&[row(0), row(1)])
}

/// A station as the rows need it.
#[derive(Debug, Clone, Copy)]
struct Prepared {
    centre: Vector3<f64>,
    station_from_world: Matrix3<f64>,
}

impl From<&Station> for Prepared {
    fn from(station: &Station) -> Self {
        let station_from_world = station.rotation.matrix().transpose();
        Self { centre: station.centre, station_from_world }
    }
}

/// Everything that many rows have in common, at one estimate.
pub(super) struct Rows<'a> {
    problem: &'a Problem,
    cameras: Vec<(Prepared, &'a Camera, &'a [InteriorUnknown])>,
    modules: Vec<Prepared>,
}

impl<'a> Rows<'a> {
    pub fn of(problem: &'a Problem) -> Self {
        let camera = |c: &super::problem::CameraStation| {
            let interior = &problem.interiors[c.interior];
            (Prepared::from(&c.station), &interior.camera, interior.unknowns.as_slice())
        };
        Self {
            problem,
            cameras: problem.cameras.iter().map(camera).collect(),
            modules: problem.modules.iter().map(|m| Prepared::from(&m.station)).collect(),
        }
    }

    /// Linearises an observation into `row`. `None` where the point has no image or the beam no
    /// dot.
    #[inline]
    pub fn linear(&self, observed: Observed, row: &mut Linear) -> Option<()> {
        match observed {
            Observed::Image(i) => self.image(&self.problem.images[i], row),
            Observed::Beam(i) => self.beam(&self.problem.beams[i], row),
        }
    }

    #[inline]
    fn image(&self, o: &ImageObservation, row: &mut Linear) -> Option<()> {
        let (station, camera, unknowns) = &self.cameras[o.camera];
        let arm = self.problem.points[o.point] - station.centre;
        let projection = camera.project_with_derivatives(&(station.station_from_world * arm))?;
        let by_point = projection.by_point * station.station_from_world;
        row.set_place(&by_point, &arm, 6 + unknowns.len());
        for (i, unknown) in unknowns.iter().enumerate() {
            let column = interior_column(&projection.by_interior, unknown.parameter);
            row.by_rest.set_column(6 + i, &column);
        }
        row.residual = o.at - projection.pixel;
        row.information = o.information;
        Some(())
    }

    #[inline]
    fn beam(&self, o: &BeamObservation, row: &mut Linear) -> Option<()> {
        let (station, fan) = (&self.modules[o.module], &self.problem.fan);
        let arm = self.problem.points[o.point] - station.centre;
        let p = station.station_from_world * arm;
        if p.z <= 1e-9 {
            return None;
        }
        let error = o.shared.map_or_else(Vector2::zeros, |beam| fan.beams[beam]);
        let tangent = o.tangent(self.problem.modules[o.module].scale + fan.scale, error)?;
        let inv_z = 1.0 / p.z;
        let at = Vector2::new(p.x * inv_z, p.y * inv_z);
        let by_local = Matrix2x3::new(inv_z, 0.0, -at.x * inv_z, 0.0, inv_z, -at.y * inv_z);
        row.set_place(&(by_local * station.station_from_world), &arm, 10);
        // Scales and errors move the observed side: minus on the computed one.
        row.by_rest.set_column(6, &-tangent.by_scale);
        row.by_rest.set_column(7, &-tangent.by_scale);
        row.by_rest.fixed_view_mut::<2, 2>(0, 8).copy_from(&-tangent.by_cosines);
        row.residual = tangent.at - at;
        row.information = o.information(&tangent.at);
        Some(())
    }
}

fn interior_column(by_interior: &SMatrix<f64, 2, 9>, parameter: InteriorParameter) -> Vector2<f64> {
    use InteriorParameter as P;
    let column = |i: usize| Vector2::new(by_interior[(0, i)], by_interior[(1, i)]);
    match parameter {
        P::Focal => column(0) + column(1),
        P::FocalX => column(0),
        P::FocalY => column(1),
        P::PrincipalX => column(2),
        P::PrincipalY => column(3),
        P::K1 => column(4),
        P::K2 => column(5),
        P::P1 => column(6),
        P::P2 => column(7),
        P::K3 => column(8),
    }
}
