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
             $(stat -Lc %G {path}) $USER`, then log in again"
        ),
        // The crate reports a port that somebody locked as missing.
        _ if text.contains("exclusive lock") || text.contains("busy") => format!(
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
        _ if text.contains("typewriter") || text.contains("ioctl") => {
            format!("this is no serial port ({text})")
        }
        _ => text,
    }
}

/// A line that was open and is no more.
pub(super) fn gone(address: &Address, error: &io::Error) -> InstrumentError {
    InstrumentError::Disconnected(format!("{address}: {error}"))
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;
    use std::time::Duration;

    use serialport::SerialPort;

    use super::super::port::{PortSettings, open};
    use super::*;

    /// What opening an address comes to.
    fn said(address: &str) -> String {
        let address: Address = address.parse().unwrap();
        let deadline = Duration::from_millis(300);
        match open(&address, &PortSettings::at(9600), deadline) {
            Ok(_) => "open".to_owned(),
            Err(error) => cannot_open(&address, &error).to_string(),
        }
    }

    #[test]
    fn a_port_that_is_missing_or_none_says_so() {
        let missing = said("/dev/there-is-no-such-port");
        assert!(missing.contains("no such port"), "{missing}");
        let none = said("/dev/null");
        assert!(none.contains("no serial port"), "{none}");
    }

    #[test]
    fn a_port_in_use_names_the_cure() {
        let (_master, slave) = serialport::TTYPort::pair().unwrap();
        let path = slave.name().unwrap();
        drop(slave);
        let owner = open(&path.parse().unwrap(), &PortSettings::at(9600), Duration::ZERO).unwrap();
        let in_use = said(&path);
        assert!(in_use.contains("another program has it open"), "{in_use}");
        assert!(in_use.contains(&format!("fuser -v {path}")), "{in_use}");
        drop(owner);
        assert_eq!(said(&path), "open");
    }

    #[test]
    fn a_port_without_permission_names_the_cure() {
        // The tests may run as root, who has every permission: the error as the crate makes it.
        let denied = io::Error::new(io::ErrorKind::PermissionDenied, "Permission denied");
        let address: Address = "/dev/serial/by-id/usb-FTDI_1-if00".parse().unwrap();
        let said = cannot_open(&address, &denied).to_string();
        // A name that stays is a link: the group is that of the port behind it.
        assert!(said.contains("dialout") && said.contains("stat -Lc %G"), "{said}");
    }

    #[test]
    fn a_host_that_refuses_is_told_from_one_that_is_not_there() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        drop(listener);
        let refused = said(&format!("tcp:127.0.0.1:{port}"));
        assert!(refused.contains(&format!("nothing listens on port {port}")), "{refused}");
        let unknown = said("tcp:there-is-no-such-host.invalid:23");
        assert!(unknown.contains("check the address"), "{unknown}");
    }
}
