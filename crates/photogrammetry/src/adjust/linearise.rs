//! Residuals and Jacobians of each kind of observation, and the reduced normal equations.
//!
//! Jacobians are of the computed value by the unknowns; a residual is observed minus computed.

use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Vector2, Vector3};

use super::problem::{BeamObservation, ImageObservation, Interior, Layout, Problem, Rows};
use crate::pose::Station;

/// One linearised observation of two coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Row2 {
    pub residual: Vector2<f64>,
    pub information: Matrix2<f64>,
    pub by_point: Rows<3>,
    pub by_pose: Rows<6>,
    /// By focal length and principal point of a camera; by the fan's scale (first column) and the
    /// beam's error (second and third) of a module.
    pub by_rest: Rows<3>,
}

/// Derivatives of a station-frame function by the station's pose, from those by the point in the
/// station's frame: `p = R^T (X - C)`.
fn by_station(by_point: &Rows<3>, station: &Station, point: &Vector3<f64>) -> (Rows<3>, Rows<6>) {
    let station_from_world = station.rotation.inverse().into_inner();
    let by_world = by_point * station_from_world;
    let mut by_pose = Rows::<6>::zeros();
    by_pose.fixed_columns_mut::<3>(0).copy_from(&-by_world);
    let arm = point - station.centre;
    by_pose.fixed_columns_mut::<3>(3).copy_from(&(by_world * arm.cross_matrix()));
    (by_world, by_pose)
}

/// Linearises an image point. `None` where the point has no image.
pub(super) fn image_row(problem: &Problem, o: &ImageObservation) -> Option<Row2> {
    let camera = &problem.cameras[o.camera];
    let point = &problem.points[o.point];
    let in_camera = camera.station.station_point(point);
    let projection = camera.corrected().project_with_derivatives(&in_camera)?;
    let (by_point, by_pose) = by_station(&projection.by_point, &camera.station, point);
    let interior = &projection.by_interior;
    let by_rest = Rows::<3>::from_columns(&[
        interior.column(0) + interior.column(1),
        interior.column(2).into(),
        interior.column(3).into(),
    ]);
    let residual = o.at - projection.pixel;
    Some(Row2 { residual, information: o.information, by_point, by_pose, by_rest })
}

/// Linearises a beam. `None` where the dot is behind the module.
pub(super) fn beam_row(problem: &Problem, o: &BeamObservation) -> Option<Row2> {
    let module = &problem.modules[o.module];
    let point = &problem.points[o.point];
    let p = module.station.station_point(point);
    if p.z <= 1e-9 {
        return None;
    }
    let error = o.shared.map_or_else(Vector2::zeros, |beam| problem.fan.beams[beam]);
    let tangent = o.tangent(module.scale + problem.fan.scale, error)?;
    let inv_z = 1.0 / p.z;
    let at = Vector2::new(p.x * inv_z, p.y * inv_z);
    let by_local = Rows::<3>::new(inv_z, 0.0, -at.x * inv_z, 0.0, inv_z, -at.y * inv_z);
    let (by_point, by_pose) = by_station(&by_local, &module.station, point);
    // Scale and errors move the observed side: minus on the computed one.
    let by_rest = -Rows::<3>::from_columns(&[
        tangent.by_scale,
        tangent.by_cosines.column(0).into(),
        tangent.by_cosines.column(1).into(),
    ]);
    let information = o.information(&tangent.at);
    Some(Row2 { residual: tangent.at - at, information, by_point, by_pose, by_rest })
}

/// The observations of each point, in a fixed order.
#[derive(Debug, Clone, Default)]
pub(super) struct ByPoint {
    pub images: Vec<Vec<usize>>,
    pub beams: Vec<Vec<usize>>,
    pub controls: Vec<Vec<usize>>,
}

impl ByPoint {
    pub fn of(problem: &Problem) -> Self {
        let n = problem.points.len();
        let mut by = Self {
            images: vec![Vec::new(); n],
            beams: vec![Vec::new(); n],
            controls: vec![Vec::new(); n],
        };
        for (i, o) in problem.images.iter().enumerate() {
            by.images[o.point].push(i);
        }
        for (i, o) in problem.beams.iter().enumerate() {
            by.beams[o.point].push(i);
        }
        for (i, o) in problem.controls.iter().enumerate() {
            by.controls[o.point].push(i);
        }
        by
    }
}

