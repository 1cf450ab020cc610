//! The wavelength drift on series that the virtual lab's own diode and instruments give: what was
//! set must come out, within what is stated, and what is not there must not be found.

use std::sync::Arc;
use std::time::Duration;

use beampose_analysis::wavelength_drift::{DriftLimits, Sample, WavelengthDriftInput};
use beampose_analysis::{WavelengthDriftResult, wavelength_drift};
use beampose_core::units::{Millimetre, Nanometre, Second};
use beampose_core::{Clock, Laser, Sensor, VirtualClock};
use beampose_virtual_lab::config::{
    HopAt, ModeHop, RoomConfig, ThermometerConfig, WavemeterConfig,
};
use beampose_virtual_lab::{
    SimulatedDiodeThermometer, SimulatedLaser, SimulatedThermometer, SimulatedWavemeter, World,
    WorldConfig,
};

/// As in the default rig: 0.01 nm stated, 30 % of it noise.
const METER_NOISE_NM: f64 = 0.003;
const COEFFICIENT: f64 = 0.3;
const TIME_CONSTANT_S: f64 = 1500.0;
const ROOM_DEGC_PER_HOUR: f64 = 0.2;

/// The laboratory with the default rig's meters and diode.
fn laboratory(hops: &[ModeHop]) -> WorldConfig {
    let mut config = WorldConfig::laboratory();
    config.wavemeter = WavemeterConfig { noise_nm: METER_NOISE_NM, bias_u_nm: 0.0095 };
    config.thermometer = ThermometerConfig { noise_degc: 0.1 };
    config.diode_thermometer = ThermometerConfig { noise_degc: 0.02 };
    config.room = RoomConfig { temperature_degc: 24.0, drift_degc_per_hour: ROOM_DEGC_PER_HOUR };
    config.diode.self_heating_degc = 1.02;
    config.diode.time_constant_s = TIME_CONSTANT_S;
    config.diode.tuning_nm_per_degc = COEFFICIENT;
    config.diode.mode_hops = hops.to_vec();
    // Pictures are not taken: nothing of them need be placed.
    config.cameras.clear();
    config
}

/// One series of wavelengths, diode and room temperatures.
type Readings = [Vec<Sample>; 3];

/// Every second for six minutes, every ten for a hundred, from a cold start.
fn read(config: WorldConfig, seed: u64) -> (Readings, f64) {
    let world = Arc::new(World::new(config, seed).unwrap());
    let clock = VirtualClock::starting_at(jiff::Timestamp::UNIX_EPOCH);
    let shared = || -> Arc<dyn Clock> { Arc::new(clock.clone()) };
    let laser = SimulatedLaser::new(world.clone(), shared());
    let wavemeter = SimulatedWavemeter::new(world.clone(), shared());
    let diode = SimulatedDiodeThermometer::new(world.clone(), shared());
    let room = SimulatedThermometer::new(world.clone(), shared());
    let sensors: [&dyn Sensor; 3] = [&wavemeter, &diode, &room];
    let run = async {
        laser.emit().await.unwrap();
        let lit = clock.now().monotonic.as_secs_f64();
        let mut readings: Readings = Default::default();
        let periods = [(360, 1), (600, 10)];
        for (count, seconds) in periods {
            for _ in 0..count {
                clock.sleep(Duration::from_secs(seconds)).await;
                for (sensor, samples) in sensors.iter().zip(&mut readings) {
                    let reading = sensor.read().await.unwrap();
                    samples.push(Sample {
                        at_s: reading.at.monotonic.as_secs_f64(),
                        value: reading.value,
                        standard_uncertainty: reading.standard_uncertainty,
                    });
                }
            }
        }
        (readings, lit)
    };
    tokio::runtime::Builder::new_current_thread()
        .build()
        .unwrap()
        .block_on(clock.drive(Box::pin(run)))
}

fn analysed(hops: &[ModeHop], seed: u64) -> WavelengthDriftResult {
    let config = laboratory(hops);
    let pattern = config.pattern.clone();
    let ([wavelength, diode_temperature, room_temperature], lit) = read(config, seed);
    wavelength_drift(&WavelengthDriftInput {
        wavelength,
        diode_temperature,
        room_temperature,
        light_on_s: vec![lit],
        pattern: &pattern,
        distance: Millimetre(900.0),
        measurement: Second(1800.0),
        settled_within: Nanometre(0.05),
        limits: DriftLimits::default(),
    })
    .result
}

fn hop(minutes: f64, by_nm: f64) -> ModeHop {
    ModeHop { at: HopAt::TimeS(60.0 * minutes), by_nm }
}

/// Errors in units of their stated standard uncertainty: at least nine in ten of them, and 18 of the
/// first 20, within 2; as a whole neither too large nor too small: the root mean square of n normal
/// deviates scatters by 1 / sqrt(2 n).
#[track_caller]
fn honest(name: &str, errors: &[f64]) {
    let n = errors.len() as f64;
    let rms = (errors.iter().map(|z| z * z).sum::<f64>() / n).sqrt();
    let within = errors.iter().filter(|z| z.abs() <= 2.0).count();
    let first = errors.iter().take(20).filter(|z| z.abs() <= 2.0).count();
    println!("{name}: {within} of {n} within 2 u, {first} of the first 20, rms {rms:.2}");
    assert!(within as f64 >= 0.9 * n && first >= 18, "{name}: {errors:.2?}");
    assert!((rms - 1.0).abs() < 4.0 / (2.0 * n).sqrt(), "{name}: rms {rms}: {errors:.2?}");
}

