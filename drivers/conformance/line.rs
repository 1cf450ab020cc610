//! What holds for every instrument on a line.

use std::pin::pin;
use std::task::{Context, Waker};
use std::time::{Duration, Instant};

use beampose_core::InstrumentError;
use futures::FutureExt;

use super::Way;
use super::bench::Bench;
use crate::registry::{Connected, Moved};
use crate::sim::{Fault, LineSettings};
use crate::transport::FlowControl;

pub(super) fn identifies(bench: &Bench) -> Result<(), String> {
    let asker = bench.asker()?;
    let identity = bench.run(asker.identify()).map_err(|error| error.to_string())?;
    if identity.model.trim().is_empty() {
        return Err("its model is empty".to_owned());
    }
    if !identity.simulated {
        return Err("it does not say that it is simulated".to_owned());
    }
    Ok(())
}

/// A pty takes all bytes whatever their speed, so that only the settings tell. Parity and data bits
/// it does not even keep.
pub(super) fn port(bench: &Bench) -> Result<(), String> {
    let (Some(host), Some(wanted), Way::Pty) = (bench.host(), bench.driver.port, bench.way) else {
        return Ok(());
    };
    let _asker = bench.asker()?;
    let found = host.line_settings().ok_or("the port was not seen")?;
    let as_wanted = LineSettings {
        baud: wanted.baud,
        two_stop_bits: wanted.stop_bits == 2,
        software_flow: wanted.flow == FlowControl::Software,
        hardware_flow: wanted.flow == FlowControl::Hardware,
    };
    if found != as_wanted {
        return Err(format!("expected {as_wanted:?}, found {found:?}"));
    }
    Ok(())
}

pub(super) fn silent(bench: &Bench) -> Result<(), String> {
    let Some(trouble) = bench.trouble() else { return Ok(()) };
    let asker = bench.asker()?;
    trouble.next([Fault::Silent; 3]);
    match bench.run(asker.ask()) {
        Err(InstrumentError::Timeout(_)) => {}
        other => return Err(format!("expected a timeout, got {other:?}")),
    }
    trouble.forget();
    works_again(bench, &asker)
}

pub(super) fn garbled(bench: &Bench) -> Result<(), String> {
    damaged(bench, Fault::Garbled)
}

pub(super) fn half(bench: &Bench) -> Result<(), String> {
    damaged(bench, Fault::Half)
}

fn damaged(bench: &Bench, fault: Fault) -> Result<(), String> {
    let Some(trouble) = bench.trouble() else { return Ok(()) };
    let asker = bench.asker()?;
    trouble.next([fault; 3]);
    match bench.run(asker.ask()) {
        Err(InstrumentError::Garbled { .. } | InstrumentError::Timeout(_)) => {}
        other => return Err(format!("expected garbled or a timeout, got {other:?}")),
    }
    trouble.forget();
    works_again(bench, &asker)
}

fn works_again(bench: &Bench, asker: &super::bench::Asker) -> Result<(), String> {
    bench.run(asker.ask()).map_err(|error| format!("afterwards: {error}"))
}

pub(super) fn chatter(bench: &Bench) -> Result<(), String> {
    let Some(host) = bench.host() else { return Ok(()) };
    if !host.can_chatter() {
        return Ok(());
    }
    let asker = bench.asker()?;
    host.trouble().next([Fault::Chatter; 4]);
    for _ in 0..4 {
        bench.run(asker.ask()).map_err(|error| error.to_string())?;
    }
    Ok(())
}

/// The answer to the first question comes while the second is asked; the values differ.
pub(super) fn late(bench: &Bench) -> Result<(), String> {
    let Some(trouble) = bench.trouble() else { return Ok(()) };
    match bench.connect()? {
        Connected::Axis(axis) => {
            let go = |target: f64| bench.bring(&axis, target);
            let read = || bench.run(axis.position()).map(|reading| reading.value);
            go(10.0)?;
            trouble.next([Fault::Late(bench.deadline() * 2)]);
            expect_timeout(read())?;
            go(20.0)?;
            near(20.0, read().map_err(|error| error.to_string())?)
        }
        Connected::Sensor(sensor) => {
            let read = || bench.run(sensor.read()).map(|reading| reading.value);
            let probe = bench.probe.as_ref().ok_or("no probe")?;
            read().map_err(|error| error.to_string())?;
            trouble.next([Fault::Late(bench.deadline() * 2)]);
            expect_timeout(read())?;
            std::thread::sleep(bench.deadline() / 2);
            let found = read().map_err(|error| format!("after the late answer: {error}"))?;
            near(probe.value(probe.reads() - 1), found)
        }
        Connected::Laser(_) | Connected::Camera(_) => {
            let asker = bench.asker()?;
            trouble.next([Fault::Late(bench.deadline() * 2)]);
            let _ = bench.run(asker.ask());
            std::thread::sleep(bench.deadline() * 2);
            works_again(bench, &asker)
        }
    }
}

