//! One camera of libgphoto2, driven by lines on standard input: see `gphoto2/protocol.rs` of this
//! crate, which this program deliberately does not use.
//!
//! A program of its own for each camera, because the `gphoto2` crate sends the calls of a whole
//! process through one thread, and several cameras must fire together. It holds one session from
//! its start until its input ends.
//!
//! `beampose-camera-helper PORT [MODEL]`: `ptpip:127.0.0.2 "PTP/IP Camera"`, `usb:001,002`.
//!
//! Asked | Answered
//! --- | ---
//! (its start) | `READY`, tab, model, tab, serial number
//! `ARM` | `OK`; what came from the camera before is dropped, `LATE` and its name for a picture
//! `TRIGGER at n quiet` | `RELEASED`, tab, when; then `PICTURE`, tab, number of bytes, tab, name; then the bytes
//! `KEEP yes`, `KEEP no` | `OK`: whether pictures stay on the card
//!
//! `at` and when the release went out are nanoseconds of the monotonic clock: helpers that are given
//! the same instant release together, however late each was woken before it. `n` is how many earlier pictures may still come ahead of this one; where there are any, it is the
//! last that comes before nothing comes for `quiet` milliseconds. Anything may be answered by
//! `ERROR`, tab, a word (`gone`, `refused`, `timeout`, `fault`), tab, words for people.

use std::io::{self, BufRead, Write};
use std::time::{Duration, Instant};

use gphoto2::camera::CameraEvent;
use gphoto2::error::ErrorKind;
use gphoto2::file::CameraFilePath;
use gphoto2::list::CameraDescriptor;
use gphoto2::widget::TextWidget;
use gphoto2::{Camera, Context, Error};
use rustix::process::{setpriority_process, setsid};
use rustix::thread::{ClockId, clock_nanosleep_absolute};
use rustix::time::{Timespec, clock_gettime};

/// What a camera is over the network, where nobody says more.
const NETWORK_MODEL: &str = "PTP/IP Camera";
/// The camera's queue counts as empty after so long without an event.
const DRAINED: Duration = Duration::from_millis(1);
/// Ahead of all that is not a driver: -20 is the highest.
const PRIORITY: i32 = -15;
/// One wait for an event; the program that asks has deadlines of its own and ends this one.
const LISTEN: Duration = Duration::from_millis(500);

/// A word for the other program, and words for people.
struct Failure(&'static str, String);

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        let word = match error.kind() {
            ErrorKind::Timeout => "timeout",
            ErrorKind::CameraBusy | ErrorKind::NotSupported | ErrorKind::NoSpace => "refused",
            ErrorKind::CameraError | ErrorKind::CorruptedData => "fault",
            _ => "gone",
        };
        Self(word, error.to_string())
    }
}

impl From<io::Error> for Failure {
    fn from(error: io::Error) -> Self {
        Self("gone", error.to_string())
    }
}

fn main() -> io::Result<()> {
    come_first();
    let mut out = io::stdout().lock();
    let (port, model) = {
        let mut words = std::env::args().skip(1);
        (words.next().unwrap_or_default(), words.next().unwrap_or_default())
    };
    let opened = open(&port, &model);
    let session = match opened {
        Ok(session) => session,
        Err(failure) => return say_failure(&mut out, failure),
    };
    writeln!(out, "READY\t{}\t{}", clean(&session.model), clean(&session.serial))?;
    out.flush()?;
    let mut keep = true;
    for line in io::stdin().lock().lines() {
        let line = line?;
        let done = match line.split_once(' ').unwrap_or((&line, "")) {
            ("ARM", _) => session.drain(&mut out).and_then(|()| Ok(writeln!(out, "OK")?)),
            ("KEEP", word) => {
                keep = word != "no";
                writeln!(out, "OK").map_err(Failure::from)
            }
            ("TRIGGER", words) => session.take(&mut out, Ahead::read(words), keep),
            _ => Err(Failure("refused", format!("unknown request {line:?}"))),
        };
        if let Err(failure) = done {
            say_failure(&mut out, failure)?;
        }
        out.flush()?;
    }
    Ok(())
}

/// A release that waits for other programs is late. Only some may put themselves first; others go
/// without. Linux weighs sessions before it weighs programs, hence one of its own, which also keeps
/// Ctrl-C from it: it ends when its input does.
fn come_first() {
    let _ = setsid();
    let _ = std::fs::write("/proc/self/autogroup", PRIORITY.to_string());
    let _ = setpriority_process(None, PRIORITY);
}

fn say_failure(out: &mut impl Write, Failure(word, why): Failure) -> io::Result<()> {
    writeln!(out, "ERROR\t{word}\t{}", clean(&why))?;
    out.flush()
}

/// On one line, without tabs.
fn clean(text: &str) -> String {
    text.split(char::is_control).collect::<Vec<_>>().join(" ").trim().to_owned()
}

/// Earlier pictures that may come ahead of one.
#[derive(Clone, Copy)]
struct Ahead {
    /// When to release.
    at: Duration,
    count: usize,
    quiet: Duration,
}