#[test]
fn what_is_set_in_the_laboratory_is_found_within_its_uncertainty() {
    let hops = [hop(40.0, 0.05), hop(75.0, -0.08)];
    for (name, hops) in [("without hops", &hops[..0]), ("with hops", &hops[..])] {
        let results: Vec<WavelengthDriftResult> =
            (0..200).map(|seed| analysed(hops, seed)).collect();
        let each =
            |z: fn(&WavelengthDriftResult) -> f64| -> Vec<f64> { results.iter().map(z).collect() };
        honest(
            &format!("coefficient {name}"),
            &each(|r| {
                let t = r.temperature.unwrap();
                (t.coefficient_nm_per_degc - COEFFICIENT) / t.standard_uncertainty_nm_per_degc
            }),
        );
        honest(
            &format!("time constant {name}"),
            &each(|r| {
                let w = r.warm_up.unwrap();
                (w.time_constant_s - TIME_CONSTANT_S) / w.time_constant_standard_uncertainty_s
            }),
        );
        honest(
            &format!("steady drift {name}"),
            &each(|r| {
                let d = r.steady_drift.unwrap();
                let set = COEFFICIENT * ROOM_DEGC_PER_HOUR;
                (d.drift_nm_per_hour - set) / d.standard_uncertainty_nm_per_hour
            }),
        );
        let t = results[0].temperature.unwrap();
        println!(
            "{name}: coefficient {:.5} +- {:.5} nm/degC (ordinary line {:.5}), time constant {:.1} +- {:.1} s",
            t.coefficient_nm_per_degc,
            t.standard_uncertainty_nm_per_degc,
            t.ordinary_nm_per_degc,
            results[0].warm_up.unwrap().time_constant_s,
            results[0].warm_up.unwrap().time_constant_standard_uncertainty_s,
        );
    }
}

/// The correction matters: an ordinary line would be wrong by more than its uncertainty allows.
#[test]
fn an_ordinary_line_over_a_noisy_temperature_would_be_too_flat() {
    let results = (0..100).map(|seed| analysed(&[], seed).temperature.unwrap());
    let z: Vec<f64> = results
        .map(|t| (t.ordinary_nm_per_degc - COEFFICIENT) / t.standard_uncertainty_nm_per_degc)
        .collect();
    let mean = z.iter().sum::<f64>() / z.len() as f64;
    println!("ordinary line: mean error {mean:.2} standard uncertainties");
    // The mean of a hundred scatters by 0.1.
    assert!(mean < -0.5, "{mean}");
}

#[test]
fn there_is_no_false_alarm_over_a_hundred_minutes() {
    let seeds = 0..200;
    let count = seeds.clone().count();
    let alarms: usize = seeds.map(|seed| analysed(&[], seed).hops.len()).sum();
    println!("false alarms in {count} series without a hop: {alarms}");
    assert_eq!(alarms, 0);
}

#[test]
fn every_hop_of_0_05_nm_is_found_where_it_is_and_nothing_else() {
    let (mut sizes, mut weakest) = (Vec::new(), f64::INFINITY);
    for seed in 0..100 {
        // At another time each: within the fast readings too.
        let minutes = 2.0 + 1.03 * seed as f64 % 100.0;
        let by_nm = if seed % 2 == 0 { 0.05 } else { -0.05 };
        let found = analysed(&[hop(minutes, by_nm)], 1000 + seed).hops;
        assert_eq!(found.len(), 1, "seed {seed}, {minutes} min: {found:?}");
        // The world's time is half a second ahead of the light's.
        let late = found[0].at_s + 0.5 - 60.0 * minutes;
        assert!(late.abs() <= 6.0, "seed {seed}: {late} s late");
        sizes.push((found[0].by_nm - by_nm) / found[0].by_standard_uncertainty_nm);
        weakest = weakest.min(found[0].significance);
    }
    println!("100 hops of 0.05 nm found, none more; the weakest stands out by {weakest:.1} u");
    honest("sizes of hops", &sizes);
}

#[test]
fn a_hop_at_a_temperature_is_found_when_the_diode_reaches_it() {
    let at = ModeHop { at: HopAt::DiodeDegc(24.6), by_nm: 0.05 };
    let found = analysed(&[at], 5).hops;
    assert_eq!(found.len(), 1);
    // 24.6 = 24 + 1.02 (1 - exp(-t / 1500)) + 0.2 t / 3600: at 1190 s, by hand.
    let reached = |t: f64| 1.02 * (1.0 - (-t / 1500.0_f64).exp()) + 0.2 * (t + 0.5) / 3600.0;
    assert!((reached(found[0].at_s) - 0.6).abs() < 0.005, "{found:?}");
}

#[test]
fn the_recommended_warm_up_is_that_of_the_set_course() {
    // The change in 30 min from t: the settling that is left, and the room's drift.
    let rise = COEFFICIENT * 1.02;
    let drift = COEFFICIENT * ROOM_DEGC_PER_HOUR * 0.5;
    let left = |t: f64| rise * (-t / TIME_CONSTANT_S).exp() * (1.0 - (-1.2_f64).exp()) + drift;
    let settled = -TIME_CONSTANT_S * ((0.05 - drift) / (rise * (1.0 - (-1.2_f64).exp()))).ln();
    assert!((left(settled) - 0.05).abs() < 1e-12);
    let mut errors = Vec::new();
    for seed in 0..100 {
        let found = analysed(&[], seed).recommendation.unwrap();
        errors.push((found.warm_up_s - settled) / found.warm_up_standard_uncertainty_s.unwrap());
        assert!(found.largest_change_nm <= 0.05);
        let change = left(found.warm_up_s) - found.largest_change_nm;
        assert!(change.abs() < 4.0 * found.largest_change_standard_uncertainty_nm, "{found:?}");
    }
    println!("recommended warm-up as set: {:.1} min", settled / 60.0);
    honest("recommended warm-up", &errors);
}
