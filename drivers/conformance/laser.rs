//! What a laser must do: the rules of [`crate::laser`], seen from the world.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use beampose_core::{Clock, Emission, InstrumentError};
use futures::future::{join, select};

use super::bench::{Bench, role};
use crate::laser::SHORTEST_DELAY;
use crate::registry::Role;
use crate::sim::{Diode, TestDiode};

fn diode(bench: &Bench) -> Result<&Arc<TestDiode>, String> {
    bench.diode.as_ref().ok_or_else(|| "no diode".to_owned())
}

fn in_words(error: InstrumentError) -> String {
    error.to_string()
}

pub(super) fn off_at_connect(bench: &Bench) -> Result<(), String> {
    let diode = diode(bench)?;
    diode.switch(true);
    let laser = bench.laser()?;
    bench.run(laser.identify()).map_err(in_words)?;
    if diode.is_on() {
        return Err("connected, and it is still on".to_owned());
    }
    expect(Emission::Off, bench.run(laser.emission()))
}

fn expect(expected: Emission, found: Emission) -> Result<(), String> {
    if expected == found { Ok(()) } else { Err(format!("expected {expected:?}, found {found:?}")) }
}

pub(super) fn on_and_off(bench: &Bench) -> Result<(), String> {
    let (laser, diode) = (bench.laser()?, diode(bench)?);
    for _ in 0..2 {
        bench.run(laser.emit()).map_err(in_words)?;
        if !diode.emits() {
            return Err("emit returned, and there is no light".to_owned());
        }
        expect(Emission::On, bench.run(laser.emission()))?;
        bench.run(laser.off()).map_err(in_words)?;
        if diode.is_on() {
            return Err("off returned, and it is on".to_owned());
        }
        expect(Emission::Off, bench.run(laser.emission()))?;
    }
    Ok(())
}

/// With a rig file that says no delay, too.
pub(super) fn delay(bench: &Bench) -> Result<(), String> {
    let no_delay = match role(bench.driver) {
        Role::Laser { current_ma, .. } => {
            Role::Laser { current_ma, emission_delay: Duration::ZERO }
        }
        other => other,
    };
    let (laser, diode) = (bench.laser_as(no_delay)?, diode(bench)?);
    bench.run(laser.identify()).map_err(in_words)?;
    let start = bench.clock.now().monotonic;
    let watch = async {
        bench.clock.sleep(SHORTEST_DELAY - Duration::from_millis(20)).await;
        diode.emits()
    };
    let (lit, early) = bench.run(join(laser.emit(), watch));
    lit.map_err(in_words)?;
    let took = bench.clock.now().monotonic - start;
    if early || took < SHORTEST_DELAY {
        return Err(format!("light before its delay; emit took {took:?}"));
    }
    Ok(())
}

pub(super) fn interlock(bench: &Bench) -> Result<(), String> {
    let (laser, diode) = (bench.laser()?, diode(bench)?);
    let contact = laser.interlock().ok_or("it has no interlock")?;
    diode.interlock_open.store(true, Ordering::SeqCst);
    if bench.run(contact.is_closed()).map_err(in_words)? {
        return Err("open reads as closed".to_owned());
    }
    refused(bench.run(laser.emit()))?;
    diode.interlock_open.store(false, Ordering::SeqCst);
    refused(bench.run(laser.emit())).map_err(|why| format!("closed again: {why}"))?;
    if diode.is_on() {
        return Err("it is on although it refused".to_owned());
    }
    bench.run(laser.off()).map_err(in_words)?;
    bench.run(laser.emit()).map_err(|error| format!("after off: {error}"))?;
    // Opened while it emits.
    diode.interlock_open.store(true, Ordering::SeqCst);
    bench.run(laser.emission());
    if !bench.soon(|| !diode.is_on()) {
        return Err("its interlock opened, was polled, and it still emits".to_owned());
    }
    diode.interlock_open.store(false, Ordering::SeqCst);
    refused(bench.run(laser.emit())).map_err(|why| format!("after it opened: {why}"))
}

/// Open for a moment while light is to come.
pub(super) fn interlock_meanwhile(bench: &Bench) -> Result<(), String> {
    let (laser, diode) = (bench.laser()?, diode(bench)?);
    let moment = async {
        bench.clock.sleep(Duration::from_secs(1)).await;
        diode.interlock_open.store(true, Ordering::SeqCst);
        bench.clock.sleep(Duration::from_millis(500)).await;
        diode.interlock_open.store(false, Ordering::SeqCst);
    };
    let (lit, ()) = bench.run(join(laser.emit(), moment));
    refused(lit)?;
    if diode.is_on() {
        return Err("it is on although its contact was open".to_owned());
    }
    refused(bench.run(laser.emit())).map_err(|why| format!("closed again: {why}"))?;
    bench.run(laser.off()).map_err(in_words)?;
    bench.run(laser.emit()).map_err(|error| format!("after off: {error}"))
}

pub(super) fn temperature(bench: &Bench) -> Result<(), String> {
    // Whose driver has no say in the temperature has no such option.
    if bench.driver.options.iter().all(|spec| spec.name != "temperature_tolerance") {
        return Ok(());
    }
    let (laser, diode) = (bench.laser()?, diode(bench)?);
    bench.run(laser.identify()).map_err(in_words)?;
    diode.warm_to(31.0);
    refused(bench.run(laser.emit()))?;
    if diode.is_on() {
        return Err("it is on although it refused".to_owned());
    }
    diode.warm_to(25.0);
    bench.run(laser.emit()).map_err(|error| format!("at its temperature again: {error}"))
}

fn refused(result: Result<(), InstrumentError>) -> Result<(), String> {
    match result {
        Err(InstrumentError::Refused(_)) => Ok(()),
        other => Err(format!("expected a refusal, got {other:?}")),
    }
}