impl Ahead {
    fn read(words: &str) -> Self {
        let mut numbers = words.split(' ').map(|word| word.parse::<u64>().unwrap_or(0));
        let mut number = || numbers.next().unwrap_or(0);
        Self {
            at: Duration::from_nanos(number()),
            count: number() as usize,
            quiet: Duration::from_millis(number()),
        }
    }
}

struct Session {
    context: Context,
    camera: Camera,
    model: String,
    serial: String,
}

fn open(port: &str, model: &str) -> Result<Session, Failure> {
    let context = Context::new()?;
    let model = match model {
        "" if port.starts_with("ptpip:") => NETWORK_MODEL.to_owned(),
        "" => detected(&context, port)?,
        model => model.to_owned(),
    };
    let descriptor = CameraDescriptor { model: model.clone(), port: port.to_owned() };
    let camera = context.get_camera(&descriptor).wait()?;
    // The first question opens the session. Not every camera has these words.
    let word = |key: &str| camera.config_key::<TextWidget>(key).wait().map(|it| it.value());
    let serial = match word("serialnumber") {
        Ok(serial) => serial,
        Err(_) => {
            camera.storages().wait()?;
            String::new()
        }
    };
    let model = word("cameramodel").unwrap_or(model);
    Ok(Session { context, camera, model, serial })
}

/// The model of what is attached at a port.
fn detected(context: &Context, port: &str) -> Result<String, Failure> {
    let mut there = Vec::new();
    for it in context.list_cameras().wait()? {
        if it.port == port {
            return Ok(it.model);
        }
        there.push(format!("{} at {}", it.model, it.port));
    }
    let there = if there.is_empty() { "no camera".to_owned() } else { there.join(", ") };
    let cure = "is it on, and does no other program hold it (gvfs does)?";
    Err(Failure("gone", format!("nothing at {port}; found {there}: {cure}")))
}

fn said_released(out: &mut impl Write, at: Duration) -> Result<(), Failure> {
    writeln!(out, "RELEASED\t{}", at.as_nanos())?;
    Ok(out.flush()?)
}

fn monotonic() -> Duration {
    Duration::try_from(clock_gettime(ClockId::Monotonic)).unwrap_or_default()
}

fn wait_until(at: Duration) {
    if let Ok(at) = Timespec::try_from(at) {
        // Where it is interrupted the release is early, and says so.
        let _ = clock_nanosleep_absolute(ClockId::Monotonic, &at);
    }
}

fn is_picture(path: &CameraFilePath) -> bool {
    let name = path.name().to_lowercase();
    [".jpg", ".jpeg", ".png"].iter().any(|end| name.ends_with(end))
}

impl Session {
    /// Passes over what the camera has said by itself.
    fn drain(&self, out: &mut impl Write) -> Result<(), Failure> {
        loop {
            match self.camera.wait_event(DRAINED).wait()? {
                CameraEvent::Timeout => return Ok(()),
                CameraEvent::NewFile(path) if is_picture(&path) => {
                    writeln!(out, "LATE\t{}", clean(&path.name()))?;
                }
                _ => {}
            }
        }
    }

    /// Releases, waits for the picture and hands it over.
    fn take(&self, out: &mut impl Write, ahead: Ahead, keep: bool) -> Result<(), Failure> {
        wait_until(ahead.at);
        let released = monotonic();
        let path = match self.camera.trigger_capture().wait() {
            Ok(()) => {
                said_released(out, released)?;
                self.own_picture(ahead)?
            }
            // Some cameras can only be asked for both at once. What the list of models says of it is
            // wrong for cameras on the network, so it is tried.
            Err(error) if error.kind() == ErrorKind::NotSupported => {
                said_released(out, monotonic())?;
                self.camera.capture_image().wait()?
            }
            Err(error) => return Err(error.into()),
        };
        let (folder, name) = (path.folder().into_owned(), path.name().into_owned());
        let file = self.camera.fs().download(&folder, &name).wait()?;
        let bytes = file.get_data(&self.context).wait()?;
        if !keep {
            self.camera.fs().delete_file(&folder, &name).wait()?;
        }
        writeln!(out, "PICTURE\t{}\t{}", bytes.len(), clean(&name))?;
        out.write_all(&bytes)?;
        out.flush()?;
        Ok(())
    }

    /// The picture of the last release: the last of those that come, where earlier ones may.
    fn own_picture(&self, ahead: Ahead) -> Result<CameraFilePath, Failure> {
        let mut came = Vec::new();
        let mut heard = Instant::now();
        loop {
            let wait = if came.is_empty() { LISTEN } else { ahead.quiet };
            match self.camera.wait_event(wait).wait()? {
                CameraEvent::NewFile(path) if is_picture(&path) => {
                    came.push(path);
                    heard = Instant::now();
                }
                _ => {}
            }
            let all =
                came.len() > ahead.count || (!came.is_empty() && heard.elapsed() >= ahead.quiet);
            if all && let Some(newest) = came.pop() {
                return Ok(newest);
            }
        }
    }
}
