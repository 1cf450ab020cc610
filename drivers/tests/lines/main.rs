//! Drivers on lines: how ports are set, what is recorded and played back, what an abort leaves.

#![expect(clippy::unwrap_used, reason = "tests")]

#[path = "../common/mod.rs"]
mod common;
mod lake_shore;

use std::future::Future;
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::pin::pin;
use std::sync::Arc;
use std::task::{Context, Waker};
use std::time::Duration;

use beampose_core::transport::Transport;
use beampose_core::{Clock, InstrumentError, Sensor, VirtualClock};
use beampose_drivers::sim::{Fault, Host, LineSettings, Part, Stage, TestProbe, TestStage};
use beampose_drivers::transport::{Address, FlowControl, PortSettings, Recorder, Replay, Wire};
use beampose_drivers::{Connected, Driver, Options, REGISTRY, find};
use common::{DEADLINE, clock, connect, device, interview, options, part, role, run};

fn any_port() -> SocketAddr {
    SocketAddr::from((Ipv4Addr::LOCALHOST, 0))
}

fn wire(
    driver: &Driver,
    options: &Options,
    host: &Host,
    clock: &VirtualClock,
    recorder: Option<Arc<Recorder>>,
) -> Arc<dyn Transport> {
    let port = driver.port_settings(options).unwrap().unwrap();
    let clock = Arc::new(clock.clone());
    Arc::new(Wire::new("it", host.address().clone(), port, clock, recorder))
}

fn sensor(connected: &Connected) -> &Arc<dyn Sensor> {
    let Connected::Sensor(sensor) = connected else { unreachable!("a sensor") };
    sensor
}

/// A pty takes any parity and seven data bits without a word; the rest is asserted.
#[test]
fn serial_ports_are_set_as_the_drivers_say() {
    for driver in REGISTRY {
        let (clock, options) = (clock(), options(driver, &[]));
        let part = part(role(driver), &clock);
        let Some(device) = device(driver, options.clone(), part, &clock) else { continue };
        let host = Host::pty(device).unwrap();
        let port = driver.port_settings(&options).unwrap().unwrap();
        let line = wire(driver, &options, &host, &clock, None);
        let connected = connect(driver, options, line, &clock).unwrap();
        run(&clock, interview(&connected))[0].as_ref().unwrap();
        let expected = LineSettings {
            baud: port.baud,
            two_stop_bits: port.stop_bits == 2,
            software_flow: port.flow == FlowControl::Software,
            hardware_flow: port.flow == FlowControl::Hardware,
        };
        assert_eq!(host.line_settings(), Some(expected), "{}", driver.name);
    }
}

#[test]
fn the_lines_of_readouts_are_those_of_their_manuals() {
    for (name, baud) in [("sylvac", 4800), ("heidenhain-nd287", 9600)] {
        let port = find("linear_axis", name).unwrap().port.unwrap();
        let parity = beampose_drivers::transport::Parity::Even;
        let set = (port.baud, port.data_bits, port.parity, port.stop_bits, port.flow);
        assert_eq!(set, (baud, 7, parity, 2, FlowControl::None), "{name}");
    }
}

#[test]
fn the_rig_file_sets_the_line_of_a_generic_reader() {
    let generic = find("sensor", "generic").unwrap();
    let written = [("baud", "2400"), ("stop_bits", "2"), ("flow", "hardware"), ("parity", "odd")];
    let port = generic.port_settings(&options(generic, &written)).unwrap().unwrap();
    assert_eq!((port.baud, port.stop_bits, port.data_bits), (2400, 2, 8));
    for wrong in [("parity", "mark"), ("flow", "rts"), ("stop_bits", "3"), ("data_bits", "5")] {
        let error = generic.port_settings(&options(generic, &[wrong])).unwrap_err().to_string();
        assert!(error.contains(wrong.0) && error.contains(wrong.1), "{error}");
    }
}

#[test]
fn a_recorded_conversation_plays_back_to_the_same_results() {
    for driver in REGISTRY.iter().filter(|it| matches!(it.kind, "sensor" | "linear_axis")) {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("wire.jsonl");
        let (clock, options) = (clock(), options(driver, &[]));
        let part = part(role(driver), &clock);
        let Some(device) = device(driver, options.clone(), part, &clock) else { continue };
        let host = Host::tcp(device, any_port()).unwrap();
        let recorder = Some(Arc::new(Recorder::create(&file).unwrap()));
        let line = wire(driver, &options, &host, &clock, recorder);
        let live = connect(driver, options.clone(), line, &clock).unwrap();
        let live = run(&clock, interview(&live));
        assert!(live.iter().all(Result::is_ok), "{}: {live:?}", driver.name);
        drop(host);

        let replay = Arc::new(Replay::load(&file, "it").unwrap());
        let clock = common::clock();
        let played = connect(driver, options, replay.clone(), &clock).unwrap();
        assert_eq!(run(&clock, interview(&played)), live, "{}", driver.name);
        assert!(replay.is_over(), "{}", driver.name);
        assert!(run(&clock, interview(&played)).iter().any(Result::is_err), "{}", driver.name);
    }
}

#[test]
fn what_the_instrument_does_not_take_is_a_timeout() {
    let listener = TcpListener::bind(any_port()).unwrap();
    let (clock, settings) = (clock(), PortSettings::at(9600));
    let Ok(SocketAddr::V4(bound)) = listener.local_addr() else { unreachable!("IPv4") };
    let address = Address::Tcp { host: bound.ip().to_string(), port: bound.port() };
    let wire = Wire::new("it", address, settings, Arc::new(clock.clone()), None);
    let deadline = Duration::from_millis(100);
    let ended = run(&clock, async {
        wire.open(deadline).await.unwrap();
        // More than any buffer between: nobody reads at the other end.
        wire.send(&vec![b'x'; 1 << 25], deadline).await
    });
    assert_eq!(ended, Err(InstrumentError::Timeout(deadline)));
}

