//! What simulators have in common: the device behind the bytes, the world it moves, the host that
//! gives it a pty or a TCP port, and the trouble that lines have.

mod bench;
mod host;
mod pty;
mod trouble;
mod world;

use std::sync::Arc;
use std::time::Instant;

use beampose_core::Clock;

use crate::options::Options;
use crate::registry::Role;
use crate::transport::Address;

pub use bench::{TestDiode, TestProbe, TestShutter, TestStage};
pub use host::Host;
pub use pty::LineSettings;
pub use trouble::{Fault, Trouble};
pub use world::{Diode, Part, Probe, Shutter, Stage};

/// One instrument of a rig that a simulator stands for.
#[derive(Clone)]
pub struct Simulated {
    /// Its name in the rig.
    pub name: String,
    /// Its options, as its driver gets them: both must mean the same device, channel and scale.
    pub options: Options,
    /// What the rig says besides.
    pub role: Role,
    /// What it is in the world.
    pub part: Part,
    /// The time.
    pub clock: Arc<dyn Clock>,
}

/// A device on a line of bytes, as its maker built it, with its traps.
pub trait Device: Send {
    /// Takes what it understands from `pending` (all that came from one client and was not taken
    /// yet) and returns what it answers at once.
    fn receive(&mut self, pending: &mut Vec<u8>) -> Vec<u8>;

    /// What it sends when a client connects.
    fn greets(&mut self) -> Vec<u8> {
        Vec::new()
    }

    /// What it sends when nobody asked, now and then: asked for every few milliseconds.
    fn says(&mut self) -> Vec<u8> {
        Vec::new()
    }

    /// Something that such a device may send unasked at any time (an alert, a key pressed); empty
    /// where it never does.
    fn chatter(&mut self) -> Vec<u8> {
        Vec::new()
    }

    /// Refuses the next command that it could carry out, in its own words. Whether it can: a device
    /// that is only read may have no such answer.
    fn refuse_next(&mut self) -> bool;

    /// Off and on again: what it remembers in volatile memory is gone.
    fn reboot(&mut self);
}

/// A simulator that brings its own sockets or files. Dropping it ends it.
pub trait Hosted: Send + Sync {
    /// Where its driver finds the instrument of that name.
    fn address(&self, name: &str) -> Option<Address>;

    /// The next picture or answer gets lost.
    fn lose_next(&self);

    /// What this machine lacks for the driver to be tried against it: a program that is built apart,
    /// a kernel module. Whoever tries says so, and does not pass over it in silence.
    fn lacks(&self) -> Option<String> {
        None
    }

    /// When requests for a picture reached the camera of that name, real time: how far apart those
    /// of several cameras are is measured by them.
    fn releases(&self, name: &str) -> Vec<Instant> {
        let _ = name;
        Vec::new()
    }
}