/// A point's part of the normal equations: its own block, and its coupling to the other unknowns.
#[derive(Debug, Clone, Default)]
pub(super) struct PointBlock {
    pub own: Matrix3<f64>,
    pub gradient: Vector3<f64>,
    /// (unknown, coupling row), unknowns ascending once merged.
    pub coupling: Vec<(usize, Vector3<f64>)>,
}

impl PointBlock {
    /// Adds up the rows of each unknown, in the order in which the observations came.
    fn merge(&mut self) {
        self.coupling.sort_by_key(|(at, _)| *at);
        self.coupling.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            if same {
                kept.1 += next.1;
            }
            same
        });
    }
}

/// The normal equations before points are eliminated.
pub(super) struct Normal {
    pub hessian: DMatrix<f64>,
    pub gradient: DVector<f64>,
    pub points: Vec<PointBlock>,
    /// Half the weighted sum of squares is the cost that peers report; this is the whole sum.
    pub chi2: f64,
}

/// Linearises everything. `None` where an observation has no image.
pub(super) fn normal_equations(
    problem: &Problem,
    layout: &Layout,
    by_point: &ByPoint,
) -> Option<Normal> {
    let mut normal = Normal {
        hessian: DMatrix::zeros(layout.size, layout.size),
        gradient: DVector::zeros(layout.size),
        points: Vec::with_capacity(problem.points.len()),
        chi2: 0.0,
    };
    for point in 0..problem.points.len() {
        let mut block = PointBlock::default();
        for &i in &by_point.images[point] {
            let row = image_row(problem, &problem.images[i])?;
            let (pose, interior) = layout.cameras[problem.images[i].camera];
            let rest = [0, 1, 2].map(|i| interior.map(|at| at + i));
            add_row(&mut normal, &mut block, &row, pose, [rest, [None; 3]].as_flattened());
        }
        for &i in &by_point.beams[point] {
            let beam = &problem.beams[i];
            let row = beam_row(problem, beam)?;
            let (pose, scale) = layout.modules[beam.module];
            let error = beam.shared.map(|shared| layout.fan_beams + 2 * shared);
            // The module's own scale and the shared one act alike.
            let rest = [scale, error, error.map(|at| at + 1), layout.fan_scale, None, None];
            add_row(&mut normal, &mut block, &row, pose, &rest);
        }
        for &i in &by_point.controls[point] {
            add_control(&mut normal, &mut block, problem, i, layout.artefact_scale);
        }
        block.merge();
        normal.points.push(block);
    }
    add_priors(&mut normal, problem, layout);
    Some(normal)
}

fn add_row(
    normal: &mut Normal,
    block: &mut PointBlock,
    row: &Row2,
    pose: usize,
    rest: &[Option<usize>],
) {
    let weighted_point = row.information * row.by_point;
    block.own += row.by_point.transpose() * weighted_point;
    block.gradient += weighted_point.transpose() * row.residual;
    let weighted_pose = row.information * row.by_pose;
    let h = row.by_pose.transpose() * weighted_pose;
    let mut view = normal.hessian.fixed_view_mut::<6, 6>(pose, pose);
    view += h;
    let mut g = normal.gradient.fixed_rows_mut::<6>(pose);
    g += weighted_pose.transpose() * row.residual;
    let coupling = row.by_pose.transpose() * weighted_point;
    block.coupling.extend((0..6).map(|i| (pose + i, coupling.row(i).transpose())));
    // The place of an unknown in `rest` names its column: the fourth acts as the first.
    for (i, at) in rest.iter().enumerate().filter_map(|(i, at)| Some((i, (*at)?))) {
        let weighted = row.information * row.by_rest.column(i % 3);
        normal.gradient[at] += weighted.dot(&row.residual);
        block.coupling.push((at, row.by_point.transpose() * weighted));
        for (j, other) in rest.iter().enumerate().filter_map(|(j, at)| Some((j, (*at)?))) {
            normal.hessian[(at, other)] += weighted.dot(&row.by_rest.column(j % 3));
        }
        let cross = row.by_pose.transpose() * weighted;
        for (k, value) in cross.iter().enumerate() {
            normal.hessian[(pose + k, at)] += value;
            normal.hessian[(at, pose + k)] += value;
        }
    }
    normal.chi2 += (row.residual.transpose() * row.information * row.residual).x;
}

