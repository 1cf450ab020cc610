//! Instruments that fail as told.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use async_trait::async_trait;
use beampose_core::instrument::{AxisUnit, ByHand};
use beampose_core::{
    Axis, Camera, Emission, Frame, Identity, Instrument, InstrumentError, Interlock, Laser,
    Reading, Sensor,
};

use super::{FaultKind, Faults};

/// How far off a wrong encoder reads, in the axis' unit.
const READS_OFF: f64 = 5.0;
/// How far an axis overshoots, in its unit.
const OVERSHOOT: f64 = 1.0;
/// How far a wavelength hops: a mode of a diode's cavity, nm.
const HOP_NM: f64 = 0.3;

macro_rules! faulty {
    ($(#[$doc:meta])* $name:ident, $role:ident $(, $field:ident: $ty:ty)*) => {
        $(#[$doc])*
        pub struct $name {
            inner: Arc<dyn $role>,
            name: String,
            faults: Arc<Faults>,
            $($field: $ty,)*
        }

        impl $name {
            /// The instrument, with the faults of this name.
            #[must_use]
            pub fn new(inner: Arc<dyn $role>, name: &str, faults: Arc<Faults>) -> Self {
                Self { inner, name: name.to_owned(), faults, $($field: Default::default(),)* }
            }

            fn strikes(&self, kind: FaultKind) -> bool {
                self.faults.strikes(&self.name, &[kind]).is_some()
            }
        }

        #[async_trait]
        impl Instrument for $name {
            async fn identify(&self) -> Result<Identity, InstrumentError> {
                self.faults.line(&self.name).await?;
                self.inner.identify().await
            }
        }
    };
}

faulty!(
    /// An axis with faults.
    FaultyAxis, Axis
);
faulty!(
    /// A laser with faults.
    FaultyLaser, Laser
);
faulty!(
    /// A sensor with faults.
    FaultySensor, Sensor
);
faulty!(
    /// A camera with faults.
    FaultyCamera, Camera, hangs: AtomicBool
);

#[async_trait]
impl Axis for FaultyAxis {
    async fn move_to(&self, target: f64) -> Result<(), InstrumentError> {
        self.faults.line(&self.name).await?;
        if self.strikes(FaultKind::Stall) {
            // It sets off, and something holds it.
            let _begun = futures::FutureExt::now_or_never(self.inner.move_to(target));
            self.inner.stop().await?;
            return std::future::pending().await;
        }
        let beyond = if self.strikes(FaultKind::Overshoot) { OVERSHOOT } else { 0.0 };
        match self.inner.move_to(target + beyond).await {
            // Against the end of its travel it overshoots to the other side.
            Err(InstrumentError::Refused(_)) if beyond > 0.0 => {
                self.inner.move_to(target - beyond).await
            }
            ended => ended,
        }
    }

    async fn position(&self) -> Result<Reading, InstrumentError> {
        self.faults.line(&self.name).await?;
        let mut reading = self.inner.position().await?;
        if self.strikes(FaultKind::WrongReadback) {
            reading.value += READS_OFF;
        }
        Ok(reading)
    }

    async fn stop(&self) -> Result<(), InstrumentError> {
        self.faults.line(&self.name).await?;
        self.inner.stop().await
    }

    fn unit(&self) -> AxisUnit {
        self.inner.unit()
    }

    fn by_hand(&self) -> Option<ByHand> {
        self.inner.by_hand()
    }
}

impl FaultyLaser {
    /// Whether the interlock is open now; light goes out by itself then.
    fn is_open(&self) -> bool {
        let open = self.strikes(FaultKind::InterlockTrip);
        if open {
            self.inner.off_without_waiting();
        }
        open
    }
}

#[async_trait]
impl Laser for FaultyLaser {
    async fn emit(&self) -> Result<(), InstrumentError> {
        self.faults.line(&self.name).await?;
        if self.is_open() {
            return Err(InstrumentError::Refused("the interlock is open (simulated)".to_owned()));
        }
        self.inner.emit().await
    }

    async fn off(&self) -> Result<(), InstrumentError> {
        self.faults.line(&self.name).await?;
        self.inner.off().await
    }

    async fn emission(&self) -> Emission {
        if self.faults.line(&self.name).await.is_err() {
            return Emission::Unknown;
        }
        self.is_open();
        if self.strikes(FaultKind::WrongReadback) {
            return Emission::On;
        }
        self.inner.emission().await
    }

    fn off_without_waiting(&self) {
        self.inner.off_without_waiting();
    }

    fn interlock(&self) -> Option<&dyn Interlock> {
        Some(self)
    }
}

#[async_trait]
impl Interlock for FaultyLaser {
    async fn is_closed(&self) -> Result<bool, InstrumentError> {
        self.faults.line(&self.name).await?;
        Ok(!self.is_open())
    }
}

#[async_trait]
impl Sensor for FaultySensor {
    async fn read(&self) -> Result<Reading, InstrumentError> {
        self.faults.line(&self.name).await?;
        let mut reading = self.inner.read().await?;
        if self.strikes(FaultKind::WrongReadback) {
            reading.value = f64::NAN;
        }
        if self.strikes(FaultKind::WavelengthHop) {
            reading.value += HOP_NM;
        }
        Ok(reading)
    }
}

#[async_trait]
impl Camera for FaultyCamera {
    async fn arm(&self) -> Result<(), InstrumentError> {
        self.hung().await;
        self.inner.arm().await
    }

    async fn trigger(&self) -> Result<Frame, InstrumentError> {
        self.hung().await;
        self.faults.line(&self.name).await?;
        if self.strikes(FaultKind::CameraHangs) {
            self.hangs.store(true, Ordering::Relaxed);
            self.hung().await;
        }
        let mut frame = self.inner.trigger().await?;
        if self.strikes(FaultKind::DroppedFrame) {
            return Err(InstrumentError::Fault("a picture was dropped (simulated)".to_owned()));
        }
        if self.strikes(FaultKind::TruncatedFrame) {
            frame.bytes.truncate(frame.bytes.len() / 2);
        }
        if self.strikes(FaultKind::BlackFrame) {
            frame.bytes = black(&frame.bytes)?;
        }
        Ok(frame)
    }

    async fn disarm(&self) -> Result<(), InstrumentError> {
        // What hangs is woken by the reset that goes with it.
        self.hangs.store(false, Ordering::Relaxed);
        self.inner.disarm().await
    }
}

impl FaultyCamera {
    async fn hung(&self) {
        if self.hangs.load(Ordering::Relaxed) {
            std::future::pending::<()>().await;
        }
    }
}

/// A black picture of the same size.
fn black(jpeg: &[u8]) -> Result<Vec<u8>, InstrumentError> {
    let lost = |error: String| InstrumentError::Fault(error);
    let image = beampose_photogrammetry::decode(jpeg).map_err(|error| lost(error.to_string()))?;
    let (Ok(width), Ok(height)) = (u16::try_from(image.width), u16::try_from(image.height)) else {
        return Err(lost("no JPEG is that large".to_owned()));
    };
    let mut bytes = Vec::new();
    let pixels = vec![0; usize::from(width) * usize::from(height)];
    jpeg_encoder::Encoder::new(&mut bytes, 90)
        .encode(&pixels, width, height, jpeg_encoder::ColorType::Luma)
        .map_err(|error| lost(error.to_string()))?;
    Ok(bytes)
}
