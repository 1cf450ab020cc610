//! An LDC501 that answers its command language, written apart from the driver's side.
//!
//! Its traps: setters answer nothing; an error comes into its register some milliseconds after the
//! command; reading a register clears it; 64 bytes of input buffer, and all of it is thrown away
//! when it overflows; how answers end and whether tokens are words is a setting that outlives power
//! off; a lower limit drags the set point down with it, without a word; the current source has no
//! delay; an open contact ends the current by itself. After power on the temperature control is off.
//! It does not insist on the blank line and `ULOC 1`: what the real one refuses without is not known.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use beampose_core::Clock;

use crate::sim::{Device, Diode, Part, Probe, Simulated};

/// From a command to its error in the register.
const ERROR_DELAY: Duration = Duration::from_millis(10);
const BUFFER: usize = 64;
/// Full scale of the LDC501 in its two ranges, mA.
const FULL_SCALE: [f64; 2] = [250.0, 500.0];

/// Tokens with their integers, and the value at the factory.
const TOKENS: &[(&str, &[&str], usize)] = &[
    ("SMOD", &["CC", "CP"], 0),
    ("RNGE", &["LOW", "HIGH"], 1),
    ("MODU", &["OFF", "ON"], 0),
    ("SIBW", &["LOW", "HIGH"], 0),
    ("PDMW", &["OFF", "ON"], 0),
    ("TEON", &["OFF", "ON"], 1),
    ("TMOD", &["CC", "CT"], 1),
    ("TOKN", &["OFF", "ON"], 1),
    ("TERM", &["NONE", "CR", "LF", "CRLF", "LFCR"], 2),
    ("AILM", &["NO", "YES"], 0),
    ("TSNR", &["NTC10UA", "NTC100UA", "NTC1MA", "NTCAUTO", "RTD", "LM335", "AD590"], 3),
];

/// Numbers with their bounds, and the value at the factory.
const NUMBERS: &[(&str, f64, f64, f64)] = &[
    ("SILD", 0.0, 500.0, 0.0),
    ("SILM", 0.0, 500.0, 100.0),
    ("SVLM", 0.1, 10.0, 5.0),
    ("BIAS", 0.0, 5.0, 0.0),
    ("SIPD", 0.0, 5000.0, 0.0),
    ("PILM", 0.0, 5000.0, 1000.0),
    ("RESP", 0.0, 5000.0, 1.0),
    ("SWPD", 0.0, 5000.0, 0.0),
    ("PWLM", 0.0, 5000.0, 10.0),
    ("TCUR", -4.5, 4.5, 0.0),
    ("TILM", -4.5, 4.5, 1.0),
    ("TVLM", -8.5, 8.5, 5.0),
    ("TEMP", -55.0, 150.0, 25.0),
    ("TMIN", -55.0, 150.0, 0.0),
    ("TMAX", -55.0, 150.0, 50.0),
    ("ULOC", 0.0, 1.0, 0.0),
];

/// An LDC501 with a diode, its temperature sensor, or both.
pub struct Ldc500 {
    diode: Option<Arc<dyn Diode>>,
    probe: Option<Arc<dyn Probe>>,
    clock: Arc<dyn Clock>,
    tokens: BTreeMap<&'static str, usize>,
    numbers: BTreeMap<&'static str, f64>,
    /// What flowed last while it was on, mA.
    flowed: f64,
    execution: Option<(Duration, u32)>,
    command: Option<(Duration, u32)>,
    refuse: bool,
}

pub(super) fn simulate(all: &[Simulated]) -> Result<Box<dyn Device>, String> {
    let (mut diode, mut probe) = (None, None);
    for it in all {
        match &it.part {
            Part::Diode(part) if diode.is_none() => diode = Some(Arc::clone(part)),
            Part::Probe(part) if probe.is_none() => probe = Some(Arc::clone(part)),
            _ => return Err(format!("{}: an LDC500 has one diode and its temperature", it.name)),
        }
    }
    let clock = all.first().ok_or("nothing to simulate")?.clock.clone();
    let mut numbers: BTreeMap<_, _> = NUMBERS.iter().map(|it| (it.0, it.3)).collect();
    if let Some(diode) = &diode {
        // Somebody has set it for this diode, and it has settled.
        numbers.insert("TEMP", (diode.temperature_degc() * 1e3).round() / 1e3);
    }
    let tokens = TOKENS.iter().map(|it| (it.0, it.2)).collect();
    Ok(Box::new(Ldc500 {
        diode,
        probe,
        clock,
        tokens,
        numbers,
        flowed: 0.0,
        execution: None,
        command: None,
        refuse: false,
    }))
}