fn add_control(
    normal: &mut Normal,
    block: &mut PointBlock,
    problem: &Problem,
    index: usize,
    scale: Option<usize>,
) {
    let control = &problem.controls[index];
    let weight = 1.0 / (control.sigma * control.sigma);
    let place = control.at * (1.0 + problem.artefact_scale);
    let residual = place - problem.points[control.point];
    block.own += Matrix3::identity() * weight;
    block.gradient += residual * weight;
    if let Some(at) = scale {
        // The scale moves the known side: its Jacobian on the computed one is minus the place.
        normal.hessian[(at, at)] += weight * control.at.norm_squared();
        normal.gradient[at] -= weight * control.at.dot(&residual);
        block.coupling.push((at, -control.at * weight));
    }
    normal.chi2 += weight * residual.norm_squared();
}

fn add_priors(normal: &mut Normal, problem: &Problem, layout: &Layout) {
    let mut prior = |at: usize, value: f64, known: f64, sigma: f64| {
        let weight = 1.0 / (sigma * sigma);
        let residual = known - value;
        normal.hessian[(at, at)] += weight;
        normal.gradient[at] += weight * residual;
        normal.chi2 += weight * residual * residual;
    };
    for (camera, (_, interior)) in problem.cameras.iter().zip(&layout.cameras) {
        if let (Interior::Prior(sigma), Some(at)) = (camera.interior, *interior) {
            prior(at, camera.correction.x, 0.0, sigma.focal_px);
            prior(at + 1, camera.correction.y, 0.0, sigma.principal_point_px[0]);
            prior(at + 2, camera.correction.z, 0.0, sigma.principal_point_px[1]);
        }
    }
    for (module, (_, scale)) in problem.modules.iter().zip(&layout.modules) {
        if let Some(at) = *scale {
            prior(at, module.scale, module.scale_prior.0, module.scale_prior.1);
        }
    }
    if let Some(at) = layout.artefact_scale {
        prior(at, problem.artefact_scale, 0.0, problem.artefact_scale_sigma);
    }
    if let Some(at) = layout.fan_scale {
        prior(at, problem.fan.scale, 0.0, problem.fan.scale_sigma);
    }
    for (i, error) in problem.fan.beams.iter().enumerate() {
        // Direction cosines of beams far off the axis move a little less than the angle; 3 % at 15
        // degrees are nothing for a prior.
        prior(layout.fan_beams + 2 * i, error.x, 0.0, problem.fan.beam_sigma);
        prior(layout.fan_beams + 2 * i + 1, error.y, 0.0, problem.fan.beam_sigma);
    }
}

#[cfg(test)]
pub(super) mod tests {
    use nalgebra::{Rotation3, Vector6};

    use super::*;
    use crate::adjust::problem::{CameraStation, Control, ModuleStation, SharedFan};
    use crate::camera::{Camera, InteriorSigma};

    pub(crate) fn small_problem() -> Problem {
        let camera = Camera {
            width: 3456,
            height: 2592,
            fx: 3529.0,
            fy: 3531.0,
            cx: 1730.0,
            cy: 1290.0,
            k1: -0.08,
            k2: 0.03,
            p1: 2e-4,
            p2: -1e-4,
            k3: 0.001,
        };
        let station = |x: f64, turn: Vector3<f64>| Station {
            centre: Vector3::new(x, 100.0, 2000.0),
            rotation: Rotation3::from_euler_angles(std::f64::consts::PI, 0.0, 0.0)
                * Rotation3::new(turn),
        };
        let sigma = InteriorSigma { focal_px: 0.9, principal_point_px: [0.8, 0.4] };
        let cameras =
            [(-400.0, Vector3::new(0.05, 0.2, 0.01)), (500.0, Vector3::new(0.02, -0.25, 0.0))].map(
                |(x, turn)| CameraStation {
                    station: station(x, turn),
                    camera,
                    interior: Interior::Prior(sigma),
                    correction: Vector3::new(0.3, -0.2, 0.4),
                },
            );
        Problem {
            cameras: cameras.into(),
            modules: vec![ModuleStation {
                station: station(20.0, Vector3::new(-0.03, 0.04, 0.02)),
                scale: 2e-4,
                scale_prior: (1e-4, 3e-4),
            }],
            points: vec![Vector3::new(30.0, -20.0, 5.0)],
            images: (0..2)
                .map(|camera| ImageObservation {
                    camera,
                    point: 0,
                    at: Vector2::new(1700.0, 1300.0),
                    information: Matrix2::new(90.0, 10.0, 10.0, 70.0),
                })
                .collect(),
            beams: vec![BeamObservation {
                module: 0,
                point: 0,
                cosines: Vector2::new(0.05, -0.04),
                sigma: 2e-5,
                shared: Some(0),
            }],
            controls: vec![Control { point: 0, at: Vector3::new(29.9, -20.1, 5.05), sigma: 0.02 }],
            artefact_scale: 1e-4,
            artefact_scale_sigma: 4e-4,
            fan: SharedFan {
                scale: -3e-5,
                scale_sigma: 1e-4,
                beams: vec![Vector2::new(1e-5, -2e-5)],
                beam_sigma: 2e-5,
            },
        }
    }

