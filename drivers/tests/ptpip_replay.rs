//! What the `gphoto2` program asked a PTP/IP camera, asked again of the simulator: five sessions as
//! they were recorded (listing, capture, trigger, summary). The recording has each operation with
//! its parameters, its response and how many bytes of data came.
//!
//! Where the simulator may differ from what was recorded: its own names and pictures have other
//! lengths (device 0x1001, storage 0x1005, object info 0x1008, picture 0x1009); it lets a picture be
//! deleted (0x100b), which the recorded camera did not know.

#![expect(clippy::unwrap_used, clippy::panic, reason = "tests")]

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::Arc;
use std::time::Duration;

use beampose_core::VirtualClock;
use beampose_drivers::sim::{Hosted, Part, Simulated, TestShutter};
use beampose_drivers::transport::Address;
use beampose_drivers::{Options, Role, Simulator};

const LOG: &str = include_str!("wire/ptpip_gphoto2_2.5.28.log");
/// Handles of the recorded camera and of the simulated one: folders, and what lay on the card.
const HANDLES: [(u32, u32); 3] = [(524_288, 0x1000), (26_214_400, 0x1001), (26_214_417, 0x2000)];
/// The picture of the session, whose number the event tells.
const TAKEN: u32 = 26_214_433;

fn camera() -> Box<dyn Hosted> {
    let driver = beampose_drivers::find("camera", "gphoto2").unwrap();
    let Simulator::Hosted(make) = driver.simulator else { unreachable!() };
    make(&[Simulated {
        name: "it".to_owned(),
        options: Options::read(driver.options, &BTreeMap::new()).unwrap(),
        role: Role::Camera { exposure: None, delivery: None },
        part: Part::Shutter(Arc::new(TestShutter::default())),
        clock: Arc::new(VirtualClock::starting_at(jiff::Timestamp::UNIX_EPOCH)),
    }])
    .unwrap()
}

fn connect(camera: &dyn Hosted) -> TcpStream {
    let Some(Address::Device(port)) = camera.address("it") else { unreachable!() };
    let host = port.strip_prefix("ptpip:").unwrap().to_owned();
    let stream = TcpStream::connect((host, 15740)).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    stream
}

fn send(stream: &mut TcpStream, kind: u32, body: &[u8]) {
    let mut bytes = (body.len() as u32 + 8).to_le_bytes().to_vec();
    bytes.extend(kind.to_le_bytes());
    bytes.extend(body);
    stream.write_all(&bytes).unwrap();
}

fn receive(stream: &mut TcpStream) -> (u32, Vec<u8>) {
    let mut head = [0; 8];
    stream.read_exact(&mut head).unwrap();
    let mut body = vec![0; u32_at(&head, 0) as usize - 8];
    stream.read_exact(&mut body).unwrap();
    (u32_at(&head, 4), body)
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes(bytes[at..at + 2].try_into().unwrap())
}

/// Numbers between brackets, as the recording has them.
fn numbers(text: &str) -> Vec<u32> {
    text.split(|c: char| !c.is_ascii_digit()).filter_map(|word| word.parse().ok()).collect()
}

struct Client {
    command: TcpStream,
    event: TcpStream,
    transaction: u32,
    taken: u32,
}

impl Client {
    /// The two connections, with the recorded first packet.
    fn open(camera: &dyn Hosted, first: &str) -> Self {
        let first: Vec<u8> = (0..first.len())
            .step_by(2)
            .map(|at| u8::from_str_radix(&first[at..at + 2], 16).unwrap())
            .collect();
        let mut command = connect(camera);
        send(&mut command, 1, &first);
        let (kind, ack) = receive(&mut command);
        assert_eq!(kind, 2, "the command connection is acknowledged");
        let mut event = connect(camera);
        send(&mut event, 3, &ack[..4]);
        assert_eq!(receive(&mut event).0, 4, "the event connection is acknowledged");
        Self { command, event, transaction: 0, taken: 0 }
    }

