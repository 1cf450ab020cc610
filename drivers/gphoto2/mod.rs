//! Cameras of libgphoto2: DSLRs and compact cameras on USB (`device:usb:001,002`), and cameras on the
//! network (`device:ptpip:192.168.1.7`); `gphoto2 --auto-detect` names them.
//!
//! Each camera has a helper program of its own, `beampose-camera-helper`, because the `gphoto2`
//! crate sends all calls of a process through one thread and several cameras must fire together. It
//! is built with the feature `gphoto2` (which needs libgphoto2-dev and libclang-dev) and looked for
//! beside this program; this module needs neither. The session stays open from one picture to the
//! next, so a trigger is one short line to a program that waits for it.
//!
//! Sources: libgphoto2 2.5.30 and the `gphoto2` crate; PTP (ISO 15740) and PTP/IP (CIPA DC-005) for
//! [`PtpIpCameras`], which the unmodified `gphoto2` program uses as any camera. What no peer could check:
//! USB, capture by makers' own commands (EOS, Nikon), pictures of several megabytes over a slow
//! network.

mod card;
mod driver;
mod helper;
mod packets;
mod protocol;
mod sim;

pub use driver::Gphoto2Camera;
pub use sim::PtpIpCameras;

use crate::options::{OptionSpec, Value};
use crate::registry::{Driver, Moved, Simulator};

/// A camera that libgphoto2 knows.
pub const CAMERA: Driver = Driver {
    kind: "camera",
    name: "gphoto2",
    instruments: "cameras that libgphoto2 releases remotely (gphoto.org lists them)",
    verified: "its simulator by the gphoto2 program over PTP/IP, the driver by libgphoto2 against \
               that simulator; never met a camera",
    moved: Moved::ByMotor,
    reads: None,
    port: None,
    options: &[
        OptionSpec {
            name: "model",
            about: "as `gphoto2 --list-cameras` has it; empty: what is attached at the port",
            default: Some(Value::Text("")),
            example: Value::Text("Canon EOS 5D Mark III"),
        },
        OptionSpec {
            name: "keep",
            about: "whether pictures stay on the camera's card",
            default: Some(Value::Switch(true)),
            example: Value::Switch(true),
        },
    ],
    connect: driver::connect,
    simulator: Simulator::Hosted(sim::simulate),
};
