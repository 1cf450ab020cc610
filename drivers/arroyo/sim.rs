//! An Arroyo ComboSource 6300 that answers its command language, written apart from the driver's
//! side.
//!
//! Its traps: setters answer nothing, errors wait in a list that reading empties; `LASer:LDI` sets
//! and `LASer:LDI?` measures, and so with `TEC:T`; a lower limit lowers the set point silently;
//! `LASer:OUTput?` is 1 from the command on, current flows only after the on-delay; a change of mode
//! switches off; answers may be in other number bases, hex floats, with another end or an echo, as
//! somebody left them; 128 characters without an end are thrown away with E-102; paths are
//! remembered behind a semicolon; an open contact switches off with E-501, temperature control that
//! is off with E-508 where the output-off register says so.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use beampose_core::Clock;

use super::words;
use crate::sim::{Device, Diode, Part, Probe, Simulated};
use words::{Command, Found};

const BUFFER: usize = 128;
/// Full scale of the current, mA.
const FULL_SCALE: f64 = 500.0;

/// A controller with a diode, its temperature sensor, or both.
pub struct ComboSource {
    diode: Option<Arc<dyn Diode>>,
    probe: Option<Arc<dyn Probe>>,
    clock: Arc<dyn Clock>,
    set_ma: f64,
    limit_ma: f64,
    /// What flowed last while it was on, mA.
    flowed: f64,
    /// When the output was switched on by a command.
    on_at: Option<Duration>,
    mode: &'static str,
    set_degc: f64,
    tec_on: bool,
    sensor_open: bool,
    /// Settings that are whole numbers.
    registers: BTreeMap<&'static str, u32>,
    radix: u32,
    errors: Vec<u32>,
    refuse: bool,
}

const REGISTERS: &[(&str, u32, u32)] = &[
    ("HEXFLOAT", 1, 0),
    ("TERM", 7, 0),
    ("TERMINAL", 1, 0),
    ("ONDELAY", 30_000, 3_000),
    ("LAS:ENAB:OUTOFF", 65_535, 40_350),
];

pub(super) fn simulate(all: &[Simulated]) -> Result<Box<dyn Device>, String> {
    let (mut diode, mut probe) = (None, None);
    for it in all {
        match &it.part {
            Part::Diode(part) if diode.is_none() => diode = Some(Arc::clone(part)),
            Part::Probe(part) if probe.is_none() => probe = Some(Arc::clone(part)),
            _ => return Err(format!("{}: a 6300 has one diode and its temperature", it.name)),
        }
    }
    let clock = all.first().ok_or("nothing to simulate")?.clock.clone();
    let degc = diode.as_ref().map_or(25.0, |diode| diode.temperature_degc());
    Ok(Box::new(ComboSource {
        diode,
        probe,
        clock,
        set_ma: 0.0,
        limit_ma: 100.0,
        flowed: 0.0,
        on_at: None,
        mode: "ILBW",
        // Somebody has set it for this diode, and it has settled.
        set_degc: (degc * 1e3).round() / 1e3,
        tec_on: true,
        sensor_open: false,
        registers: REGISTERS.iter().map(|it| (it.0, it.2)).collect(),
        radix: 10,
        errors: Vec::new(),
        refuse: false,
    }))
}

impl ComboSource {
    fn register(&self, name: &str) -> u32 {
        self.registers.get(name).copied().unwrap_or_default()
    }

    fn float(&self, value: f64, digits: usize) -> String {
        if self.register("HEXFLOAT") == 1 {
            return format!("#E{:08X}", (value as f32).to_bits());
        }
        format!("{value:.digits$}")
    }

    fn whole(&self, value: u32) -> String {
        match self.radix {
            2 => format!("#B{value:b}"),
            8 => format!("#O{value:o}"),
            16 => format!("#H{value:X}"),
            _ => value.to_string(),
        }
    }

    fn is_on(&self) -> bool {
        self.diode.as_ref().is_some_and(|diode| diode.is_on())
    }

    fn current(&mut self) -> f64 {
        let Some(diode) = &self.diode else { return 0.0 };
        let delay = Duration::from_millis(u64::from(self.register("ONDELAY")));
        let waits = self.on_at.is_some_and(|at| self.clock.now().monotonic < at + delay);
        if diode.is_on() {
            self.flowed = self.set_ma;
        }
        if diode.emits() && !waits { self.flowed } else { 0.0 }
    }

    fn switch_off(&mut self) {
        self.on_at = None;
        if let Some(diode) = &self.diode {
            diode.switch(false);
        }
    }

    /// What ends the current by itself.
    fn trip(&mut self) {
        let Some(diode) = self.diode.as_ref().filter(|diode| diode.is_on()) else { return };
        if !diode.interlock_closed() {
            self.switch_off();
            self.errors.push(501);
        } else if !self.tec_on && self.register("LAS:ENAB:OUTOFF") & 1024 != 0 {
            self.switch_off();
            self.errors.push(508);
        }
    }

    fn condition(&mut self) -> u32 {
        let open = self.diode.as_ref().is_some_and(|diode| !diode.interlock_closed());
        let flows = self.current() > 0.0;
        let at_limit = flows && self.set_ma >= self.limit_ma;
        u32::from(at_limit) | u32::from(open) << 4 | u32::from(flows) << 10
    }

    /// Reads the sensor once; whether it could is in the condition register from then on.
    fn temperature(&mut self) -> f64 {
        let read = match (&self.probe, &self.diode) {
            (Some(probe), _) => probe.read(),
            (None, Some(diode)) => Ok(diode.temperature_degc()),
            (None, None) => Err("no sensor".to_owned()),
        };
        self.sensor_open = read.is_err();
        read.unwrap_or(-99.999)
    }

