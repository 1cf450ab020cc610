//! Cameras together: armed, then released at one barrier.

use std::collections::BTreeMap;
use std::time::Duration;

use beampose_core::{
    Camera, CaptureId, CaptureRecord, EventKind, Frame, InstrumentError, InstrumentName, Picture,
    Quantity,
};
use beampose_plan::OnError;
use futures::future::join_all;

use super::{Doing, Fault};

/// How often a capture is taken whose triggers were too far apart.
const TIMES: u32 = 3;

type Cameras<'a> = BTreeMap<&'a InstrumentName, &'a dyn Camera>;

impl Doing<'_, '_> {
    /// All cameras are armed, then all are triggered together. Where one fails, what the others
    /// delivered is kept. Where the triggers went out too far apart, the capture is taken again.
    pub(super) async fn capture(
        &mut self,
        id: &CaptureId,
        names: &[InstrumentName],
    ) -> Result<(), Fault> {
        let bench = self.bench;
        let mut cameras = Cameras::new();
        for name in names {
            cameras.insert(name, bench.camera(name)?);
        }
        let mut times = 0;
        loop {
            times += 1;
            let mut faults = Vec::new();
            let armed = self.arm(&cameras, &mut faults).await;
            if !faults.is_empty() && self.step.policy.on_error != OnError::RecordMissing {
                return Err(Fault::Several(faults));
            }
            let pictures = self.release(&armed, &mut faults).await;
            let skew = skew(&pictures);
            if !pictures.is_empty() {
                self.acquired.capture = Some(self.capture_record(id, pictures));
            }
            if !faults.is_empty() || skew <= self.max_skew {
                return Fault::of_several(faults);
            }
            let limit = self.max_skew;
            if times == TIMES {
                return Err(Fault::Skew { skew, limit, times });
            }
            let message =
                format!("{id}: triggers went out {skew:?} apart, more than {limit:?}: taken again");
            self.journal.note(EventKind::Retried, message);
        }
    }

    /// The cameras that are ready for a trigger.
    async fn arm<'c>(&mut self, cameras: &Cameras<'c>, faults: &mut Vec<Fault>) -> Cameras<'c> {
        self.situation.armed.extend(cameras.keys().map(|name| (*name).clone()));
        let arming = cameras.iter().map(|(name, camera)| self.ask(name, camera.arm()));
        let answers = join_all(arming).await;
        let mut armed = Cameras::new();
        for ((name, camera), answer) in cameras.iter().zip(answers) {
            match answer {
                Ok(()) => {
                    armed.insert(name, *camera);
                }
                Err(fault) => faults.push(fault),
            }
        }
        armed
    }

    async fn release(&mut self, cameras: &Cameras<'_>, faults: &mut Vec<Fault>) -> Vec<Picture> {
        let triggers = cameras.iter().map(|(name, camera)| self.ask(name, camera.trigger()));
        let frames = join_all(triggers).await;
        let mut pictures = Vec::new();
        for (camera, frame) in cameras.keys().zip(frames) {
            match frame {
                Ok(frame) => {
                    self.situation.armed.remove(*camera);
                    if is_cut_off(&frame.bytes) {
                        let found = format!("{} bytes that end too early", frame.bytes.len());
                        let expected = "a whole picture".to_owned();
                        let source = InstrumentError::Garbled { expected, found };
                        faults.push(Fault::Instrument { name: (*camera).clone(), source });
                    }
                    // Half a picture is kept too: it is what there is.
                    pictures.push(picture(camera, frame));
                }
                Err(fault) => faults.push(fault),
            }
        }
        pictures
    }

    pub(super) fn capture_record(&self, id: &CaptureId, pictures: Vec<Picture>) -> CaptureRecord {
        let mut setpoints = self.step.context.clone();
        setpoints.extend(self.situation.setpoints.clone());
        let mut readings = by_name_and_quantity(&self.situation.sensed);
        readings.extend(self.situation.encoders.clone());
        CaptureRecord { id: id.clone(), setpoints, readings, pictures }
    }
}

/// What a capture keeps of sensors: each one's reading by its name, as encoders have it
/// (`thermometer_degc`), and by the quantity alone (`temperature_degc`) where no other sensor read it.
fn by_name_and_quantity(
    sensed: &BTreeMap<InstrumentName, (Quantity, f64)>,
) -> BTreeMap<String, f64> {
    let mut readings = BTreeMap::new();
    for (quantity, value) in sensed.values() {
        if sensed.values().filter(|(other, _)| other == quantity).count() == 1 {
            readings.insert(quantity.to_string(), *value);
        }
    }
    for (name, (quantity, value)) in sensed {
        readings.insert(format!("{name}_{}", quantity.suffix()), *value);
    }
    readings
}

/// How far apart the triggers of a capture were sent.
fn skew(pictures: &[Picture]) -> Duration {
    let sent = || pictures.iter().map(|picture| picture.requested.monotonic);
    match (sent().min(), sent().max()) {
        (Some(first), Some(last)) => last.saturating_sub(first),
        _ => Duration::ZERO,
    }
}

/// Whether a JPEG or PNG lacks its end. While the module still stands there, the picture can be
/// taken again.
pub(super) fn is_cut_off(bytes: &[u8]) -> bool {
    const END_OF_IMAGE: [u8; 2] = [0xff, 0xd9];
    const END_CHUNK: &[u8; 4] = b"IEND";
    // Some cameras fill up their last block.
    let tail = &bytes[bytes.len().saturating_sub(1024)..];
    if bytes.starts_with(&[0xff, 0xd8]) {
        return !tail.windows(2).any(|two| two == END_OF_IMAGE);
    }
    bytes.starts_with(b"\x89PNG") && !tail.windows(4).any(|four| four == END_CHUNK)
}

pub(super) fn picture(camera: &InstrumentName, frame: Frame) -> Picture {
    Picture {
        camera: camera.clone(),
        bytes: frame.bytes,
        requested: frame.requested,
        delivered: frame.delivered,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_sensors_of_one_quantity_are_told_apart() {
        let sensed = [
            ("diode", (Quantity::Temperature, 25.3)),
            ("room", (Quantity::Temperature, 21.5)),
            ("wavemeter", (Quantity::Wavelength, 658.02)),
        ];
        let sensed = sensed.map(|(name, read)| (InstrumentName::from(name), read)).into();
        let kept: Vec<(String, f64)> = by_name_and_quantity(&sensed).into_iter().collect();
        let expected = [
            ("diode_degc", 25.3),
            ("room_degc", 21.5),
            ("wavelength_nm", 658.02),
            ("wavemeter_nm", 658.02),
        ];
        // No temperature stands for both.
        assert_eq!(kept, expected.map(|(name, value)| (name.to_owned(), value)));
    }
}
