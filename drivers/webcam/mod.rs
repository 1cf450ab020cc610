//! Webcams and other video cameras of the computer (UVC and all else that V4L2 knows):
//! `device:/dev/video0`, or better `device:/dev/v4l/by-id/...`, which stays the same.
//!
//! A measuring camera must not decide for itself: exposure, gain, white balance and focus are
//! switched from automatic to manual, set and read back, and a camera that stays automatic is
//! refused. Frames are the camera's own, without loss: as PNG, or as its own JPEG where `format` is
//! `MJPG`. The camera streams all the time; a picture is the first frame whose exposure began after
//! the trigger, by the kernel's time stamps.
//!
//! Built with the feature `nokhwa` (needs libclang-dev), named after the crate that this was meant
//! for. It uses the `v4l` crate instead: nokhwa 0.10 turns the kernel's monotonic time stamps into
//! wall-clock time and drops what they mean (begin or end of the exposure), and its control for
//! exposure is not the one that UVC cameras have.
//!
//! Sources: the kernel's V4L2 documentation ("User Controls", "Camera Control Reference", "Buffers:
//! Timestamp", "YUYV"). Tried by `.ci/vivid` in a kernel with its test camera `vivid`, which has
//! gain and its automatic, but neither exposure nor focus. What that cannot check: UVC itself, how true
//! a webcam's time stamps are, and that a frame under way is passed over (vivid makes one in no time;
//! a unit test sees to that).

#[cfg(any(feature = "nokhwa", test))]
mod controls;
#[cfg(feature = "nokhwa")]
mod device;
#[cfg(feature = "nokhwa")]
mod driver;
#[cfg(any(feature = "nokhwa", test))]
mod pixels;
mod sim;

#[cfg(feature = "nokhwa")]
pub use driver::Webcam;

use beampose_core::InstrumentError;

use crate::options::{OptionSpec, Value};
use crate::registry::{Connected, Driver, Moved, Setting, Simulator};

/// A camera of V4L2.
pub const CAMERA: Driver = Driver {
    kind: "camera",
    name: "webcam",
    instruments: "webcams and frame grabbers of Linux (V4L2), built with the feature nokhwa",
    verified: "by the kernel's test camera vivid and v4l2-ctl; never met a webcam",
    moved: Moved::ByMotor,
    reads: None,
    port: None,
    options: &[
        OptionSpec {
            name: "format",
            about: "how pixels come: YUYV, GREY, Y16, RGB3, BGR3, or the camera's own JPEG, MJPG",
            default: Some(Value::Text("YUYV")),
            example: Value::Text("YUYV"),
        },
        OptionSpec {
            name: "width",
            about: "pixels in a row; 0 for the largest picture that it has",
            default: Some(Value::Number(0.0)),
            example: Value::Number(1920.0),
        },
        OptionSpec {
            name: "height",
            about: "rows; 0 for the largest picture that it has",
            default: Some(Value::Number(0.0)),
            example: Value::Number(1080.0),
        },
        OptionSpec {
            name: "gain",
            about: "gain in the camera's own numbers (`v4l2-ctl -l`); empty: as it stands, locked",
            default: Some(Value::Text("")),
            example: Value::Text("0"),
        },
        OptionSpec {
            name: "focus",
            about: "focus in the camera's own numbers; empty: as it stands, locked",
            default: Some(Value::Text("")),
            example: Value::Text("30"),
        },
    ],
    connect,
    simulator: Simulator::Hosted(sim::simulate),
};

#[cfg(feature = "nokhwa")]
fn connect(setting: Setting) -> Result<Connected, InstrumentError> {
    driver::connect(setting)
}

#[cfg(not(feature = "nokhwa"))]
fn connect(setting: Setting) -> Result<Connected, InstrumentError> {
    let why = "this program was built without webcams: install libclang-dev, then `cargo build \
               --release --features beampose-drivers/nokhwa`";
    Err(InstrumentError::Refused(format!("{}: {why}", setting.name)))
}
