use std::sync::Arc;
use std::time::Duration;

use beampose_core::instrument::AxisUnit;
use beampose_core::{
    Axis, Camera, Clock, Emission, Frame, InstrumentError, Laser, Sensor, VirtualClock,
};

use super::{clean, small};
use crate::History;
use crate::config::RotationConfig;
use crate::{
    SimulatedCamera, SimulatedDiodeThermometer, SimulatedLaser, SimulatedRail, SimulatedRotation,
    SimulatedThermometer, SimulatedWavemeter, World, WorldConfig, WorldError,
};

/// A world with its clock, and one of each instrument.
struct Bench {
    world: Arc<World>,
    clock: VirtualClock,
    rail: SimulatedRail,
    laser: SimulatedLaser,
    wavemeter: SimulatedWavemeter,
    thermometer: SimulatedThermometer,
    cameras: Vec<SimulatedCamera>,
}

fn bench(config: WorldConfig) -> Bench {
    let world = Arc::new(World::new(config, 11).unwrap());
    let clock = VirtualClock::starting_at(jiff::Timestamp::UNIX_EPOCH);
    let shared = || -> Arc<dyn Clock> { Arc::new(clock.clone()) };
    let camera = |name: &String| SimulatedCamera::new(world.clone(), shared(), name).unwrap();
    Bench {
        rail: SimulatedRail::new(world.clone(), shared()).unwrap(),
        laser: SimulatedLaser::new(world.clone(), shared()),
        wavemeter: SimulatedWavemeter::new(world.clone(), shared()),
        thermometer: SimulatedThermometer::new(world.clone(), shared()),
        cameras: world.config().cameras.keys().map(camera).collect(),
        world,
        clock,
    }
}

/// Runs in virtual time.
fn run<T: Send>(clock: &VirtualClock, future: impl Future<Output = T> + Send) -> T {
    futures::executor::block_on(clock.drive(Box::pin(future)))
}

async fn capture(bench: &Bench) -> Vec<Frame> {
    let frames = futures::future::join_all(bench.cameras.iter().map(|c| c.trigger())).await;
    frames.into_iter().map(Result::unwrap).collect()
}

#[test]
fn the_wavelength_drifts_by_0_4_nm_in_100_minutes() {
    let bench = bench(clean(small()));
    let clock = &bench.clock;
    run(clock, async {
        bench.laser.emit().await.unwrap();
        let (first, start) = (bench.wavemeter.read().await.unwrap(), clock.now());
        clock.sleep(Duration::from_secs(6000)).await;
        let (last, end) = (bench.wavemeter.read().await.unwrap(), clock.now());
        assert_eq!(last.at.monotonic - first.at.monotonic, Duration::from_secs(6000));
        let true_drift =
            bench.world.truth_at(end).wavelength_nm - bench.world.truth_at(start).wavelength_nm;
        assert!((true_drift - 0.4).abs() < 1e-9, "{true_drift}");
        // Two readings with noise 0.01 nm each.
        assert!((last.value - first.value - 0.4).abs() < 4.0 * 0.01 * 2.0_f64.sqrt());
    });
}

#[test]
fn the_wavelength_meter_has_its_own_bias_and_sees_nothing_in_the_dark() {
    let bench = bench(small());
    run(&bench.clock, async {
        assert!(matches!(bench.wavemeter.read().await, Err(InstrumentError::Refused(_))));
        bench.laser.emit().await.unwrap();
        let mut sum = 0.0;
        for _ in 0..100 {
            let reading = bench.wavemeter.read().await.unwrap();
            sum += reading.value - bench.world.truth_at(reading.at).wavelength_nm;
        }
        let bias = bench.world.true_parameters().wavemeter_bias_nm;
        assert!((sum / 100.0 - bias).abs() < 4.0 * 0.01 / 10.0, "{} not {bias}", sum / 100.0);
        let room = bench.thermometer.read().await.unwrap();
        assert!((room.value - 22.0).abs() < 4.0 * 0.05);
    });
}

