//! The angles between neighbours: the same minimum by simplex and by Levenberg-Marquardt; weighted
//! by their full covariance they are worth what the rays are.

use beampose_photogrammetry::PatternUncertainty;
use beampose_photogrammetry::pose::{
    DotField, Estimator, Fan, LocateError, Located, SimplexOptions, locate,
};
use nalgebra::{DMatrix, Matrix3, Matrix6, Vector3};

use crate::bound::{Bound, DOT_SIGMA, Scene, generator, normal};

const START: Vector3<f64> = Vector3::new(15.0, -10.0, 20.0);

fn drawn(scene: &Scene, seed: u64) -> DotField {
    let mut rng = generator(seed, 0);
    let mut noise = || Vector3::from_fn(|_, _| DOT_SIGMA * normal(&mut rng));
    let places = scene.dots.iter().map(|dot| dot + noise()).collect();
    DotField::uniform(scene.orders.clone(), places, DOT_SIGMA)
}

#[track_caller]
fn found(scene: &Scene, field: &DotField, estimator: Estimator) -> Located {
    locate(&scene.fan(), field, estimator, START).unwrap()
}

#[test]
fn simplex_and_levenberg_marquardt_end_at_the_same_minimum() {
    let scene = Scene::new(11, 29.0, 0.0);
    for seed in 0..10 {
        let field = drawn(&scene, seed);
        let lm = found(&scene, &field, Estimator::Angles);
        let options = SimplexOptions { tolerance: 1e-5, ..SimplexOptions::default() };
        let simplex = found(&scene, &field, Estimator::AnglesSimplex(options));
        // A relative spread of 1e-9 of the cost at its minimum: with 417 redundant angles that is
        // sqrt(417e-9) = 6e-4 standard deviations of the position, 0.4 mm; both ends of it.
        let apart = (lm.station.centre - simplex.station.centre).norm();
        assert!(apart < 5e-4, "seed {seed}: {apart} mm apart");
        assert!((lm.covariance - simplex.covariance).norm() < 1e-3 * lm.covariance.norm());
    }
}

#[test]
fn exact_dots_give_the_exact_module_by_every_estimator() {
    let scene = Scene::new(11, 29.0, 20.0);
    let field = DotField::uniform(scene.orders.clone(), scene.dots.clone(), 1e-6);
    let simplex = Estimator::AnglesSimplex(SimplexOptions::default());
    for estimator in [simplex, Estimator::Angles, Estimator::AnglesGeneralised, Estimator::Rays] {
        let found = found(&scene, &field, estimator);
        assert!(found.station.centre.norm() < 1e-6, "{estimator:?}: {}", found.station.centre);
        let turn = found.station.rotation.matrix() - Matrix3::identity();
        assert!(turn.norm() < 1e-9, "{estimator:?}: {turn}");
    }
}

/// To first order both use all the information of the dots. They differ by what is of second order
/// in the noise over the angle, (0.1 / 100)^2 for each of the angles: far below a tenth of sigma.
#[test]
fn angles_with_full_weights_are_worth_what_the_rays_are() {
    let scene = Scene::new(11, 29.0, 0.0);
    let bound = Bound::uniform(&scene.dots).covariance;
    for seed in 0..5 {
        let field = drawn(&scene, seed);
        let angles = found(&scene, &field, Estimator::AnglesGeneralised);
        let rays = found(&scene, &field, Estimator::Rays);
        let apart = (angles.station.centre - rays.station.centre)
            .component_div(&bound.diagonal().fixed_rows::<3>(0).map(f64::sqrt));
        assert!(apart.amax() < 0.1, "seed {seed}: {apart} sigma apart");
        let ratio = angles.covariance[(0, 0)] / bound[(0, 0)];
        assert!((ratio - 1.0).abs() < 0.01, "stated variance {ratio} of the bound");
        assert!((0.8..1.2).contains(&angles.sigma0), "sigma0 {}", angles.sigma0);
    }
}

