//! Rail and rotation stage: they take their time, and their encoders err a little.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use async_trait::async_trait;
use beampose_core::instrument::{AxisUnit, ByHand};
use beampose_core::units::Second;
use beampose_core::{Axis, Clock, Identity, Instrument, InstrumentError, Quantity, Reading};

use super::identity;
use crate::config::StageConfig;
use crate::error::WorldError;
use crate::motion::Motion;
use crate::stage::encoder_reading;
use crate::streams::{Purpose, normal};
use crate::world::{Live, World};

/// What a rail and a rotation stage have in common.
struct Stage {
    world: Arc<World>,
    clock: Arc<dyn Clock>,
    config: StageConfig,
    kind: Kind,
    reads: AtomicU64,
}

#[derive(Clone, Copy)]
enum Kind {
    Rail,
    Rotation,
}

impl Kind {
    fn motion(self, live: &mut Live) -> &mut Motion {
        match self {
            Self::Rail => &mut live.rail,
            Self::Rotation => &mut live.rotation,
        }
    }

    const fn unit(self) -> AxisUnit {
        match self {
            Self::Rail => AxisUnit::Millimetre,
            Self::Rotation => AxisUnit::Degree,
        }
    }

    const fn symbol(self) -> &'static str {
        match self {
            Self::Rail => "mm",
            Self::Rotation => "deg",
        }
    }
}

impl Stage {
    fn within_limits(&self, target: f64) -> Result<(), InstrumentError> {
        let ([low, high], unit) = (self.config.limits, self.kind.symbol());
        if !(low..=high).contains(&target) {
            let reason = format!("{target} {unit} is outside {low} to {high} {unit}");
            return Err(InstrumentError::Refused(reason));
        }
        Ok(())
    }

    async fn move_to(&self, target: f64) -> Result<(), InstrumentError> {
        self.within_limits(target)?;
        let unit = self.kind.symbol();
        let (command, arrival) = self.set_off(target);
        let travel = arrival.saturating_sub(self.clock.now().monotonic);
        self.clock.sleep(travel + Second(self.config.settle_s).duration()).await;
        let commands = self.kind.motion(&mut self.world.live()).commands();
        if commands == command {
            Ok(())
        } else {
            Err(InstrumentError::Refused(format!("stopped on the way to {target} {unit}")))
        }
    }

    /// Starts a move; returns its number and when it will arrive.
    fn set_off(&self, target: f64) -> (usize, std::time::Duration) {
        let now = self.clock.now().monotonic;
        let purpose = match self.kind {
            Kind::Rail => Purpose::RailStop,
            Kind::Rotation => Purpose::RotationStop,
        };
        let mut live = self.world.live();
        let motion = self.kind.motion(&mut live);
        let mut rng = self.world.streams.item(purpose, motion.commands() as u64);
        let drive = target + self.config.positioning_sigma * normal(&mut rng);
        // The table follows where the play is taken up.
        let play = self.config.lost_motion / 2.0;
        let stop_at = motion.at(now).clamp(drive - play, drive + play);
        let arrival = motion.go(now, stop_at, self.config.speed_per_s);
        (motion.commands(), arrival)
    }

    fn position(&self) -> Reading {
        let at = self.clock.now();
        let (purpose, quantity) = match self.kind {
            Kind::Rail => (Purpose::RailEncoder, Quantity::Position),
            Kind::Rotation => (Purpose::RotationEncoder, Quantity::Angle),
        };
        let read = self.reads.fetch_add(1, Ordering::SeqCst);
        let noise = normal(&mut self.world.streams.item(purpose, read));
        let place = self.kind.motion(&mut self.world.live()).at(at.monotonic);
        let phase = match self.kind {
            Kind::Rail => 0.0,
            Kind::Rotation => self.world.truth.turntable.graduation_phase_rad,
        };
        let value = encoder_reading(&self.config, place, phase, noise);
        // The declared uncertainty is the rig's to add.
        Reading { quantity, value, standard_uncertainty: None, at }
    }

