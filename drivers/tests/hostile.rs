//! Nobody panics, whatever comes over the line: simulators at arbitrary bytes, and drivers (hence
//! the parsers of all their protocols) at arbitrary and at damaged answers.

#![expect(clippy::unwrap_used, reason = "tests")]

mod common;

use std::sync::{Arc, Mutex};
use std::time::Duration;

use async_trait::async_trait;
use beampose_core::transport::Transport;
use beampose_core::{InstrumentError, VirtualClock};
use beampose_drivers::sim::Device;
use beampose_drivers::transport::Address;
use beampose_drivers::{Connected, Driver, REGISTRY};
use common::{clock, connect, device, interview, options, part, role, run};
use proptest::prelude::*;

/// What is done to the bytes of a conversation at a place: the place counts from the last damage.
#[derive(Debug, Clone)]
enum Damage {
    Another(u8),
    Lost,
    Twice,
    Before(Vec<u8>),
}

fn damage() -> impl Strategy<Value = (usize, Damage)> {
    let what = prop_oneof![
        any::<u8>().prop_map(Damage::Another),
        // What has a meaning somewhere: digits, signs, separators, ends.
        proptest::sample::select(b"0159-+.,:;=@!#/ \r\n\x02\x15\xff".to_vec())
            .prop_map(Damage::Another),
        Just(Damage::Lost),
        Just(Damage::Twice),
        line().prop_map(Damage::Before),
    ];
    (0_usize..60, what)
}

/// Something like a line of a protocol, or nothing like it.
fn line() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        proptest::collection::vec(any::<u8>(), 0..40),
        "[@!#/\\x02\\x15\\x1b]?[0-9A-Z ?*:;=,.+-]{0,24}[\r\n]{0,2}".prop_map(String::into_bytes),
        "[+-]?[0-9]{0,40}[.]?[0-9]{0,40}([eE][+-]?[0-9]{0,4})?\r\n".prop_map(String::into_bytes),
    ]
}

/// A line whose answers are given beforehand, or come damaged from a simulator; nobody waits.
struct Hostile {
    device: Option<Mutex<Box<dyn Device>>>,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    asked: Vec<u8>,
    answered: Vec<u8>,
    damages: Vec<(usize, Damage)>,
}

impl Hostile {
    fn saying(answers: Vec<u8>) -> Self {
        let state = State { answered: answers, ..State::default() };
        Self { device: None, state: Mutex::new(state) }
    }

    fn damaging(device: Box<dyn Device>, damages: Vec<(usize, Damage)>) -> Self {
        let state = State { damages, ..State::default() };
        Self { device: Some(Mutex::new(device)), state: Mutex::new(state) }
    }

    fn take(
        &self,
        deadline: Duration,
        enough: impl Fn(&[u8]) -> Option<usize>,
    ) -> Result<Vec<u8>, InstrumentError> {
        let mut state = self.state.lock().unwrap();
        match enough(&state.answered) {
            Some(count) => Ok(state.answered.drain(..count).collect()),
            None => {
                // As on a real line: what came in part is taken for nothing later.
                state.answered.clear();
                Err(InstrumentError::Timeout(deadline))
            }
        }
    }
}

fn damaged(bytes: Vec<u8>, damages: &mut Vec<(usize, Damage)>) -> Vec<u8> {
    let mut out = Vec::new();
    for byte in bytes {
        match damages.last_mut() {
            Some((0, what)) => {
                match what {
                    Damage::Another(other) => out.push(*other),
                    Damage::Lost => {}
                    Damage::Twice => out.extend([byte, byte]),
                    Damage::Before(before) => {
                        out.append(before);
                        out.push(byte);
                    }
                }
                damages.pop();
            }
            Some((left, _)) => {
                *left -= 1;
                out.push(byte);
            }
            None => out.push(byte),
        }
    }
    out
}

#[async_trait]
impl Transport for Hostile {
    async fn open(&self, _: Duration) -> Result<u64, InstrumentError> {
        Ok(1)
    }

    async fn send(&self, bytes: &[u8], _: Duration) -> Result<(), InstrumentError> {
        let Some(device) = &self.device else { return Ok(()) };
        let mut state = self.state.lock().unwrap();
        state.asked.extend_from_slice(bytes);
        let mut answer = device.lock().unwrap().receive(&mut state.asked);
        answer = damaged(answer, &mut state.damages);
        state.answered.append(&mut answer);
        Ok(())
    }

