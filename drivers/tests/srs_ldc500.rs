//! The LDC501 that we simulate: what a real client said to one, its traps, and laser and sensor on
//! one line.
#![expect(clippy::unwrap_used, reason = "tests")]

use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader, Write as _};
use std::sync::Arc;
use std::time::Duration;

use beampose_core::{Clock, Emission, Quantity, VirtualClock};
use beampose_drivers::sim::{Device, Diode, Host, Part, Simulated, TestDiode, TestProbe};
use beampose_drivers::transport::{Address, Line, Wire};
use beampose_drivers::{Connected, Driver, Options, Role, Setting, Simulator, find};

const DEADLINE: Duration = Duration::from_millis(500);
const LASER: Role = Role::Laser { current_ma: Some(60.0), emission_delay: Duration::from_secs(3) };
const SENSOR: Role = Role::Sensor { quantity: Quantity::Temperature, u: Some(0.05) };

fn options(driver: &'static Driver) -> Options {
    let written = [("limit_current".to_owned(), "120".to_owned())];
    let written = BTreeMap::from(written).into_iter().filter(|_| driver.kind == "laser").collect();
    Options::read(driver.options, &written).unwrap()
}

struct Lab {
    clock: VirtualClock,
    diode: Arc<TestDiode>,
    probe: Arc<TestProbe>,
}

impl Lab {
    fn new() -> Self {
        let clock = VirtualClock::starting_at(jiff::Timestamp::UNIX_EPOCH);
        let diode = Arc::new(TestDiode::new(Arc::new(clock.clone())));
        Self { clock, diode, probe: Arc::new(TestProbe::new(25.1, 0.0)) }
    }

    fn device(&self) -> Box<dyn Device> {
        let driver = find("laser", "srs-ldc500").unwrap();
        let simulated = |name: &str, kind: &str, role: Role, part: Part| Simulated {
            name: name.to_owned(),
            options: options(find(kind, "srs-ldc500").unwrap()),
            role,
            part,
            clock: Arc::new(self.clock.clone()),
        };
        let Simulator::Device(make) = driver.simulator else { unreachable!("a line of bytes") };
        make(&[
            simulated("laser", "laser", LASER, Part::Diode(self.diode.clone())),
            simulated("diode", "sensor", SENSOR, Part::Probe(self.probe.clone())),
        ])
        .unwrap()
    }

    fn line(&self, host: &Host) -> Arc<Line> {
        let clock: Arc<dyn Clock> = Arc::new(self.clock.clone());
        let port = find("laser", "srs-ldc500").unwrap().port.unwrap();
        let wire = Wire::new("line", host.address().clone(), port, clock, None);
        Arc::new(Line::new(Arc::new(wire), DEADLINE))
    }

    fn on(&self, line: &Arc<Line>, kind: &str, role: Role) -> Connected {
        self.with(line, kind, role, options(find(kind, "srs-ldc500").unwrap()))
    }

    fn with(&self, line: &Arc<Line>, kind: &str, role: Role, options: Options) -> Connected {
        (find(kind, "srs-ldc500").unwrap().connect)(Setting {
            name: kind.to_owned(),
            address: Address::Device("this line".to_owned()),
            line: Some(Arc::clone(line)),
            clock: Arc::new(self.clock.clone()),
            options,
            role,
            deadline: DEADLINE,
            simulated: true,
            scratch: std::env::temp_dir(),
        })
        .unwrap()
    }

    fn wait(&self, ms: u64) {
        let sleep = self.clock.sleep(Duration::from_millis(ms));
        futures::executor::block_on(self.clock.drive(Box::pin(sleep)));
    }
}

fn ask(device: &mut dyn Device, text: &str) -> String {
    String::from_utf8(device.receive(&mut text.as_bytes().to_vec())).unwrap()
}

/// Every answer is that of the recording.
#[test]
fn a_recorded_conversation_with_pymeasure_goes_the_same_way() {
    let lab = Lab::new();
    let mut device = lab.device();
    let (mut last, mut answers) = (String::new(), 0);
    for line in include_str!("wire/srs_ldc501_pymeasure_0.16.log").lines() {
        if let Some(sent) = line.strip_prefix("RX b'") {
            assert_eq!(last, "", "an answer that the recording has not, before {sent}");
            last = ask(device.as_mut(), &format!("{}\n", sent.trim_end_matches('\'')));
            lab.wait(15);
        } else if let Some(answered) = line.strip_prefix("TX '") {
            assert_eq!(last.trim_end(), answered.trim_end_matches('\''));
            last.clear();
            answers += 1;
        }
    }
    assert_eq!(answers, 7);
}

