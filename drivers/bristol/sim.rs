//! A Bristol meter behind its telnet server.
//!
//! It keeps these traps: a banner with telnet options in it, wavelengths in the medium that is set
//! (air, as from the factory), frequencies that are not, a register that remembers that a value was
//! read, queries in error that are not answered but queued.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::sim::{Device, Probe, Simulated};

/// Refractive index of air under usual conditions.
const AIR: f64 = 1.000_276;
const READ_BEFORE: u32 = 1;
const NO_SIGNAL: u32 = 256;

/// One meter.
pub struct BristolMeter {
    probe: Arc<dyn Probe>,
    /// The wavelength in vacuum of the last scan, nm.
    last: Option<f64>,
    scan: u64,
    fetched: bool,
    in_air: bool,
    averaging: bool,
    count: u32,
    errors: VecDeque<(i32, &'static str)>,
    refuse: bool,
}

pub(super) fn simulate(all: &[Simulated]) -> Result<Box<dyn Device>, String> {
    let [it] = all else { return Err("a Bristol has one input only".to_owned()) };
    Ok(Box::new(BristolMeter {
        probe: it.part.probe()?,
        last: None,
        scan: 0,
        fetched: false,
        in_air: true,
        averaging: false,
        count: 2,
        errors: VecDeque::new(),
        refuse: false,
    }))
}

/// Whether a word is a keyword, in its long or its short form (the capitals).
fn is(word: &str, keyword: &str) -> bool {
    let short: String = keyword.chars().filter(|c| !c.is_ascii_lowercase()).collect();
    word.eq_ignore_ascii_case(keyword) || word.eq_ignore_ascii_case(&short)
}

impl BristolMeter {
    fn scan_once(&mut self) {
        self.scan += 1;
        self.fetched = false;
        self.last = self.probe.read().ok();
    }

    fn register(&self) -> u32 {
        let signal = if self.last.is_some() { 0 } else { NO_SIGNAL };
        signal | if self.fetched { READ_BEFORE } else { 0 }
    }

    fn value(&mut self, what: &str) -> Option<String> {
        let register = self.register();
        let shown = self.last.map_or(0.0, |nm| if self.in_air { nm / AIR } else { nm });
        let power = if self.last.is_some() { 1.25 } else { 0.0 };
        let answer = if is(what, "FREQuency") {
            format!("{:.7}", self.last.map_or(0.0, |nm| 299_792.458 / nm))
        } else if is(what, "WAVelength") {
            format!("{shown:.6}")
        } else if is(what, "WNUMber") {
            format!("{:.6}", if shown > 0.0 { 1e7 / shown } else { 0.0 })
        } else if is(what, "POWer") {
            format!("{power:.3}")
        } else if is(what, "ENVironment") {
            "24.1, 760.2".to_owned()
        } else if is(what, "ALL") {
            format!("{}, {register}, {shown:.6}, {power:.3}", self.scan)
        } else {
            return None;
        };
        self.fetched = true;
        Some(answer)
    }

    /// A query's answer, an empty one for a setter; `None` for what it does not know.
    fn obey(&mut self, header: &str, value: &str) -> Option<String> {
        let parts: Vec<&str> = header.trim_start_matches(':').split(':').collect();
        let known = match parts[..] {
            [verb, what] if is(verb, "READ") || is(verb, "MEASure") => {
                self.scan_once();
                return self.value(what.strip_suffix('?')?);
            }
            [verb, what] if is(verb, "FETCh") => {
                if self.scan == 0 {
                    self.scan_once();
                }
                return self.value(what.strip_suffix('?')?);
            }
            ["*IDN?"] => "BRISTOL WAVELENGTH METER, 671, 1135, 1.03".to_owned(),
            ["*CLS"] => {
                self.errors.clear();
                String::new()
            }
            ["*STB?"] => {
                let errors = if self.errors.is_empty() { 0 } else { 8 };
                (errors | if self.register() == 0 { 0 } else { 32 }).to_string()
            }
            [a, b] if is(a, "SYSTem") && is(b, "ERRor?") => {
                let (number, words) = self.errors.pop_front().unwrap_or((0, "No Error"));
                format!("{number},\"{words}\"")
            }
            [a, b, c] if is(a, "STATus") && is(b, "QUEStionable") && is(c, "CONDition?") => {
                self.register().to_string()
            }
            [a, b] if is(a, "SENSe") && is(b, "MEDium?") => {
                if self.in_air { "AIR" } else { "VAC" }.to_owned()
            }
            [a, b] if is(a, "SENSe") && is(b, "MEDium") => {
                self.in_air = !is(value, "VACuum");
                String::new()
            }
            [a, b, c] if is(a, "SENSe") && is(b, "AVERage") && is(c, "STATe?") => {
                if self.averaging { "ON" } else { "OFF" }.to_owned()
            }
            [a, b, c] if is(a, "SENSe") && is(b, "AVERage") && is(c, "STATe") => {
                self.averaging = value.eq_ignore_ascii_case("ON");
                String::new()
            }
            [a, b, c] if is(a, "SENSe") && is(b, "AVERage") && is(c, "COUNt?") => {
                self.count.to_string()
            }
            [a, b, c] if is(a, "SENSe") && is(b, "AVERage") && is(c, "COUNt") => {
                self.count = value.parse().ok().filter(|count| (2..=128).contains(count))?;
                String::new()
            }
            _ => return None,
        };
        Some(known)
    }