    /// The numeric derivative of a residual's computed side (hence the minus).
    #[track_caller]
    fn check(analytic: Vector2<f64>, residual: impl Fn(f64) -> Vector2<f64>, step: f64) {
        let numeric = -(residual(step) - residual(-step)) / (2.0 * step);
        let error = (numeric - analytic).norm();
        assert!(error < 1e-5 * analytic.norm().max(1e-3), "{analytic} against {numeric}");
    }

    #[test]
    fn image_jacobians_agree_with_finite_differences() {
        let problem = small_problem();
        let row = image_row(&problem, &problem.images[0]).unwrap();
        for i in 0..6 {
            let at = |h: f64| {
                let mut p = problem.clone();
                let mut step = Vector6::zeros();
                step[i] = h;
                p.cameras[0].station = p.cameras[0].station.moved(&step);
                image_row(&p, &p.images[0]).unwrap().residual
            };
            check(row.by_pose.column(i).into(), at, if i < 3 { 1e-3 } else { 1e-6 });
        }
        for i in 0..3 {
            let at = |h: f64| {
                let mut p = problem.clone();
                p.cameras[0].correction[i] += h;
                image_row(&p, &p.images[0]).unwrap().residual
            };
            check(row.by_rest.column(i).into(), at, 1e-3);
            let at = |h: f64| {
                let mut p = problem.clone();
                p.points[0][i] += h;
                image_row(&p, &p.images[0]).unwrap().residual
            };
            check(row.by_point.column(i).into(), at, 1e-3);
        }
    }

    #[test]
    fn beam_jacobians_agree_with_finite_differences() {
        let problem = small_problem();
        let row = beam_row(&problem, &problem.beams[0]).unwrap();
        for i in 0..6 {
            let at = |h: f64| {
                let mut p = problem.clone();
                let mut step = Vector6::zeros();
                step[i] = h;
                p.modules[0].station = p.modules[0].station.moved(&step);
                beam_row(&p, &p.beams[0]).unwrap().residual
            };
            check(row.by_pose.column(i).into(), at, if i < 3 { 1e-2 } else { 1e-6 });
        }
        for i in 0..3 {
            let at = |h: f64| {
                let mut p = problem.clone();
                p.points[0][i] += h;
                beam_row(&p, &p.beams[0]).unwrap().residual
            };
            check(row.by_point.column(i).into(), at, 1e-2);
        }
        let at = |h: f64| {
            let mut p = problem.clone();
            p.modules[0].scale += h;
            beam_row(&p, &p.beams[0]).unwrap().residual
        };
        check(row.by_rest.column(0).into(), at, 1e-5);
        for i in 0..2 {
            let at = |h: f64| {
                let mut p = problem.clone();
                p.fan.beams[0][i] += h;
                beam_row(&p, &p.beams[0]).unwrap().residual
            };
            check(row.by_rest.column(1 + i).into(), at, 1e-5);
        }
    }

    #[test]
    fn the_gradient_of_the_whole_is_the_slope_of_chi_squared() {
        let problem = small_problem();
        let layout = Layout::of(&problem);
        let by_point = ByPoint::of(&problem);
        let chi2 = |p: &Problem| normal_equations(p, &layout, &by_point).unwrap().chi2;
        let normal = normal_equations(&problem, &layout, &by_point).unwrap();
        let at = layout.artefact_scale.unwrap();
        let h = 1e-6;
        let (mut more, mut less) = (problem.clone(), problem.clone());
        more.artefact_scale += h;
        less.artefact_scale -= h;
        let slope = (chi2(&more) - chi2(&less)) / (2.0 * h);
        assert!((slope + 2.0 * normal.gradient[at]).abs() < 1e-4 * slope.abs().max(1.0));
    }
}
