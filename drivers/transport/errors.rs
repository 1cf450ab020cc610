//! What an operating system's error means to somebody who wants the instrument to answer.

use std::io;

use beampose_core::InstrumentError;

use super::Address;
use super::ports::attached_ports;

/// A line that cannot be opened: why, and what cures it.
pub(super) fn cannot_open(address: &Address, error: &io::Error) -> InstrumentError {
    let cure = match address {
        Address::Serial { path, .. } => serial_cure(path, error),
        Address::Tcp { host, port } => match error.kind() {
            io::ErrorKind::ConnectionRefused => {
                format!(
                    "{host} is there, but nothing listens on port {port}: is the instrument's network interface on, or does another program hold its one connection?"
                )
            }
            io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock => {
                format!("nothing answers at {host}: check cable, power and address (`ping {host}`)")
            }
            _ => format!("check the address and the network ({error})"),
        },
        _ => error.to_string(),
    };
    InstrumentError::Disconnected(format!("{address}: {cure}"))
}

fn serial_cure(path: &str, error: &io::Error) -> String {
    let text = error.to_string();
    match error.kind() {
        io::ErrorKind::PermissionDenied => format!(
            "no permission; the port belongs to a group (mostly `dialout`): `sudo usermod -aG \
             $(stat -c %G {path}) $USER`, then log in again"
        ),
        // The crate reports a port that somebody locked as missing.
        _ if text.contains("lock") || text.contains("busy") => format!(
            "another program has it open (`fuser -v {path}` says which); two must not speak to one \
             instrument"
        ),
        io::ErrorKind::NotFound => {
            let ports: Vec<String> = attached_ports().into_iter().map(|port| port.path).collect();
            if ports.is_empty() {
                "there is no such port, and no other serial port is attached: check cable and power"
                    .to_owned()
            } else {
                format!("there is no such port; attached are {}", ports.join(", "))
            }
        }
        _ => text,
    }
}

/// A line that was open and is no more.
pub(super) fn gone(address: &Address, error: &io::Error) -> InstrumentError {
    InstrumentError::Disconnected(format!("{address}: {error}"))
}
