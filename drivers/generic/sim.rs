//! An instrument that answers as the rig file says it does; it reads the options by itself.

use std::sync::Arc;

use beampose_core::Quantity;

use crate::registry::Role;
use crate::sim::{Device, Probe, Simulated};

/// What somebody may ask of it.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Asked {
    Reading,
    Identity,
    Setting,
}

/// One instrument.
pub struct GenericDevice {
    probe: Arc<dyn Probe>,
    known: Vec<(Vec<u8>, Asked)>,
    template: String,
    unit: String,
    quantity: Quantity,
    end: Vec<u8>,
}

pub(super) fn simulate(all: &[Simulated]) -> Result<Box<dyn Device>, String> {
    let [it] = all else { return Err("only one reader on a line".to_owned()) };
    let text = |name: &str| it.options.text(name).map_err(|error| error.to_string());
    let Role::Sensor { quantity, .. } = it.role else { return Err("no sensor".to_owned()) };
    let mut known = vec![(unescape(text("command")?), Asked::Reading)];
    known.push((unescape(text("identify")?), Asked::Identity));
    for setup in text("setup")?.split('|') {
        known.push((unescape(setup), Asked::Setting));
    }
    known.retain(|(command, _)| !command.is_empty());
    // The longest first: one command may begin as another does.
    known.sort_by_key(|(command, _)| std::cmp::Reverse(command.len()));
    Ok(Box::new(GenericDevice {
        probe: it.part.probe()?,
        known,
        template: text("answer")?.to_owned(),
        unit: text("unit")?.to_owned(),
        quantity,
        end: unescape(text("terminator")?),
    }))
}

fn unescape(text: &str) -> Vec<u8> {
    let replaced = text.replace("\\\\", "\0").replace("\\r", "\r").replace("\\n", "\n");
    let mut parts = replaced.split("\\x");
    let mut out = parts.next().unwrap_or_default().replace("\\t", "\t").into_bytes();
    for part in parts {
        let (code, rest) = part.split_at_checked(2).unwrap_or((part, ""));
        out.extend(u8::from_str_radix(code, 16).ok());
        out.extend(rest.replace("\\t", "\t").into_bytes());
    }
    out.iter_mut().filter(|byte| **byte == 0).for_each(|byte| *byte = b'\\');
    out
}

/// A reading in the unit that the instrument speaks.
fn spoken(value: f64, unit: &str, quantity: Quantity) -> f64 {
    match (unit, quantity) {
        ("um", Quantity::Wavelength) => value / 1000.0,
        ("pm", _) | ("um" | "uA", _) => value * 1000.0,
        ("THz", _) => 299_792.458 / value,
        ("m" | "A", _) => value / 1000.0,
        ("cm", _) => value / 10.0,
        ("in", _) => value / 25.4,
        ("rad", _) => value.to_radians(),
        ("mrad", _) => value.to_radians() * 1000.0,
        ("K", _) => value + 273.15,
        ("F", _) => value * 1.8 + 32.0,
        _ => value,
    }
}

impl GenericDevice {
    fn answer(&self, asked: Asked) -> Vec<u8> {
        let text = match asked {
            Asked::Setting => return Vec::new(),
            Asked::Identity => "GENERIC,SIMULATED,0,1".to_owned(),
            Asked::Reading => {
                let number = self.probe.read().map_or_else(
                    |_| "---".to_owned(),
                    |value| format!("{:.9}", spoken(value, &self.unit, self.quantity)),
                );
                self.template.replace('*', "").replace("{value}", &number)
            }
        };
        let mut bytes = text.into_bytes();
        bytes.extend(&self.end);
        bytes
    }
}

impl Device for GenericDevice {
    fn receive(&mut self, pending: &mut Vec<u8>) -> Vec<u8> {
        let mut out = Vec::new();
        while !pending.is_empty() {
            let known = self.known.iter().find(|(command, _)| pending.starts_with(command));
            if let Some((command, asked)) = known {
                out.extend(self.answer(*asked));
                pending.drain(..command.len());
            } else if self.known.iter().any(|(command, _)| command.starts_with(pending)) {
                break;
            } else {
                pending.remove(0);
            }
        }
        out
    }

    fn refuse_next(&mut self) -> bool {
        // It knows one question; what another instrument says when it refuses nobody can know.
        false
    }

    fn reboot(&mut self) {}
}