/// Stated covariances against the scatter of 300 draws, with noise of dots, beams, the scale and a
/// common shift and stretch of all dots: the mean of the normalised squared error of six unknowns
/// is 6 with a standard deviation of sqrt(12 / 300) = 0.2; four of these are allowed.
#[test]
fn every_estimator_states_its_own_scatter() {
    let mut scene = Scene::new(11, 29.0, 20.0);
    scene.pattern.u = PatternUncertainty { angle_deg: 0.002, common_relative: 0.0 };
    let fan = Fan { pattern: &scene.pattern, scale: 0.0, scale_sigma: 3e-4 };
    let common = DMatrix::from_fn(3 * scene.dots.len(), 2, |row, column| {
        let dot = scene.dots[row / 3];
        if column == 0 { [0.1, -0.05, 0.2][row % 3] } else { 1e-4 * dot[row % 3] }
    });
    let draws = 300;
    for estimator in [Estimator::Angles, Estimator::AnglesGeneralised, Estimator::Rays] {
        let sum: f64 = (0..draws)
            .map(|seed| {
                let field = everything_drawn(&scene, &fan, &common, seed);
                let found = locate(&fan, &field, estimator, START).unwrap();
                normalised(&found)
            })
            .sum();
        let mean = sum / draws as f64;
        println!("{estimator:?}: mean normalised squared error {mean:.2}, 6 expected");
        assert!((mean - 6.0).abs() < 0.8, "{estimator:?}: {mean}");
    }
}

fn normalised(found: &Located) -> f64 {
    let mut error = nalgebra::Vector6::zeros();
    error.fixed_rows_mut::<3>(0).copy_from(&found.station.centre);
    error.fixed_rows_mut::<3>(3).copy_from(&found.station.rotation.scaled_axis());
    let covariance: Matrix6<f64> = found.covariance;
    error.dot(&covariance.cholesky().unwrap().solve(&error))
}

fn everything_drawn(scene: &Scene, fan: &Fan<'_>, common: &DMatrix<f64>, seed: u64) -> DotField {
    let mut rng = generator(99, seed);
    let scale = fan.scale_sigma * normal(&mut rng);
    let together = [normal(&mut rng), normal(&mut rng)];
    let wall = Vector3::new(20_f64.to_radians().sin(), 0.0, 20_f64.to_radians().cos());
    let places = scene.orders.iter().enumerate().map(|(i, order)| {
        let beam = scene.pattern.direction(*order, scale).unwrap();
        let error = Vector3::from_fn(|_, _| fan.beam_sigma() * normal(&mut rng));
        let along = (beam + error - beam * error.dot(&beam)).normalize();
        let dot = along * (2000.0 * wall.z / along.dot(&wall));
        let alone = Vector3::from_fn(|_, _| DOT_SIGMA * normal(&mut rng));
        let of = |c: usize| Vector3::from_fn(|r, _| common[(3 * i + r, c)] * together[c]);
        dot + alone + of(0) + of(1)
    });
    let own = vec![Matrix3::identity() * DOT_SIGMA.powi(2); scene.dots.len()];
    let places = places.collect();
    DotField { orders: scene.orders.clone(), places, own, common: common.clone() }
}

#[test]
fn what_the_dots_do_not_fix_is_said() {
    let scene = Scene::new(11, 29.0, 0.0);
    let mut few = drawn(&scene, 0);
    few.orders.truncate(2);
    few.places.truncate(2);
    few.own.truncate(2);
    few.common = DMatrix::zeros(6, 0);
    let fan = scene.fan();
    for estimator in [Estimator::Angles, Estimator::AnglesGeneralised, Estimator::Rays] {
        assert!(locate(&fan, &few, estimator, START).is_err(), "{estimator:?}");
    }
    let many = Scene::new(41, 35.0, 0.0);
    let refused = locate(&many.fan(), &drawn(&many, 0), Estimator::AnglesGeneralised, START);
    assert!(matches!(refused, Err(LocateError::TooManyAngles { .. })));
}
