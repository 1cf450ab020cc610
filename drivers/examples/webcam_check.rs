//! The webcam driver before the kernel's test camera: run by `.ci/vivid` as the one program of a
//! small system, with `v4l2-ctl` as the other hand on the same controls. Prints PASS.
//!
//! The test picture is changed right before each trigger, and must be seen in the picture. That a
//! frame which began before the trigger is passed over cannot be seen here, because vivid makes a
//! frame in no time and hands it out before the end that it stamps on it: a test beside the driver
//! sees to that.

use std::collections::BTreeMap;
use std::process::Command;
use std::sync::Arc;
use std::time::{Duration, Instant};

use beampose_core::clock::{BoxFuture, ExternalGuard};
use beampose_core::{Camera, Clock, Stamp};
use beampose_drivers::{Connected, Options, Role, Setting};

/// Only looked at: this driver never sleeps.
struct WallClock(Instant);

impl Clock for WallClock {
    fn now(&self) -> Stamp {
        Stamp { monotonic: self.0.elapsed(), utc: jiff::Timestamp::now() }
    }

    fn sleep(&self, _: Duration) -> BoxFuture<'_, ()> {
        Box::pin(std::future::pending())
    }

    fn external(&self) -> ExternalGuard {
        ExternalGuard::default()
    }
}

type Done<T = ()> = Result<T, String>;

fn camera(
    device: &str,
    options: &[(&str, &str)],
    exposure: Option<Duration>,
) -> Done<Arc<dyn Camera>> {
    let driver = beampose_drivers::find("camera", "webcam").ok_or("no driver")?;
    let written: BTreeMap<String, String> =
        options.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
    let setting = Setting {
        name: device.to_owned(),
        address: format!("device:{device}").parse().map_err(|_| "address")?,
        line: None,
        clock: Arc::new(WallClock(Instant::now())),
        options: Options::read(driver.options, &written).map_err(|(_, why)| why)?,
        role: Role::Camera { exposure, delivery: Some(Duration::from_millis(500)) },
        deadline: Duration::from_millis(500),
        simulated: false,
        scratch: "/tmp".into(),
    };
    match (driver.connect)(setting).map_err(|error| error.to_string())? {
        Connected::Camera(it) => Ok(it),
        _ => Err("no camera".to_owned()),
    }
}

fn run<T>(future: impl Future<Output = Result<T, beampose_core::InstrumentError>>) -> Done<T> {
    futures::executor::block_on(future).map_err(|error| error.to_string())
}

/// The other hand.
fn v4l2_ctl(device: &str, words: &[&str]) -> Done<String> {
    let done = Command::new("v4l2-ctl").args(["-d", device]).args(words).output();
    let done = done.map_err(|error| format!("v4l2-ctl: {error}"))?;
    if !done.status.success() {
        return Err(format!("v4l2-ctl {words:?}: {}", String::from_utf8_lossy(&done.stderr)));
    }
    Ok(String::from_utf8_lossy(&done.stdout).into_owned())
}

/// The mean of each colour, of a PNG file with that size.
fn means(file: &[u8], size: (u32, u32)) -> Done<[f64; 3]> {
    let wrong = |error: png::DecodingError| error.to_string();
    let mut reader = png::Decoder::new(std::io::Cursor::new(file)).read_info().map_err(wrong)?;
    let mut bytes = vec![0; reader.output_buffer_size().ok_or("too large")?];
    let about = reader.next_frame(&mut bytes).map_err(wrong)?;
    if (about.width, about.height) != size {
        return Err(format!("{} x {} pixels", about.width, about.height));
    }
    let channels = about.color_type.samples();
    let pixels = bytes[..about.buffer_size()].chunks_exact(channels);
    let count = pixels.len() as f64;
    let mut sums = [0.0; 3];
    for pixel in pixels {
        for (sum, channel) in sums.iter_mut().zip([0, 1, 2]) {
            *sum += f64::from(pixel[channel.min(channels - 1)]);
        }
    }
    Ok(sums.map(|sum| sum / count))
}

/// Test patterns of vivid, and what their mean is at least near: the moving text covers some of it.
const PATTERNS: [(&str, [f64; 3]); 5] = [
    ("test_pattern=6", [255.0, 255.0, 255.0]),
    ("test_pattern=5", [0.0, 0.0, 0.0]),
    ("test_pattern=7", [255.0, 0.0, 0.0]),
    ("test_pattern=8", [0.0, 255.0, 0.0]),
    ("test_pattern=9", [0.0, 0.0, 255.0]),
];

