//! An axis turned until a dot stands at its pixel.

use beampose_core::instrument::AxisUnit;
use beampose_core::{Axis, Camera, EventKind, InstrumentName, Look, Picture, Reading};
use beampose_plan::Action;

use super::capture::{is_cut_off, picture};
use super::{Doing, Fault, suffix};
use crate::closing_in::{ClosingIn, Goal, Next};
use crate::sight::Sight;

/// The instruments of a closing-in.
struct Eyes<'a> {
    axis: (&'a InstrumentName, &'a dyn Axis),
    unit: AxisUnit,
    camera: (&'a InstrumentName, &'a dyn Camera),
    sight: &'a dyn Sight,
}

/// What one look gave.
struct Seen {
    read: Reading,
    picture: Picture,
    spots: Vec<[f64; 2]>,
}

impl Doing<'_, '_> {
    /// Moves, looks and moves again. The last picture is kept, and the encoder's reading where the
    /// dot stands at its pixel.
    pub(super) async fn align(&mut self) -> Result<(), Fault> {
        let step = self.step;
        let Action::Align {
            id,
            axis: name,
            unit,
            camera,
            dot,
            target_px,
            tolerance_px,
            moves,
            px_per_unit,
            zero,
            within,
            sense,
        } = &step.action
        else {
            return Ok(());
        };
        let bench = self.bench;
        let Some(sight) = bench.sight.as_deref() else {
            return Err(Fault::Align("nobody can find dots in pictures here".to_owned()));
        };
        let axis = bench.axis(name)?;
        if axis.unit() != *unit {
            let (name, found) = (name.clone(), axis.unit());
            return Err(Fault::WrongUnit { name, planned: *unit, found });
        }
        let eyes = Eyes {
            axis: (name, axis),
            unit: *unit,
            camera: (camera, bench.camera(camera)?),
            sight,
        };
        let off_zero = |dot: [i32; 2]| {
            let [m, n] = dot;
            let none = || Fault::Align(format!("the pattern has no beam {m} {n}"));
            sight.off_zero_deg(dot).ok_or_else(none)
        };
        let expected = match self.situation.aligned.get(name) {
            Some((other, read)) => read + sense * (off_zero(*dot)? - off_zero(*other)?),
            None => zero + sense * off_zero(*dot)?,
        };
        let mut closing_in = ClosingIn::new(Goal {
            target_px: *target_px,
            tolerance_px: *tolerance_px,
            px_per_unit: *px_per_unit,
            expected,
            within: *within,
            moves: *moves,
        });
        let mut to = closing_in.start();
        loop {
            let seen = self.move_and_look(&eyes, to).await?;
            let next = closing_in.look(to, seen.read.value, &seen.spots);
            let (at, read) = (seen.picture.delivered, seen.read.value);
            let look = Look { at, commanded: to, read, dot_px: closing_in.dot_px() };
            self.acquired.looks.push(look);
            let goes_on = matches!(next, Next::MoveTo(_));
            if !goes_on {
                self.acquired.capture = Some(self.capture_record(id, vec![seen.picture]));
            }
            match next {
                Next::MoveTo(next) => to = next,
                Next::GiveUp(why) => return Err(Fault::Align(why)),
                Next::There { dot_px: [x, y], off_px } => {
                    let message = format!(
                        "{name} at {read:.5} {}: {} at {x:.2}, {y:.2} px, {off_px:+.3} px off, \
                         after {} moves (step {})",
                        suffix(*unit),
                        step.action,
                        closing_in.moves(),
                        step.number
                    );
                    self.journal.note(EventKind::Moved, message);
                    self.situation.have_read(name, &seen.read);
                    self.situation.aligned.insert(name.clone(), (*dot, read));
                    self.acquired.readings.push((name.clone(), seen.read));
                    return Ok(());
                }
            }
        }
    }

    async fn move_and_look(&mut self, eyes: &Eyes<'_>, to: f64) -> Result<Seen, Fault> {
        let ((name, axis), (camera_name, camera)) = (eyes.axis, eyes.camera);
        self.situation.moved(name, to, eyes.unit);
        self.situation.moving.insert(name.clone());
        self.ask(name, axis.move_to(to)).await?;
        self.situation.moving.remove(name);
        let read = self.look(name).await?;
        self.situation.armed.insert(camera_name.clone());
        self.ask(camera_name, camera.arm()).await?;
        let frame = self.ask(camera_name, camera.trigger()).await?;
        self.situation.armed.remove(camera_name);
        if is_cut_off(&frame.bytes) {
            let found = format!("{} bytes that end too early", frame.bytes.len());
            return Err(Fault::Align(format!("{camera_name}: {found}")));
        }
        let picture = picture(camera_name, frame);
        let spots = eyes.sight.spots(camera_name, &picture.bytes);
        let spots = spots.map_err(|why| Fault::Align(format!("{camera_name}: {why}")))?;
        Ok(Seen { read, picture, spots })
    }
}
