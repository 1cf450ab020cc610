//! Where an instrument is, as written in a rig file.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// Where an instrument is.
///
/// `/dev/ttyUSB0`, `/dev/serial/by-id/usb-...`, `serial:COM3` with `?baud=9600` behind it where the
/// driver's own setting does not hold; `tcp:host:port`; `folder:pictures/left`;
/// `simulator:tcp` and `simulator:pty`, with `/name` behind it where instruments share one device.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Address {
    /// A serial port.
    Serial {
        /// Its device path.
        path: String,
        /// Another speed than the driver's own.
        baud: Option<u32>,
    },
    /// A TCP port.
    Tcp {
        /// Name or number of the host.
        host: String,
        /// The port.
        port: u16,
    },
    /// A folder of files.
    Folder(PathBuf),
    /// Something that only the driver understands, as the name of a USB camera.
    Device(String),
    /// The driver's own simulator, started by this program.
    Simulator {
        /// Through a pty, else through TCP.
        pty: bool,
        /// Which device, where several instruments share it.
        device: Option<String>,
    },
}

/// An address that cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{found:?} is no address: {why}")]
pub struct AddressError {
    /// What stands there.
    pub found: String,
    /// What is wrong with it.
    pub why: String,
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let wrong = |why: &str| AddressError { found: text.to_owned(), why: why.to_owned() };
        if let Some(rest) = text.strip_prefix("tcp:") {
            let (host, port) =
                rest.rsplit_once(':').ok_or_else(|| wrong("expected tcp:host:port"))?;
            let port = port.parse().map_err(|_| wrong("the port must be 1 to 65535"))?;
            let host = host.trim_matches(['[', ']']).to_owned();
            if host.is_empty() || port == 0 {
                return Err(wrong("expected tcp:host:port"));
            }
            return Ok(Self::Tcp { host, port });
        }
        if let Some(rest) = text.strip_prefix("simulator:") {
            let (how, device) = match rest.split_once('/') {
                Some((how, device)) => (how, Some(device.to_owned())),
                None => (rest, None),
            };
            let pty = match how {
                "pty" => true,
                "tcp" => false,
                _ => return Err(wrong("expected simulator:tcp or simulator:pty")),
            };
            return Ok(Self::Simulator { pty, device });
        }
        if let Some(rest) = text.strip_prefix("folder:") {
            return Ok(Self::Folder(PathBuf::from(rest)));
        }
        if let Some(rest) = text.strip_prefix("device:") {
            return Ok(Self::Device(rest.to_owned()));
        }
        let serial = text.strip_prefix("serial:");
        let Some(rest) = serial.or(looks_serial(text).then_some(text)) else {
            return Err(wrong(
                "expected a serial port (/dev/ttyUSB0), tcp:host:port, folder:path, device:name or \
                 simulator:tcp",
            ));
        };
        let (path, baud) = match rest.split_once("?baud=") {
            None => (rest, None),
            Some((path, baud)) => {
                (path, Some(baud.parse().map_err(|_| wrong("the baud rate must be a number"))?))
            }
        };
        if path.is_empty() {
            return Err(wrong("the name of the serial port is missing"));
        }
        Ok(Self::Serial { path: path.to_owned(), baud })
    }
}

/// Whether it is the name of a serial port without a word before it.
fn looks_serial(text: &str) -> bool {
    text.starts_with('/') || text.starts_with("COM")
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial { path, baud } => {
                let word = if looks_serial(path) { "" } else { "serial:" };
                write!(f, "{word}{path}")?;
                baud.map_or(Ok(()), |baud| write!(f, "?baud={baud}"))
            }
            Self::Tcp { host, port } if host.contains(':') => write!(f, "tcp:[{host}]:{port}"),
            Self::Tcp { host, port } => write!(f, "tcp:{host}:{port}"),
            Self::Folder(path) => write!(f, "folder:{}", path.display()),
            Self::Device(name) => write!(f, "device:{name}"),
            Self::Simulator { pty, device } => {
                write!(f, "simulator:{}", if *pty { "pty" } else { "tcp" })?;
                device.as_ref().map_or(Ok(()), |device| write!(f, "/{device}"))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_read_as_they_are_written() {
        for text in [
            "/dev/ttyUSB0",
            "/dev/serial/by-id/usb-FTDI_1-if00?baud=9600",
            "tcp:10.0.0.7:55550",
            "tcp:[::1]:23",
            "folder:pictures/left",
            "device:usb:001,002",
            "simulator:pty",
            "simulator:tcp/chain",
            "serial:usb-port?baud=4800",
        ] {
            assert_eq!(text.parse::<Address>().unwrap().to_string(), text);
        }
        assert_eq!("serial:COM3".parse::<Address>().unwrap().to_string(), "COM3");
    }

    #[test]
    fn what_is_no_address_says_what_was_expected() {
        for (text, part) in [
            ("tcp:host", "tcp:host:port"),
            ("tcp:host:99999", "1 to 65535"),
            ("tcp:[]:23", "tcp:host:port"),
            ("ttyUSB0", "/dev/ttyUSB0"),
            ("/dev/ttyUSB0?baud=fast", "baud"),
            ("simulator:usb", "simulator:tcp"),
            ("serial:", "missing"),
        ] {
            let error = text.parse::<Address>().unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
    }
}
