//! The wavelength drift on constructed series, and its page.

use beampose_analysis::wavelength_drift::{DriftLimits, PointMark, Sample, WavelengthDriftInput};
use beampose_analysis::{Verdict, WavelengthDrift, html, wavelength_drift};
use beampose_core::units::{Millimetre, Nanometre, Second};
use beampose_photogrammetry::{Pattern, PatternUncertainty};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};

use crate::synthetic::around;

const TAU: f64 = 900.0;

/// A course of 70 minutes, a reading every ten seconds, with what `more` adds to it.
fn samples(seed: u64, more: impl Fn(f64) -> f64) -> Vec<Sample> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut noise = move || {
        let normal: f64 = StandardNormal.sample(&mut rng);
        0.003 * normal
    };
    let one = |i: u32| {
        let t = 10.0 * f64::from(i);
        let value = 658.0 - 0.3 * (-t / TAU).exp() + more(t) + noise();
        Sample { at_s: 100.0 + t, value, standard_uncertainty: Some(0.01) }
    };
    let mut samples = Vec::new();
    let mut one = one;
    for i in 1..=420 {
        samples.push(one(i));
    }
    samples
}

fn pattern() -> Pattern {
    Pattern::equal_angle(
        11,
        2.9_f64.to_radians(),
        PatternUncertainty { angle_deg: 0.0, common_relative: 0.0 },
    )
}

fn input(pattern: &Pattern, wavelength: Vec<Sample>) -> WavelengthDriftInput<'_> {
    WavelengthDriftInput {
        wavelength,
        diode_temperature: Vec::new(),
        room_temperature: Vec::new(),
        light_on_s: vec![100.0],
        pattern,
        distance: Millimetre(900.0),
        measurement: Second(1200.0),
        settled_within: Nanometre(0.03),
        limits: DriftLimits {
            max_drift_per_hour: Some(Nanometre(0.1)),
            max_position_error: Some(Millimetre(0.05)),
            max_hops: Some(0),
            max_warm_up: Some(Second(2700.0)),
        },
    }
}

fn analysed(wavelength: Vec<Sample>) -> WavelengthDrift {
    wavelength_drift(&input(&pattern(), wavelength))
}

#[test]
fn a_diode_that_settles_passes_and_one_that_hops_or_drifts_does_not() {
    let settling = analysed(samples(1, |_| 0.0));
    assert_eq!(settling.result.verdict, Verdict::Pass, "{:?}", settling.result.reasons);
    let hopping = analysed(samples(1, |t| if t > 3000.0 { 0.02 } else { 0.0 }));
    assert_eq!(hopping.result.verdict, Verdict::Fail);
    assert_eq!(hopping.result.hops.len(), 1);
    assert_eq!(hopping.series.iter().filter(|p| p.mark == PointMark::Hop).count(), 1);
    let drifting = analysed(samples(1, |t| 0.2 * t / 3600.0));
    assert_eq!(drifting.result.verdict, Verdict::Fail, "{:?}", drifting.result.reasons);
    // 0.2 nm/h are 0.07 nm in twenty minutes: it never stays within 0.03.
    assert!(drifting.result.recommendation.is_none());
}

#[test]
fn a_stray_reading_is_marked_and_changes_nothing() {
    let mut stray = samples(2, |_| 0.0);
    stray[200].value += 0.3;
    let (with, without) = (analysed(stray), analysed(samples(2, |_| 0.0)));
    assert_eq!((with.result.stray_readings, with.result.hops.len()), (1, 0));
    assert_eq!(with.series[200].mark, PointMark::Stray);
    let tau = |d: &WavelengthDrift| d.result.warm_up.unwrap().time_constant_s;
    assert!((tau(&with) - tau(&without)).abs() < 5.0);
}

#[test]
fn of_two_warm_ups_the_longer_is_analysed() {
    let mut all = samples(3, |_| 0.0);
    all.truncate(100);
    let again = samples(4, |_| 0.0).into_iter().map(|s| Sample { at_s: s.at_s + 2000.0, ..s });
    all.extend(again);
    let pattern = pattern();
    let two = WavelengthDriftInput { light_on_s: vec![100.0, 2100.0], ..input(&pattern, all) };
    let found = wavelength_drift(&two).result;
    assert_eq!((found.readings, found.hops.len()), (420, 0));
    assert!(found.notes[0].contains("longest of 2 stretches"), "{:?}", found.notes);
    assert!((found.warm_up.unwrap().time_constant_s - TAU).abs() < 100.0);
}

#[test]
fn nothing_few_or_equal_readings_give_no_verdict_and_a_page() {
    let mut constant = samples(5, |_| 0.0);
    constant.iter_mut().for_each(|s| s.value = 658.0);
    let mut broken = samples(5, |_| 0.0);
    broken.iter_mut().for_each(|s| s.value = f64::NAN);
    let few = samples(5, |_| 0.0).into_iter().take(12).collect();
    for (name, wavelength) in
        [("none", vec![]), ("few", few), ("broken", broken), ("constant", constant)]
    {
        let found = analysed(wavelength);
        let mut input = around(vec![]);
        input.experiment = "wavelength-drift".to_owned();
        (input.verdict, input.reasons) = (found.result.verdict, found.result.reasons.clone());
        if name == "constant" {
            assert_eq!(found.result.verdict, Verdict::Pass, "{:?}", found.result);
        } else {
            assert_eq!(found.result.verdict, Verdict::Inconclusive, "{name}");
        }
        input.drift = Some(found);
        crate::report::check(&html(&input));
        assert!(beampose_analysis::json(&input).is_ok());
    }
}

#[test]
fn the_page_shows_what_was_found() {
    let pattern = pattern();
    let mut input_of = input(&pattern, samples(6, |t| if t > 3000.0 { 0.05 } else { 0.0 }));
    let degc = |s: &Sample| {
        let t = s.at_s - 100.0;
        // The same as the wavelength's course, at 0.3 nm a degree.
        Sample { value: 25.0 - (-t / TAU).exp() + 0.005 * (t * 7.7).sin(), ..*s }
    };
    input_of.diode_temperature = input_of.wavelength.iter().map(degc).collect();
    input_of.room_temperature =
        input_of.wavelength.iter().map(|s| Sample { value: 24.0, ..*s }).collect();
    let found = wavelength_drift(&input_of);
    let coefficient = found.result.temperature.unwrap();
    let error = coefficient.coefficient_nm_per_degc - 0.3;
    assert!(error.abs() < 4.0 * coefficient.standard_uncertainty_nm_per_degc, "{coefficient:?}");
    let mut input = around(vec![]);
    input.experiment = "wavelength-drift".to_owned();
    (input.verdict, input.reasons) = (found.result.verdict, found.result.reasons.clone());
    input.drift = Some(found);
    let page = html(&input);
    crate::report::check(&page);
    for said in ["Mode hops", "nm/°C", "Allan deviation", "eq. 4.12", "420 of the wavelength"] {
        assert!(page.contains(said), "{said}");
    }
    assert!(!page.contains("Computing time") && !page.contains("none were taken"));
    let csv = beampose_analysis::series_csv(&input.drift.unwrap().series);
    assert_eq!(csv.lines().count(), 421);
    assert!(csv.lines().nth(1).unwrap().ends_with(",0,warming_up"), "{csv}");
}
