//! A chain of Zaber devices: stages of the world that answer the ASCII protocol.
//!
//! Written apart from the driver's side. It knows what clients ask beyond the driver: broadcasts,
//! settings, warnings, commands without number or check sum.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::sim::{Device, Simulated, Stage};

/// All devices on one line.
pub struct ZaberChain {
    axes: Vec<AxisOf>,
    refuse: bool,
    alerts: bool,
}

struct AxisOf {
    device: u32,
    axis: u32,
    stage: Arc<dyn Stage>,
    scale: f64,
    homed: bool,
    /// The last move was cut short.
    interrupted: bool,
    settings: BTreeMap<String, String>,
}

pub(super) fn simulate(all: &[Simulated]) -> Result<Box<dyn Device>, String> {
    let number = |it: &Simulated, name: &str| {
        it.options.number(name).map_err(|error| format!("{}: {error}", it.name))
    };
    let mut axes = Vec::new();
    for it in all {
        axes.push(AxisOf {
            device: number(it, "device")? as u32,
            axis: number(it, "axis")? as u32,
            stage: it.part.stage()?,
            scale: number(it, "steps_per_unit")?,
            // Stands as somebody left it who had homed it; a reboot forgets that.
            homed: true,
            interrupted: false,
            settings: BTreeMap::new(),
        });
    }
    axes.sort_by_key(|it| (it.device, it.axis));
    Ok(Box::new(ZaberChain { axes, refuse: false, alerts: false }))
}

/// What a command says, taken apart.
struct Asked<'a> {
    device: u32,
    axis: u32,
    id: Option<&'a str>,
    words: Vec<&'a str>,
}

fn sum_of(text: &str) -> u8 {
    let total: u32 = text.bytes().map(u32::from).sum();
    (256 - total % 256) as u8
}

/// A line behind its slash. `None` where the device keeps silent: check sum wrong, or not for anyone.
fn take_apart(line: &str) -> Option<Asked<'_>> {
    let body = match line.split_once(':') {
        None => line,
        Some((body, sum)) => {
            if u8::from_str_radix(sum.trim(), 16).ok()? != sum_of(body) {
                return None;
            }
            body
        }
    };
    let mut words: Vec<&str> = body.split_whitespace().collect();
    let mut number = || {
        let first = words.first()?;
        let value = first.parse::<u32>().ok()?;
        words.remove(0);
        Some(value)
    };
    let device = number().unwrap_or(0);
    let axis = number().unwrap_or(0);
    let is_id = |word: &&str| *word == "--" || word.parse::<u8>().is_ok_and(|id| id < 100);
    let id = words.first().copied().filter(|word| is_id(word));
    if id.is_some() {
        words.remove(0);
    }
    Some(Asked { device, axis, id, words })
}

impl AxisOf {
    fn flag(&self) -> &'static str {
        if !self.homed {
            "WR"
        } else if self.interrupted {
            "NI"
        } else {
            "--"
        }
    }

    fn position(&self) -> i64 {
        (self.stage.encoder() * self.scale).round() as i64
    }

    fn go(&mut self, steps: f64) -> Result<String, &'static str> {
        // Steps to units by the same scale that the stage's own limits are in.
        self.stage.go(steps / self.scale).map_err(|_| "BADDATA")?;
        self.interrupted = false;
        Ok("0".to_owned())
    }

    fn obey(&mut self, words: &[&str]) -> Result<String, &'static str> {
        let zero = || Ok("0".to_owned());
        match words {
            [] => zero(),
            ["home"] => {
                self.homed = true;
                let [low, high] = self.stage.limits();
                self.go(0.0_f64.clamp(low, high) * self.scale)
            }
            ["move", "abs", steps] => self.go(steps.parse().map_err(|_| "BADDATA")?),
            ["move", "rel", steps] => {
                let by: f64 = steps.parse().map_err(|_| "BADDATA")?;
                self.go(self.stage.encoder() * self.scale + by)
            }
            ["move", "min"] => self.go(self.stage.limits()[0] * self.scale),
            ["move", "max"] => self.go(self.stage.limits()[1] * self.scale),
            ["stop" | "estop"] => {
                self.interrupted = self.stage.is_moving();
                self.stage.stop();
                zero()
            }
            ["get", "pos" | "encoder.pos"] => Ok(self.position().to_string()),
            ["get", "limit.min"] => Ok(self.limit(0)),
            ["get", "limit.max"] => Ok(self.limit(1)),
            ["get", "resolution"] => Ok("64".to_owned()),
            ["get", "peripheralid" | "peripheral.serial" | "peripheral.hw.modified"] => zero(),
            ["get", setting] => {
                let known = self.settings.get(*setting).cloned();
                let usual = matches!(*setting, "maxspeed" | "accel" | "comm.alert");
                known.or_else(|| usual.then(|| "0".to_owned())).ok_or("BADCOMMAND")
            }
            ["set", "pos", _] => zero(),
            ["set", setting @ ("maxspeed" | "accel" | "comm.alert" | "knob.enable"), value] => {
                if value.parse::<f64>().is_err() {
                    return Err("BADDATA");
                }
                self.settings.insert((*setting).to_owned(), (*value).to_owned());
                zero()
            }
            ["warnings"] | ["warnings", "clear"] => {
                let flag = self.flag();
                if words.len() == 2 {
                    self.interrupted = false;
                }
                Ok(if flag == "--" { "00".to_owned() } else { format!("01 {flag}") })
            }
            _ => Err("BADCOMMAND"),
        }
    }

    fn limit(&self, which: usize) -> String {
        ((self.stage.limits()[which] * self.scale).round() as i64).to_string()
    }
}