    fn stop(&self) {
        let now = self.clock.now().monotonic;
        self.kind.motion(&mut self.world.live()).stop(now);
    }
}

macro_rules! stage {
    ($(#[$doc:meta])* $name:ident, $kind:ident, $field:ident, $called:literal) => {
        $(#[$doc])*
        pub struct $name(Stage);

        impl $name {
            /// The world's own stage of this kind.
            ///
            /// # Errors
            /// [`WorldError::NoStage`] where the world has none.
            pub fn new(world: Arc<World>, clock: Arc<dyn Clock>) -> Result<Self, WorldError> {
                let config = world.config.$field.ok_or(WorldError::NoStage($called))?.stage;
                let reads = AtomicU64::new(world.history().$field.reads);
                Ok(Self(Stage { world, clock, config, kind: Kind::$kind, reads }))
            }
        }

        /// The stage alone, without a driver's waiting: what a simulator of its bytes moves.
        impl $name {
            /// Sets off and does not wait.
            ///
            /// # Errors
            /// [`InstrumentError::Refused`] beyond its limits.
            pub fn set_off(&self, target: f64) -> Result<(), InstrumentError> {
                self.0.within_limits(target)?;
                self.0.set_off(target);
                Ok(())
            }

            /// Whether it is on its way.
            #[must_use]
            pub fn is_moving(&self) -> bool {
                let now = self.0.clock.now().monotonic;
                self.0.kind.motion(&mut self.0.world.live()).is_under_way(now)
            }

            /// One reading of its encoder, in its unit.
            #[must_use]
            pub fn encoder(&self) -> f64 {
                self.0.position().value
            }

            /// Stops it where it is.
            pub fn halt(&self) {
                self.0.stop();
            }

            /// Between which places it can move, in its unit.
            #[must_use]
            pub const fn limits(&self) -> [f64; 2] {
                self.0.config.limits
            }
        }

        #[async_trait]
        impl Instrument for $name {
            async fn identify(&self) -> Result<Identity, InstrumentError> {
                Ok(identity($called))
            }
        }

        #[async_trait]
        impl Axis for $name {
            async fn move_to(&self, target: f64) -> Result<(), InstrumentError> {
                self.0.move_to(target).await
            }

            async fn position(&self) -> Result<Reading, InstrumentError> {
                Ok(self.0.position())
            }

            async fn stop(&self) -> Result<(), InstrumentError> {
                self.0.stop();
                Ok(())
            }

            fn unit(&self) -> AxisUnit {
                self.0.kind.unit()
            }
        }
    };
}

stage!(
    /// The rail, mm.
    SimulatedRail, Rail, rail, "rail"
);
stage!(
    /// The rotation stage, degrees.
    SimulatedRotation, Rotation, rotation, "rotation stage"
);

/// A stage that somebody moves: told where to, the simulated person sets off at the stage's speed,
/// and nobody waits for them here.
pub struct HandMoved {
    stage: Arc<dyn Axis>,
    by_hand: ByHand,
}

impl HandMoved {
    /// The stage, without its motor.
    #[must_use]
    pub fn new(stage: Arc<dyn Axis>, by_hand: ByHand) -> Self {
        Self { stage, by_hand }
    }
}

#[async_trait]
impl Instrument for HandMoved {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        self.stage.identify().await
    }
}

#[async_trait]
impl Axis for HandMoved {
    async fn move_to(&self, target: f64) -> Result<(), InstrumentError> {
        // The first poll sets the stage off; where it is then follows from the clock.
        futures::FutureExt::now_or_never(self.stage.move_to(target)).unwrap_or(Ok(()))
    }

    async fn position(&self) -> Result<Reading, InstrumentError> {
        self.stage.position().await
    }

    async fn stop(&self) -> Result<(), InstrumentError> {
        self.stage.stop().await
    }

    fn unit(&self) -> AxisUnit {
        self.stage.unit()
    }

    fn by_hand(&self) -> Option<ByHand> {
        Some(self.by_hand)
    }
}
