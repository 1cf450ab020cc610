//! A folder into which any other program drops pictures: a maker's tethering program, a memory card
//! that sends over WLAN, an intervalometer's download, another computer's share.
//!
//! How the camera is released is the option `release`: a command line that is waited for to its
//! end, `tcp:host:port` (the line `RELEASE` is sent, `OK` or `ERROR why` awaited), or nothing: then
//! somebody else releases. A program that fills the folder and can be asked for a release may leave
//! a file `.beampose-release` in it with its `tcp:host:port`; so does [`TetheredFolder`]. A command is never
//! taken from such a file.
//!
//! What was in the folder before the release is never taken for its picture. After a picture that
//! did not come in time, the next `arm` waits once more for it; a file that comes then, or ahead of
//! the next picture, is left where it is, with a warning. Each picture needs a file name of its own
//! (no `latest.jpg` that is written again and again), and what is written in place must end as JPEG
//! or PNG files end.
//!
//! What cannot be told: where somebody else releases, a picture exposed before `trigger` and
//! delivered after it counts as its own.

mod driver;
mod protocol;
mod release;
mod sim;

pub use driver::FolderCamera;
pub use sim::TetheredFolder;

use crate::options::{OptionSpec, Value};
use crate::registry::{Driver, Moved, Simulator};

/// A watched folder as a camera.
pub const CAMERA: Driver = Driver {
    kind: "camera",
    name: "folder",
    instruments: "any camera whose pictures another program drops into a folder",
    verified: "by its simulator, and with the gphoto2 program as what fills the folder",
    moved: Moved::ByMotor,
    reads: None,
    port: None,
    options: &[
        OptionSpec {
            name: "release",
            about: "what releases the camera: a command line, waited for to its end; or \
                    tcp:host:port; empty where somebody else does, or where the folder's \
                    .beampose-release says it",
            default: Some(Value::Text("")),
            example: Value::Text("gphoto2 --trigger-capture"),
        },
        OptionSpec {
            name: "pattern",
            about: "which files are pictures: patterns with * and ?, commas between them, capitals \
                    or not",
            default: Some(Value::Text("*.jpg,*.jpeg,*.png")),
            example: Value::Text("left_*.jpg"),
        },
        OptionSpec {
            name: "keep",
            about: "whether a picture stays in the folder after it was read",
            default: Some(Value::Switch(true)),
            example: Value::Switch(true),
        },
    ],
    connect: driver::connect,
    simulator: Simulator::Hosted(sim::simulate),
};
