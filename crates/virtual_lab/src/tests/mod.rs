//! Behaviour of the whole world: pictures, instruments, draws.

mod dots;
mod draws;
mod instruments;
mod pictures;
mod targets;

use crate::config::{ErrorDraw, SpeckleConfig};
use crate::{World, WorldConfig};

/// The laboratory with pictures a quarter as wide and high.
fn small() -> WorldConfig {
    WorldConfig { picture_scale: 0.25, ..WorldConfig::laboratory() }
}

/// Without speckle, noise or uneven light, and as declared.
fn clean(mut config: WorldConfig) -> WorldConfig {
    config.errors = ErrorDraw::Nominal;
    config.picture.speckle = SpeckleConfig { contrast: 0.0, grain_px: 1.0 };
    config.picture.photon_noise_grey = 0.0;
    config.picture.read_noise_grey = 0.0;
    config.picture.gradient_relative = [0.0, 0.0];
    config.picture.vignetting_relative = 0.0;
    config
}

fn world(config: WorldConfig, seed: u64) -> World {
    World::new(config, seed).unwrap()
}