#[test]
fn the_thermometer_on_the_diode_follows_it_with_noise_of_its_own() {
    let bench = bench(small());
    let shared = || -> Arc<dyn Clock> { Arc::new(bench.clock.clone()) };
    let diode = SimulatedDiodeThermometer::new(bench.world.clone(), shared());
    let history = History { diode_temperature_reads: 300, ..History::default() };
    let resumed = Arc::new(World::after(small(), 11, history).unwrap());
    let resumed = SimulatedDiodeThermometer::new(resumed, shared());
    run(&bench.clock, async {
        let again = resumed.read().await.unwrap().value;
        let room = bench.thermometer.read().await.unwrap().value;
        bench.laser.emit().await.unwrap();
        bench.clock.sleep(Duration::from_secs(600)).await;
        let mut squares = 0.0;
        for _ in 0..300 {
            let reading = diode.read().await.unwrap();
            squares += (reading.value - bench.world.truth_at(reading.at).diode_degc).powi(2);
        }
        // 300 draws: a standard deviation good to 4 %.
        assert!(((squares / 300.0_f64).sqrt() / 0.02 - 1.0).abs() < 4.0 * 0.041);
        // A run that goes on takes the next number of the diode's noise.
        let next = diode.read().await.unwrap().value;
        let now = bench.world.truth_at(bench.clock.now()).diode_degc;
        let cold = bench
            .world
            .truth_at(beampose_core::Stamp { monotonic: Duration::ZERO, ..bench.clock.now() });
        // Both as shown, in steps of 0.001 degrees.
        assert!((next - now - (again - cold.diode_degc)).abs() <= 0.001);
        assert!((room - 22.0).abs() < 4.0 * 0.05, "the room's is another one: {room}");
    });
}

#[test]
fn cameras_triggered_together_show_the_same_moment_with_consistent_stamps() {
    let bench = bench(small());
    run(&bench.clock, async {
        bench.laser.emit().await.unwrap();
        for index in 0..2 {
            let requested = bench.clock.now();
            let frames = capture(&bench).await;
            for ((name, config), frame) in bench.world.config().cameras.iter().zip(&frames) {
                let busy = config.trigger_delay_s + config.exposure_s + config.readout_s;
                assert_eq!(frame.requested, requested);
                let took = frame.delivered.monotonic - requested.monotonic;
                assert!((took.as_secs_f64() - busy).abs() < 1e-6);
                let middle = config.trigger_delay_s + config.exposure_s / 2.0;
                let exposed = requested.monotonic + Duration::from_secs_f64(middle);
                let module = bench.world.module_at(exposed);
                assert!(frame.bytes == bench.world.render_jpeg(name, &module, index).unwrap());
            }
            let longest = 0.035 + 0.5;
            let passed = bench.clock.now().monotonic - requested.monotonic;
            assert!((passed.as_secs_f64() - longest).abs() < 1e-6);
        }
    });
}

#[test]
fn a_resumed_camera_goes_on_with_the_next_picture() {
    let first = bench(small());
    let frames = run(&first.clock, async {
        capture(&first).await;
        capture(&first).await
    });
    let history = History {
        triggers: first.world.config().cameras.keys().map(|name| (name.clone(), 1)).collect(),
        ..History::default()
    };
    let world = Arc::new(World::after(small(), 11, history).unwrap());
    let again = bench(small());
    let clock: Arc<dyn Clock> = Arc::new(again.clock.clone());
    let camera = SimulatedCamera::new(world, clock, "cam_a").unwrap();
    let frame = run(&again.clock, async { camera.trigger().await.unwrap() });
    assert!(frame.bytes == frames[0].bytes);
}

#[test]
fn the_rail_refuses_beyond_its_limits_and_stays() {
    let bench = bench(small());
    run(&bench.clock, async {
        for target in [-0.001, 900.001, f64::NAN] {
            assert!(matches!(bench.rail.move_to(target).await, Err(InstrumentError::Refused(_))));
        }
        assert_eq!(bench.world.truth_at(bench.clock.now()).rail_mm, Some(0.0));
        assert_eq!(bench.clock.now().monotonic, Duration::ZERO);
    });
}

