//! The bare wall: a smooth gradient of the illumination under the lens' loss of light.

use beampose_photogrammetry::Camera;

use super::to_signal;
use crate::config::PictureConfig;

/// How light falls off over a picture.
pub(super) struct Illumination {
    centre: [f64; 2],
    /// One over half the width and half the height.
    inverse_half: [f64; 2],
    gradient: [f64; 2],
    /// Vignetting over the squared normalised radius, 2 in the corners.
    vignetting: f64,
}

impl Illumination {
    pub(super) fn new(camera: &Camera, picture: &PictureConfig) -> Self {
        let half = [camera.width as f64 / 2.0, camera.height as f64 / 2.0];
        Self {
            centre: half.map(|h| h - 0.5),
            inverse_half: half.map(|h| 1.0 / h),
            gradient: picture.gradient_relative,
            vignetting: picture.vignetting_relative / 2.0,
        }
    }

    fn normalised(&self, x: f64, y: f64) -> (f64, f64) {
        ((x - self.centre[0]) * self.inverse_half[0], (y - self.centre[1]) * self.inverse_half[1])
    }

    /// What the lens lets through at a pixel: 1 in the middle.
    pub(super) fn lens(&self, x: f64, y: f64) -> f64 {
        let (u, v) = self.normalised(x, y);
        (1.0 - self.vignetting * (u * u + v * v)).max(0.0)
    }

    /// Room light at a pixel, lens included: 1 in the middle.
    pub(super) fn room(&self, x: f64, y: f64) -> f64 {
        let (u, v) = self.normalised(x, y);
        (1.0 + self.gradient[0] * u + self.gradient[1] * v).max(0.0) * self.lens(x, y)
    }
}

/// The bare wall's signal, row by row.
pub(super) fn layer(camera: &Camera, picture: &PictureConfig) -> Vec<u16> {
    let light = Illumination::new(camera, picture);
    let mut layer = Vec::with_capacity(camera.width * camera.height);
    for y in 0..camera.height {
        let pixel = |x: usize| to_signal(picture.background_grey * light.room(x as f64, y as f64));
        layer.extend((0..camera.width).map(pixel));
    }
    layer
}
