//! A pseudo terminal under a name that stays, as a serial port has one.

use std::io;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{ControlModes, InputModes, OptionalActions, tcgetattr, tcsetattr};

/// How the client has set the port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LineSettings {
    /// Bits per second.
    pub baud: u32,
    /// Two stop bits.
    pub two_stop_bits: bool,
    /// XON and XOFF.
    pub software_flow: bool,
    /// RTS and CTS.
    pub hardware_flow: bool,
}

/// The instrument's side of a pseudo terminal, linked from a path of our own.
pub(super) struct Pty {
    pub(super) master: OwnedFd,
}

impl Pty {
    /// A new one, raw, linked from `link`.
    pub(super) fn linked(link: &Path) -> io::Result<Self> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        let name = ptsname(&master, Vec::new())?;
        let path = PathBuf::from(name.to_string_lossy().into_owned());
        // Raw before anybody opens it, or carriage returns and echoes get mangled.
        let mut settings = tcgetattr(&master)?;
        settings.make_raw();
        tcsetattr(&master, OptionalActions::Now, &settings)?;
        let new = link.with_extension("new");
        let _ = std::fs::remove_file(&new);
        std::os::unix::fs::symlink(&path, &new)?;
        std::fs::rename(&new, link)?;
        Ok(Self { master })
    }

    pub(super) fn settings(&self) -> Option<LineSettings> {
        let settings = tcgetattr(&self.master).ok()?;
        let control = settings.control_modes;
        Some(LineSettings {
            baud: settings.output_speed(),
            two_stop_bits: control.contains(ControlModes::CSTOPB),
            software_flow: settings.input_modes.contains(InputModes::IXON),
            hardware_flow: control.contains(ControlModes::CRTSCTS),
        })
    }
}
