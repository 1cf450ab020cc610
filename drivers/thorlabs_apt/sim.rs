//! An APT controller with a USB connector, each channel with a stage of the world.
//!
//! Written apart from the driver's side. The traps of the real ones: no check sum and no resync,
//! commands are answered by nothing until they end, a controller that was not homed moves all the
//! same and counts from where it was switched on, a target out of reach ends at the limit switch,
//! a channel that is off ignores moves, messages that nobody asked for come at any time, and each
//! model knows only one of the two status updates.

use std::sync::Arc;
use std::time::Duration;

use beampose_core::Clock;

use crate::sim::{Device, Simulated, Stage};

/// Between two status messages that were ordered.
const UPDATE: Duration = Duration::from_millis(100);
/// After so many that nobody acknowledged it falls silent.
const PATIENCE: u32 = 50;

/// A controller and all its channels.
pub struct AptUnit {
    model: Model,
    channels: Vec<Channel>,
    clock: Arc<dyn Clock>,
    refuse: bool,
    /// Since when status messages are ordered, and how many went unacknowledged.
    updates: Option<(Duration, u32)>,
}

#[derive(Clone, Copy)]
struct Model {
    name: &'static str,
    serial: u32,
    hardware: u16,
    has_dc_motor: bool,
}

#[derive(Clone, Copy, PartialEq)]
enum Activity {
    Stands,
    Moves { forward: bool },
    Homes,
    Stops,
}

struct Channel {
    number: u16,
    stage: Arc<dyn Stage>,
    scale: f64,
    activity: Activity,
    homed: bool,
    enabled: bool,
    /// Where the stage is when the counter says zero.
    zero: f64,
    /// Where the servo has settled, once that is known: it holds the counter there.
    settled: Option<i32>,
    limit_bits: u32,
    preset: i32,
    velocity: [u8; 12],
    backlash: [u8; 4],
    jog: [u8; 20],
    home: [u8; 12],
    limit_switches: [u8; 14],
}

pub(super) fn simulate(all: &[Simulated]) -> Result<Box<dyn Device>, String> {
    let first = all.first().ok_or("a controller without channels")?;
    let wrong = |it: &Simulated, why: &dyn std::fmt::Display| format!("{}: {why}", it.name);
    let model = match first.options.text("controller").map_err(|e| wrong(first, &e))? {
        "k10cr1" => ("K10CR1", 55_000_001, 50, false),
        "lts300" => ("LTS300", 45_000_001, 45, false),
        _ => ("KDC101", 27_000_001, 16, true),
    };
    let (name, serial, hardware, has_dc_motor) = model;
    let mut channels = Vec::new();
    for it in all {
        let number = |name: &str| it.options.number(name).map_err(|e| wrong(it, &e));
        channels.push(Channel {
            number: number("channel")? as u16,
            stage: it.part.stage()?,
            scale: number("counts_per_unit")?,
            activity: Activity::Stands,
            // Stands as somebody left it who had homed it; a reboot forgets that.
            homed: true,
            enabled: true,
            zero: 0.0,
            settled: None,
            limit_bits: 0,
            preset: 0,
            velocity: numbers(&[0, 13_744, 772_981]),
            backlash: numbers(&[0]),
            jog: [0; 20],
            home: numbers(&[0x0001_0002, 134_218, 0]),
            limit_switches: [0; 14],
        });
    }
    Ok(Box::new(AptUnit {
        model: Model { name, serial, hardware, has_dc_motor },
        channels,
        clock: Arc::clone(&first.clock),
        refuse: false,
        updates: None,
    }))
}

fn numbers<const N: usize>(all: &[u32]) -> [u8; N] {
    let mut bytes = [0; N];
    for (place, number) in bytes.chunks_exact_mut(4).zip(all) {
        place.copy_from_slice(&number.to_le_bytes());
    }
    bytes
}

/// A message to the host, without data.
fn brief(id: u16, first: u8, second: u8) -> Vec<u8> {
    vec![id as u8, (id >> 8) as u8, first, second, 0x01, 0x50]
}

/// A message to the host about a channel, with data.
fn full(id: u16, parts: &[&[u8]]) -> Vec<u8> {
    let data = parts.concat();
    let length = data.len() as u16;
    let mut out = vec![id as u8, (id >> 8) as u8, length as u8, (length >> 8) as u8, 0x81, 0x50];
    out.extend(data);
    out
}

/// A message from the host, taken apart.
struct Asked {
    id: u16,
    first: u8,
    second: u8,
    data: Vec<u8>,
}

impl Asked {
    fn channel(&self) -> u16 {
        match self.data.as_slice() {
            [low, high, ..] => u16::from(*low) | u16::from(*high) << 8,
            _ => u16::from(self.first),
        }
    }