pub(super) fn stuck(bench: &Bench) -> Result<(), String> {
    let (laser, diode) = (bench.laser()?, diode(bench)?);
    bench.run(laser.emit()).map_err(in_words)?;
    diode.stuck.store(true, Ordering::SeqCst);
    match bench.run(laser.off()) {
        Err(InstrumentError::Fault(why)) if why.contains("assume on") => {}
        other => return Err(format!("expected a fault, got {other:?}")),
    }
    match bench.run(laser.emission()) {
        Emission::Off => Err("it burns and reads as off".to_owned()),
        _ => Ok(()),
    }
}

/// Its output says off, and current flows.
pub(super) fn leaking(bench: &Bench) -> Result<(), String> {
    let (laser, diode) = (bench.laser()?, diode(bench)?);
    bench.run(laser.emit()).map_err(in_words)?;
    diode.leaks.store(true, Ordering::SeqCst);
    match bench.run(laser.off()) {
        Err(InstrumentError::Fault(why)) if why.contains("assume on") => {}
        other => return Err(format!("expected a fault, got {other:?}")),
    }
    match bench.run(laser.emission()) {
        Emission::Off => Err("current flows, and it reads as off".to_owned()),
        _ => Ok(()),
    }
}

/// Somebody switches on at the front panel.
pub(super) fn uncommanded(bench: &Bench) -> Result<(), String> {
    let (laser, diode) = (bench.laser()?, diode(bench)?);
    bench.run(laser.identify()).map_err(in_words)?;
    diode.switch(true);
    if bench.run(laser.emission()) == Emission::Off {
        return Err("it is on and reads as off".to_owned());
    }
    if !bench.soon(|| !diode.is_on()) {
        return Err("on without a command, seen, and left on".to_owned());
    }
    diode.switch(true);
    match bench.run(laser.emit()) {
        Err(InstrumentError::Fault(why)) if !why.is_empty() => {}
        other => return Err(format!("expected a fault, got {other:?}")),
    }
    if diode.is_on() { Err("it is on although it refused".to_owned()) } else { Ok(()) }
}

/// Dropped while it emits, and given up while it is to emit.
pub(super) fn dropped(bench: &Bench) -> Result<(), String> {
    let (laser, diode) = (bench.laser()?, diode(bench)?);
    let given_up = bench.clock.sleep(Duration::from_secs(1));
    drop(bench.run(select(Box::pin(laser.emit()), given_up)));
    bench.soon(|| !diode.is_on());
    bench.run(bench.clock.sleep(Duration::from_secs(10)));
    if diode.is_on() {
        return Err("emit was given up half-way, and it is on".to_owned());
    }
    bench.run(laser.off()).map_err(in_words)?;
    bench.run(laser.emit()).map_err(in_words)?;
    drop(laser);
    if !bench.soon(|| !diode.is_on()) {
        Err("nobody holds it any more, and it is on".to_owned())
    } else {
        Ok(())
    }
}

pub(super) fn lost(bench: &Bench) -> Result<(), String> {
    let (laser, diode) = (bench.laser()?, diode(bench)?);
    let Some(trouble) = bench.trouble() else { return Ok(()) };
    bench.run(laser.emit()).map_err(in_words)?;
    trouble.unplug(true);
    bench.pause();
    expect(Emission::Unknown, bench.run(laser.emission()))?;
    if bench.run(laser.off()).is_ok() {
        return Err("off over a pulled cable succeeded".to_owned());
    }
    trouble.unplug(false);
    bench.pause();
    bench.run(laser.emission());
    expect(Emission::Off, bench.run(laser.emission()))?;
    if diode.is_on() {
        return Err("connected again, and it is still on".to_owned());
    }
    Ok(())
}

pub(super) fn reboot(bench: &Bench) -> Result<(), String> {
    let Some(host) = bench.host() else { return Ok(()) };
    let (laser, diode) = (bench.laser()?, diode(bench)?);
    bench.run(laser.emit()).map_err(in_words)?;
    host.reboot();
    bench.pause();
    bench.run(laser.emission());
    expect(Emission::Off, bench.run(laser.emission()))?;
    if diode.is_on() { Err("it is on after a reboot".to_owned()) } else { Ok(()) }
}

pub(super) fn above_limit(bench: &Bench) -> Result<(), String> {
    let emission_delay = Duration::from_secs(3);
    for current_ma in [Some(1e5), None] {
        // A serial port has one owner.
        let bench = Bench::new(bench.driver, bench.way)?;
        let laser = bench.laser_as(Role::Laser { current_ma, emission_delay })?;
        refused(bench.run(laser.emit())).map_err(|why| format!("{current_ma:?} mA: {why}"))?;
        if diode(&bench)?.is_on() {
            return Err("it is on although it refused".to_owned());
        }
    }
    Ok(())
}

pub(super) fn last_resort(bench: &Bench) -> Result<(), String> {
    let (laser, diode) = (bench.laser()?, diode(bench)?);
    bench.run(laser.emit()).map_err(in_words)?;
    laser.off_without_waiting();
    if !bench.soon(|| !diode.is_on()) {
        return Err("it is still on".to_owned());
    }
    // During the delay too: the device's own command must not be waited for.
    bench.run(laser.off()).map_err(in_words)?;
    let cry = async {
        bench.clock.sleep(Duration::from_secs(1)).await;
        laser.off_without_waiting();
    };
    let (lit, ()) = bench.run(join(laser.emit(), cry));
    if lit.is_ok() || !bench.soon(|| !diode.is_on()) {
        return Err("off during the delay, and it is on".to_owned());
    }
    Ok(())
}