    fn query(&mut self, word: &str) -> Option<String> {
        Some(match word {
            "*IDN" => "Arroyo 6305 1104123 2.43 1205".to_owned(),
            "ERR" => {
                let codes = std::mem::take(&mut self.errors);
                let codes: Vec<String> = codes.iter().map(u32::to_string).collect();
                if codes.is_empty() { "0".to_owned() } else { codes.join(",") }
            }
            "LAS:COND" => {
                let condition = self.condition();
                self.whole(condition)
            }
            "LAS:OUT" => self.whole(u32::from(self.is_on())),
            "LAS:LDI" => {
                let current = self.current();
                self.float(current, 2)
            }
            "LAS:SET:LDI" => self.float(self.set_ma, 2),
            "LAS:LIM:LDI" => self.float(self.limit_ma, 2),
            "LAS:MODE" => self.mode.to_owned(),
            "TEC:OUT" => self.whole(u32::from(self.tec_on)),
            "TEC:COND" => {
                self.whole(u32::from(self.sensor_open) << 6 | u32::from(self.tec_on) << 10)
            }
            "TEC:T" => {
                let degc = self.temperature();
                self.float(degc, 3)
            }
            "TEC:SET:T" => self.float(self.set_degc, 3),
            _ => self.whole(*self.registers.get(word)?),
        })
    }

    /// A setting; the code of its error, where it has one.
    fn set(&mut self, word: &'static str, value: &str) -> Result<(), u32> {
        if let Some(mode) = word.strip_prefix("LAS:MODE:") {
            if mode != self.mode && self.is_on() {
                self.switch_off();
                self.errors.push(514);
            }
            self.mode = mode;
            return Ok(());
        }
        if word == "RAD" {
            let bases = [("DEC", 10), ("HEX", 16), ("OCT", 8), ("BIN", 2)];
            let base = bases.iter().find(|it| it.0.eq_ignore_ascii_case(value));
            self.radix = base.ok_or(104_u32)?.1;
            return Ok(());
        }
        if value.is_empty() {
            return Err(126);
        }
        let number = words::number(value).ok_or(124_u32)?;
        let within =
            |most: f64| if (0.0..=most).contains(&number) { Ok(number) } else { Err(201_u32) };
        match word {
            "LAS:OUT" => self.switch(within(1.0)? == 1.0),
            "LAS:LDI" => {
                self.set_ma = within(self.limit_ma)?;
                Ok(())
            }
            "LAS:LIM:LDI" => {
                self.limit_ma = within(FULL_SCALE)?;
                self.set_ma = self.set_ma.min(self.limit_ma);
                Ok(())
            }
            "TEC:OUT" => {
                self.tec_on = within(1.0)? == 1.0;
                Ok(())
            }
            "TEC:T" => {
                self.set_degc = number;
                Ok(())
            }
            _ => {
                let (name, most, _) = REGISTERS.iter().find(|it| it.0 == word).ok_or(127_u32)?;
                self.registers.insert(name, within(f64::from(*most))? as u32);
                Ok(())
            }
        }
    }

    fn switch(&mut self, on: bool) -> Result<(), u32> {
        if !on {
            self.switch_off();
            return Ok(());
        }
        let Some(diode) = &self.diode else { return Err(998) };
        if !diode.interlock_closed() {
            return Err(501);
        }
        if !self.tec_on && self.register("LAS:ENAB:OUTOFF") & 1024 != 0 {
            return Err(508);
        }
        if self.register("ONDELAY") == 0 {
            diode.strike()
        } else {
            diode.switch(true)
        }
        self.on_at.get_or_insert(self.clock.now().monotonic);
        Ok(())
    }

    fn obey(&mut self, command: Command<'_>) -> Option<String> {
        let Found { word, is_query } = command.found?;
        if is_query {
            let answer = self.query(word);
            if answer.is_none() {
                self.errors.push(123);
            }
            return answer;
        }
        if std::mem::take(&mut self.refuse) {
            self.errors.push(127);
        } else if let Err(code) = self.set(word, command.value) {
            self.errors.push(code);
        }
        None
    }

    fn line(&mut self, text: &str) -> String {
        let mut out = String::new();
        let mut path = Vec::new();
        for part in text.split(';').map(str::trim).filter(|it| !it.is_empty()) {
            let command = words::take_apart(part, &mut path);
            if command.found.is_none() {
                self.errors.push(123);
            }
            if let Some(answer) = self.obey(command) {
                out.push_str(&answer);
                out.push_str(["\r\n", "\r", "\n", ""][self.register("TERM") as usize / 2]);
            }
        }
        out
    }
}

impl Device for ComboSource {
    fn receive(&mut self, pending: &mut Vec<u8>) -> Vec<u8> {
        let (mut out, mut buffer) = (Vec::new(), Vec::new());
        self.trip();
        if self.register("TERMINAL") == 1 {
            out.extend_from_slice(pending);
        }
        for byte in pending.drain(..) {
            if matches!(byte, b'\r' | b'\n') {
                let text = String::from_utf8_lossy(&std::mem::take(&mut buffer)).into_owned();
                out.extend(self.line(&text).into_bytes());
                continue;
            }
            buffer.push(byte);
            if buffer.len() > BUFFER {
                buffer.clear();
                self.errors.push(102);
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
        self.switch_off();
        self.tec_on = false;
        self.errors.clear();
        self.radix = 10;
        self.registers.insert("HEXFLOAT", 0);
        self.registers.insert("TERMINAL", 0);
    }
}