    /// The number behind the channel, where there are data.
    fn number(&self) -> Option<i32> {
        let bytes = self.data.get(2..6)?;
        Some(bytes.iter().rev().fold(0_u32, |sum, byte| sum << 8 | u32::from(*byte)) as i32)
    }

    /// What is behind the channel, into its place.
    fn store(&self, place: &mut [u8]) {
        if let Some(bytes) = self.data.get(2..2 + place.len()) {
            place.copy_from_slice(bytes);
        }
    }
}

impl Channel {
    fn count(&self, at: f64) -> i32 {
        ((at - self.zero) * self.scale).round() as i32
    }

    fn encoder(&self) -> i32 {
        self.count(self.stage.encoder())
    }

    /// As in a status update: where it has settled, else one reading.
    fn position(&mut self) -> i32 {
        if self.activity != Activity::Stands {
            return self.encoder();
        }
        match self.settled {
            Some(counts) => counts,
            None => *self.settled.insert(self.count(self.stage.encoder())),
        }
    }

    fn bits(&self) -> u32 {
        let mut bits = 0x0000_0100 | self.limit_bits;
        bits |= match self.activity {
            Activity::Stands => 0x2000,
            Activity::Moves { forward: true } => 0x10,
            Activity::Moves { forward: false } | Activity::Stops => 0x20,
            Activity::Homes => 0x0200 | 0x20,
        };
        if self.homed {
            bits |= 0x0400;
        }
        if self.enabled { bits | 0x8000_0000 } else { bits }
    }

    fn go(&mut self, counts: i32) {
        if !self.enabled {
            return;
        }
        let [low, high] = self.stage.limits();
        let wanted = f64::from(counts) / self.scale + self.zero;
        let target = wanted.clamp(low, high);
        let before = self.position();
        if self.stage.go(target).is_err() {
            return;
        }
        let reached = if wanted == target { counts } else { self.count(target) };
        self.limit_bits = u32::from(wanted > high) | u32::from(wanted < low) << 1;
        self.activity = Activity::Moves { forward: reached >= before };
        self.settled = Some(reached);
    }

    fn search(&mut self) {
        if !self.enabled {
            return;
        }
        let [low, high] = self.stage.limits();
        if self.stage.go(0.0_f64.clamp(low, high)).is_ok() {
            self.homed = false;
            self.limit_bits = 0;
            self.activity = Activity::Homes;
        }
    }

    fn stop(&mut self) {
        self.stage.stop();
        if self.activity != Activity::Stands {
            self.settled = None;
        }
        self.activity = Activity::Stops;
    }

    /// What it has to say of a motion that ended.
    fn ended(&mut self, has_dc_motor: bool) -> Vec<u8> {
        let was = self.activity;
        if was == Activity::Stands || self.stage.is_moving() {
            return Vec::new();
        }
        self.activity = Activity::Stands;
        match was {
            Activity::Homes => {
                let [low, high] = self.stage.limits();
                (self.homed, self.zero) = (true, 0.0);
                self.settled = Some(self.count(0.0_f64.clamp(low, high)));
                brief(0x0444, self.number as u8, 0)
            }
            Activity::Stops => self.update(0x0466, has_dc_motor),
            _ => self.update(0x0464, has_dc_motor),
        }
    }

    fn update(&mut self, id: u16, has_dc_motor: bool) -> Vec<u8> {
        let position = self.position();
        // Velocity and current of a DC motor stand where a stepper has its encoder, if it has one.
        let middle = if has_dc_motor { [0; 4] } else { position.to_le_bytes() };
        let (number, bits) = (self.number.to_le_bytes(), self.bits().to_le_bytes());
        full(id, &[&number, &position.to_le_bytes(), &middle, &bits])
    }

    /// Parameters that are kept and given back, and nothing else.
    fn parameters(&mut self, asked: &Asked) -> Option<Vec<u8>> {
        let place: &mut [u8] = match asked.id {
            0x0413 | 0x0414 => &mut self.velocity,
            0x0416 | 0x0417 => &mut self.jog,
            0x0423 | 0x0424 => &mut self.limit_switches,
            0x043a | 0x043b => &mut self.backlash,
            0x0440 | 0x0441 => &mut self.home,
            _ => return None,
        };
        if asked.data.is_empty() {
            // A question; the answer has the next number.
            return Some(full(asked.id + 1, &[&self.number.to_le_bytes(), place]));
        }
        asked.store(place);
        Some(Vec::new())
    }

