//! What a sensor must do.

use super::bench::{Bench, role};
use super::line::near;
use crate::registry::Role;

pub(super) fn reads(bench: &Bench) -> Result<(), String> {
    let sensor = bench.sensor()?;
    let probe = bench.probe.as_ref().ok_or("no probe")?;
    let Role::Sensor { quantity, .. } = role(bench.driver) else { return Ok(()) };
    for _ in 0..4 {
        let reading = bench.run(sensor.read()).map_err(|error| error.to_string())?;
        if reading.quantity != quantity {
            return Err(format!("expected {quantity:?}, found {:?}", reading.quantity));
        }
        near(probe.value(probe.reads() - 1), reading.value)?;
    }
    Ok(())
}

pub(super) fn no_signal(bench: &Bench) -> Result<(), String> {
    let sensor = bench.sensor()?;
    let probe = bench.probe.as_ref().ok_or("no probe")?;
    bench.run(sensor.read()).map_err(|error| error.to_string())?;
    probe.lose_signal(true);
    if let Ok(reading) = bench.run(sensor.read()) {
        return Err(format!("nothing to read, and it reads {}", reading.value));
    }
    probe.lose_signal(false);
    bench.run(sensor.read()).map(drop).map_err(|error| format!("afterwards: {error}"))
}