impl Ldc500 {
    fn token(&self, name: &str) -> usize {
        self.tokens.get(name).copied().unwrap_or_default()
    }

    fn value(&self, name: &str) -> f64 {
        self.numbers.get(name).copied().unwrap_or_default()
    }

    fn worded(&self, words: &[&str], which: usize) -> String {
        if self.token("TOKN") == 1 { words[which].to_owned() } else { which.to_string() }
    }

    fn is_on(&self) -> bool {
        self.diode.as_ref().is_some_and(|diode| diode.is_on())
    }

    fn contact_closed(&self) -> bool {
        self.diode.as_ref().is_none_or(|diode| diode.interlock_closed())
    }

    /// The contact is in the current's way.
    fn trip(&mut self) {
        if let Some(diode) = &self.diode
            && diode.is_on()
            && !diode.interlock_closed()
        {
            diode.switch(false);
        }
    }

    fn current(&mut self) -> f64 {
        let Some(diode) = &self.diode else { return 0.0 };
        let (on, emits) = (diode.is_on(), diode.emits());
        if on {
            self.flowed = self.value("SILD");
        }
        if emits { self.flowed } else { 0.0 }
    }

    fn temperature(&self) -> String {
        let read = match (&self.probe, &self.diode) {
            (Some(probe), _) => probe.read(),
            (None, Some(diode)) => Ok(diode.temperature_degc()),
            (None, None) => Err("no sensor".to_owned()),
        };
        // What the real one writes without a sensor is not known; no number is.
        read.map_or_else(|_| "NAN".to_owned(), |degc| format!("{degc:.3}"))
    }

    fn wrong_command(&mut self, code: u32) {
        self.command = Some((self.clock.now().monotonic + ERROR_DELAY, code));
    }

    /// The manual's table for these codes could not be read; any but zero says "refused".
    fn wrong_execution(&mut self) {
        self.execution = Some((self.clock.now().monotonic + ERROR_DELAY, 1));
    }

    fn obey(&mut self, command: &str) -> Option<String> {
        let (word, is_query, rest) = match command.split_once('?') {
            Some((word, rest)) => (word.trim(), true, rest.trim()),
            None => match command.split_once(' ') {
                Some((word, rest)) => (word, false, rest.trim()),
                None => (command, false, ""),
            },
        };
        let word = word.to_ascii_uppercase();
        if is_query {
            let answer = self.query(&word);
            if answer.is_none() {
                // A setting only, or nothing at all.
                self.wrong_command(if word == "CALP" { 3 } else { 2 });
            }
            return answer;
        }
        if rest.is_empty() && !word.starts_with('*') {
            self.wrong_command(if self.query_only(&word) { 4 } else { 5 });
        } else if std::mem::take(&mut self.refuse) {
            self.wrong_execution();
        } else {
            self.set(&word, rest);
        }
        None
    }

    fn query_only(&self, word: &str) -> bool {
        matches!(word, "ILOC" | "RILD" | "RVLD" | "TTRD" | "TIRD" | "TVRD" | "LEXE" | "LCME")
    }

    fn query(&mut self, word: &str) -> Option<String> {
        let now = self.clock.now().monotonic;
        let read = |register: &mut Option<(Duration, u32)>| {
            let code = register.take_if(|(at, _)| *at <= now);
            code.map_or(0, |(_, code)| code).to_string()
        };
        Some(match word {
            "*IDN" => "Stanford_Research_Systems,LDC501,s/n098023,ver2.00".to_owned(),
            // Says that commands were executed, not that anything has settled.
            "*OPC" => "1".to_owned(),
            "LEXE" => read(&mut self.execution),
            "LCME" => read(&mut self.command),
            "LDON" => self.worded(&["OFF", "ON"], usize::from(self.is_on())),
            "ILOC" => self.worded(&["OPEN", "CLOSED"], usize::from(self.contact_closed())),
            "RILD" => format!("{:.3}", self.current()),
            "RVLD" => format!("{:.3}", if self.current() > 0.0 { 2.1 } else { 0.0 }),
            "RIPD" | "RWPD" | "TIRD" | "TVRD" => "0.000".to_owned(),
            "TTRD" => self.temperature(),
            // Bit 0 stands for "on": the others could not be read in the manual.
            "LDCR" => u8::from(self.is_on()).to_string(),
            _ => match TOKENS.iter().find(|it| it.0 == word) {
                Some((name, words, _)) => self.worded(words, self.token(name)),
                None => format!("{:.3}", self.numbers.get(word)?),
            },
        })
    }

