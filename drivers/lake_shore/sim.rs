//! A Lake Shore monitor with the inputs that the rig reads; the others have no sensor.
//!
//! It keeps these traps: zeros for an input that reads nothing (only its status tells), three
//! decimals, queries that come faster than 20 in a second are lost, what it does not understand it
//! does not answer but notes in a register, which reading clears.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use beampose_core::Clock;

use crate::sim::{Device, Probe, Simulated};

/// A little less than a twentieth of a second: two clocks are never alike.
const BUSY: Duration = Duration::from_millis(45);
/// Status: sensor units over range, as an open input.
const OPEN: u16 = 128;
const COMMAND_ERROR: u8 = 32;
const EXECUTION_ERROR: u8 = 16;

struct Input {
    probe: Arc<dyn Probe>,
    /// The last reading, degrees Celsius; `None` after one that failed.
    last: Option<f64>,
}

/// One monitor.
pub struct LakeShoreMonitor {
    inputs: BTreeMap<String, Input>,
    clock: Arc<dyn Clock>,
    /// When the last command came.
    last: Option<Duration>,
    events: u8,
    refuse: bool,
}

pub(super) fn simulate(all: &[Simulated]) -> Result<Box<dyn Device>, String> {
    let mut inputs = BTreeMap::new();
    for it in all {
        let channel = it.options.text("channel").map_err(|error| error.to_string())?;
        let input = Input { probe: it.part.probe()?, last: None };
        if inputs.insert(channel.to_uppercase(), input).is_some() {
            return Err(format!("{}: input {channel} is already read", it.name));
        }
    }
    let clock = all.first().map(|it| Arc::clone(&it.clock)).ok_or("no instrument")?;
    Ok(Box::new(LakeShoreMonitor { inputs, clock, last: None, events: 0, refuse: false }))
}

/// The names of all inputs: those of a 218 where the rig's begin with a digit.
fn names(of: &str) -> &'static [&'static str] {
    if of.starts_with(|first: char| first.is_ascii_digit()) {
        &["1", "2", "3", "4", "5", "6", "7", "8"]
    } else {
        &["A", "B", "C", "D", "C1", "C2", "C3", "C4", "C5", "D1", "D2", "D3", "D4", "D5"]
    }
}

impl LakeShoreMonitor {
    fn is_218(&self) -> bool {
        self.inputs.keys().next().is_some_and(|name| name.as_bytes()[0].is_ascii_digit())
    }

    fn knows(&self, channel: &str) -> bool {
        let first = self.inputs.keys().next();
        first.is_some_and(|first| names(first).contains(&channel))
    }

    /// What an input reads, in a unit that `of` makes of degrees Celsius.
    fn reading(&mut self, channel: &str, of: fn(f64) -> f64) -> Option<String> {
        if channel == "0" && self.is_218() {
            let all: Option<Vec<String>> =
                names("1").iter().map(|name| self.reading(name, of)).collect();
            return all.map(|all| all.join(","));
        }
        if !self.knows(channel) {
            return None;
        }
        let celsius = self.inputs.get_mut(channel).and_then(|input| {
            input.last = input.probe.read().ok();
            input.last
        });
        Some(celsius.map_or_else(|| "+000.000".to_owned(), |it| format!("{:+08.3}", of(it))))
    }

    fn status(&self, channel: &str) -> Option<String> {
        if !self.knows(channel) {
            return None;
        }
        let reads = self.inputs.get(channel).is_some_and(|input| input.last.is_some());
        Some(format!("{:03}", if reads { 0 } else { OPEN }))
    }

    fn answer(&mut self, line: &str) -> Option<String> {
        let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
        let channel = rest.trim().to_uppercase();
        let word = word.to_uppercase();
        if self.refuse && word.ends_with("RDG?") {
            self.refuse = false;
            self.events |= EXECUTION_ERROR;
            return None;
        }
        let answered = match word.as_str() {
            "*IDN?" if self.is_218() => Some("LSCI,MODEL218S,21A1234,080603".to_owned()),
            "*IDN?" => Some("LSCI,MODEL336,LSA1234/#######,2.9".to_owned()),
            "*CLS" => {
                self.events = 0;
                return None;
            }
            "*ESR?" => Some(std::mem::take(&mut self.events).to_string()),
            "CRDG?" => self.reading(&channel, |celsius| celsius),
            "KRDG?" => self.reading(&channel, |celsius| celsius + 273.15),
            // A platinum resistor of 100 ohms, roughly.
            "SRDG?" => self.reading(&channel, |celsius| 100.0 + 0.385 * celsius),
            "RDGST?" => self.status(&channel),
            _ => {
                self.events |= COMMAND_ERROR;
                return None;
            }
        };
        if answered.is_none() {
            self.events |= EXECUTION_ERROR;
        }
        answered
    }
}

impl Device for LakeShoreMonitor {
    fn receive(&mut self, pending: &mut Vec<u8>) -> Vec<u8> {
        let mut out = String::new();
        while let Some(end) = pending.iter().position(|byte| *byte == b'\n') {
            let raw: Vec<u8> = pending.drain(..=end).collect();
            let line = String::from_utf8_lossy(&raw).trim().to_owned();
            if line.is_empty() {
                continue;
            }
            // Only queries count: a setter has no answer, so that a client in virtual time may send
            // the next command, later on its clock, before this thread saw the first.
            if line.contains('?') {
                let now = self.clock.now().monotonic;
                let busy = self.last.is_some_and(|last| now.saturating_sub(last) < BUSY);
                self.last = Some(now);
                if busy {
                    continue;
                }
            }
            if let Some(answer) = self.answer(&line) {
                out.push_str(&answer);
                out.push_str("\r\n");
            }
        }
        out.into_bytes()
    }

    fn refuse_next(&mut self) -> bool {
        self.refuse = true;
        true
    }

    fn reboot(&mut self) {
        self.events = 128;
    }
}
