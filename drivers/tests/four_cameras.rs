//! Four cameras of libgphoto2 at once, each with its helper program: how far apart their releases
//! are, and whose picture each brings.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, Instant};

use beampose_core::{Camera, VirtualClock};
use beampose_drivers::sim::{Part, Shutter, Simulated};
use beampose_drivers::{Connected, Options, Role, Setting, Simulator};
use futures::future::join_all;

const NAMES: [&str; 4] = ["left", "right", "top", "bottom"];
const SHOTS: usize = 20;
const ROUNDS: usize = 3;
/// All shots but one of a round are at least so good: a computer that is busy with other things may
/// delay one. Where it is busier yet, another round is tried.
const SKEW: Duration = Duration::from_millis(10);
/// As big as the picture of a camera of 5 megapixels.
const BYTES: usize = 2 << 20;

/// Pictures that tell whose they are, and which. Made beforehand: a camera has a processor of its
/// own, and takes none from the others.
struct Marked {
    camera: u8,
    shots: AtomicU8,
    plain: Arc<Vec<u8>>,
}

fn plain() -> Vec<u8> {
    let mut bytes = vec![0xff, 0xd8, 0xff, 0xe0, 0, 0];
    bytes.extend((0..BYTES).map(|i| (i % 251) as u8));
    bytes.extend([0xff, 0xd9]);
    bytes
}

fn marked(plain: &[u8], camera: u8, shot: u8) -> Vec<u8> {
    let mut bytes = plain.to_vec();
    bytes[4..6].copy_from_slice(&[camera, shot]);
    bytes
}

impl Shutter for Marked {
    fn expose(&self) -> Result<Vec<u8>, String> {
        Ok(marked(&self.plain, self.camera, self.shots.fetch_add(1, Ordering::SeqCst)))
    }
}

#[test]
fn four_cameras_are_released_together() {
    let driver = beampose_drivers::find("camera", "gphoto2").unwrap();
    let Simulator::Hosted(make) = driver.simulator else { unreachable!() };
    let clock = VirtualClock::starting_at(jiff::Timestamp::UNIX_EPOCH);
    let options = Options::read(driver.options, &BTreeMap::new()).unwrap();
    let role = Role::Camera { exposure: None, delivery: Some(Duration::from_secs(5)) };
    let plain = Arc::new(plain());
    let all: Vec<Simulated> = (0..4)
        .map(|camera| {
            let it = Marked { camera, shots: AtomicU8::new(0), plain: Arc::clone(&plain) };
            Simulated {
                name: NAMES[usize::from(camera)].to_owned(),
                options: options.clone(),
                role,
                part: Part::Shutter(Arc::new(it)),
                clock: Arc::new(clock.clone()),
            }
        })
        .collect();
    let hosted = make(&all).unwrap();
    if let Some(why) = hosted.lacks() {
        let _ = writeln!(std::io::stderr(), "not tried here: four cameras at once: {why}");
        return;
    }
    let scratch = tempfile::tempdir().unwrap();
    let cameras: Vec<Arc<dyn Camera>> = NAMES
        .iter()
        .map(|name| {
            let setting = Setting {
                name: (*name).to_owned(),
                address: hosted.address(name).unwrap(),
                line: None,
                clock: Arc::new(clock.clone()),
                options: options.clone(),
                role,
                deadline: Duration::from_millis(500),
                simulated: true,
                scratch: scratch.path().to_owned(),
            };
            match (driver.connect)(setting).unwrap() {
                Connected::Camera(it) => it,
                _ => unreachable!(),
            }
        })
        .collect();
    for round in 0..ROUNDS {
        for shot in round * SHOTS..(round + 1) * SHOTS {
            futures::executor::block_on(clock.drive(Box::pin(async {
                for armed in join_all(cameras.iter().map(|it| it.arm())).await {
                    armed.unwrap();
                }
                let frames = join_all(cameras.iter().map(|it| it.trigger())).await;
                for (number, frame) in frames.into_iter().enumerate() {
                    let expected = marked(&plain, number as u8, shot as u8);
                    assert!(frame.unwrap().bytes == expected, "{shot} of {number}, byte for byte");
                }
            })));
        }
        let released: Vec<_> = NAMES.iter().map(|name| hosted.releases(name)).collect();
        let skews = skews(&released, round * SHOTS);
        let _ = writeln!(
            std::io::stderr(),
            "four cameras, {SHOTS} shots, {} pictures of {BYTES} bytes the same byte for byte; \
             their releases were apart by {:.2} ms (median), {:.2} ms (worst)",
            SHOTS * NAMES.len(),
            skews[SHOTS / 2].as_secs_f64() * 1e3,
            skews[SHOTS - 1].as_secs_f64() * 1e3,
        );
        if skews[SHOTS - 2] <= SKEW {
            return;
        }
    }
    panic!("{ROUNDS} rounds, and in none all cameras fired within {SKEW:?}");
}

/// How far apart the releases of each shot of a round were, the smallest first.
fn skews(released: &[Vec<Instant>], first: usize) -> Vec<Duration> {
    let of_shot = |shot: usize| {
        let instants = || released.iter().filter_map(|of_camera| of_camera.get(shot));
        let (first, last) = (instants().min()?, instants().max()?);
        Some(*last - *first)
    };
    let mut skews: Vec<Duration> = (first..first + SHOTS).filter_map(of_shot).collect();
    skews.sort();
    skews
}
