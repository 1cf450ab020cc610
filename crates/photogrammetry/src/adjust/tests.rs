//! Jacobians by finite differences, and the whole against its slope.

use nalgebra::{Matrix2, Rotation3, Vector2, Vector3, Vector6};

use super::layout::Layout;
use super::normal::{Normal, normal_equations, scalars};
use super::rows::{Linear, Rows};
use super::structure::{Observed, Structure};
use super::*;
use crate::camera::Camera;
use crate::pose::Station;

const ALL: [InteriorParameter; 9] = {
    use InteriorParameter as P;
    [P::FocalX, P::FocalY, P::PrincipalX, P::PrincipalY, P::K1, P::K2, P::P1, P::P2, P::K3]
};

/// Two cameras, a module, an eliminated point, a point in the border and a scale bar; every kind of
/// observation, none at its minimum.
fn small_problem() -> Problem {
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
    let sigma = crate::camera::InteriorSigma { focal_px: 0.9, principal_point_px: [0.8, 0.4] };
    let mut tied = InteriorOrientation::calibrated(camera, &sigma);
    tied.camera.fx += 0.3;
    tied.camera.fy += 0.3;
    let stations = [
        (-400.0, Vector3::new(0.05, 0.2, 0.01)),
        (500.0, Vector3::new(0.02, -0.25, 0.0)),
        (150.0, Vector3::new(0.01, 0.05, 0.1)),
    ];
    let images = (0..3).flat_map(|camera| (0..3).map(move |point| (camera, point)));
    let module = station(20.0, Vector3::new(-0.03, 0.04, 0.02));
    let point = Vector3::new(30.0, -20.0, 5.0);
    // Near its beam: the weight of a beam follows its direction, which no Jacobian knows.
    let cosines = module.station_point(&point).normalize().xy() + Vector2::new(1e-4, -2e-4);
    Problem {
        interiors: vec![tied, InteriorOrientation::free(camera, &ALL)],
        cameras: stations
            .iter()
            .enumerate()
            .map(|(i, (x, turn))| CameraStation {
                station: station(*x, *turn),
                interior: i.min(1),
                is_held: i == 2,
            })
            .collect(),
        modules: vec![ModuleStation { station: module, scale: 2e-4, scale_prior: (1e-4, 3e-4) }],
        points: vec![point, Vector3::new(-130.0, 60.0, 15.0), Vector3::new(90.0, 160.0, -15.0)],
        images: images
            .map(|(camera, point)| ImageObservation {
                camera,
                point,
                at: Vector2::new(1700.0 + 9.0 * point as f64, 1300.0),
                information: Matrix2::new(90.0, 10.0, 10.0, 70.0),
            })
            .collect(),
        beams: vec![BeamObservation { module: 0, point: 0, cosines, sigma: 2e-5, shared: Some(0) }],
        controls: vec![
            Control { point: 0, at: Vector3::new(29.9, -20.1, 5.05), sigma: 0.02 },
            Control { point: 1, at: Vector3::new(-129.9, 60.1, 15.05), sigma: 0.03 },
        ],
        scale_bars: vec![ScaleBar { ends: [1, 2], length: 241.0, sigma: 0.01 }],
        artefact_scale: 1e-4,
        artefact_scale_sigma: 4e-4,
        fan: SharedFan {
            scale: -3e-5,
            scale_sigma: 1e-4,
            beams: vec![Vector2::new(1e-5, -2e-5)],
            beam_sigma: 2e-5,
        },
        held_points: Vec::new(),
    }
}

/// The problem with one unknown of a row's Jacobian moved.
type Move<'a> = &'a dyn Fn(&mut Problem, f64);

#[track_caller]
fn check(observed: Observed, column: usize, step: f64, change: Move<'_>) {
    let problem = small_problem();
    let at = |h: f64| -> Linear {
        let mut problem = problem.clone();
        change(&mut problem, h);
        let mut linear = Linear::new();
        Rows::of(&problem).linear(observed, &mut linear).unwrap();
        linear
    };
    // The residual is observed minus computed: its slope is minus that of the computed side.
    let numeric = -(at(step).residual - at(-step).residual) / (2.0 * step);
    let analytic: Vector2<f64> = at(0.0).by_rest.column(column).into();
    let error = (numeric - analytic).norm();
    let limit = 1e-5 * analytic.norm().max(1e-3);
    assert!(error < limit, "{observed:?}, column {column}: {analytic} against {numeric}");
}

fn turned(station: &mut Station, axis: usize, h: f64) {
    let mut step = Vector6::zeros();
    step[axis] = h;
    *station = station.moved(&step);
}