impl ZaberChain {
    /// What the device as a whole answers.
    fn of_device(&mut self, device: u32, words: &[&str]) -> Option<Result<String, &'static str>> {
        let count = self.axes.iter().filter(|it| it.device == device).count();
        Some(Ok(match words {
            ["get", "deviceid"] => "50081".to_owned(),
            ["get", "system.serial"] => format!("{}", 900_000 + device),
            ["get", "version"] => "7.25".to_owned(),
            ["get", "version.build"] => "14000".to_owned(),
            ["get", "device.hw.modified"] => "0".to_owned(),
            ["get", "system.axiscount"] => count.to_string(),
            ["get", "comm.command.packets.max"] => "1".to_owned(),
            ["get", "comm.word.size.max"] => "50".to_owned(),
            ["get", "get.settings.max"] => "10".to_owned(),
            ["get", "comm.packet.size.max"] => return Some(Err("BADCOMMAND")),
            ["set", "comm.alert", value] => {
                self.alerts = *value == "1";
                "0".to_owned()
            }
            ["system", "reset"] => {
                self.reboot();
                "0".to_owned()
            }
            _ => return None,
        }))
    }

    fn answer(&mut self, line: &str) -> String {
        let Some(asked) = take_apart(line) else { return String::new() };
        let mut devices: Vec<u32> = self.axes.iter().map(|it| it.device).collect();
        devices.dedup();
        let mut out = String::new();
        for device in devices {
            if asked.device == 0 || asked.device == device {
                let reply = self.of_one(device, &asked);
                if asked.id != Some("--") {
                    out.push_str(&reply);
                }
            }
        }
        out
    }

    fn of_one(&mut self, device: u32, asked: &Asked<'_>) -> String {
        let refused = std::mem::take(&mut self.refuse);
        let whole = if asked.axis == 0 { self.of_device(device, &asked.words) } else { None };
        let result = match whole {
            _ if refused => Err("STATUSBUSY"),
            Some(result) => result,
            None => {
                let for_it =
                    |it: &&mut AxisOf| it.device == device && [0, it.axis].contains(&asked.axis);
                let answers: Vec<_> =
                    self.axes.iter_mut().filter(for_it).map(|it| it.obey(&asked.words)).collect();
                let all: Result<Vec<String>, _> = answers.into_iter().collect();
                match all {
                    Ok(values) if values.is_empty() => Err("BADAXIS"),
                    // One value where all say the same "0", as after a command.
                    Ok(values) if asked.words.first() != Some(&"get") => Ok(values[0].clone()),
                    Ok(values) => Ok(values.join(" ")),
                    Err(error) => Err(error),
                }
            }
        };
        let of_it = |it: &&AxisOf| it.device == device && [0, it.axis].contains(&asked.axis);
        let busy = self.axes.iter().filter(of_it).any(|it| it.stage.is_moving());
        let flag = self.axes.iter().find(of_it).map_or("--", AxisOf::flag);
        let (word, data) = match result {
            Ok(data) => ("OK", data),
            Err(why) => ("RJ", why.to_owned()),
        };
        let status = if busy { "BUSY" } else { "IDLE" };
        // A number comes back with two digits, however it was written.
        let id = asked.id.and_then(|id| id.parse::<u8>().ok());
        let id = id.map_or(String::new(), |id| format!("{id:02} "));
        let body = format!("{device:02} {} {id}{word} {status} {flag} {data}", asked.axis);
        format!("@{body}:{:02X}\r\n", sum_of(&body))
    }
}

impl Device for ZaberChain {
    fn receive(&mut self, pending: &mut Vec<u8>) -> Vec<u8> {
        let mut out = Vec::new();
        while let Some(end) = pending.iter().position(|byte| matches!(byte, b'\r' | b'\n')) {
            let raw: Vec<u8> = pending.drain(..=end).collect();
            let mut line = Vec::new();
            for byte in raw {
                match byte {
                    8 => drop(line.pop()),
                    0x7f => line.clear(),
                    other => line.push(other),
                }
            }
            let text = String::from_utf8_lossy(&line).trim().to_owned();
            if let Some(command) = text.strip_prefix('/') {
                out.extend(self.answer(command).into_bytes());
            }
        }
        out
    }

    fn chatter(&mut self) -> Vec<u8> {
        let of = self.axes.first().map_or((1, 1), |it| (it.device, it.axis));
        format!("!{:02} {} IDLE --\r\n", of.0, of.1).into_bytes()
    }

    fn refuse_next(&mut self) -> bool {
        self.refuse = true;
        true
    }

    fn reboot(&mut self) {
        for it in &mut self.axes {
            it.stage.stop();
            it.homed = false;
            it.interrupted = false;
            it.settings.clear();
        }
    }
}