/// Polls a future for a while and drops it, as an abort does.
fn begin(future: impl Future, milliseconds: u32) {
    let mut future = pin!(future);
    let mut context = Context::from_waker(Waker::noop());
    for _ in 0..milliseconds * 4 {
        if future.as_mut().poll(&mut context).is_ready() {
            return;
        }
        std::thread::sleep(Duration::from_micros(250));
    }
}

#[test]
fn the_answer_to_an_aborted_question_is_not_taken_for_the_next() {
    let generic = find("sensor", "generic").unwrap();
    for milliseconds in [1, 5, 20] {
        let (clock, options) = (clock(), options(generic, &[("answer", "T={value} C")]));
        let probe = Arc::new(TestProbe::new(21.0, 0.25));
        let part = Part::Probe(probe.clone());
        let device = device(generic, options.clone(), part, &clock).unwrap();
        let host = Host::tcp(device, any_port()).unwrap();
        let line = wire(generic, &options, &host, &clock, None);
        let connected = connect(generic, options, line, &clock).unwrap();
        let sensor = sensor(&connected);
        run(&clock, sensor.read()).unwrap();
        // Its answer comes when nobody waits for it any more, and the next question was asked.
        host.trouble().next([Fault::Late(DEADLINE * 5 / 4)]);
        begin(sensor.read(), milliseconds);
        let read = run(&clock, sensor.read()).unwrap().value;
        let newest = probe.value(probe.reads() - 1);
        assert!((read - newest).abs() < 1e-9, "after {milliseconds} ms: {read}, not {newest}");
    }
}

#[test]
fn a_generic_reader_reads_what_its_rig_file_describes() {
    let generic = find("sensor", "generic").unwrap();
    let written = [
        ("command", "T\\r"),
        ("terminator", "\\r"),
        ("answer", "t: {value} F *"),
        ("unit", "F"),
        ("setup", "SA=0\\r|U=F\\r"),
        ("identify", "*IDN?\\r"),
    ];
    let (clock, options) = (clock(), options(generic, &written));
    let part = part(role(generic), &clock);
    let device = device(generic, options.clone(), part, &clock).unwrap();
    let host = Host::pty(device).unwrap();
    let line = wire(generic, &options, &host, &clock, None);
    let connected = connect(generic, options, line, &clock).unwrap();
    let sensor = sensor(&connected);
    for expected in [21.0, 21.25] {
        let read = run(&clock, sensor.read()).unwrap();
        assert!((read.value - expected).abs() < 1e-6, "{}", read.value);
    }
    let identity = run(&clock, sensor.identify()).unwrap();
    assert!(identity.model.starts_with("GENERIC"), "{}", identity.model);
}

#[test]
fn a_generic_readers_error_names_the_pattern_and_what_came() {
    let generic = find("sensor", "generic").unwrap();
    let (clock, of_device) = (clock(), options(generic, &[("answer", "Temp {value}")]));
    let part = part(role(generic), &clock);
    let device = device(generic, of_device, part, &clock).unwrap();
    let host = Host::tcp(device, any_port()).unwrap();
    let of_driver = options(generic, &[("answer", "T={value} C")]);
    let line = wire(generic, &of_driver, &host, &clock, None);
    let connected = connect(generic, of_driver, line, &clock).unwrap();
    let error = run(&clock, sensor(&connected).read()).unwrap_err().to_string();
    assert!(error.contains("T={value} C") && error.contains("Temp 21.0"), "{error}");
    for wrong in [("unit", "mm"), ("answer", "T="), ("command", "\\q"), ("terminator", "")] {
        let line = wire(generic, &options(generic, &[]), &host, &clock, None);
        let error = connect(generic, options(generic, &[wrong]), line, &clock).err().unwrap();
        assert!(error.to_string().contains(wrong.0), "{error}");
    }
}

#[test]
fn what_print_sends_is_not_taken_for_the_position() {
    let sylvac = find("linear_axis", "sylvac").unwrap();
    let (clock, options) = (clock(), options(sylvac, &[]));
    let shared = Arc::new(clock.clone());
    let stage = Arc::new(TestStage::new(shared, [0.0, 300.0], 50.0));
    let part = Part::Stage(stage.clone());
    let device = device(sylvac, options.clone(), part, &clock).unwrap();
    let host = Host::pty(device).unwrap();
    let line = wire(sylvac, &options, &host, &clock, None);
    let connected = connect(sylvac, options, line, &clock).unwrap();
    let Connected::Axis(axis) = &connected else { unreachable!("an axis") };
    // What PRINT sends comes before the value, before the value and its unit, before all of them.
    for (count, place) in [(1, 12.0), (2, 7.0), (7, 30.0)] {
        stage.go(place).unwrap();
        run(&clock, clock.sleep(Duration::from_secs(1)));
        host.trouble().next(vec![Fault::Chatter; count]);
        for _ in 0..3 {
            let read = run(&clock, axis.position()).unwrap().value;
            assert!((read - place).abs() < 1e-9, "{read}, not {place}");
        }
        host.trouble().forget();
    }
    let identity = run(&clock, axis.identify()).unwrap();
    assert_eq!(identity.model, "SYLVAC - TRIMOS V600");
}
