//! Pictures: what never changes is rendered once per camera, dots and noise once per picture.
//!
//! Signals are fixed-point grey levels with [`FRACTION_BITS`] fractional bits in 16 bits: up to
//! 1023 grey levels, so that what is brighter than white is clipped after the noise, as a sensor
//! does it. One picture is rendered by one thread; cameras are what runs in parallel.

mod background;
mod dots;
mod noise;
mod rays;
mod speckle;
mod targets;

use beampose_core::Emission;
use beampose_photogrammetry::GrayImage;

use crate::error::WorldError;
use crate::streams::Purpose;
use crate::world::{ImagedDot, ImagedTarget, ModuleState, World};

/// Fractional bits of a signal.
const FRACTION_BITS: u32 = 6;
/// One grey level as a signal.
const UNIT: f64 = (1 << FRACTION_BITS) as f64;

/// Background and targets, as signals, row by row.
#[derive(Debug)]
pub(crate) struct StaticLayer(Vec<u16>);

/// Where the dots are.
pub(crate) fn imaged_dots(world: &World, camera: usize, module: &ModuleState) -> Vec<ImagedDot> {
    let view = &world.cameras[camera].view;
    let (width, height) = (view.camera.width as f64, view.camera.height as f64);
    let inside = |dot: &ImagedDot| {
        let at = dot.pixel;
        at.x > -0.5 && at.y > -0.5 && at.x < width - 0.5 && at.y < height - 0.5
    };
    dots::spots(world, camera, module).iter().map(dots::Spot::imaged).filter(inside).collect()
}

/// Where the targets are.
pub(crate) fn imaged_targets(world: &World, camera: usize) -> Vec<ImagedTarget> {
    let view = &world.cameras[camera].view;
    let (width, height) = (view.camera.width as f64, view.camera.height as f64);
    let imaged = |target: targets::PlacedTarget| {
        let pixel = target.image(view)?;
        let inside = pixel.x > 0.0 && pixel.y > 0.0 && pixel.x < width && pixel.y < height;
        inside.then_some(ImagedTarget { code: target.code, pixel })
    };
    targets::placed(world).filter_map(imaged).collect()
}

/// One picture.
pub(crate) fn render(
    world: &World,
    camera: usize,
    module: &ModuleState,
    capture: u64,
) -> GrayImage {
    let placed = &world.cameras[camera];
    let (width, height) = (placed.view.camera.width, placed.view.camera.height);
    let layer = placed.layer.get_or_init(|| static_layer(world, camera));
    let patches = match module.emission {
        Emission::On => dots::patches(world, camera, module, capture),
        Emission::Off | Emission::Unknown => Vec::new(),
    };
    let rng = world.streams.picture(Purpose::PixelNoise, camera, capture, 0);
    let noise = noise::Noise::new(&world.config.picture, rng);
    let mut data = vec![0; width * height];
    let mut signal = vec![0; width];
    for (y, out) in data.chunks_exact_mut(width).enumerate() {
        signal.copy_from_slice(&layer.0[y * width..(y + 1) * width]);
        for patch in &patches {
            patch.add_to_row(y, &mut signal);
        }
        noise.expose(y, &signal, out);
    }
    GrayImage { width, height, data }
}

/// A picture as a JPEG file.
pub(crate) fn jpeg(image: &GrayImage, quality: u8) -> Result<Vec<u8>, WorldError> {
    let failed = |reason: &dyn std::fmt::Display| WorldError::Encode(reason.to_string());
    let width = u16::try_from(image.width).map_err(|e| failed(&e))?;
    let height = u16::try_from(image.height).map_err(|e| failed(&e))?;
    let mut bytes = Vec::with_capacity(image.data.len() / 3);
    jpeg_encoder::Encoder::new(&mut bytes, quality)
        .encode(&image.data, width, height, jpeg_encoder::ColorType::Luma)
        .map_err(|e| failed(&e))?;
    Ok(bytes)
}

fn static_layer(world: &World, camera: usize) -> StaticLayer {
    let view = &world.cameras[camera].view;
    let mut layer = background::layer(&view.camera, &world.config.picture);
    for target in targets::placed(world) {
        targets::paint(&mut layer, view, &world.config.picture, &target);
    }
    StaticLayer(layer)
}

/// A signal from grey levels.
fn to_signal(grey: f64) -> u16 {
    (grey * UNIT).round().clamp(0.0, f64::from(u16::MAX)) as u16
}