#[test]
fn jacobians_of_image_points_agree_with_finite_differences() {
    for (image, interior) in [(0, 0), (3, 1)] {
        let observed = Observed::Image(image);
        for axis in 0..6 {
            let step = if axis < 3 { 1e-3 } else { 1e-6 };
            check(observed, axis, step, &|p, h| turned(&mut p.cameras[interior].station, axis, h));
        }
        let unknowns = small_problem().interiors[interior].unknowns.clone();
        for (i, unknown) in unknowns.iter().enumerate() {
            check(observed, 6 + i, 1e-4, &|p, h| {
                unknown.parameter.add(&mut p.interiors[interior].camera, h);
            });
        }
        for axis in 0..3 {
            check(observed, 6 + unknowns.len() + axis, 1e-3, &|p, h| p.points[0][axis] += h);
        }
    }
}

#[test]
fn jacobians_of_beams_agree_with_finite_differences() {
    let observed = Observed::Beam(0);
    for axis in 0..6 {
        let step = if axis < 3 { 1e-2 } else { 1e-6 };
        check(observed, axis, step, &|p, h| turned(&mut p.modules[0].station, axis, h));
    }
    check(observed, 6, 1e-5, &|p, h| p.modules[0].scale += h);
    check(observed, 7, 1e-5, &|p, h| p.fan.scale += h);
    for axis in 0..2 {
        check(observed, 8 + axis, 1e-5, &|p, h| p.fan.beams[0][axis] += h);
    }
    for axis in 0..3 {
        check(observed, 10 + axis, 1e-2, &|p, h| p.points[0][axis] += h);
    }
}

#[test]
fn scale_bars_and_controls_of_the_border_agree_with_finite_differences() {
    let problem = small_problem();
    let layout = Layout::of(&problem, false);
    let structure = Structure::of(&problem, &layout);
    let all = |p: &Problem| scalars(p, &layout, &structure);
    let layout::PointPlace::Border(first) = layout.points[1] else { unreachable!() };
    let mut seen = 0;
    for (i, (slopes, _)) in all(&problem).iter().enumerate() {
        for (at, slope) in slopes.iter().filter(|(at, _)| (first..first + 3).contains(at)) {
            let moved = |h: f64| {
                let mut p = problem.clone();
                p.points[1][at - first] += h;
                all(&p)[i].1.residual
            };
            let numeric = -(moved(1e-4) - moved(-1e-4)) / 2e-4;
            assert!((numeric - slope).abs() < 1e-7, "{numeric} against {slope}");
            seen += 1;
        }
    }
    // The bar's three, and one for each coordinate of the control.
    assert_eq!(seen, 6);
}

/// The gradient over all common unknowns.
fn gradient(normal: &Normal, layout: &Layout) -> Vec<f64> {
    let mut all = normal.common.gradient.as_slice().to_vec();
    all.resize(layout.size, 0.0);
    for (pose, block) in normal.common.poses.iter().zip(&layout.independent) {
        all[block.at..block.at + block.len]
            .copy_from_slice(pose.as_ref().unwrap().gradient.as_slice());
    }
    all
}

#[test]
fn the_gradient_of_the_whole_is_the_slope_of_chi_squared() {
    let problem = small_problem();
    let layout = Layout::of(&problem, false);
    let structure = Structure::of(&problem, &layout);
    let sums = |p: &Problem| normal_equations(p, &layout, &structure, Loss::Squares, None).unwrap();
    let gradient = gradient(&sums(&problem), &layout);
    let slope = |change: Move<'_>, h: f64| {
        let (mut more, mut less) = (problem.clone(), problem.clone());
        change(&mut more, h);
        change(&mut less, -h);
        (sums(&more).chi2 - sums(&less).chi2) / (2.0 * h)
    };
    let compare = |at: usize, change: Move<'_>, h: f64| {
        let (numeric, analytic) = (slope(change, h), -2.0 * gradient[at]);
        let error = (numeric - analytic).abs();
        assert!(error < 1e-4 * analytic.abs().max(1.0), "{at}: {numeric} against {analytic}");
    };
    compare(layout.artefact_scale.unwrap(), &|p, h| p.artefact_scale += h, 1e-7);
    compare(layout.fan_scale.unwrap(), &|p, h| p.fan.scale += h, 1e-7);
    compare(layout.fan_beams + 1, &|p, h| p.fan.beams[0].y += h, 1e-8);
    compare(layout.modules[0].at + 6, &|p, h| p.modules[0].scale += h, 1e-7);
    let layout::PointPlace::Border(point) = layout.points[2] else { unreachable!() };
    compare(point + 1, &|p, h| p.points[2].y += h, 1e-4);
    for (i, block) in layout.cameras.iter().enumerate().filter_map(|(i, b)| Some((i, (*b)?))) {
        compare(block.at + 4, &|p, h| turned(&mut p.cameras[i].station, 4, h), 1e-7);
        let interior = problem.cameras[i].interior;
        let at = layout.interiors[interior].at;
        compare(
            at,
            &|p, h| {
                let unknown = p.interiors[interior].unknowns[0];
                unknown.parameter.add(&mut p.interiors[interior].camera, h);
            },
            1e-4,
        );
    }
}
