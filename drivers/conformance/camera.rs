//! What a camera must do.

use super::bench::Bench;
use crate::sim::TestShutter;

pub(super) fn pictures(bench: &Bench) -> Result<(), String> {
    let camera = bench.camera()?;
    for shot in 0..3 {
        bench.run(camera.arm()).map_err(|error| format!("arm: {error}"))?;
        let frame = bench.run(camera.trigger()).map_err(|error| error.to_string())?;
        if frame.bytes != TestShutter::picture(shot) {
            return Err(format!("picture {shot} is not that of its trigger"));
        }
        if frame.delivered < frame.requested {
            return Err("delivered before it was requested".to_owned());
        }
    }
    Ok(())
}

pub(super) fn lost(bench: &Bench) -> Result<(), String> {
    let camera = bench.camera()?;
    let shutter = bench.shutter.as_ref().ok_or("no shutter")?;
    bench.run(camera.trigger()).map_err(|error| error.to_string())?;
    bench.lose_next();
    if bench.run(camera.trigger()).is_ok() {
        return Err("a picture came although it was lost".to_owned());
    }
    let frame = bench.run(camera.trigger()).map_err(|error| format!("afterwards: {error}"))?;
    if frame.bytes != TestShutter::picture(shutter.shots() - 1) {
        return Err("the picture is not that of its own trigger".to_owned());
    }
    Ok(())
}

pub(super) fn disarms(bench: &Bench) -> Result<(), String> {
    let camera = bench.camera()?;
    bench.run(camera.arm()).map_err(|error| format!("arm: {error}"))?;
    bench.run(camera.disarm()).map_err(|error| format!("disarm: {error}"))?;
    bench.run(camera.trigger()).map(drop).map_err(|error| format!("afterwards: {error}"))
}
