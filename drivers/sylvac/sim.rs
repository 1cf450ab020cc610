//! An OptoRS readout on a rail that is moved by hand.
//!
//! It keeps these traps: no unit in a value, blanks for leading zeros and for plus, values that the
//! PRINT key sends unasked, carriage returns only, spaces and case in commands do not matter, an
//! error for each wrong command.

use std::sync::Arc;

use crate::sim::{Device, Simulated, Stage};

/// One readout.
pub struct SylvacReadout {
    stage: Arc<dyn Stage>,
    inches: bool,
    three_places: bool,
    /// Added to what the scale counts, mm.
    preset: f64,
    /// What it showed when it was last asked.
    shown: String,
    refuse: bool,
}

pub(super) fn simulate(all: &[Simulated]) -> Result<Box<dyn Device>, String> {
    let [it] = all else { return Err("a readout shows one rail".to_owned()) };
    Ok(Box::new(SylvacReadout {
        stage: it.part.stage()?,
        inches: false,
        three_places: true,
        preset: 0.0,
        shown: "     0.000".to_owned(),
        refuse: false,
    }))
}

impl SylvacReadout {
    fn value(&self) -> String {
        let mm = self.stage.encoder() + self.preset;
        match (self.inches, self.three_places) {
            (true, _) => format!("{:>10.5}", mm / 25.4),
            (false, true) => format!("{mm:>10.3}"),
            (false, false) => format!("{mm:>10.2}"),
        }
    }

    /// The answer to a command; `None` for what it does not know.
    fn obey(&mut self, command: &str) -> Option<String> {
        Some(match command {
            "?" | "PRI" => {
                self.shown = self.value();
                self.shown.clone()
            }
            "ID?" => "SYLVAC - TRIMOS V600".to_owned(),
            "UNI?" => if self.inches { "IN" } else { "MM" }.to_owned(),
            "VER?" => "1.04".to_owned(),
            "MOD?" => "NOR".to_owned(),
            "MM" | "IN" => {
                self.inches = command == "IN";
                String::new()
            }
            "RES2" | "RES3" => {
                self.three_places = command == "RES3";
                String::new()
            }
            "KEY0" | "KEY1" => String::new(),
            preset => {
                let to: f64 = preset.strip_prefix("PRE")?.parse().ok()?;
                let mm = if self.inches { to * 25.4 } else { to };
                self.preset = mm - self.stage.encoder();
                String::new()
            }
        })
    }
}

impl Device for SylvacReadout {
    fn receive(&mut self, pending: &mut Vec<u8>) -> Vec<u8> {
        let mut out = String::new();
        while let Some(end) = pending.iter().position(|byte| *byte == b'\r') {
            let raw: Vec<u8> = pending.drain(..=end).collect();
            let text = String::from_utf8_lossy(&raw).to_ascii_uppercase();
            let command: String = text.chars().filter(|c| !c.is_whitespace()).collect();
            if command.is_empty() {
                continue;
            }
            let answer = if std::mem::take(&mut self.refuse) { None } else { self.obey(&command) };
            match answer.as_deref() {
                Some("") => {}
                Some(answer) => out.extend([answer, "\r"]),
                None => out.push_str("ERR1\r"),
            }
        }
        out.into_bytes()
    }

    fn chatter(&mut self) -> Vec<u8> {
        // PRINT was pressed a while ago. Nothing is read for it: what the encoder is asked, and
        // how often, is the caller's alone.
        format!("{}\r", self.shown).into_bytes()
    }

    fn refuse_next(&mut self) -> bool {
        self.refuse = true;
        true
    }

    fn reboot(&mut self) {
        // Switched on it shows what it showed.
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use beampose_core::{Clock, VirtualClock};

    use super::*;
    use crate::sim::TestStage;

    #[test]
    fn values_look_as_in_the_manual() {
        let clock: Arc<dyn Clock> =
            Arc::new(VirtualClock::starting_at(jiff::Timestamp::UNIX_EPOCH));
        assert_eq!(clock.now().monotonic, Duration::ZERO);
        let stage = Arc::new(TestStage::new(clock, [0.0, 300.0], 50.0));
        let mut readout = SylvacReadout {
            stage,
            inches: false,
            three_places: true,
            preset: 0.0,
            shown: String::new(),
            refuse: false,
        };
        let mut ask = |words: &str| {
            let mut pending = format!("{words}\r").into_bytes();
            String::from_utf8(readout.receive(&mut pending)).unwrap()
        };
        assert_eq!(ask("PRE 123.456"), "");
        assert_eq!(ask("?"), "   123.456\r");
        assert_eq!(ask("pre-12.34"), "");
        assert_eq!(ask("p r i"), "   -12.340\r");
        assert_eq!(ask("IN"), "");
        assert_eq!(ask("?"), "  -0.48583\r");
        assert_eq!(ask("uni?"), "IN\r");
        assert_eq!(ask("GO"), "ERR1\r");
    }
}
