//! The instruments of a run by their names in the rig, as what they can do.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::AtomicU32;

use beampose_core::{Axis, Camera, Instrument, InstrumentName, Laser, Sensor};
use beampose_plan::{Action, Step};

use crate::EngineError;
use crate::sight::Sight;

/// Instruments by name. An instrument of two abilities stands in two maps.
#[derive(Clone, Default)]
pub struct Bench {
    /// Rails and rotation stages.
    pub axes: BTreeMap<InstrumentName, Arc<dyn Axis>>,
    /// Laser sources.
    pub lasers: BTreeMap<InstrumentName, Arc<dyn Laser>>,
    /// Wavelength meters, thermometers.
    pub sensors: BTreeMap<InstrumentName, Arc<dyn Sensor>>,
    /// Cameras.
    pub cameras: BTreeMap<InstrumentName, Arc<dyn Camera>>,
    /// Who finds dots in pictures, for steps that go by them.
    pub sight: Option<Arc<dyn Sight>>,
    /// How far from its target an axis may read after a move, in its unit; not checked where it is
    /// not said.
    pub tolerances: BTreeMap<InstrumentName, f64>,
    /// The number of the step under way, 0 before the first: for simulated faults.
    pub under_way: Arc<AtomicU32>,
}

impl std::fmt::Debug for Bench {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Bench")
            .field("axes", &self.axes.keys())
            .field("lasers", &self.lasers.keys())
            .field("sensors", &self.sensors.keys())
            .field("cameras", &self.cameras.keys())
            .finish()
    }
}

/// Either that can be read: a sensor, or an axis by its encoder.
#[derive(Clone, Copy)]
pub(crate) enum Readable<'a> {
    Axis(&'a dyn Axis),
    Sensor(&'a dyn Sensor),
}

impl Bench {
    /// The axis of that name.
    ///
    /// # Errors
    /// [`EngineError::NoInstrument`].
    pub fn axis(&self, name: &InstrumentName) -> Result<&dyn Axis, EngineError> {
        look_up(&self.axes, name, "axis").map(|it| &**it)
    }

    /// The laser of that name.
    ///
    /// # Errors
    /// [`EngineError::NoInstrument`].
    pub fn laser(&self, name: &InstrumentName) -> Result<&dyn Laser, EngineError> {
        look_up(&self.lasers, name, "laser").map(|it| &**it)
    }

    /// The sensor of that name.
    ///
    /// # Errors
    /// [`EngineError::NoInstrument`].
    pub fn sensor(&self, name: &InstrumentName) -> Result<&dyn Sensor, EngineError> {
        look_up(&self.sensors, name, "sensor").map(|it| &**it)
    }

    /// The camera of that name.
    ///
    /// # Errors
    /// [`EngineError::NoInstrument`].
    pub fn camera(&self, name: &InstrumentName) -> Result<&dyn Camera, EngineError> {
        look_up(&self.cameras, name, "camera").map(|it| &**it)
    }

    pub(crate) fn readable(&self, name: &InstrumentName) -> Result<Readable<'_>, EngineError> {
        if let Some(axis) = self.axes.get(name) {
            return Ok(Readable::Axis(&**axis));
        }
        if let Some(sensor) = self.sensors.get(name) {
            return Ok(Readable::Sensor(&**sensor));
        }
        let known = self.axes.keys().chain(self.sensors.keys()).cloned().collect();
        Err(EngineError::NoInstrument { name: name.clone(), role: "sensor or axis", known })
    }

    /// Every instrument once, by name.
    pub(crate) fn instruments(&self) -> BTreeMap<&InstrumentName, &dyn Instrument> {
        let mut all: BTreeMap<&InstrumentName, &dyn Instrument> = BTreeMap::new();
        all.extend(self.axes.iter().map(|(name, it)| (name, &**it as &dyn Instrument)));
        all.extend(self.lasers.iter().map(|(name, it)| (name, &**it as &dyn Instrument)));
        all.extend(self.sensors.iter().map(|(name, it)| (name, &**it as &dyn Instrument)));
        all.extend(self.cameras.iter().map(|(name, it)| (name, &**it as &dyn Instrument)));
        all
    }

    /// Whether every instrument that `steps` need is here, so that a run does not find out midway.
    ///
    /// # Errors
    /// [`EngineError::NoInstrument`] for the first that is not.
    pub fn check(&self, steps: &[Step]) -> Result<(), EngineError> {
        for step in steps {
            match &step.action {
                Action::LaserOn { laser } | Action::LaserOff { laser } => {
                    self.laser(laser)?;
                }
                Action::Wait { .. } | Action::Prompt { .. } => {}
                Action::Move { axis, .. } => {
                    self.axis(axis)?;
                }
                Action::Align { axis, camera, .. } => {
                    self.axis(axis)?;
                    self.camera(camera)?;
                }
                Action::Read { instruments } => {
                    instruments.iter().try_for_each(|name| self.readable(name).map(drop))?;
                }
                Action::Capture { cameras, .. } => {
                    cameras.iter().try_for_each(|name| self.camera(name).map(drop))?;
                }
            }
        }
        Ok(())
    }
}

fn look_up<'a, T>(
    map: &'a BTreeMap<InstrumentName, T>,
    name: &InstrumentName,
    role: &'static str,
) -> Result<&'a T, EngineError> {
    map.get(name).ok_or_else(|| EngineError::NoInstrument {
        name: name.clone(),
        role,
        known: map.keys().cloned().collect(),
    })
}
