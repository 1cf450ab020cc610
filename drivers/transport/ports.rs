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

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn a_port_goes_by_the_name_that_stays() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().canonicalize().unwrap();
        let (devices, links) = (place.join("dev"), place.join("by-id"));
        std::fs::create_dir(&devices).unwrap();
        std::fs::create_dir(&links).unwrap();
        for name in ["ttyUSB0", "ttyUSB1", "ttyS0"] {
            std::fs::write(devices.join(name), "").unwrap();
        }
        symlink("../dev/ttyUSB1", links.join("usb-FTDI_A50285BI-if00-port0")).unwrap();
        symlink(devices.join("ttyUSB0"), links.join("usb-Zaber_X-LRQ-if00")).unwrap();
        // Left behind by a device that is gone.
        symlink("../dev/ttyUSB7", links.join("usb-gone-if00")).unwrap();
        let names = stable_names(&links);
        let name = |device: &str| names.get(&devices.join(device)).cloned();
        let link = |name: &str| Some(links.join(name).to_string_lossy().into_owned());
        assert_eq!(name("ttyUSB1"), link("usb-FTDI_A50285BI-if00-port0"));
        assert_eq!(name("ttyUSB0"), link("usb-Zaber_X-LRQ-if00"));
        assert_eq!(name("ttyS0"), None);
        assert_eq!(names.len(), 2);
        assert!(stable_names(&place.join("nowhere")).is_empty());
    }
}
