//! An ND 287 on a rail that is moved by hand.
//!
//! It keeps these traps: texts of fixed length after STX, NAK alone and without line end for what is
//! invalid, the count without its decimal point, an error text only while an error is displayed.

use std::sync::Arc;

use crate::sim::{Device, Simulated, Stage};

const ESC: u8 = 27;

/// One display.
pub struct Nd287Display {
    stage: Arc<dyn Stage>,
    refuse: bool,
    error: Option<&'static str>,
}

pub(super) fn simulate(all: &[Simulated]) -> Result<Box<dyn Device>, String> {
    let [it] = all else { return Err("a display shows one rail".to_owned()) };
    Ok(Box::new(Nd287Display { stage: it.part.stage()?, refuse: false, error: None }))
}

impl Nd287Display {
    /// What stands after STX; `None` for what is invalid.
    fn screen(&mut self, command: &str) -> Option<String> {
        if std::mem::take(&mut self.refuse) {
            self.error = Some("SIGNAL X1 TOO SMALL");
            return None;
        }
        let mm = || self.stage.encoder();
        Some(match command {
            "A0000" => format!("{:<10}\r\n{:<10}\r\n{:<10}", "ND-287", "646118-01", "V1-01"),
            "A0100" => format!("{:>11.4}", mm()),
            "A0200" => format!("{:+010}", (mm() * 1e4).round() as i64),
            "A0301" => format!("{:<33}", self.error.take()?),
            "A0800" => "00000011".to_owned(),
            _ => return None,
        })
    }
}

impl Device for Nd287Display {
    fn receive(&mut self, pending: &mut Vec<u8>) -> Vec<u8> {
        let mut out = Vec::new();
        while let Some(end) = pending.iter().position(|byte| *byte == b'\r') {
            let raw: Vec<u8> = pending.drain(..=end).collect();
            // Before an escape nothing is a command.
            let Some(start) = raw.iter().position(|byte| *byte == ESC) else { continue };
            let command = String::from_utf8_lossy(&raw[start + 1..end]).into_owned();
            match self.screen(&command) {
                Some(text) => {
                    out.push(2);
                    out.extend(text.into_bytes());
                    out.extend(b"\r\n");
                }
                None => out.push(21),
            }
        }
        out
    }

    fn refuse_next(&mut self) -> bool {
        self.refuse = true;
        true
    }

    fn reboot(&mut self) {
        self.error = None;
    }
}
