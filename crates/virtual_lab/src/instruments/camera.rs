//! A camera: a trigger takes delay, exposure and readout on the clock; the picture is rendered on
//! rayon meanwhile, so cameras that are triggered together render in parallel.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use async_trait::async_trait;
use beampose_core::units::Second;
use beampose_core::{Camera, Clock, Frame, Identity, Instrument, InstrumentError};
use futures::channel::oneshot;

use super::identity;
use crate::config::CameraConfig;
use crate::error::WorldError;
use crate::world::World;

/// One camera of the world.
pub struct SimulatedCamera {
    world: Arc<World>,
    clock: Arc<dyn Clock>,
    name: String,
    config: CameraConfig,
    /// Triggers so far: the number that chooses noise and speckle.
    triggers: AtomicU64,
}

impl SimulatedCamera {
    /// The world's camera of this name.
    ///
    /// # Errors
    /// [`WorldError::UnknownCamera`].
    pub fn new(world: Arc<World>, clock: Arc<dyn Clock>, name: &str) -> Result<Self, WorldError> {
        let unknown = || WorldError::UnknownCamera(name.to_owned());
        let config = *world.config.cameras.get(name).ok_or_else(unknown)?;
        let earlier = world.history().triggers.get(name).copied();
        let triggers = AtomicU64::new(earlier.unwrap_or(0));
        Ok(Self { world, clock, name: name.to_owned(), config, triggers })
    }

    /// What the camera would photograph if it were triggered now, as the bytes of a JPEG file: for a
    /// simulator of its bytes. Takes no time of the clock.
    ///
    /// # Errors
    /// As [`World::render_jpeg`].
    pub fn photograph(&self) -> Result<Vec<u8>, WorldError> {
        let capture = self.triggers.fetch_add(1, Ordering::SeqCst);
        let middle = Second(self.config.trigger_delay_s + self.config.exposure_s / 2.0).duration();
        let module = self.world.module_at(self.clock.now().monotonic.saturating_add(middle));
        self.world.render_jpeg(&self.name, &module, capture)
    }

    /// Renders, on another thread, what the camera sees now.
    fn expose(&self) -> oneshot::Receiver<Result<Vec<u8>, WorldError>> {
        let capture = self.triggers.fetch_add(1, Ordering::SeqCst);
        let middle = Second(self.config.exposure_s / 2.0).duration();
        let module = self.world.module_at(self.clock.now().monotonic.saturating_add(middle));
        let (send, receive) = oneshot::channel();
        let (world, name) = (self.world.clone(), self.name.clone());
        rayon::spawn(move || {
            // Nobody listens if the trigger was given up: then the picture is not wanted.
            let _ = send.send(world.render_jpeg(&name, &module, capture));
        });
        receive
    }
}

#[async_trait]
impl Instrument for SimulatedCamera {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        let serial = Some(self.name.clone());
        Ok(Identity { serial, ..identity("camera") })
    }
}

#[async_trait]
impl Camera for SimulatedCamera {
    async fn arm(&self) -> Result<(), InstrumentError> {
        Ok(())
    }

    async fn trigger(&self) -> Result<Frame, InstrumentError> {
        let requested = self.clock.now();
        self.clock.sleep(Second(self.config.trigger_delay_s).duration()).await;
        let picture = self.expose();
        let busy = Second(self.config.exposure_s + self.config.readout_s);
        self.clock.sleep(busy.duration()).await;
        let delivered = self.clock.now();
        let rendered = {
            let _clock_stands_still = self.clock.external();
            picture.await
        };
        let lost = || InstrumentError::Fault("the picture was lost while rendering".to_owned());
        let bytes = rendered
            .map_err(|_| lost())?
            .map_err(|error| InstrumentError::Fault(error.to_string()))?;
        Ok(Frame { bytes, requested, delivered })
    }
}
