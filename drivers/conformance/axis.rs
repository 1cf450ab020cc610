//! What a rail or a rotation stage must do.

use std::time::Duration;

use beampose_core::{Clock, InstrumentError};
use futures::future::{join, select};

use super::bench::{Bench, role};
use super::line::{is_done_within, near};
use crate::registry::{Moved, Role};
use crate::sim::{Fault, Stage};

pub(super) fn moves(bench: &Bench) -> Result<(), String> {
    let axis = bench.axis()?;
    let stage = bench.stage.as_ref().ok_or("no stage")?;
    for target in [12.5, 80.0, 3.25, 0.0] {
        bench.bring(&axis, target)?;
        near(target, stage.encoder()).map_err(|why| format!("where it stands: {why}"))?;
        let read = bench.run(axis.position()).map_err(|error| error.to_string())?;
        near(target, read.value)?;
    }
    Ok(())
}

pub(super) fn unit(bench: &Bench) -> Result<(), String> {
    let Role::Axis { unit, .. } = role(bench.driver) else { return Ok(()) };
    let axis = bench.axis()?;
    if axis.unit() != unit {
        return Err(format!("expected {unit:?}, found {:?}", axis.unit()));
    }
    Ok(())
}

pub(super) fn limits(bench: &Bench) -> Result<(), String> {
    let axis = bench.axis()?;
    let stage = bench.stage.as_ref().ok_or("no stage")?;
    bench.bring(&axis, 5.0)?;
    for target in [-1000.0, 1000.0, f64::NAN] {
        match bench.run(axis.move_to(target)) {
            Err(InstrumentError::Refused(_)) => near(5.0, stage.encoder())?,
            other => return Err(format!("to {target}: {other:?}")),
        }
    }
    Ok(())
}

pub(super) fn by_hand(bench: &Bench) -> Result<(), String> {
    if bench.driver.moved == Moved::ByMotor {
        return Ok(());
    }
    let axis = bench.axis()?;
    let stage = bench.stage.as_ref().ok_or("no stage")?;
    bench.bring(&axis, 5.0)?;
    let before = bench.clock.now().monotonic;
    bench.run(axis.move_to(80.0)).map_err(|error| format!("a move: {error}"))?;
    bench.run(axis.stop()).map_err(|error| format!("stop: {error}"))?;
    if stage.is_moving() || bench.clock.now().monotonic != before {
        return Err("a person moves it, and it moved or waited itself".to_owned());
    }
    near(5.0, bench.run(axis.position()).map_err(|error| error.to_string())?.value)?;
    // Read on its way, as the engine does while somebody pushes it.
    stage.go(80.0)?;
    bench.run(bench.clock.sleep(Duration::from_millis(500)));
    let read = bench.run(axis.position()).map_err(|error| error.to_string())?.value;
    near(stage.encoder(), read)
}

pub(super) fn stops(bench: &Bench) -> Result<(), String> {
    if bench.driver.moved == Moved::ByHand {
        return Ok(());
    }
    let axis = bench.axis()?;
    bench.run(axis.move_to(0.0)).map_err(|error| error.to_string())?;
    let stop = async {
        bench.clock.sleep(Duration::from_secs(1)).await;
        axis.stop().await
    };
    let (moved, stopped) = bench.run(join(axis.move_to(80.0), stop));
    stopped.map_err(|error| format!("stop: {error}"))?;
    if moved.is_ok() {
        return Err("the move that was stopped ended as if it had arrived".to_owned());
    }
    let at = bench.run(axis.position()).map_err(|error| error.to_string())?.value;
    if !(5.0..75.0).contains(&at) {
        return Err(format!("it stands at {at}, which is not on the way"));
    }
    bench.run(axis.move_to(10.0)).map_err(|error| format!("afterwards: {error}"))?;
    near(10.0, bench.run(axis.position()).map_err(|error| error.to_string())?.value)
}

/// An answer is waited for that does not come, and stop is on its way before that is given up.
pub(super) fn stops_at_once(bench: &Bench) -> Result<(), String> {
    let (Some(trouble), Moved::ByMotor) = (bench.trouble(), bench.driver.moved) else {
        return Ok(());
    };
    let axis = bench.axis()?;
    let stage = bench.stage.as_ref().ok_or("no stage")?;
    bench.run(axis.move_to(0.0)).map_err(|error| error.to_string())?;
    bench.run(select(axis.move_to(80.0), bench.clock.sleep(Duration::from_secs(1))));
    if !stage.is_moving() {
        return Err("it does not move one second after it was told to".to_owned());
    }
    trouble.next([Fault::Silent]);
    let (mut question, mut stop) = (axis.position(), axis.stop());
    if is_done_within(&mut question, bench.deadline() / 4) {
        return Err("the answer was not to come".to_owned());
    }
    is_done_within(&mut stop, bench.deadline() / 4);
    if stage.is_moving() {
        return Err("somebody waits for an answer, and stop waits too".to_owned());
    }
    drop((question, stop));
    trouble.forget();
    bench.run(axis.stop()).map_err(|error| format!("stop: {error}"))?;
    let at = bench.run(axis.position()).map_err(|error| error.to_string())?.value;
    near(stage.encoder(), at)
}

pub(super) fn cut_on_the_way(bench: &Bench) -> Result<(), String> {
    let Some(trouble) = bench.trouble() else { return Ok(()) };
    if bench.driver.moved == Moved::ByHand {
        return Ok(());
    }
    let axis = bench.axis()?;
    bench.run(axis.move_to(0.0)).map_err(|error| error.to_string())?;
    let pull = async {
        bench.clock.sleep(Duration::from_millis(700)).await;
        trouble.unplug(true);
        // Real time: the host notices.
        bench.pause();
    };
    let (moved, ()) = bench.run(join(axis.move_to(80.0), pull));
    match moved {
        Err(InstrumentError::Disconnected(_) | InstrumentError::Timeout(_)) => {}
        other => return Err(format!("expected a lost connection, got {other:?}")),
    }
    trouble.unplug(false);
    bench.pause();
    let _ = bench.run(axis.position());
    bench.run(axis.stop()).map_err(|error| format!("stop afterwards: {error}"))?;
    bench.run(axis.move_to(10.0)).map_err(|error| format!("afterwards: {error}"))
}

pub(super) fn reboot(bench: &Bench) -> Result<(), String> {
    let Some(host) = bench.host() else { return Ok(()) };
    let axis = bench.axis()?;
    bench.run(axis.move_to(5.0)).map_err(|error| error.to_string())?;
    host.reboot();
    bench.pause();
    let _ = bench.run(axis.position());
    let Some(homing) = axis.homing() else {
        return bench.run(axis.move_to(10.0)).map_err(|error| format!("afterwards: {error}"));
    };
    if bench.run(homing.is_homed()).map_err(|error| error.to_string())? {
        return Err("it says that it is homed after a reboot".to_owned());
    }
    match bench.run(axis.move_to(10.0)) {
        Err(InstrumentError::Refused(_)) => {}
        other => return Err(format!("a move without reference: {other:?}")),
    }
    bench.run(homing.home()).map_err(|error| format!("homing: {error}"))?;
    // Again: some controllers take that only after a reset, which is the driver's affair.
    bench.run(homing.home()).map_err(|error| format!("homing again: {error}"))?;
    if !bench.run(homing.is_homed()).map_err(|error| error.to_string())? {
        return Err("it does not say that it is homed after homing".to_owned());
    }
    bench.run(axis.move_to(10.0)).map_err(|error| format!("afterwards: {error}"))
}
