//! Several inputs of one Lake Shore monitor, on one line.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::sync::Arc;

use crate::common::{DEADLINE, clock, options, role, run};
use beampose_core::{Clock, Sensor, VirtualClock};
use beampose_drivers::sim::{Host, Part, Simulated, TestProbe};
use beampose_drivers::transport::{Line, Wire};
use beampose_drivers::{Connected, Driver, Setting, Simulator, find};
use futures::future::join;

fn driver() -> &'static Driver {
    find("sensor", "lake-shore").unwrap()
}

fn simulated(channel: &str, probe: Arc<TestProbe>, clock: &VirtualClock) -> Simulated {
    Simulated {
        name: format!("input {channel}"),
        options: options(driver(), &[("channel", channel)]),
        role: role(driver()),
        part: Part::Probe(probe),
        clock: Arc::new(clock.clone()),
    }
}

/// A monitor with a sensor at each of the inputs, at these temperatures, and its line.
fn monitor(clock: &VirtualClock, inputs: &[(&str, f64)]) -> (Host, Arc<Line>) {
    let Simulator::Device(make) = driver().simulator else { unreachable!("a device") };
    let all: Vec<Simulated> = inputs
        .iter()
        .map(|(channel, degc)| simulated(channel, Arc::new(TestProbe::new(*degc, 0.5)), clock))
        .collect();
    let any_port = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    let host = Host::tcp(make(&all).unwrap(), any_port).unwrap();
    let port = driver().port.unwrap();
    let shared: Arc<dyn Clock> = Arc::new(clock.clone());
    let wire = Wire::new("it", host.address().clone(), port, shared, None);
    (host, Arc::new(Line::new(Arc::new(wire), DEADLINE)))
}

fn input(
    line: &Arc<Line>,
    host: &Host,
    written: &[(&str, &str)],
    clock: &VirtualClock,
) -> Arc<dyn Sensor> {
    let setting = Setting {
        name: "it".to_owned(),
        address: host.address().clone(),
        line: Some(Arc::clone(line)),
        clock: Arc::new(clock.clone()),
        options: options(driver(), written),
        role: role(driver()),
        deadline: DEADLINE,
        simulated: true,
        scratch: Path::to_owned(&std::env::temp_dir()),
    };
    let Connected::Sensor(sensor) = (driver().connect)(setting).unwrap() else {
        unreachable!("a sensor")
    };
    sensor
}

#[test]
fn inputs_of_one_monitor_share_its_line_and_its_pace() {
    let clock = clock();
    let (host, line) = monitor(&clock, &[("1", 20.0), ("8", 60.0)]);
    let one = input(&line, &host, &[("channel", "1")], &clock);
    let eight = input(&line, &host, &[("channel", "8"), ("scale", "kelvin")], &clock);
    let before = clock.now().monotonic;
    for turn in 0..5 {
        // Both at once: the simulator loses queries that come faster than 20 in a second.
        let (one, eight) = run(&clock, join(one.read(), eight.read()));
        let (one, eight) = (one.unwrap().value, eight.unwrap().value);
        let risen = 0.5 * f64::from(turn);
        assert!((one - 20.0 - risen).abs() < 1e-9, "{one}");
        assert!((eight - 60.0 - risen).abs() < 1e-9, "{eight}");
    }
    let passed = clock.now().monotonic.saturating_sub(before).as_secs_f64();
    assert!((1.0..2.0).contains(&passed), "20 queries took {passed} s");
}

#[test]
fn an_input_without_a_sensor_or_a_name_is_an_error() {
    let clock = clock();
    let (host, line) = monitor(&clock, &[("A", 20.0)]);
    let read = |written: &[(&str, &str)]| {
        let sensor = input(&line, &host, written, &clock);
        run(&clock, sensor.read()).map(|reading| reading.value).map_err(|error| error.to_string())
    };
    assert_eq!(read(&[("channel", "a")]), Ok(20.0));
    let open = read(&[("channel", "B")]).unwrap_err();
    assert!(open.contains("input B") && open.contains("none is connected"), "{open}");
    // Its zeros look like a temperature in Celsius, and are below all of them in kelvin.
    assert_eq!(read(&[("channel", "B"), ("status", "false")]), Ok(0.0));
    let kelvin = [("channel", "B"), ("status", "false"), ("scale", "kelvin")];
    assert!(read(&kelvin).unwrap_err().contains("absolute zero"));
    let unknown = read(&[("channel", "E")]).unwrap_err();
    assert!(unknown.contains("input E") && unknown.contains("such an input"), "{unknown}");
}

#[test]
fn an_input_cannot_be_two_instruments() {
    let clock = clock();
    let Simulator::Device(make) = driver().simulator else { unreachable!("a device") };
    let twice = ["A", "a"].map(|name| simulated(name, Arc::new(TestProbe::new(1.0, 0.0)), &clock));
    assert!(make(&twice).err().unwrap().contains("already read"));
}
