//! Four cameras of libgphoto2 at once, each with its helper program: how far apart their releases
//! are, and whose picture each brings.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::Duration;

use beampose_core::{Camera, VirtualClock};
use beampose_drivers::sim::{Hosted, Part, Shutter, Simulated};
use beampose_drivers::{Connected, Options, Role, Setting, Simulator};
use futures::future::join_all;

const NAMES: [&str; 4] = ["left", "right", "top", "bottom"];
const SHOTS: usize = 60;
/// What a rig with such cameras may ask for as its `max_skew`.
const SKEW: Duration = Duration::from_millis(10);
/// How often a capture is taken until its cameras were together, as by the engine.
const TIMES: usize = 3;
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
    let mut taken = 0;
    for capture in 0..SHOTS {
        let within_limit = (0..TIMES).any(|_| {
            futures::executor::block_on(clock.drive(Box::pin(async {
                for armed in join_all(cameras.iter().map(|it| it.arm())).await {
                    armed.unwrap();
                }
                let frames = join_all(cameras.iter().map(|it| it.trigger())).await;
                for (number, frame) in frames.into_iter().enumerate() {
                    let expected = marked(&plain, number as u8, taken as u8);
                    assert!(frame.unwrap().bytes == expected, "{taken} of {number}, byte for byte");
                }
            })));
            taken += 1;
            skew(&*hosted, taken - 1) <= SKEW
        });
        assert!(within_limit, "capture {capture}: {TIMES} times further apart than {SKEW:?}");
    }
    let mut skews: Vec<f64> =
        (0..taken).map(|shot| skew(&*hosted, shot).as_secs_f64() * 1e3).collect();
    skews.sort_by(f64::total_cmp);
    let _ = writeln!(
        std::io::stderr(),
        "four cameras, {SHOTS} captures, {} pictures of {BYTES} bytes the same byte for byte; their \
         releases were apart by {:.2} ms (median), {:.2} ms (worst); taken again beyond {SKEW:?}: {}",
        taken * NAMES.len(),
        skews[taken / 2],
        skews[taken - 1],
        taken - SHOTS,
    );
}

/// How far apart the cameras heard of the release of a shot.
fn skew(cameras: &dyn Hosted, shot: usize) -> Duration {
    let mut heard = NAMES.map(|name| cameras.releases(name)[shot]);
    heard.sort();
    heard[NAMES.len() - 1] - heard[0]
}
