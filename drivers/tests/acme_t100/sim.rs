//! An Acme T100 that answers bytes, written apart from the driver's side.
//!
//! Its trap: it reads in Fahrenheit after power on, and in whatever unit somebody chose since.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::sim::{Device, Probe, Simulated};

struct T100 {
    channels: BTreeMap<String, Arc<dyn Probe>>,
    celsius: bool,
    refuse: bool,
}

/// All instruments of the rig at one address are channels of one device.
pub(super) fn simulate(all: &[Simulated]) -> Result<Box<dyn Device>, String> {
    let mut channels = BTreeMap::new();
    for it in all {
        let channel = it.options.text("channel").map_err(|error| error.to_string())?;
        channels.insert(channel.to_owned(), it.part.probe()?);
    }
    Ok(Box::new(T100 { channels, celsius: false, refuse: false }))
}

impl T100 {
    fn answer(&mut self, command: &str) -> String {
        if std::mem::take(&mut self.refuse) {
            return "ERR 2".to_owned();
        }
        match command.split_once(' ') {
            None if command == "ID?" => "ACME T100 4711".to_owned(),
            Some(("UNIT", unit @ ("C" | "F"))) => {
                self.celsius = unit == "C";
                "OK".to_owned()
            }
            Some(("T?", channel)) => match self.channels.get(channel).map(|probe| probe.read()) {
                Some(Ok(degc)) if self.celsius => format!("{degc:+.3} C"),
                Some(Ok(degc)) => format!("{:+.3} F", degc * 1.8 + 32.0),
                Some(Err(_)) | None => "OPEN".to_owned(),
            },
            _ => "ERR 1".to_owned(),
        }
    }
}

impl Device for T100 {
    fn receive(&mut self, pending: &mut Vec<u8>) -> Vec<u8> {
        let mut out = Vec::new();
        // A command may come in pieces: what has no end yet stays.
        while let Some(end) = pending.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = pending.drain(..=end).collect();
            let answer = self.answer(String::from_utf8_lossy(&line).trim_end());
            out.extend(format!("{answer}\r\n").into_bytes());
        }
        out
    }

    fn refuse_next(&mut self) -> bool {
        self.refuse = true;
        true
    }

    fn reboot(&mut self) {
        self.celsius = false;
    }
}