    async fn receive_until(&self, end: u8, limit: Duration) -> Result<Vec<u8>, InstrumentError> {
        self.take(limit, |bytes| Some(1 + bytes.iter().position(|byte| *byte == end)?))
    }

    async fn receive_exactly(
        &self,
        count: usize,
        limit: Duration,
    ) -> Result<Vec<u8>, InstrumentError> {
        self.take(limit, |bytes| (bytes.len() >= count).then_some(count))
    }

    async fn discard(&self, _: Duration) -> Result<(), InstrumentError> {
        // What was given beforehand is meant for the driver's parsers.
        if self.device.is_some() {
            self.state.lock().unwrap().answered.clear();
        }
        Ok(())
    }

    async fn close(&self) {}

    fn send_without_waiting(&self, _: &[u8]) {}
}

/// Everything that a driver can be asked; whether it answers is all the same.
fn use_it(driver: &'static Driver, transport: Hostile, clock: &VirtualClock) {
    let connected = connect(driver, options(driver, &[]), Arc::new(transport), clock).unwrap();
    drop(run(clock, interview(&connected)));
    run(clock, async {
        match &connected {
            Connected::Axis(it) => {
                let _ = it.move_to(20.0).await;
                let _ = it.stop().await;
                if let Some(homing) = it.homing() {
                    let _ = homing.is_homed().await;
                    let _ = homing.home().await;
                }
            }
            Connected::Laser(it) => {
                let _ = it.emit().await;
                let _ = it.emission().await;
                let _ = it.off().await;
            }
            Connected::Sensor(it) => drop(it.read().await),
            Connected::Camera(it) => drop(it.trigger().await),
        }
    });
}

fn on_lines() -> impl Iterator<Item = &'static Driver> {
    REGISTRY.iter().filter(|driver| driver.port.is_some())
}

fn fresh(driver: &'static Driver, clock: &VirtualClock) -> Option<Box<dyn Device>> {
    device(driver, options(driver, &[]), part(role(driver), clock), clock)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    #[test]
    fn addresses_take_any_text_and_read_back_as_they_are_written(
        text in "((tcp|serial|simulator|folder|device):)?[/\\[\\]:.?=a-z0-9C-O]{0,24}(:[0-9]{1,5})?",
    ) {
        if let Ok(address) = text.parse::<Address>() {
            prop_assert_eq!(address.to_string().parse::<Address>(), Ok(address));
        }
    }

    #[test]
    fn simulators_take_any_bytes(pieces in proptest::collection::vec(line(), 1..12)) {
        for driver in REGISTRY {
            let clock = clock();
            let Some(mut device) = fresh(driver, &clock) else { continue };
            let _ = device.greets();
            let mut pending = Vec::new();
            for piece in &pieces {
                pending.extend_from_slice(piece);
                let _ = device.receive(&mut pending);
                let _ = (device.says(), device.chatter());
            }
            device.refuse_next();
            device.reboot();
            let _ = device.receive(&mut pending);
        }
    }

    #[test]
    fn drivers_take_any_answers(lines in proptest::collection::vec(line(), 0..30)) {
        for driver in on_lines() {
            use_it(driver, Hostile::saying(lines.concat()), &clock());
        }
    }

    #[test]
    fn drivers_take_damaged_answers(damages in proptest::collection::vec(damage(), 1..12)) {
        for driver in on_lines() {
            let clock = clock();
            let Some(device) = fresh(driver, &clock) else { continue };
            use_it(driver, Hostile::damaging(device, damages.clone()), &clock);
        }
    }
}

/// The damage reaches the parsers: without any the drivers understand their simulators here.
#[test]
fn undamaged_answers_are_understood() {
    for driver in on_lines() {
        let clock = clock();
        let Some(device) = fresh(driver, &clock) else { continue };
        let line = Arc::new(Hostile::damaging(device, Vec::new()));
        let connected = connect(driver, options(driver, &[]), line, &clock).unwrap();
        let said = run(&clock, interview(&connected));
        assert!(said.iter().all(Result::is_ok), "{}: {said:?}", driver.name);
    }
}
