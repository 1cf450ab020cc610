//! The Arroyo 6300 that we simulate: examples of its manual, its traps, and a driver that finds it as
//! somebody else left it.
#![expect(clippy::unwrap_used, reason = "tests")]

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use beampose_core::{Clock, Emission, InstrumentError, Quantity, VirtualClock};
use beampose_drivers::sim::{Device, Diode, Host, Part, Simulated, TestDiode};
use beampose_drivers::transport::{Address, Line, Wire};
use beampose_drivers::{Connected, Options, Role, Setting, Simulator, find};

const DEADLINE: Duration = Duration::from_millis(300);
const LASER: Role = Role::Laser { current_ma: Some(60.0), emission_delay: Duration::from_secs(3) };

fn options(more: &[(&str, &str)]) -> Options {
    let all = [&[("limit_current", "120")], more].concat();
    let written: BTreeMap<String, String> =
        all.into_iter().map(|(key, value)| (key.to_owned(), value.to_owned())).collect();
    Options::read(find("laser", "arroyo").unwrap().options, &written).unwrap()
}

struct Lab {
    clock: VirtualClock,
    diode: Arc<TestDiode>,
}

impl Lab {
    fn new() -> Self {
        let clock = VirtualClock::starting_at(jiff::Timestamp::UNIX_EPOCH);
        let diode = Arc::new(TestDiode::new(Arc::new(clock.clone())));
        Self { clock, diode }
    }

    fn device(&self) -> Box<dyn Device> {
        let Simulator::Device(make) = find("laser", "arroyo").unwrap().simulator else {
            unreachable!("a line of bytes")
        };
        make(&[Simulated {
            name: "laser".to_owned(),
            options: options(&[]),
            role: LASER,
            part: Part::Diode(self.diode.clone()),
            clock: Arc::new(self.clock.clone()),
        }])
        .unwrap()
    }

    fn wait(&self, ms: u64) {
        let sleep = self.clock.sleep(Duration::from_millis(ms));
        futures::executor::block_on(self.clock.drive(Box::pin(sleep)));
    }

    fn line(&self, host: &Host) -> Arc<Line> {
        let clock: Arc<dyn Clock> = Arc::new(self.clock.clone());
        let port = find("laser", "arroyo").unwrap().port.unwrap();
        let wire = Wire::new("line", host.address().clone(), port, clock, None);
        Arc::new(Line::new(Arc::new(wire), DEADLINE))
    }

    fn on(&self, line: Arc<Line>, kind: &str, role: Role, options: Options) -> Connected {
        (find(kind, "arroyo").unwrap().connect)(Setting {
            name: kind.to_owned(),
            address: Address::Device("this line".to_owned()),
            line: Some(line),
            clock: Arc::new(self.clock.clone()),
            options,
            role,
            deadline: DEADLINE,
            simulated: true,
            scratch: std::env::temp_dir(),
        })
        .unwrap()
    }

    fn connect(&self, host: &Host, more: &[(&str, &str)]) -> Connected {
        self.on(self.line(host), "laser", LASER, options(more))
    }
}

fn ask(device: &mut dyn Device, text: &str) -> String {
    String::from_utf8(device.receive(&mut text.as_bytes().to_vec())).unwrap()
}

#[test]
fn commands_are_taken_in_the_forms_of_the_manual() {
    let lab = Lab::new();
    let mut device = lab.device();
    let device = device.as_mut();
    // Examples of "Command Paths": whole, without the common path, abbreviated, from the root.
    for text in ["LASER:LDI 10; LASER:OUTPUT 1", "LASER:LDI 10;OUTPUT 1", "LAS:LDI 10;OUT 1"] {
        assert_eq!(ask(device, &format!("{text}\r\n")), "", "{text}");
        assert_eq!(ask(device, "ERR?;LAS:SET:LDI?;:LAS:OUT?\r"), "0\r\n10.00\r\n1\r\n", "{text}");
        ask(device, "LAS:OUT OFF;LDI 0\n");
    }
    // Nothing runs before the end of the line.
    let mut pending = b"LAS:LDI 20;".to_vec();
    device.receive(&mut pending);
    assert_eq!(pending, b"LAS:LDI 20;");
    pending.extend(b"SET:LDI?\n");
    assert_eq!(device.receive(&mut pending), b"20.00\r\n");
    // Its example of number bases.
    ask(device, "LAS:ENAB:OUTOFF #HBA13\nRADIX HEX\n");
    assert_eq!(ask(device, "LAS:ENAB:OUTOFF?\n"), "#HBA13\r\n");
    assert_eq!(ask(device, "RADIX OCT;:LAS:ENAB:OUTOFF?\n"), "#O135023\r\n");
    assert_eq!(ask(device, "RAD BIN;:LAS:ENAB:OUTOFF?\n"), "#B1011101000010011\r\n");
    // Errors: data of the wrong form, out of range, no such path, none given; reading empties.
    ask(device, "RAD DEC;:LAS:LDI x;LDI 900;NONE 1;LDI\n");
    assert_eq!(ask(device, "ERR?;ERR?\n"), "124,201,123,126\r\n0\r\n");
}

