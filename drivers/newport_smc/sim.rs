//! SMC100 controllers on one line, each with a stage of the world.
//!
//! Written apart from the driver's side. The traps of the real ones: setters answer nothing, an
//! error waits in a register that reading clears, a second search of the reference is refused until
//! a reset, after a reset it is deaf for 5 s, a move that was stopped ends in the same state as one
//! that arrived, and every state refuses what does not belong to it with its own letter.

use std::sync::Arc;
use std::time::Duration;

use beampose_core::Clock;

use crate::registry::Role;
use crate::sim::{Device, Simulated, Stage};

/// How long it is deaf after a reset.
const DEAF: Duration = Duration::from_secs(5);

// States as the manual numbers them: the first digit is the state, the second how it came there.
const AFTER_RESET: u8 = 0x0a;
const AFTER_HOMING_FAILED: u8 = 0x0b;
const AFTER_CONFIGURATION: u8 = 0x0c;
const CONFIGURATION: u8 = 0x14;
const HOMING: u8 = 0x1e;
const MOVING: u8 = 0x28;
const READY_FROM_HOMING: u8 = 0x32;
const READY_FROM_MOVING: u8 = 0x33;
const READY_FROM_DISABLE: u8 = 0x34;
const DISABLE_FROM_READY: u8 = 0x3c;
const DISABLE_FROM_MOVING: u8 = 0x3d;

/// All controllers on one line.
pub struct SmcChain {
    controllers: Vec<Controller>,
    refuse: bool,
}

struct Controller {
    address: u32,
    stage: Arc<dyn Stage>,
    clock: Arc<dyn Clock>,
    /// As it was last set; [`Controller::state`] looks whether a motion has ended since.
    state: u8,
    error: char,
    /// Where it should be, once that is known.
    setpoint: Option<f64>,
    limits: [f64; 2],
    velocity: f64,
    /// Of the stage: more is refused.
    top_velocity: f64,
    acceleration: f64,
    deaf_until: Duration,
}

pub(super) fn simulate(all: &[Simulated]) -> Result<Box<dyn Device>, String> {
    let mut controllers = Vec::new();
    for it in all {
        let address = it.options.number("address").map_err(|e| format!("{}: {e}", it.name))?;
        let Role::Axis { speed, .. } = it.role else {
            return Err(format!("{} is no axis", it.name));
        };
        let stage = it.part.stage()?;
        controllers.push(Controller {
            address: address as u32,
            clock: Arc::clone(&it.clock),
            // Stands as somebody left it who had homed it; a reboot forgets that.
            state: READY_FROM_HOMING,
            error: '@',
            setpoint: None,
            limits: stage.limits(),
            stage,
            velocity: speed,
            top_velocity: 2.0 * speed,
            acceleration: 4.0 * speed,
            deaf_until: Duration::ZERO,
        });
    }
    Ok(Box::new(SmcChain { controllers, refuse: false }))
}

impl Controller {
    fn state(&mut self) -> u8 {
        if matches!(self.state, HOMING | MOVING) && !self.stage.is_moving() {
            self.state = if self.state == HOMING { READY_FROM_HOMING } else { READY_FROM_MOVING };
        }
        self.state
    }

    /// Where it should be. After a stop that is where it is: one reading.
    fn setpoint(&mut self) -> f64 {
        *self.setpoint.get_or_insert_with(|| self.stage.encoder())
    }

    /// The letter with which this state refuses what is not for it.
    fn letter(&mut self) -> char {
        match self.state() {
            0x0a..=0x11 => 'H',
            CONFIGURATION => 'I',
            0x3c..=0x3e => 'J',
            0x32..=0x35 => 'K',
            HOMING => 'L',
            _ => 'M',
        }
    }

    fn is_ready(&mut self) -> bool {
        matches!(self.state(), 0x32..=0x35)
    }

    /// A question; `None` where it is none.
    fn answer(&mut self, name: &str, value: &str) -> Option<String> {
        Some(match (name, value) {
            ("TS", "" | "?") | ("MM", "?") => {
                let state = self.state();
                if name == "TS" { format!("0000{state:02X}") } else { format!("{state:02X}") }
            }
            ("TE", "" | "?") => std::mem::replace(&mut self.error, '@').to_string(),
            ("TB", letter) => {
                format!("{letter} {}", if letter == "@" { "No error" } else { "Error" })
            }
            ("TP", "" | "?") => format!("{:.5}", self.stage.encoder()),
            ("TH", "" | "?") if self.stage.is_moving() => format!("{:.5}", self.stage.encoder()),
            ("TH", "" | "?") | ("PA", "?") => format!("{:.5}", self.setpoint()),
            ("SL", "?") => self.limits[0].to_string(),
            ("SR", "?") => self.limits[1].to_string(),
            ("VA", "?") => self.velocity.to_string(),
            ("AC", "?") => self.acceleration.to_string(),
            ("VE", "" | "?") => " SMC100CC 2.0.0".to_owned(),
            ("ID", "?") => "TRA25CC".to_owned(),
            _ => return None,
        })
    }