/// A question is given up while its answer is under way, as the engine gives up a move to stop it.
pub(super) fn given_up(bench: &Bench) -> Result<(), String> {
    let Some(trouble) = bench.trouble() else { return Ok(()) };
    let connected = bench.connect()?;
    let asker = bench.asker_of(connected.clone())?;
    if let Connected::Axis(axis) = &connected {
        bench.bring(axis, 10.0)?;
    }
    trouble.next([Fault::Late(bench.deadline() / 2)]);
    if is_done_within(&mut pin!(asker.ask()), bench.deadline() / 4) {
        return Err("the answer was to come later".to_owned());
    }
    match &connected {
        Connected::Axis(axis) => {
            bench.run(axis.stop()).map_err(|error| format!("stop: {error}"))?;
            bench.bring(axis, 20.0)?;
            near(20.0, bench.run(axis.position()).map_err(|error| error.to_string())?.value)
        }
        Connected::Sensor(sensor) => {
            let probe = bench.probe.as_ref().ok_or("no probe")?;
            let found = bench.run(sensor.read()).map_err(|error| error.to_string())?;
            near(probe.value(probe.reads() - 1), found.value)
        }
        Connected::Laser(_) | Connected::Camera(_) => works_again(bench, &asker),
    }
}

/// Follows it for so long, in real time, and gives it up.
pub(super) fn is_done_within(future: &mut (impl Future + Unpin), time: Duration) -> bool {
    let mut context = Context::from_waker(Waker::noop());
    let end = Instant::now() + time;
    while Instant::now() < end {
        if future.poll_unpin(&mut context).is_ready() {
            return true;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    false
}

fn expect_timeout(result: Result<f64, InstrumentError>) -> Result<(), String> {
    match result {
        Err(InstrumentError::Timeout(_)) => Ok(()),
        other => Err(format!("expected a timeout, got {other:?}")),
    }
}

/// Within what any of these instruments rounds to.
pub(super) fn near(expected: f64, found: f64) -> Result<(), String> {
    if (expected - found).abs() <= 2e-3 {
        return Ok(());
    }
    Err(format!("expected {expected}, read {found}"))
}

pub(super) fn cut(bench: &Bench) -> Result<(), String> {
    let Some(trouble) = bench.trouble() else { return Ok(()) };
    let asker = bench.asker()?;
    trouble.cut();
    bench.pause();
    // The first call may find out, the next finds it mended.
    match bench.run(asker.ask()) {
        Ok(()) | Err(InstrumentError::Disconnected(_) | InstrumentError::Timeout(_)) => {}
        other => return Err(format!("expected a lost connection, got {other:?}")),
    }
    works_again(bench, &asker)
}

pub(super) fn unplugged(bench: &Bench) -> Result<(), String> {
    let Some(trouble) = bench.trouble() else { return Ok(()) };
    let asker = bench.asker()?;
    trouble.unplug(true);
    bench.pause();
    let mut last = Ok(());
    for _ in 0..3 {
        last = bench.run(asker.ask());
    }
    match last {
        Err(InstrumentError::Disconnected(why)) if !why.is_empty() => {}
        other => return Err(format!("expected a lost connection with a reason, got {other:?}")),
    }
    trouble.unplug(false);
    bench.pause();
    let _ = bench.run(asker.ask());
    works_again(bench, &asker)
}

pub(super) fn two_clients(bench: &Bench) -> Result<(), String> {
    let first = bench.asker()?;
    if bench.way == Way::Pty {
        // A serial port has one owner: the second says so.
        let second = super::bench::Asker::new(bench.connect()?);
        return match bench.run(second.ask()) {
            Err(InstrumentError::Disconnected(why)) if why.contains("another program") => {
                works_again(bench, &first)
            }
            other => Err(format!("a second owner of the port: {other:?}")),
        };
    }
    let second = match (bench.asker(), bench.way) {
        // A camera too may have one owner.
        (Err(why), Way::Own) if why.contains("another program") => {
            return works_again(bench, &first);
        }
        (second, _) => second?,
    };
    for _ in 0..5 {
        bench.run(first.ask()).map_err(|error| format!("the first: {error}"))?;
        bench.run(second.ask()).map_err(|error| format!("the second: {error}"))?;
    }
    Ok(())
}

pub(super) fn refusal(bench: &Bench) -> Result<(), String> {
    let Some(host) = bench.host() else { return Ok(()) };
    let connected = bench.connect()?;
    let asker = bench.asker_of(connected.clone())?;
    if !host.refuse_next() {
        return Ok(());
    }
    let result = match &connected {
        Connected::Axis(axis) if bench.driver.moved == Moved::ByMotor => {
            bench.run(axis.move_to(1.0))
        }
        Connected::Laser(laser) => bench.run(laser.emit()),
        _ => bench.run(asker.ask()),
    };
    match result {
        Err(InstrumentError::Refused(why) | InstrumentError::Fault(why)) if !why.is_empty() => {}
        other => return Err(format!("expected a refusal, got {other:?}")),
    }
    works_again(bench, &asker)
}
