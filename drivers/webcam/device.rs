//! A V4L2 device that streams: a thread takes every frame, and hands out those that are asked for.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use beampose_core::InstrumentError;
use futures::channel::oneshot;
use v4l::buffer::{Flags, Metadata, Type};
use v4l::control::{Control, Value};
use v4l::format::{Colorspace, FourCC, Quantization};
use v4l::io::mmap::Stream;
use v4l::io::traits::CaptureStream as _;
use v4l::video::Capture as _;
use v4l::{Device, Format as Shape};

use super::controls::Controls;
use super::pixels::{Format, began};

/// Buffers that the kernel fills one after the other.
const BUFFERS: u32 = 4;
/// A camera that gives no frame for so long, or for four frames, has stopped.
const STOPPED: Duration = Duration::from_secs(2);
/// What the kernel says of a call that the device does not know.
const NOT_THERE: i32 = 22;

/// A device, set up and not streaming yet.
pub(super) struct Opened {
    pub(super) device: Arc<Device>,
    pub(super) model: String,
    pub(super) shape: Shape,
    /// From one frame to the next.
    pub(super) interval: Duration,
}

impl Opened {
    /// Opens a device with a format; a size of zero is the largest that it has.
    pub(super) fn new(
        path: &Path,
        format: Format,
        [width, height]: [u32; 2],
    ) -> Result<Self, InstrumentError> {
        let failed = |error| cannot(path, &error);
        let device = Device::with_path(path).map_err(failed)?;
        let about = device.query_caps().map_err(failed)?;
        let letters = FourCC::new(format.letters());
        let size = if width == 0 || height == 0 {
            largest(&device, letters).unwrap_or((width, height))
        } else {
            (width, height)
        };
        let asked = Shape::new(size.0, size.1, letters);
        let shape = device.set_format(&asked).map_err(failed)?;
        if (shape.fourcc, shape.width, shape.height) != (letters, size.0, size.1) {
            let has = device.enum_formats().unwrap_or_default();
            let has: Vec<String> = has.iter().map(|it| it.fourcc.to_string()).collect();
            let why = format!(
                "{}: no {letters} with {} x {} pixels: it takes {} with {} x {}; its formats are {}",
                path.display(),
                size.0,
                size.1,
                shape.fourcc,
                shape.width,
                shape.height,
                has.join(", ")
            );
            return Err(InstrumentError::Refused(why));
        }
        let every = device.params().map_err(failed)?.interval;
        let interval = f64::from(every.numerator) / f64::from(every.denominator.max(1));
        let interval = Duration::try_from_secs_f64(interval).unwrap_or_default();
        let model = format!("{} ({})", about.card, about.bus);
        Ok(Self { device: Arc::new(device), model, shape, interval })
    }

    /// Whether YUYV uses all values.
    pub(super) fn is_full_range(&self) -> bool {
        match self.shape.quantization {
            Quantization::FullRange => true,
            Quantization::LimitedRange => false,
            Quantization::Default => matches!(self.shape.colorspace, Colorspace::JPEG),
        }
    }

    /// Begins to stream.
    pub(super) fn stream(&self, path: &Path) -> Result<Frames, InstrumentError> {
        let failed = |error| cannot(path, &error);
        let device = &self.device;
        let mut stream =
            Stream::with_buffers(device, Type::VideoCapture, BUFFERS).map_err(failed)?;
        stream.set_timeout(STOPPED.max(self.interval * 4));
        // The first frame: whether it streams at all.
        stream.next().map_err(failed)?;
        let (jobs, queue) = channel();
        let interval = self.interval;
        let thread = std::thread::Builder::new()
            .name("webcam".to_owned())
            .spawn(move || serve(stream, &queue, interval))
            .map_err(failed)?;
        Ok(Frames { jobs: Some(jobs), thread: Some(thread) })
    }
}

fn largest(device: &Device, letters: FourCC) -> Option<(u32, u32)> {
    let sizes = device.enum_framesizes(letters).ok()?;
    let all = sizes.into_iter().flat_map(|it| it.size.to_discrete());
    all.map(|it| (it.width, it.height)).max_by_key(|(width, height)| width * height)
}

fn cannot(path: &Path, error: &io::Error) -> InstrumentError {
    let path = path.display();
    let why = match error.kind() {
        io::ErrorKind::NotFound => {
            "there is no such camera: `v4l2-ctl --list-devices` shows them".to_owned()
        }
        io::ErrorKind::PermissionDenied => {
            "no permission: `sudo usermod -aG video $USER`, then log in again".to_owned()
        }
        io::ErrorKind::ResourceBusy => {
            format!("another program has it (`fuser -v {path}` says which)")
        }
        io::ErrorKind::TimedOut => "no frame comes".to_owned(),
        _ => error.to_string(),
    };
    InstrumentError::Disconnected(format!("{path}: {why}"))
}

/// A stream that runs. Dropped, it has ended, and the device can be opened again.
pub(super) struct Frames {
    jobs: Option<Sender<Job>>,
    thread: Option<JoinHandle<()>>,
}

impl Frames {
    /// Asks for a frame. `Err` where the stream has ended.
    pub(super) fn ask(&self, job: Job) -> Result<(), ()> {
        self.jobs.as_ref().ok_or(())?.send(job).map_err(|_| ())
    }
}

