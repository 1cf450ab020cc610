//! Distances, fit, uncertainties and verdict on constructed passes.

use std::collections::BTreeMap;

use beampose_analysis::{
    Decision, DistanceRule, JointCovariance, Limits, StatedScale, TranslationInput,
    TranslationResult, TravelCapture, Verdict, translation,
};
use beampose_core::units::Millimetre;
use beampose_core::{CaptureId, Pose};
use beampose_photogrammetry::solve::Method;

const METHOD: Method = Method::VirtualCamera;

/// A pose at `z` above (1, 2, 900) with standard uncertainties of the coordinates.
pub fn pose(z: f64, u: [f64; 3]) -> Pose {
    let mut covariance = [[0.0; 6]; 6];
    for i in 0..3 {
        covariance[i][i] = u[i] * u[i];
        covariance[3 + i][3 + i] = 1e-8;
    }
    Pose { position_mm: [1.0, 2.0, 900.0 + z], quaternion_wxyz: [0.0, 1.0, 0.0, 0.0], covariance }
}

fn capture(pass: u32, rail: f64, pose: Result<Pose, String>) -> TravelCapture {
    TravelCapture {
        id: CaptureId(format!("p{pass}_{rail}")),
        pass,
        setpoint: Millimetre(rail),
        readback: Millimetre(rail + 0.001),
        poses: BTreeMap::from([(METHOD, pose)]),
    }
}

/// Passes over 0, 300, 600 mm; `error(pass, rail)` is added to the true travel.
fn passes(n: u32, error: impl Fn(u32, f64) -> f64) -> Vec<TravelCapture> {
    let stop = |pass, rail: f64| {
        let z = if rail == 0.0 { 0.0 } else { rail + error(pass, rail) };
        capture(pass, rail, Ok(pose(z, [0.4, 0.4, 0.03])))
    };
    (1..=n).flat_map(|p| [0.0, 300.0, 600.0].map(|rail| stop(p, rail))).collect()
}

fn input(captures: Vec<TravelCapture>) -> TranslationInput<'static> {
    TranslationInput {
        captures,
        scale_relative_u: 0.0,
        stated_scale: StatedScale::Separate,
        rule: DistanceRule::AlongTravel,
        limits: Limits {
            max_abs_difference: [(METHOD, Millimetre(0.5))].into(),
            ..Limits::default()
        },
    }
}

/// Differences of coordinates near 1500 mm are exact to about 1e-12 mm.
#[track_caller]
fn close(got: f64, expect: f64) {
    assert!((got - expect).abs() < 1e-9, "{got} is not {expect}");
}

#[test]
fn a_known_slope_is_found_and_the_first_stop_is_zero() {
    let result = translation(&input(passes(2, |_, rail| 0.0005 * rail)));
    let method = &result.methods[&METHOD];
    close(method.slope.unwrap(), 1.0005);
    close(method.offset_mm.unwrap(), 0.0);
    close(method.slope_standard_error.unwrap(), 0.0);
    let means: Vec<f64> = method.positions.iter().map(|p| p.mean_difference_mm).collect();
    for (got, expect) in means.into_iter().zip([0.0, 0.15, 0.3]) {
        close(got, expect);
    }
    assert_eq!((result.captures, result.solved, result.verdict), (6, 6, Verdict::Pass));
}

#[test]
fn mean_and_deviation_over_passes_are_those_of_the_differences() {
    let result = translation(&input(passes(3, |pass, _| 0.1 * f64::from(pass))));
    let stop = result.methods[&METHOD].positions[2];
    close(stop.mean_difference_mm, 0.2);
    close(stop.standard_deviation_mm.unwrap(), 0.1);
    assert_eq!((stop.rail_mm, stop.passes), (600.0, 3));
}

#[test]
fn the_uncertainty_of_a_mean_is_repeatability_stated_part_and_scale() {
    let mut input = input(passes(3, |pass, _| 0.1 * f64::from(pass)));
    input.scale_relative_u = 0.0004;
    let stop = translation(&input).methods[&METHOD].positions[2];
    // 0.1 over three passes; 0.03 along z at start and end; 0.04 % of the measured distance.
    let scale = 0.0004 * 600.2;
    let expect = (0.01_f64 / 3.0 + 2.0 * 0.03 * 0.03 + scale * scale).sqrt();
    close(stop.standard_uncertainty_mm, expect);
    close(stop.expanded_uncertainty_mm, 2.0 * expect);
}

#[test]
fn a_stated_covariance_that_contains_the_scale_does_not_get_it_twice() {
    let mut input = input(passes(1, |_, _| 0.0));
    input.scale_relative_u = 0.00001;
    input.stated_scale = StatedScale::Included;
    let stop = translation(&input).methods[&METHOD].positions[2];
    close(stop.standard_uncertainty_mm, 0.03 * 2.0_f64.sqrt());
    // But a distance is never better than the scale that it is measured with.
    input.scale_relative_u = 0.0004;
    let stop = translation(&input).methods[&METHOD].positions[2];
    close(stop.standard_uncertainty_mm, 0.24);
}