    fn go(&mut self, target: f64) -> Result<(), char> {
        if !self.is_ready() {
            return Err(self.letter());
        }
        let [low, high] = self.limits;
        // Not a number is within no limits either.
        if !(low..=high).contains(&target) {
            return Err('G');
        }
        self.stage.go(target).map_err(|_| 'G')?;
        self.setpoint = Some(target);
        self.state = MOVING;
        Ok(())
    }

    fn stop(&mut self) -> Result<(), char> {
        let after = match self.state() {
            MOVING => READY_FROM_MOVING,
            HOMING => AFTER_HOMING_FAILED,
            _ => return Err(self.letter()),
        };
        self.stage.stop();
        self.setpoint = None;
        self.state = after;
        Ok(())
    }

    fn reset(&mut self) {
        self.stage.stop();
        self.state = AFTER_RESET;
        self.error = '@';
        self.limits = self.stage.limits();
        self.velocity = self.top_velocity / 2.0;
    }

    fn search(&mut self) -> Result<(), char> {
        match self.state() {
            0x0a..=0x11 => {
                let [low, high] = self.stage.limits();
                let home = 0.0_f64.clamp(low, high);
                self.stage.go(home).map_err(|_| 'V')?;
                self.setpoint = Some(home);
                self.state = HOMING;
                Ok(())
            }
            HOMING => Err('E'),
            _ => Err(self.letter()),
        }
    }

    fn switch_motor(&mut self, value: &str) -> Result<(), char> {
        self.state = match (value, self.state()) {
            ("0", MOVING) => {
                self.stop()?;
                DISABLE_FROM_MOVING
            }
            ("0", 0x32..=0x35) => DISABLE_FROM_READY,
            ("1", 0x3c..=0x3e) => READY_FROM_DISABLE,
            ("0" | "1", _) => return Err(self.letter()),
            _ => return Err('C'),
        };
        Ok(())
    }

    /// What changes something; nothing of it is answered.
    fn obey(&mut self, name: &str, value: &str) -> Result<(), char> {
        let number = value.parse::<f64>().map_err(|_| 'C');
        match name {
            "OR" => self.search(),
            "PA" => self.go(number?),
            "PR" => {
                let target = self.setpoint() + number?;
                self.go(target)
            }
            "ST" => self.stop(),
            "MM" => self.switch_motor(value),
            "VA" | "AC" | "SL" | "SR" => self.set(name, number?),
            "PW" => match (value, self.state()) {
                ("1", 0x0a..=0x11) => {
                    self.state = CONFIGURATION;
                    Ok(())
                }
                ("0", CONFIGURATION) => {
                    self.state = AFTER_CONFIGURATION;
                    Ok(())
                }
                _ => Err(self.letter()),
            },
            "RS" => {
                self.reset();
                self.deaf_until = self.clock.now().monotonic + DEAF;
                Ok(())
            }
            _ => Err('A'),
        }
    }

    fn set(&mut self, name: &str, value: f64) -> Result<(), char> {
        if !matches!(self.state(), 0x32..=0x35 | 0x3c..=0x3e | CONFIGURATION) {
            return Err(self.letter());
        }
        let at = self.setpoint();
        let (place, fits) = match name {
            "VA" => (&mut self.velocity, value > 0.0 && value <= self.top_velocity),
            "AC" => (&mut self.acceleration, value > 0.0),
            "SL" => (&mut self.limits[0], value <= at),
            _ => (&mut self.limits[1], value >= at),
        };
        if !fits {
            return Err('C');
        }
        *place = value;
        Ok(())
    }
}

impl SmcChain {
    fn line(&mut self, line: &str) -> String {
        let digits = line.bytes().take_while(u8::is_ascii_digit).count();
        let (address, rest) = line.split_at(digits);
        let Some((name, value)) = rest.split_at_checked(2) else { return String::new() };
        let (name, value) = (name.to_ascii_uppercase(), value.trim());
        let mut out = String::new();
        for it in &mut self.controllers {
            // Without an address only a stop is for anybody: for all.
            let is_for_it = match address.parse::<u32>() {
                Ok(address) => address == it.address,
                Err(_) => name == "ST",
            };
            if !is_for_it || it.clock.now().monotonic < it.deaf_until {
                continue;
            }
            if let Some(answer) = it.answer(&name, value) {
                out.push_str(&format!("{}{name}{answer}\r\n", it.address));
                continue;
            }
            let result =
                if std::mem::take(&mut self.refuse) { Err('D') } else { it.obey(&name, value) };
            if let Err(letter) = result {
                it.error = letter;
            }
        }
        out
    }
}

impl Device for SmcChain {
    fn receive(&mut self, pending: &mut Vec<u8>) -> Vec<u8> {
        let mut out = Vec::new();
        // Several commands may come in one piece.
        while let Some(end) = pending.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = pending.drain(..=end).collect();
            let text = String::from_utf8_lossy(&line).trim().to_owned();
            out.extend(self.line(&text).into_bytes());
        }
        out
    }

    fn refuse_next(&mut self) -> bool {
        self.refuse = true;
        true
    }

    /// By the time anybody is there again, it has started.
    fn reboot(&mut self) {
        for it in &mut self.controllers {
            it.reset();
        }
    }
}