fn pictures_are_of_their_triggers(format: &str, shots: usize) -> Done {
    let device = "/dev/video0";
    let options = [("format", format), ("width", "640"), ("height", "360")];
    let it = camera(device, &options, None)?;
    println!("{format}: {}", run(it.identify())?.model);
    for shot in 0..shots {
        let (pattern, expected) = PATTERNS[shot % PATTERNS.len()];
        run(it.arm())?;
        // Frames of the old pattern fill the buffers.
        std::thread::sleep(Duration::from_millis(150));
        v4l2_ctl(device, &["-c", pattern])?;
        let frame = run(it.trigger())?;
        let found = means(&frame.bytes, (640, 360))?;
        let luma = |c: [f64; 3]| 0.299 * c[0] + 0.587 * c[1] + 0.114 * c[2];
        let near = if format == "GREY" {
            (luma(expected) - found[0]).abs() < 45.0
        } else {
            expected.iter().zip(found).all(|(a, b)| (a - b).abs() < 45.0)
        };
        if !near {
            return Err(format!("{format} {pattern}: expected {expected:?}, found {found:?}"));
        }
        let took = (frame.delivered.monotonic - frame.requested.monotonic).as_secs_f64() * 1e3;
        println!("{format} {pattern}: mean {found:.0?}, {took:.0} ms");
    }
    Ok(())
}

fn controls_are_locked() -> Done {
    let device = "/dev/video0";
    v4l2_ctl(device, &["-c", "gain_automatic=1"])?;
    let it = camera(device, &[("gain", "77"), ("width", "640"), ("height", "360")], None)?;
    run(it.arm())?;
    let said = v4l2_ctl(device, &["-C", "gain_automatic,gain"])?;
    if !said.contains("gain_automatic: 0") || !said.contains("gain: 77") {
        return Err(format!("after arming: {said}"));
    }
    v4l2_ctl(device, &["-c", "gain_automatic=1"])?;
    match run(it.arm()) {
        Err(why) if why.contains("gain") => println!("turned by another: {why}"),
        other => return Err(format!("automatic gain came back, and arm says {other:?}")),
    }
    run(it.arm())?;
    run(it.trigger())?;
    let refused = |it: Arc<dyn Camera>, part: &str| match run(it.arm()) {
        Err(why) if why.contains(part) => {
            println!("refused: {why}");
            Ok(())
        }
        other => Err(format!("expected {part:?}, got {other:?}")),
    };
    drop(it);
    refused(camera(device, &[("gain", "9999")], None)?, "become 9999")?;
    refused(camera(device, &[], Some(Duration::from_millis(10)))?, "no control for exposure")?;
    refused(camera(device, &[("width", "123"), ("height", "77")], None)?, "123 x 77")?;
    refused(camera("/dev/video9", &[], None)?, "no such camera")
}

fn one_owner_and_two_cameras() -> Done {
    let size = [("width", "640"), ("height", "360")];
    let (first, second) =
        (camera("/dev/video0", &size, None)?, camera("/dev/video1", &size, None)?);
    let (a, b) =
        futures::executor::block_on(futures::future::join(first.trigger(), second.trigger()));
    for frame in [a, b] {
        means(&frame.map_err(|error| error.to_string())?.bytes, (640, 360))?;
    }
    match run(camera("/dev/video0", &size, None)?.trigger()) {
        Err(why) if why.contains("another program") => println!("second owner: {why}"),
        other => return Err(format!("a second owner: {:?}", other.map(|frame| frame.bytes.len()))),
    }
    run(first.trigger()).map(drop)
}

fn main() {
    let done = pictures_are_of_their_triggers("YUYV", 10)
        .and_then(|()| pictures_are_of_their_triggers("RGB3", 5))
        .and_then(|()| pictures_are_of_their_triggers("GREY", 5))
        .and_then(|()| controls_are_locked())
        .and_then(|()| one_owner_and_two_cameras());
    match done {
        Ok(()) => println!("webcam_check: PASS"),
        Err(why) => println!("webcam_check: FAIL: {why}"),
    }
}