    /// An operation: its response and its data.
    fn ask(&mut self, code: u16, parameters: &[u32]) -> (u16, Vec<u8>) {
        let mut body = 1_u32.to_le_bytes().to_vec();
        body.extend(code.to_le_bytes());
        body.extend(self.transaction.to_le_bytes());
        for it in parameters {
            let own = HANDLES.iter().find(|(theirs, _)| theirs == it).map(|(_, own)| *own);
            let own = if *it == TAKEN { self.taken } else { own.unwrap_or(*it) };
            body.extend(own.to_le_bytes());
        }
        send(&mut self.command, 6, &body);
        let (mut data, mut announced) = (Vec::new(), 0);
        loop {
            let (kind, body) = receive(&mut self.command);
            match kind {
                9 => announced = u32_at(&body, 4) as usize,
                10 | 12 => data.extend(&body[4..]),
                7 => {
                    assert_eq!(u32_at(&body, 2), self.transaction);
                    assert_eq!(data.len(), announced, "as much data as was announced");
                    self.transaction += 1;
                    return (u16_at(&body, 0), data);
                }
                other => panic!("packet {other}"),
            }
        }
    }

    fn next_event(&mut self) -> u16 {
        let (kind, body) = receive(&mut self.event);
        assert_eq!(kind, 8);
        if u16_at(&body, 0) == 0x4002 {
            self.taken = u32_at(&body, 6);
        }
        u16_at(&body, 0)
    }
}

#[test]
fn recorded_sessions_of_gphoto2_get_the_same_answers() {
    let camera = camera();
    let mut client = None;
    let mut operations = 0;
    for line in LOG.lines() {
        let mut words = line.splitn(3, ' ');
        match (words.next(), words.next(), words.next()) {
            (Some("INIT_CMD"), Some(first), _) => {
                // The one before hangs up; a camera has one client.
                drop(client.take());
                std::thread::sleep(Duration::from_millis(100));
                client = Some(Client::open(&*camera, first));
            }
            (Some("OP"), Some(code), Some(rest)) => {
                let it = client.as_mut().unwrap();
                let code = u16::from_str_radix(&code[2..], 16).unwrap();
                let (asked, answered) = rest.split_once(" -> ").unwrap();
                let (response, length) = answered.split_once(' ').unwrap();
                let expected = u16::from_str_radix(&response[2..], 16).unwrap();
                let (found, data) = it.ask(code, &numbers(asked));
                let expected = if code == 0x100b { 0x2001 } else { expected };
                assert_eq!(found, expected, "{line}");
                if !matches!(code, 0x1001 | 0x1005 | 0x1008 | 0x1009) {
                    // The recorded card held two pictures at last; this one keeps what is taken.
                    let lists_roll = code == 0x1007 && asked.ends_with("26214400]");
                    let expected: usize = length.parse().unwrap();
                    assert!(data.len() == expected || lists_roll, "{line}: {} bytes", data.len());
                }
                if code == 0x100e {
                    assert_eq!([it.next_event(), it.next_event()], [0x4002, 0x400d]);
                }
                if code == 0x1009 {
                    assert_eq!(data, TestShutter::picture(0), "the picture, byte for byte");
                }
                operations += 1;
            }
            _ => {}
        }
    }
    assert!(operations > 50, "{operations}");
    assert_eq!(camera.releases("it").len(), 3);
}

#[test]
fn before_a_session_there_is_nothing_but_the_description() {
    let camera = camera();
    let first = "93458a962b6d696ccedb679eb7de824476006d00000000000100";
    let mut it = Client::open(&*camera, first);
    assert_eq!(it.ask(0x1004, &[]).0, 0x2003);
    assert_eq!(it.ask(0x1001, &[]).0, 0x2001);
    assert_eq!(it.ask(0x1002, &[0]).0, 0x201d);
    assert_eq!(it.ask(0x1002, &[1]).0, 0x2001);
    assert_eq!(it.ask(0x1002, &[1]).0, 0x201e);
    assert_eq!(it.ask(0x9999, &[]).0, 0x2005);
    assert_eq!(it.ask(0x1009, &[77]).0, 0x2009);
    assert_eq!(it.ask(0x1007, &[5, 0, 0]).0, 0x2008);
    // A second client is told that the camera is busy.
    let mut second = connect(&*camera);
    send(&mut second, 1, &[0; 22]);
    assert_eq!(receive(&mut second), (5, 2_u32.to_le_bytes().to_vec()));
}
