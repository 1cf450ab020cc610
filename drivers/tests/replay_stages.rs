//! What real clients of stages said, said again to our simulators: they must answer what the devices
//! answered that the clients were content with. The recordings are in `drivers/tests/wire`; where
//! ours may differ from them, the test says in what and why.

#![expect(clippy::unwrap_used, reason = "tests")]

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use beampose_core::instrument::AxisUnit;
use beampose_core::{Clock, VirtualClock};
use beampose_drivers::sim::{Device, Part, Simulated, TestStage};
use beampose_drivers::{Options, Role, Simulator};

/// One thing that a client said, and all that was answered before it spoke again.
struct Said {
    /// Seconds, where the recording has them.
    at: Option<f64>,
    question: Vec<u8>,
    answer: Vec<u8>,
}

fn recording(text: &str) -> Vec<Said> {
    let mut all: Vec<Said> = Vec::new();
    for line in text.lines() {
        let (at, rest) = match line.split_once(' ').unwrap() {
            (direction @ ("RX" | "TX"), rest) => (None, (direction, rest)),
            (at, rest) => (at.parse().ok(), rest.split_once(' ').unwrap()),
        };
        match rest {
            ("RX", bytes) => all.push(Said { at, question: read(bytes), answer: Vec::new() }),
            ("TX", bytes) => all.last_mut().unwrap().answer.extend(read(bytes)),
            _ => {}
        }
    }
    all
}

/// `b'1TP\r\n'`, or hexadecimal.
fn read(bytes: &str) -> Vec<u8> {
    match bytes.strip_prefix("b'").and_then(|text| text.strip_suffix('\'')) {
        Some(text) => text.replace("\\r", "\r").replace("\\n", "\n").into_bytes(),
        None => bytes.split(' ').map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect(),
    }
}

/// A simulator with one stage that is fresh from power on.
struct Replayed {
    clock: VirtualClock,
    device: Box<dyn Device>,
}

impl Replayed {
    fn new(name: &str, options: &[(&str, &str)], limits: [f64; 2], speed: f64) -> Self {
        let driver = beampose_drivers::find("linear_axis", name).unwrap();
        let written: BTreeMap<String, String> =
            options.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
        let clock = VirtualClock::starting_at(jiff::Timestamp::UNIX_EPOCH);
        let shared: Arc<dyn Clock> = Arc::new(clock.clone());
        let stage = TestStage::new(Arc::clone(&shared), limits, speed);
        let all = [Simulated {
            name: "it".to_owned(),
            options: Options::read(driver.options, &written).unwrap(),
            role: Role::Axis { unit: AxisUnit::Millimetre, limits, speed },
            part: Part::Stage(Arc::new(stage)),
            clock: shared,
        }];
        let Simulator::Device(make) = driver.simulator else { unreachable!() };
        let mut device = make(&all).unwrap();
        device.reboot();
        Self { clock, device }
    }

    fn wait(&self, seconds: f64) {
        let sleep = self.clock.sleep(Duration::from_secs_f64(seconds));
        futures::executor::block_on(self.clock.drive(sleep));
    }

    fn ask(&mut self, question: &[u8]) -> Vec<u8> {
        let mut pending = question.to_vec();
        let answer = self.device.receive(&mut pending);
        assert!(pending.is_empty(), "{question:?} was not taken");
        answer
    }

