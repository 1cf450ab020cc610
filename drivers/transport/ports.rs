//! The serial ports that are attached, by names that stay.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A serial port of this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AttachedPort {
    /// The path to write into a rig file: by-id where there is one, since it stays the same
    /// whichever is plugged in first.
    pub path: String,
    /// The device path now.
    pub device: String,
    /// What the USB device says of itself.
    pub about: Option<String>,
}

/// All serial ports, by path.
#[must_use]
pub fn attached_ports() -> Vec<AttachedPort> {
    let stable = stable_names(Path::new("/dev/serial/by-id"));
    let ports = serialport::available_ports().unwrap_or_default();
    let mut ports: Vec<AttachedPort> = ports
        .into_iter()
        .map(|port| {
            let about = match port.port_type {
                serialport::SerialPortType::UsbPort(usb) => {
                    let words = [usb.manufacturer, usb.product, usb.serial_number];
                    Some(words.into_iter().flatten().collect::<Vec<_>>().join(" "))
                }
                _ => None,
            };
            let path = stable.get(Path::new(&port.port_name));
            AttachedPort {
                path: path.cloned().unwrap_or_else(|| port.port_name.clone()),
                device: port.port_name,
                about: about.filter(|words| !words.is_empty()),
            }
        })
        .collect();
    ports.sort_by(|a, b| a.path.cmp(&b.path));
    ports
}

/// Device path to its name in a folder of links.
fn stable_names(folder: &Path) -> BTreeMap<PathBuf, String> {
    let Ok(entries) = std::fs::read_dir(folder) else { return BTreeMap::new() };
    entries
        .flatten()
        .filter_map(|entry| {
            let device = std::fs::canonicalize(entry.path()).ok()?;
            Some((device, entry.path().to_string_lossy().into_owned()))
        })
        .collect()
}