#[test]
fn the_rail_takes_its_time_and_its_encoder_knows_nothing_of_its_scale_error() {
    let bench = bench(small());
    run(&bench.clock, async {
        bench.rail.move_to(700.0).await.unwrap();
        let now = bench.clock.now();
        assert!((now.monotonic.as_secs_f64() - 14.5).abs() < 1e-3);
        let truth = bench.world.truth_at(now);
        let reading = bench.rail.position().await.unwrap();
        // Encoder noise 1 um before rounding to 1 um.
        assert!((reading.value - truth.rail_mm.unwrap()).abs() < 0.006);
        assert!((reading.value - 700.0).abs() < 0.016);
        let micrometres = reading.value * 1000.0;
        assert!((micrometres - micrometres.round()).abs() < 1e-6);
        // 700 mm are 7 um longer than the encoder says; straightness is across the rail.
        let travelled = truth.position_mm[2] - 900.0;
        assert!((travelled - truth.rail_mm.unwrap() * (1.0 + 1e-5)).abs() < 1e-9);
        assert!(
            bench
                .world
                .truth_at(beampose_core::Stamp { monotonic: Duration::from_secs(7), ..now })
                .rail_mm
                .unwrap()
                < 351.0
        );
    });
}

#[test]
fn a_stopped_move_says_so() {
    let bench = bench(small());
    run(&bench.clock, async {
        let halt = async {
            bench.clock.sleep(Duration::from_secs(3)).await;
            bench.rail.stop().await.unwrap();
        };
        let (moved, ()) = futures::future::join(bench.rail.move_to(700.0), halt).await;
        assert!(matches!(moved, Err(InstrumentError::Refused(_))));
        let stands = bench.rail.position().await.unwrap().value;
        assert!((stands - 150.0).abs() < 0.1, "{stands}");
    });
}

#[test]
fn the_laser_is_off_at_start_and_shines_after_its_delay() {
    let bench = bench(small());
    run(&bench.clock, async {
        assert_eq!(bench.laser.emission().await, Emission::Off);
        let dark = capture(&bench).await;
        let before = bench.clock.now();
        bench.laser.emit().await.unwrap();
        assert_eq!(bench.clock.now().monotonic - before.monotonic, Duration::from_millis(500));
        assert!(!bench.world.truth_at(before).emitting);
        assert_eq!(bench.laser.emission().await, Emission::On);
        let lit = capture(&bench).await;
        bench.laser.off_without_waiting();
        assert_eq!(bench.laser.emission().await, Emission::Off);
        let brightest = |frame: &Frame| {
            let picture = beampose_photogrammetry::decode(&frame.bytes).unwrap();
            picture.data.iter().copied().max().unwrap()
        };
        let (lit, dark) = (brightest(&lit[1]), brightest(&dark[1]));
        // The zero order is the brightest; without it the labels of grey 130 are.
        assert!(lit > dark + 40 && dark < 170, "{lit} {dark}");
    });
}

#[test]
fn a_world_without_a_rotation_stage_has_no_such_instrument() {
    let bench = bench(small());
    let clock: Arc<dyn Clock> = Arc::new(bench.clock.clone());
    let missing = SimulatedRotation::new(bench.world.clone(), clock).err();
    assert_eq!(missing, Some(WorldError::NoStage("rotation stage")));
}

#[test]
fn the_rotation_stage_turns_the_module() {
    let mut config = clean(small());
    let mut stage = config.rail.unwrap().stage;
    (stage.limits, stage.speed_per_s, stage.positioning_sigma) = ([-60.0, 60.0], 20.0, 0.0);
    config.rotation = Some(RotationConfig {
        misalignment_u_mm: [0.0; 3],
        tilt_u_deg: 0.0,
        stage,
        axis_point_mm: [0.0, 0.0, 900.0],
        axis_direction: [0.0, 1.0, 0.0],
    });
    let bench = bench(config);
    let clock: Arc<dyn Clock> = Arc::new(bench.clock.clone());
    let rotation = SimulatedRotation::new(bench.world.clone(), clock).unwrap();
    assert_eq!(rotation.unit(), AxisUnit::Degree);
    run(&bench.clock, async { rotation.move_to(30.0).await.unwrap() });
    let truth = bench.world.truth_at(bench.clock.now());
    assert_eq!(truth.rotation_deg, Some(30.0));
    let q = beampose_photogrammetry::rotation::from_wxyz(truth.quaternion_wxyz);
    let phi = beampose_photogrammetry::rotation::omega_phi_kappa(&q)[1].to_degrees();
    // The rail's turning is a few arc seconds.
    assert!((phi - 30.0).abs() < 0.005, "{phi}");
}