impl Drop for Frames {
    fn drop(&mut self) {
        self.jobs = None;
        if let Some(thread) = self.thread.take() {
            // It ends with the frame that is under way.
            let _ = thread.join();
        }
    }
}

/// A frame that is asked for.
pub(super) struct Job {
    /// Its exposure must begin after this, by the kernel's monotonic clock.
    pub(super) since: Duration,
    pub(super) until: Instant,
    pub(super) reply: oneshot::Sender<Result<Vec<u8>, InstrumentError>>,
}

/// The kernel's monotonic clock, by which it stamps frames.
pub(super) fn monotonic() -> Duration {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    Duration::new(now.tv_sec.unsigned_abs(), now.tv_nsec as u32)
}

/// Takes frames until nobody can ask any more, or none come.
fn serve(mut stream: Stream<'_>, queue: &Receiver<Job>, interval: Duration) {
    let mut waiting: Vec<Job> = Vec::new();
    loop {
        let frame = stream.next();
        loop {
            match queue.try_recv() {
                Ok(job) => waiting.push(job),
                Err(TryRecvError::Empty) => break,
                Err(TryRecvError::Disconnected) if waiting.is_empty() => return,
                Err(TryRecvError::Disconnected) => break,
            }
        }
        let (bytes, about) = match frame {
            Ok(frame) => frame,
            Err(error) => {
                for job in waiting {
                    let why = InstrumentError::Disconnected(format!("the stream ended: {error}"));
                    let _ = job.reply.send(Err(why));
                }
                return;
            }
        };
        let answer = |job: &Job| answer(job, bytes, about, interval);
        let (done, rest): (Vec<Job>, Vec<Job>) =
            waiting.into_iter().partition(|job| answer(job).is_some());
        for job in done {
            if let Some(answer) = answer(&job) {
                // Whoever asked may have gone.
                let _ = job.reply.send(answer);
            }
        }
        waiting = rest;
    }
}

/// What to answer now, if anything.
fn answer(
    job: &Job,
    bytes: &[u8],
    about: &Metadata,
    interval: Duration,
) -> Option<Result<Vec<u8>, InstrumentError>> {
    if about.flags & Flags::TIMESTAMP_MASK != Flags::TIMESTAMP_MONOTONIC {
        let why = "it does not stamp its frames: whether one began after the trigger is unknown";
        return Some(Err(InstrumentError::Refused(why.to_owned())));
    }
    let is_begin = about.flags & Flags::TSTAMP_SRC_MASK == Flags::TSTAMP_SRC_SOE;
    let stamp = Duration::from_secs(about.timestamp.sec.unsigned_abs())
        + Duration::from_micros(about.timestamp.usec.unsigned_abs());
    let whole = !about.flags.contains(Flags::ERROR);
    if whole && began(stamp, is_begin, interval) >= job.since {
        let count = (about.bytesused as usize).min(bytes.len());
        return Some(Ok(bytes[..count].to_vec()));
    }
    let over = Instant::now() >= job.until;
    over.then_some(Err(InstrumentError::Timeout(STOPPED)))
}

impl Controls for Device {
    fn get(&self, id: u32) -> Result<Option<i64>, String> {
        match self.control(id) {
            Ok(Control { value: Value::Integer(value), .. }) => Ok(Some(value)),
            Ok(Control { value: Value::Boolean(value), .. }) => Ok(Some(i64::from(value))),
            Ok(_) => Ok(None),
            Err(error) if error.raw_os_error() == Some(NOT_THERE) => Ok(None),
            Err(error) => Err(error.to_string()),
        }
    }

    fn set(&self, id: u32, value: i64) -> Result<(), String> {
        let value = Value::Integer(value);
        self.set_control(Control { id, value }).map_err(|error| error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use v4l::timestamp::Timestamp;

    use super::*;

    /// What a frame with such a stamp is to somebody who asked at 10 s, at 25 frames in a second.
    fn at(stamp_ms: i64, flags: Flags) -> Option<Result<Vec<u8>, InstrumentError>> {
        let job = Job {
            since: Duration::from_secs(10),
            until: Instant::now() + Duration::from_secs(60),
            reply: oneshot::channel().0,
        };
        let timestamp = Timestamp::new(stamp_ms / 1000, stamp_ms % 1000 * 1000);
        let about = Metadata { bytesused: 2, flags, timestamp, ..Metadata::default() };
        answer(&job, &[1, 2, 0, 0], &about, Duration::from_millis(40))
    }

    #[test]
    fn a_frame_counts_that_began_after_it_was_asked_for() {
        let end = Flags::TIMESTAMP_MONOTONIC;
        let begin = end | Flags::TSTAMP_SRC_SOE;
        for (ms, flags, counts) in [
            // It waited in a buffer.
            (9_960, begin, false),
            (9_960, end, false),
            // It was under way.
            (10_039, end, false),
            (10_040, end, true),
            (9_999, begin, false),
            (10_000, begin, true),
            // The kernel says that some of it is missing.
            (10_040, begin | Flags::ERROR, false),
        ] {
            let expected = counts.then(|| Ok(vec![1, 2]));
            assert_eq!(at(ms, flags), expected, "{ms} ms, {flags:?}");
        }
    }

    #[test]
    fn frames_without_a_known_time_are_refused() {
        for flags in [Flags::TIMESTAMP_UNKNOWN, Flags::TIMESTAMP_COPY] {
            assert!(matches!(at(10_040, flags), Some(Err(InstrumentError::Refused(_)))));
        }
    }
}
