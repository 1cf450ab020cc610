//! A webcam that measures.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use async_trait::async_trait;
use beampose_core::{Camera, Clock, Frame, Identity, Instrument, InstrumentError};
use futures::channel::oneshot;
use futures::lock::Mutex;
use v4l::Device;

use super::controls::{Locked, Wanted, check, lock};
use super::device::{Frames, Job, Opened, monotonic};
use super::pixels::{Format, Pixels, pixels};
use crate::aside::aside;
use crate::registry::{Connected, Role, Setting};
use crate::transport::Address;

/// A picture is waited for at least so long.
const SHORTEST: Duration = Duration::from_secs(2);
/// Until a picture is here, where the rig does not say.
const DELIVERY: Duration = Duration::from_millis(500);

/// A camera of V4L2.
pub struct Webcam {
    name: String,
    path: PathBuf,
    format: Format,
    size: [u32; 2],
    wanted: Wanted,
    wait: Duration,
    clock: Arc<dyn Clock>,
    simulated: bool,
    slot: Mutex<Option<Streaming>>,
}

/// The open camera.
struct Streaming {
    device: Arc<Device>,
    model: String,
    locked: Locked,
    frames: Frames,
    /// A picture is waited for at least so long: a frame that is under way does not count.
    wait: Duration,
    picture: Picture,
}

/// How a frame becomes a picture.
#[derive(Clone, Copy)]
struct Picture {
    format: Format,
    /// Width, height, and bytes from one row to the next.
    shape: [u32; 3],
    full_range: bool,
}

pub(super) fn connect(setting: Setting) -> Result<Connected, InstrumentError> {
    let refused = |why: &str| InstrumentError::Refused(format!("{}: {why}", setting.name));
    let Role::Camera { delivery, exposure } = setting.role else {
        return Err(refused("it is no camera"));
    };
    let Address::Device(path) = &setting.address else {
        return Err(refused("its address must be as device:/dev/video0"));
    };
    let whole = |name: &str| match setting.options.text(name)? {
        "" => Ok(None),
        text => text.parse::<i64>().map(Some).map_err(|_| {
            InstrumentError::Refused(format!("option {name} must be a whole number or empty"))
        }),
    };
    let format = Format::read(setting.options.text("format")?);
    let most = 1 << 16;
    Ok(Connected::Camera(Arc::new(Webcam {
        path: PathBuf::from(path),
        format: format
            .ok_or_else(|| refused("option format: YUYV, GREY, Y16, RGB3, BGR3, MJPG"))?,
        size: [setting.options.whole("width", 0, most)?, setting.options.whole("height", 0, most)?],
        wanted: Wanted { exposure, gain: whole("gain")?, focus: whole("focus")? },
        wait: (delivery.unwrap_or(DELIVERY) * 4).max(SHORTEST),
        simulated: setting.simulated,
        slot: Mutex::default(),
        clock: setting.clock,
        name: setting.name,
    })))
}

impl Picture {
    fn file(self, bytes: Vec<u8>) -> Result<Vec<u8>, InstrumentError> {
        let garbled = |expected: &str, bytes: &[u8]| InstrumentError::Garbled {
            expected: expected.to_owned(),
            found: format!("{} bytes", bytes.len()),
        };
        if self.format == Format::Jpeg {
            // Some leave out the tables that every camera of their kind has, and so is no file.
            let is_file =
                bytes.starts_with(&[0xff, 0xd8]) && bytes.windows(2).any(|two| two == [0xff, 0xc4]);
            let expected = "a JPEG file with its Huffman tables; take format YUYV";
            return if is_file { Ok(bytes) } else { Err(garbled(expected, &bytes)) };
        }
        let [width, height, _] = self.shape;
        let shape = self.shape.map(|x| x as usize);
        let found = pixels(self.format, shape, self.full_range, &bytes);
        let found = found.ok_or_else(|| garbled("a whole frame", &bytes))?;
        png_file(&found, width, height)
            .map_err(|error| InstrumentError::Fault(format!("PNG: {error}")))
    }
}