    /// Says it all at the pace of the recording. What was said and answered, and what ours answered.
    fn all(&mut self, said: Vec<Said>) -> Vec<(Said, Vec<u8>)> {
        let later: Vec<Option<f64>> = said.iter().skip(1).map(|said| said.at).collect();
        let mut replayed = Vec::new();
        for (i, said) in said.into_iter().enumerate() {
            let mut answer = self.ask(&said.question);
            if let Some((now, next)) = said.at.zip(later.get(i).copied().flatten()) {
                self.wait((next - now).max(0.0));
                answer.extend(self.device.says());
            }
            replayed.push((said, answer));
        }
        replayed
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// The device of both recordings goes 20 000 microsteps a second.
fn zaber() -> Replayed {
    Replayed::new("zaber", &[("steps_per_unit", "10000")], [0.0, 100.0], 2.0)
}

#[test]
fn zaber_motion_gets_the_answers_it_was_content_with() {
    for (said, ours) in zaber().all(recording(include_str!("wire/zaber_motion_10.3.0_tcp.log"))) {
        let question = text(&said.question);
        if question.contains("get maxspeed") {
            // Another speed than that of the recorded device.
            let digits = |bytes: &[u8]| text(bytes).starts_with("@01 1 19 OK IDLE -- ");
            assert!(digits(&said.answer) && digits(&ours));
            continue;
        }
        assert_eq!(text(&ours), text(&said.answer), "{question}");
    }
}

#[test]
fn zproto_gets_the_answers_it_was_content_with() {
    let replayed = zaber().all(recording(include_str!("wire/zproto_0.4.2.log")));
    assert!(replayed.len() > 50);
    for (said, ours) in replayed {
        assert_eq!(text(&ours), text(&said.answer), "{}", text(&said.question));
    }
}

#[test]
fn yaqd_newport_gets_the_answers_it_was_content_with() {
    let mut smc = Replayed::new("newport-smc", &[], [0.0, 25.0], 10.0);
    for said in recording(include_str!("wire/smc100_yaqd_newport.log")) {
        let question = text(&said.question);
        // The recording has no times. Its device was asked about every 90 ms.
        if question.contains("TP") {
            smc.wait(0.09);
        }
        let ours = text(&smc.ask(&said.question));
        if question.contains("RS") {
            // The recorded device answered at once after a reset; a real one, and ours, is deaf.
            smc.wait(5.0);
        }
        let theirs = text(&said.answer);
        let (ours, theirs): (Vec<_>, Vec<_>) = (ours.lines().collect(), theirs.lines().collect());
        assert_eq!(ours.len(), theirs.len(), "{question}");
        for (ours, theirs) in ours.iter().zip(&theirs) {
            match (ours.strip_prefix("1TP"), theirs.strip_prefix("1TP")) {
                // On the way by half a millimetre, as the time of the recording is a guess.
                (Some(ours), Some(theirs)) => {
                    let (ours, theirs): (f64, f64) =
                        (ours.parse().unwrap(), theirs.parse().unwrap());
                    assert!((ours - theirs).abs() < 0.5, "{ours} {theirs}");
                }
                _ => assert_eq!(ours, theirs, "{question}"),
            }
        }
    }
    assert_eq!(smc.ask(b"1TP\r\n1TS\r\n"), b"1TP5.00000\r\n1TS000033\r\n");
}

/// APT messages of a device, one by one, without what ours says otherwise.
fn messages(mut bytes: &[u8]) -> Vec<Vec<u8>> {
    let mut all = Vec::new();
    while !bytes.is_empty() {
        let data = if bytes[4] & 0x80 == 0 { 0 } else { usize::from(bytes[2]) };
        let (message, rest) = bytes.split_at(6 + data);
        let mut message = message.to_vec();
        match message[0] {
            // Its notes are other words.
            0x06 => message[6 + 18..6 + 66].fill(0),
            // The recorded device knew four of the status bits: enabled, homed, homing, moving.
            // Ours says besides that a motor is connected and that it has settled.
            0x2a | 0x64 | 0x66 => message[6 + data - 3] &= 0x06,
            _ => {}
        }
        all.push(message);
        bytes = rest;
    }
    all
}

#[test]
fn pylablib_gets_the_answers_it_was_content_with() {
    let speed = 200_000.0 / 34_304.0;
    let options = [("counts_per_unit", "34304"), ("controller", "kdc101")];
    let mut apt = Replayed::new("thorlabs-apt", &options, [0.0, 50.0], speed);
    let log = include_str!("wire/apt_pylablib_1.4.5_and_tad_0.3.8.log");
    for (said, ours) in apt.all(recording(log)) {
        assert_eq!(messages(&ours), messages(&said.answer), "{:x?}", said.question);
    }
}