#[test]
fn the_simulator_keeps_the_traps_of_the_manual() {
    let lab = Lab::new();
    let mut device = lab.device();
    let device = device.as_mut();
    // Set and measured have nearly one name; a lower limit lowers the set point silently.
    assert_eq!(ask(device, "LAS:LDI 80;LDI?;SET:LDI?\n"), "0.00\r\n80.00\r\n");
    assert_eq!(ask(device, "LAS:LIM:LDI 50\nLAS:SET:LDI?;:ERR?\n"), "50.00\r\n0\r\n");
    // On, and no current before the delay is over.
    let state = "LAS:OUT?;LDI?;COND?\n";
    assert_eq!(ask(device, &format!("LAS:OUT 1;{}", &state[4..])), "1\r\n0.00\r\n0\r\n");
    lab.wait(2_900);
    assert_eq!(ask(device, state), "1\r\n0.00\r\n0\r\n");
    lab.wait(200);
    assert_eq!(ask(device, state), "1\r\n50.00\r\n1025\r\n");
    // A change of mode switches off.
    assert_eq!(ask(device, "LAS:MODE:IHBW;:ERR?;:LAS:OUT?\n"), "514\r\n0\r\n");
    // So do an open contact and temperature control that goes off.
    ask(device, "LAS:OUT 1\n");
    lab.diode.interlock_open.store(true, Ordering::SeqCst);
    assert_eq!(ask(device, "ERR?;:LAS:OUT?;COND?\n"), "501\r\n0\r\n16\r\n");
    assert_eq!(ask(device, "LAS:OUT 1;:ERR?\n"), "501\r\n");
    lab.diode.interlock_open.store(false, Ordering::SeqCst);
    ask(device, "LAS:OUT 1;:TEC:OUT 0\n");
    assert_eq!(ask(device, "ERR?;:LAS:OUT?\n"), "508\r\n0\r\n");
    // More than 128 characters are thrown away together.
    let long = format!("LAS:LDI 1;{}", "LDI 1;".repeat(21));
    assert_eq!(ask(device, &format!("{long}\nERR?\n")), "102,123\r\n");
    // As hex float, the manual's example; with an echo.
    assert_eq!(ask(device, "TEC:T 123.45;:HEXFLOAT 1;:TEC:SET:T?\n"), "#E42F6E666\r\n");
    ask(device, "TERMINAL 1\n");
    assert_eq!(ask(device, "TERM 4;TERM?\n"), "TERM 4;TERM?\n4\n");
}

/// Number base, hex floats, echo, line ends, mode, delay: nothing of it is assumed.
#[test]
fn the_driver_finds_its_way_however_the_box_was_left() {
    let lab = Lab::new();
    let mut device = lab.device();
    let left = "TEC:OUT?;:LAS:MODE:MDI;:ONDELAY 0;:RAD HEX;:HEXFLOAT 1;:TERM 6;:NONE;:TERMINAL 1\n";
    ask(device.as_mut(), left);
    let host = Host::tcp(device, "127.0.0.1:0".parse().unwrap()).unwrap();
    let Connected::Laser(laser) = lab.connect(&host, &[]) else { unreachable!("a laser") };
    let run = async {
        laser.emit().await.unwrap();
        assert!(lab.diode.emits() && lab.clock.now().monotonic >= Duration::from_secs(3));
        laser.off().await.unwrap();
        assert!(!lab.diode.is_on());
    };
    futures::executor::block_on(lab.clock.drive(Box::pin(run)));
}

#[test]
fn light_without_temperature_control_is_given_only_where_the_rig_says_so() {
    for (more, refused) in [(&[][..], true), (&[("temperature_control", "false")][..], false)] {
        let lab = Lab::new();
        let mut device = lab.device();
        ask(device.as_mut(), "TEC:OUT 0\n");
        let host = Host::tcp(device, "127.0.0.1:0".parse().unwrap()).unwrap();
        let Connected::Laser(laser) = lab.connect(&host, more) else { unreachable!("a laser") };
        let lit = futures::executor::block_on(lab.clock.drive(Box::pin(laser.emit())));
        match lit {
            Err(InstrumentError::Refused(why)) => {
                assert!(refused && why.contains("temperature control is off"), "{why}");
            }
            other => assert!(!refused && other.is_ok(), "{other:?}"),
        }
    }
}

#[test]
fn laser_and_sensor_share_a_line_and_leave_each_other_alone() {
    let lab = Lab::new();
    let host = Host::tcp(lab.device(), "127.0.0.1:0".parse().unwrap()).unwrap();
    let line = lab.line(&host);
    let laser = lab.on(Arc::clone(&line), "laser", LASER, options(&[]));
    let role = Role::Sensor { quantity: Quantity::Temperature, u: Some(0.05) };
    let sensor = lab.on(line, "sensor", role, Options::default());
    let (Connected::Laser(laser), Connected::Sensor(sensor)) = (laser, sensor) else {
        unreachable!("a laser and a sensor")
    };
    let run = async {
        laser.emit().await.unwrap();
        // The sensor's first word on this line: the light stays.
        assert_eq!(sensor.read().await.unwrap().value, 25.0);
        assert_eq!(laser.emission().await, Emission::On);
        assert!(lab.diode.emits());
        // Nobody holds the laser any more; the sensor holds the line.
        drop(laser);
        std::thread::sleep(Duration::from_millis(60));
        assert!(!lab.diode.is_on());
        assert_eq!(sensor.read().await.unwrap().value, 25.0);
    };
    futures::executor::block_on(lab.clock.drive(Box::pin(run)));
}