fn png_file(pixels: &Pixels, width: u32, height: u32) -> Result<Vec<u8>, png::EncodingError> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(if pixels.colour { png::ColorType::Rgb } else { png::ColorType::Grayscale });
    encoder.set_depth(if pixels.bits == 16 {
        png::BitDepth::Sixteen
    } else {
        png::BitDepth::Eight
    });
    encoder.set_compression(png::Compression::Fast);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&pixels.bytes)?;
    writer.finish()?;
    Ok(file)
}

impl Webcam {
    /// The camera, opened, locked and streaming.
    async fn streaming<'a>(
        &self,
        slot: &'a mut Option<Streaming>,
    ) -> Result<&'a mut Streaming, InstrumentError> {
        if let Some(streaming) = slot {
            return Ok(streaming);
        }
        let (path, format, size, wanted) = (self.path.clone(), self.format, self.size, self.wanted);
        let opened = aside(&*self.clock, &self.name, move || {
            let opened = Opened::new(&path, format, size)?;
            let locked = lock(&*opened.device, wanted)?;
            let frames = opened.stream(&path)?;
            // Some switch an automatic on as they begin to stream.
            check(&*opened.device, &locked)?;
            let shape = [opened.shape.width, opened.shape.height, opened.shape.stride];
            let picture = Picture { format, shape, full_range: opened.is_full_range() };
            let wait = opened.interval * 4;
            let Opened { model, device, .. } = opened;
            Ok(Streaming { model, device, locked, frames, wait, picture })
        });
        Ok(slot.insert(opened.await?))
    }

    async fn frame(&self, streaming: &Streaming) -> Result<Vec<u8>, InstrumentError> {
        let (reply, frame) = oneshot::channel();
        let ended = || InstrumentError::Disconnected("its stream has ended".to_owned());
        let _time_stands_still = self.clock.external();
        let wait = self.wait.max(streaming.wait);
        let job = Job { since: monotonic(), until: Instant::now() + wait, reply };
        streaming.frames.ask(job).map_err(|_| ended())?;
        match frame.await.map_err(|_| ended())? {
            Err(InstrumentError::Timeout(_)) => Err(InstrumentError::Timeout(wait)),
            other => other,
        }
    }

    /// Sees that nobody turned anything.
    async fn checked(&self, streaming: &Streaming) -> Result<(), InstrumentError> {
        let (device, locked) = (Arc::clone(&streaming.device), streaming.locked.clone());
        aside(&*self.clock, &self.name, move || check(&*device, &locked)).await
    }
}

#[async_trait]
impl Instrument for Webcam {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        let mut slot = self.slot.lock().await;
        let streaming = self.streaming(&mut slot).await?;
        let [width, height, _] = streaming.picture.shape;
        let model = format!("{}, {width} x {height} pixels", streaming.model);
        Ok(Identity { model, serial: None, simulated: self.simulated })
    }
}

#[async_trait]
impl Camera for Webcam {
    async fn arm(&self) -> Result<(), InstrumentError> {
        let mut slot = self.slot.lock().await;
        let streaming = self.streaming(&mut slot).await?;
        let checked = self.checked(streaming).await;
        if checked.is_err() {
            // The next call locks it again.
            *slot = None;
        }
        checked
    }

    async fn trigger(&self) -> Result<Frame, InstrumentError> {
        let mut slot = self.slot.lock().await;
        let streaming = self.streaming(&mut slot).await?;
        let requested = self.clock.now();
        let taken = match self.frame(streaming).await {
            Ok(bytes) => self.checked(streaming).await.map(|()| bytes),
            Err(error) => Err(error),
        };
        let picture = streaming.picture;
        if taken.is_err() {
            *slot = None;
        }
        let bytes = taken?;
        let bytes = aside(&*self.clock, &self.name, move || picture.file(bytes)).await?;
        Ok(Frame { bytes, requested, delivered: self.clock.now() })
    }
}