    fn set(&mut self, word: &str, value: &str) {
        if let Some((name, words, _)) = TOKENS.iter().find(|it| it.0 == word) {
            match token(words, value) {
                Some(which) => self.set_token(name, which),
                None => self.wrong_command(14),
            }
        } else if let Some((name, low, high, _)) = NUMBERS.iter().find(|it| it.0 == word) {
            match value.parse::<f64>() {
                Ok(number) if (*low..=*high).contains(&number) => self.set_number(name, number),
                Ok(_) => self.wrong_execution(),
                Err(_) => self.wrong_command(9),
            }
        } else if word == "LDON" {
            match token(&["OFF", "ON"], value) {
                Some(on) => self.switch(on == 1),
                None => self.wrong_command(14),
            }
        } else if word == "*CLS" {
            (self.execution, self.command) = (None, None);
        } else {
            let only_asked = self.query_only(word);
            self.wrong_command(if only_asked { 4 } else { 2 });
        }
    }

    fn set_token(&mut self, name: &'static str, which: usize) {
        self.tokens.insert(name, which);
        if name == "RNGE" {
            self.lower_to("SILM", FULL_SCALE[which]);
            self.lower_to("SILD", self.value("SILM"));
        }
    }

    fn set_number(&mut self, name: &'static str, number: f64) {
        let most = match name {
            "SILD" => self.value("SILM"),
            "SILM" => FULL_SCALE[self.token("RNGE")],
            _ => f64::INFINITY,
        };
        if number > most {
            self.wrong_execution();
            return;
        }
        self.numbers.insert(name, number);
        if name == "SILM" {
            self.lower_to("SILD", number);
        }
    }

    fn lower_to(&mut self, name: &'static str, most: f64) {
        let lower = self.value(name).min(most);
        self.numbers.insert(name, lower);
    }

    fn switch(&mut self, on: bool) {
        match &self.diode {
            Some(diode) if !on => diode.switch(false),
            Some(diode) if diode.interlock_closed() => diode.strike(),
            None if !on => {}
            _ => self.wrong_execution(),
        }
    }
}

fn token(words: &[&str], value: &str) -> Option<usize> {
    let by_word = words.iter().position(|word| word.eq_ignore_ascii_case(value));
    by_word.or_else(|| value.parse().ok().filter(|which| *which < words.len()))
}

impl Device for Ldc500 {
    fn receive(&mut self, pending: &mut Vec<u8>) -> Vec<u8> {
        let (mut out, mut buffer) = (Vec::new(), Vec::new());
        self.trip();
        for byte in pending.drain(..) {
            if !matches!(byte, b'\r' | b'\n') {
                buffer.push(byte);
                if buffer.len() > BUFFER {
                    buffer.clear();
                }
                continue;
            }
            let line = String::from_utf8_lossy(&std::mem::take(&mut buffer)).into_owned();
            for command in line.split(';').map(str::trim).filter(|it| !it.is_empty()) {
                if let Some(answer) = self.obey(command) {
                    let end = ["", "\r", "\n", "\r\n", "\n\r"][self.token("TERM")];
                    out.extend(answer.bytes().chain(end.bytes()));
                }
            }
        }
        *pending = buffer;
        out
    }

    fn says(&mut self) -> Vec<u8> {
        self.trip();
        Vec::new()
    }

    fn refuse_next(&mut self) -> bool {
        // A controller without a diode is only read.
        self.refuse = self.diode.is_some();
        self.refuse
    }

    fn reboot(&mut self) {
        if let Some(diode) = &self.diode {
            diode.switch(false);
        }
        self.tokens.insert("TEON", 0);
        self.numbers.insert("ULOC", 0.0);
        (self.execution, self.command) = (None, None);
    }
}