    fn obey(&mut self, asked: &Asked, has_dc_motor: bool) -> Vec<u8> {
        if let Some(answer) = self.parameters(asked) {
            return answer;
        }
        let number = self.number.to_le_bytes();
        match asked.id {
            0x0210 => self.enabled = asked.second == 1,
            0x0211 => return brief(0x0212, asked.first, if self.enabled { 1 } else { 2 }),
            0x0410 => {
                let counts = asked.number().unwrap_or(0);
                self.zero = self.stage.encoder() - f64::from(counts) / self.scale;
                self.settled = Some(counts);
            }
            0x0411 => return full(0x0412, &[&number, &self.encoder().to_le_bytes()]),
            0x040a => return full(0x040b, &[&number, &self.encoder().to_le_bytes()]),
            0x0429 => return full(0x042a, &[&number, &self.bits().to_le_bytes()]),
            0x0443 => self.search(),
            0x0448 => {
                let from = self.position();
                self.go(from.saturating_add(asked.number().unwrap_or(0)));
            }
            0x0450 => self.preset = asked.number().unwrap_or(self.preset),
            0x0453 => self.go(asked.number().unwrap_or(self.preset)),
            0x0465 => self.stop(),
            0x0480 if !has_dc_motor => return self.update(0x0481, false),
            0x0490 if has_dc_motor => return self.update(0x0491, true),
            _ => {}
        }
        Vec::new()
    }
}

impl AptUnit {
    fn ended(&mut self) -> Vec<u8> {
        let has_dc_motor = self.model.has_dc_motor;
        self.channels.iter_mut().flat_map(|it| it.ended(has_dc_motor)).collect()
    }

    fn info(&self) -> Vec<u8> {
        let mut model = [0; 8];
        model[..self.model.name.len()].copy_from_slice(self.model.name.as_bytes());
        let mut notes = [0; 48];
        notes[..9].copy_from_slice(b"simulated");
        let channels = self.channels.len() as u8;
        let tail = [1, 0, 0, 0, channels, 0];
        let hardware = self.model.hardware.to_le_bytes();
        let serial = self.model.serial.to_le_bytes();
        full(0x0006, &[&serial, &model, &hardware, &[1, 2, 3, 0], &notes, &[0; 12], &tail])
    }

    fn answer(&mut self, asked: &Asked) -> Vec<u8> {
        match asked.id {
            0x0005 => return self.info(),
            0x0011 => self.updates = Some((self.clock.now().monotonic, 0)),
            0x0012 => self.updates = None,
            0x0492 => self.updates = self.updates.map(|(since, _)| (since, 0)),
            _ => {}
        }
        let is_command = matches!(asked.id, 0x0210 | 0x0413 | 0x0443 | 0x0448 | 0x0453);
        if is_command && std::mem::take(&mut self.refuse) {
            let mut notes = [0; 64];
            notes[..15].copy_from_slice(b"not carried out");
            return full(0x0081, &[&asked.id.to_le_bytes(), &[6, 0], &notes]);
        }
        let (channel, has_dc_motor) = (asked.channel(), self.model.has_dc_motor);
        let of_it = self.channels.iter_mut().find(|it| it.number == channel);
        of_it.map_or_else(Vec::new, |it| it.obey(asked, has_dc_motor))
    }
}

/// The next whole message, if one is there. `Some(None)`: it was not to this unit.
fn next(pending: &mut Vec<u8>) -> Option<Option<Asked>> {
    let (&[low, high, first, second, to, _], _) = pending.split_first_chunk::<6>()?;
    let is_long = to >= 0x80;
    let length = if is_long { usize::from(first) + 256 * usize::from(second) } else { 0 };
    let data = pending.get(6..6 + length)?.to_vec();
    pending.drain(..6 + length);
    let id = u16::from(low) + 256 * u16::from(high);
    Some((to & 0x7f == 0x50).then_some(Asked { id, first, second, data }))
}

impl Device for AptUnit {
    fn receive(&mut self, pending: &mut Vec<u8>) -> Vec<u8> {
        // What ended before the question was said before the answer.
        let mut out = self.ended();
        while let Some(asked) = next(pending) {
            if let Some(asked) = asked {
                out.extend(self.answer(&asked));
            }
        }
        out
    }

    fn says(&mut self) -> Vec<u8> {
        let mut out = self.ended();
        let now = self.clock.now().monotonic;
        if let Some((since, unheard)) = self.updates
            && unheard < PATIENCE
            && now >= since + UPDATE
        {
            self.updates = Some((now, unheard + 1));
            let (id, dc) = if self.model.has_dc_motor { (0x0491, true) } else { (0x0481, false) };
            out.extend(self.channels.iter_mut().flat_map(|it| it.update(id, dc)));
        }
        out
    }

    fn chatter(&mut self) -> Vec<u8> {
        let has_dc_motor = self.model.has_dc_motor;
        self.channels.first_mut().map(|it| it.update(0x0464, has_dc_motor)).unwrap_or_default()
    }

    fn refuse_next(&mut self) -> bool {
        self.refuse = true;
        true
    }

    fn reboot(&mut self) {
        self.updates = None;
        for it in &mut self.channels {
            it.stage.stop();
            it.activity = Activity::Stands;
            it.homed = false;
            // It counts from where it wakes up.
            it.zero = it.stage.encoder();
            it.settled = Some(0);
            it.limit_bits = 0;
        }
    }
}
