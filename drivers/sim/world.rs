//! The world as a simulator sees it: what it moves, switches and reads. The virtual lab's
//! instruments are handed in as these, or the simple ones of [`super::bench`] in tests.

use std::sync::Arc;
use std::time::Duration;

/// A stage: takes its time, and has an encoder.
pub trait Stage: Send + Sync {
    /// Sets off to `target`, in millimetres or degrees.
    ///
    /// # Errors
    /// Why it does not, where it would leave its limits.
    fn go(&self, target: f64) -> Result<(), String>;
    /// Whether it is on its way.
    fn is_moving(&self) -> bool;
    /// Reads the encoder once, in millimetres or degrees. Each reading has its own noise.
    fn encoder(&self) -> f64;
    /// Stops where it is.
    fn stop(&self);
    /// Between which places it can move.
    fn limits(&self) -> [f64; 2];
}

/// A laser diode with its temperature control.
pub trait Diode: Send + Sync {
    /// Current on or off. The light may come later.
    fn switch(&self, on: bool);
    /// Current on and light at once, for controllers that have no delay of their own. A diode that
    /// knows no difference lights after its delay.
    fn strike(&self) {
        self.switch(true);
    }
    /// Whether the current is switched on.
    fn is_on(&self) -> bool;
    /// Whether light comes out: on, and the delay is over. Light of a diode that is not on is a
    /// fault to be found: current flows past the switch.
    fn emits(&self) -> bool;
    /// From on to light.
    fn delay(&self) -> Duration;
    /// Whether the safety contact is closed.
    fn interlock_closed(&self) -> bool;
    /// Temperature of the diode, degrees Celsius.
    fn temperature_degc(&self) -> f64;
}

/// Something that can be read.
pub trait Probe: Send + Sync {
    /// One reading, in the quantity's unit.
    ///
    /// # Errors
    /// Why there is none: no light to measure.
    fn read(&self) -> Result<f64, String>;
}

/// A camera.
pub trait Shutter: Send + Sync {
    /// What it sees now, as the bytes of a JPEG file.
    ///
    /// # Errors
    /// Why there is no picture.
    fn expose(&self) -> Result<Vec<u8>, String>;
}

/// What an instrument is in the world.
#[derive(Clone)]
pub enum Part {
    /// A rail or a rotation stage.
    Stage(Arc<dyn Stage>),
    /// A laser.
    Diode(Arc<dyn Diode>),
    /// A sensor.
    Probe(Arc<dyn Probe>),
    /// A camera.
    Shutter(Arc<dyn Shutter>),
}

impl Part {
    /// As a stage.
    ///
    /// # Errors
    /// For people, where it is none.
    pub fn stage(&self) -> Result<Arc<dyn Stage>, String> {
        if let Self::Stage(it) = self { Ok(it.clone()) } else { Err(wrong("a stage")) }
    }

    /// As a laser diode.
    ///
    /// # Errors
    /// For people, where it is none.
    pub fn diode(&self) -> Result<Arc<dyn Diode>, String> {
        if let Self::Diode(it) = self { Ok(it.clone()) } else { Err(wrong("a laser diode")) }
    }

    /// As something to read.
    ///
    /// # Errors
    /// For people, where it is none.
    pub fn probe(&self) -> Result<Arc<dyn Probe>, String> {
        if let Self::Probe(it) = self { Ok(it.clone()) } else { Err(wrong("something to read")) }
    }

    /// As a camera.
    ///
    /// # Errors
    /// For people, where it is none.
    pub fn shutter(&self) -> Result<Arc<dyn Shutter>, String> {
        if let Self::Shutter(it) = self { Ok(it.clone()) } else { Err(wrong("a camera")) }
    }
}

fn wrong(what: &str) -> String {
    format!("the simulator needs {what} of the simulated world")
}