#[test]
fn only_the_direction_of_travel_counts_unless_all_coordinates_are_asked_for() {
    let mut input = input(passes(1, |_, _| 0.0));
    let along = translation(&input).methods[&METHOD].positions[1];
    close(along.standard_uncertainty_mm, 0.03 * 2.0_f64.sqrt());
    input.rule = DistanceRule::AllCoordinates;
    let all = translation(&input).methods[&METHOD].positions[1];
    close(all.standard_uncertainty_mm, (2.0 * (2.0 * 0.16 + 0.0009_f64)).sqrt());
}

/// Every capture shares `common` and has `own` of its own.
struct Shared {
    common: f64,
    own: f64,
}

impl JointCovariance for Shared {
    fn block(&self, a: &CaptureId, b: &CaptureId) -> Option<[[f64; 3]; 3]> {
        let variance = self.common + if a == b { self.own } else { 0.0 };
        Some([[variance, 0.0, 0.0], [0.0, variance, 0.0], [0.0, 0.0, variance]])
    }
}

#[test]
fn with_a_joint_covariance_what_is_common_cancels_in_a_distance() {
    let joint = Shared { common: 0.25, own: 0.01 };
    let mut input = input(passes(4, |_, _| 0.0));
    input.rule = DistanceRule::Joint(&joint);
    let result = translation(&input);
    let method = &result.methods[&METHOD];
    close(method.positions[1].standard_uncertainty_mm, (2.0 * 0.01 / 4.0_f64).sqrt());
    close(method.differences[1].expanded_uncertainty_mm, 2.0 * (2.0 * 0.01_f64).sqrt());
}

#[test]
fn the_verdict_follows_limit_decision_and_solved_fraction() {
    let check = |error: f64, edit: &dyn Fn(&mut Limits)| {
        let mut input = input(passes(1, |_, rail| if rail > 300.0 { error } else { 0.0 }));
        edit(&mut input.limits);
        translation(&input).verdict
    };
    // U of the one pass is 2 * 0.03 * sqrt(2) = 0.085 mm.
    assert_eq!(check(0.45, &|_| ()), Verdict::Pass);
    assert_eq!(check(-0.55, &|_| ()), Verdict::Fail);
    assert_eq!(check(0.45, &|l| l.decision = Decision::GuardBand), Verdict::Inconclusive);
    assert_eq!(check(0.40, &|l| l.decision = Decision::GuardBand), Verdict::Pass);
    assert_eq!(check(0.60, &|l| l.decision = Decision::GuardBand), Verdict::Fail);
    assert_eq!(check(0.0, &|l| l.max_abs_difference.clear()), Verdict::Inconclusive);
    assert_eq!(check(0.0, &|l| l.min_solved_fraction = Some(1.0)), Verdict::Pass);
}

#[test]
fn a_pass_without_its_first_pose_gives_no_distances_and_says_so() {
    let mut captures = passes(2, |_, _| 0.0);
    captures[0].poses.insert(METHOD, Err("too few dots".to_owned()));
    let mut input = input(captures);
    input.limits.min_solved_fraction = Some(0.9);
    let result = translation(&input);
    let method = &result.methods[&METHOD];
    assert_eq!((result.solved, method.solved, method.differences.len()), (5, 5, 3));
    assert!(method.notes[0].contains("pass 1") && method.notes[0].contains("2 other"));
    assert_eq!(result.verdict, Verdict::Fail, "5 of 6 are fewer than 90 %");
}

#[test]
fn nothing_at_all_is_inconclusive_and_has_no_numbers() {
    for captures in
        [vec![], vec![capture(1, 0.0, Err("dark".to_owned()))], passes(1, |_, _| 0.0)[..1].to_vec()]
    {
        let result = translation(&input(captures));
        assert_eq!(result.verdict, Verdict::Inconclusive);
        for method in result.methods.values() {
            assert_eq!((method.slope, method.within_expanded_uncertainty), (None, None));
        }
    }
}

#[test]
fn differences_are_held_against_their_own_uncertainty() {
    // U is 0.085 mm: of six moved captures those of passes 1 and 2 are within, that of 3 is not.
    let result = translation(&input(passes(3, |pass, _| 0.04 * f64::from(pass))));
    close(result.methods[&METHOD].within_expanded_uncertainty.unwrap(), 4.0 / 6.0);
}

#[test]
fn the_json_has_the_keys_that_other_programs_read() {
    let result: TranslationResult = translation(&input(passes(2, |_, _| 0.1)));
    let value = serde_json::to_value(&result).unwrap();
    assert_eq!(value["experiment"], "translation");
    assert_eq!(value["verdict"], "pass");
    let stop = &value["methods"]["virtual-camera"]["positions"][1];
    for key in [
        "rail_mm",
        "mean_difference_mm",
        "standard_uncertainty_mm",
        "expanded_uncertainty_mm",
        "standard_deviation_mm",
        "passes",
    ] {
        assert!(stop[key].is_number(), "{key} in {stop}");
    }
    assert_eq!(serde_json::from_value::<TranslationResult>(value).unwrap(), result);
}