    fn answer(&mut self, line: &str) -> String {
        let (header, value) = line.split_once(' ').unwrap_or((line, ""));
        let is_error_query = header.to_ascii_uppercase().contains("ERR");
        if self.refuse && !is_error_query {
            self.refuse = false;
            self.errors.push_back((-200, "Execution error"));
            return String::new();
        }
        match self.obey(&header.to_ascii_uppercase(), value.trim()) {
            Some(answer) if answer.is_empty() => answer,
            Some(answer) => answer + "\r\n",
            None => {
                self.errors.push_back((-113, "Undefined header"));
                String::new()
            }
        }
    }
}

impl Device for BristolMeter {
    fn receive(&mut self, pending: &mut Vec<u8>) -> Vec<u8> {
        let mut out = String::new();
        while let Some(end) = pending.iter().position(|byte| *byte == b'\n') {
            let raw: Vec<u8> = pending.drain(..=end).collect();
            // A telnet client answers our options: 0xff and two bytes, none of them printable here.
            let line: Vec<u8> =
                raw.into_iter().filter(|byte| (b' '..=b'~').contains(byte)).collect();
            let line = String::from_utf8_lossy(&line).trim().to_owned();
            if !line.is_empty() {
                out.push_str(&self.answer(&line));
            }
        }
        out.into_bytes()
    }

    fn greets(&mut self) -> Vec<u8> {
        let mut bytes = b"\xff\xfb\x01\xff\xfb\x03\xff\xfd\x18\r\n".to_vec();
        bytes.extend(b"Bristol Instruments, Inc.\r\nLaser Wavelength Meter\r\n\r\n");
        bytes.extend(b"SCPI interface, type *IDN? for the version.\r\n\r\n");
        bytes
    }

    fn refuse_next(&mut self) -> bool {
        self.refuse = true;
        true
    }

    fn reboot(&mut self) {
        self.errors.clear();
        self.last = None;
        self.scan = 0;
        self.fetched = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::TestProbe;

    #[test]
    fn a_wavelength_depends_on_the_medium_and_a_frequency_does_not() {
        let mut meter = BristolMeter {
            probe: Arc::new(TestProbe::new(658.0, 0.0)),
            last: None,
            scan: 0,
            fetched: false,
            in_air: true,
            averaging: false,
            count: 2,
            errors: VecDeque::new(),
            refuse: false,
        };
        let mut ask = |words: &str| {
            let mut pending = format!("{words}\n").into_bytes();
            String::from_utf8(meter.receive(&mut pending)).unwrap().trim().to_owned()
        };
        let both = |air: &str, frequency: &str| (air.to_owned(), frequency.to_owned());
        let in_air = (ask(":READ:WAV?"), ask(":fetch:frequency?"));
        assert_eq!(in_air, both("657.818442", "455.6116383"));
        assert_eq!(ask(":STAT:QUES:COND?"), "1");
        assert_eq!(ask(":SENS:MED VAC"), "");
        let in_vacuum = (ask(":READ:WAV?"), ask(":FETC:FREQ?"));
        assert_eq!(in_vacuum, both("658.000000", "455.6116383"));
        assert_eq!(ask(":NONSENSE?"), "");
        assert_eq!(ask(":SYST:ERR?"), "-113,\"Undefined header\"");
        assert_eq!(ask(":SYST:ERR?"), "0,\"No Error\"");
    }
}