#[test]
fn the_simulator_keeps_the_traps_of_the_manual() {
    let lab = Lab::new();
    let mut device = lab.device();
    let device = device.as_mut();
    // A lower limit drags the set point, and nothing says so.
    assert_eq!(ask(device, "SILD 80;SILM 50;SILD?\r"), "50.000\n");
    assert_eq!(ask(device, "LEXE?\n"), "0\n");
    // An error is not there at once; reading it clears it.
    assert_eq!(ask(device, "SILD 80\nLEXE?\n"), "0\n");
    lab.wait(20);
    assert_eq!(ask(device, "LEXE?;LEXE?\n"), "1\n0\n");
    assert_eq!(ask(device, "RILD 1;NONE?\n"), "");
    lab.wait(20);
    assert_eq!(ask(device, "LCME?\n"), "2\n");
    assert_eq!(ask(device, "ILOC\n"), "");
    lab.wait(20);
    assert_eq!(ask(device, "LCME?\n"), "4\n");
    // More than 64 bytes are thrown away together.
    let long = format!("SILD 40;{}", "SILD 40;".repeat(7));
    assert_eq!(ask(device, &format!("{long}SILD 41\nSILD?\n")), "50.000\n");
    // Form of answers.
    assert_eq!(ask(device, "TERM CRLF;TOKN OFF;ILOC?;LDON?;TERM?\n"), "1\r\n0\r\n3\r\n");
    assert_eq!(ask(device, "TERM NONE;TOKN 1;ILOC?;TOKN?\n"), "CLOSEDON");
    device.reboot();
    assert_eq!(ask(device, "LDON?;TEON?;TERM 2\n"), "OFFOFF");
    // Half a command waits for its end.
    let mut pending = b"SIL".to_vec();
    assert!(device.receive(&mut pending).is_empty());
    pending.extend(b"D?\n");
    assert_eq!(device.receive(&mut pending), b"50.000\n");
}

#[test]
fn laser_and_sensor_share_a_line_and_leave_each_other_alone() {
    let lab = Lab::new();
    let host = Host::tcp(lab.device(), "127.0.0.1:0".parse().unwrap()).unwrap();
    let line = lab.line(&host);
    let (Connected::Laser(laser), Connected::Sensor(sensor)) =
        (lab.on(&line, "laser", LASER), lab.on(&line, "sensor", SENSOR))
    else {
        unreachable!("a laser and a sensor")
    };
    let run = async {
        laser.emit().await.unwrap();
        // The sensor's first word on this line: the light stays.
        let reading = sensor.read().await.unwrap();
        assert_eq!((reading.value, reading.standard_uncertainty), (25.1, Some(0.05)));
        assert_eq!(laser.emission().await, Emission::On);
        assert!(lab.diode.emits());
        // Somebody pulled the cable, and the sensor was the first to notice.
        host.trouble().cut();
        std::thread::sleep(Duration::from_millis(60));
        let _ = sensor.read().await;
        sensor.read().await.unwrap();
        assert_eq!(laser.emission().await, Emission::Off);
        assert!(!lab.diode.is_on());
    };
    futures::executor::block_on(lab.clock.drive(Box::pin(run)));
}

/// Tokens, line ends, modulation, mode: nothing of it is assumed.
#[test]
fn the_driver_finds_its_way_however_the_box_was_left() {
    let lab = Lab::new();
    let mut device = lab.device();
    ask(device.as_mut(), "SILM 200;SILD 150;SMOD CP;MODU ON;NONE 1;TOKN OFF;TERM NONE\nSIL");
    let host = Host::tcp(device, "127.0.0.1:0".parse().unwrap()).unwrap();
    let Connected::Laser(laser) = lab.on(&lab.line(&host), "laser", LASER) else {
        unreachable!("a laser")
    };
    let run = async {
        laser.emit().await.unwrap();
        assert!(lab.diode.emits());
        laser.off().await.unwrap();
        assert!(!lab.diode.is_on());
    };
    futures::executor::block_on(lab.clock.drive(Box::pin(run)));
    drop(laser);
    let Address::Tcp { host: name, port } = host.address() else { unreachable!("TCP") };
    let mut second = std::net::TcpStream::connect((name.as_str(), *port)).unwrap();
    second.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    second.write_all(b"SMOD?;MODU?;SILM?;SILD?;LDON?\n").unwrap();
    let answers: Vec<String> = BufReader::new(second).lines().take(5).map(Result::unwrap).collect();
    assert_eq!(answers, ["CC", "OFF", "120.000", "0.000", "OFF"]);
}

/// In the lower range the hardware cannot have the limit: it says so, and so does the driver.
#[test]
fn a_limit_beyond_the_range_is_an_error_in_words() {
    let lab = Lab::new();
    let mut device = lab.device();
    ask(device.as_mut(), "RNGE LOW\n");
    let host = Host::tcp(device, "127.0.0.1:0".parse().unwrap()).unwrap();
    let written = BTreeMap::from([("limit_current".to_owned(), "300".to_owned())]);
    let options = Options::read(find("laser", "srs-ldc500").unwrap().options, &written).unwrap();
    let laser = lab.with(&lab.line(&host), "laser", LASER, options);
    let Connected::Laser(laser) = laser else { unreachable!("a laser") };
    let lit = futures::executor::block_on(lab.clock.drive(Box::pin(laser.emit())));
    let why = lit.unwrap_err().to_string();
    assert!(why.contains("SILM 300.000") && why.contains("LEXE"), "{why}");
    assert!(!lab.diode.is_on());
}
