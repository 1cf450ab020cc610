//! Ring-coded targets on their labels, painted once into a camera's static layer.
//!
//! Each pixel is divided into [`SUB`] x [`SUB`] samples that are mapped back to the label's plane
//! through the true distortion; a sample near an edge takes the part of it that is inked. Point
//! spread and pixel area are then one convolution on the finer grid, symmetric about the pixel's
//! centre, so that edges are where they are projected.

use beampose_photogrammetry::Camera;
use beampose_photogrammetry::scene::{RING_BITS, canonical_code, ring_sectors};
use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};

use super::background::Illumination;
use super::rays::RayPatch;
use super::{UNIT, to_signal};
use crate::config::{PictureConfig, Polarity, TargetConfig};
use crate::geometry::{View, plane_axes};
use crate::world::World;

/// Samples per pixel and axis.
const SUB: usize = 6;
/// Half the side of the label, in radii of the centre disc.
const LABEL: f64 = 3.6;
/// Side of the patches within which rays are interpolated, pixels.
const TILE: usize = 32;

/// A target where it truly is.
pub(super) struct PlacedTarget {
    pub(super) code: u16,
    centre: Vector3<f64>,
    /// Columns: right, up (turned with the target), normal.
    axes: Matrix3<f64>,
    radius: f64,
    sectors: [bool; RING_BITS as usize],
    polarity: Polarity,
}

/// The targets of a world, where they truly are.
pub(super) fn placed(world: &World) -> impl Iterator<Item = PlacedTarget> {
    world.config.targets.iter().zip(&world.truth.targets).map(|(config, truth)| PlacedTarget {
        code: canonical_code(config.code),
        centre: Vector3::from(truth.xyz_mm),
        axes: turned_axes(config),
        radius: config.radius_mm,
        sectors: ring_sectors(config.code),
        polarity: config.polarity,
    })
}

fn turned_axes(config: &TargetConfig) -> Matrix3<f64> {
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), config.turn_deg.to_radians());
    plane_axes(&Vector3::from(config.normal)) * turn.into_inner()
}

impl PlacedTarget {
    fn world_point(&self, right: f64, up: f64) -> Vector3<f64> {
        self.centre + self.axes * Vector3::new(right, up, 0.0)
    }

    /// The image of the centre, pixels; `None` where the camera does not see the front.
    pub(super) fn image(&self, view: &View) -> Option<Vector2<f64>> {
        let facing = self.axes.column(2).dot(&(view.position - self.centre)) > 0.0;
        if facing { view.project(&self.centre) } else { None }
    }

    /// From normalised image coordinates (x, y, 1) to the label's plane, homogeneous.
    fn plane_from_image(&self, view: &View) -> Option<Matrix3<f64>> {
        let to_camera = view.world_from_camera.inverse().to_rotation_matrix().into_inner();
        let mut plane = self.axes;
        plane.set_column(2, &(self.centre - view.position));
        (to_camera * plane).try_inverse()
    }

    /// Part of a sample that the label covers, and part of the sample that is inked.
    /// `per_mm`: samples per millimetre.
    fn sample(&self, at: Vector2<f64>, per_mm: f64) -> (f32, f32) {
        let inside = |distance: f64| (0.5 + distance * per_mm).clamp(0.0, 1.0);
        let r = self.radius;
        let label = inside(LABEL * r - at.x.abs().max(at.y.abs()));
        if label == 0.0 {
            return (0.0, 0.0);
        }
        let distance = at.norm();
        let ring = inside(distance - 2.0 * r) * inside(3.0 * r - distance);
        let ring = if ring > 0.0 && self.sector(at) { ring } else { 0.0 };
        (label as f32, (inside(r - distance) + ring) as f32)
    }

    /// The bit of the sector that holds a point: clockwise from the target's own top.
    fn sector(&self, at: Vector2<f64>) -> bool {
        let clockwise = at.x.atan2(at.y).rem_euclid(std::f64::consts::TAU);
        let sector = clockwise / std::f64::consts::TAU * f64::from(RING_BITS);
        self.sectors[(sector as usize).min(RING_BITS as usize - 1)]
    }
}

/// A rectangle of pixels with its fine samples: label cover and ink.
struct Canvas {
    x: i64,
    y: i64,
    width: usize,
    height: usize,
    samples: Vec<(f32, f32)>,
}

/// Paints one target over a static layer.
pub(super) fn paint(
    layer: &mut [u16],
    view: &View,
    picture: &PictureConfig,
    target: &PlacedTarget,
) {
    let kernel = kernel(picture.psf_sigma_px);
    let margin = (kernel.len() / SUB / 2 + 1) as i64;
    let Some(mut canvas) = canvas(view, target, margin) else { return };
    if canvas.fill(view, target).is_none() {
        return;
    }
    let covered = canvas.blurred(&kernel);
    let light = Illumination::new(&view.camera, picture);
    let (white, black) = (picture.white_grey, picture.black_grey);
    let (paper, ink) = match target.polarity {
        Polarity::DarkOnLight => (white, black),
        Polarity::LightOnDark => (black, white),
    };
    for (i, &(label, inked)) in covered.iter().enumerate() {
        let (x, y) = (canvas.x + (i % canvas.width) as i64, canvas.y + (i / canvas.width) as i64);
        let Some(pixel) = layer_index(&view.camera, x, y).and_then(|at| layer.get_mut(at)) else {
            continue;
        };
        let (label, inked) = (f64::from(label), f64::from(inked));
        let grey = (paper * (label - inked) + ink * inked) * light.room(x as f64, y as f64);
        *pixel = to_signal(f64::from(*pixel) / UNIT * (1.0 - label) + grey);
    }
}

fn layer_index(camera: &Camera, x: i64, y: i64) -> Option<usize> {
    let (x, y) = (usize::try_from(x).ok()?, usize::try_from(y).ok()?);
    (x < camera.width && y < camera.height).then_some(y * camera.width + x)
}

/// The rectangle around a label's image, `margin` pixels wider; `None` if the picture has none of
/// it.
fn canvas(view: &View, target: &PlacedTarget, margin: i64) -> Option<Canvas> {
    target.image(view)?;
    let half = LABEL * target.radius;
    let mut low = Vector2::repeat(f64::INFINITY);
    let mut high = -low;
    for (right, up) in [(-half, -half), (half, -half), (half, half), (-half, half)] {
        let corner = view.project(&target.world_point(right, up))?;
        (low, high) = (low.inf(&corner), high.sup(&corner));
    }
    let range = |low: f64, high: f64, size: usize| {
        let first = (low.floor() as i64 - margin).max(-margin);
        let last = (high.ceil() as i64 + margin).min(size as i64 - 1 + margin);
        usize::try_from(last - first + 1).ok().map(|count| (first, count))
    };
    let (x, width) = range(low.x, high.x, view.camera.width)?;
    let (y, height) = range(low.y, high.y, view.camera.height)?;
    let samples = vec![(0.0, 0.0); width * height * SUB * SUB];
    (!samples.is_empty()).then_some(Canvas { x, y, width, height, samples })
}

impl Canvas {
    /// Takes all samples, tile by tile. `None` where the lens has no inverse.
    fn fill(&mut self, view: &View, target: &PlacedTarget) -> Option<()> {
        let plane_from_image = target.plane_from_image(view)?;
        let per_mm = SUB as f64 * pixels_per_mm(view, target)?;
        for ty in (0..self.height).step_by(TILE) {
            for tx in (0..self.width).step_by(TILE) {
                let low = Vector2::new((self.x + tx as i64) as f64, (self.y + ty as i64) as f64);
                let size = Vector2::new(self.width - tx, self.height - ty).map(|n| n.min(TILE));
                let high = low + size.map(|n| n as f64);
                let rays =
                    RayPatch::new(&view.camera, low.add_scalar(-0.5), high.add_scalar(-0.5))?;
                let columns = tx * SUB..(tx + TILE).min(self.width) * SUB;
                for sy in ty * SUB..(ty + TILE).min(self.height) * SUB {
                    let row = rays.row(sample_place(self.y, sy));
                    let line = &mut self.samples[sy * self.width * SUB..];
                    for sx in columns.clone() {
                        let n = row.at(sample_place(self.x, sx));
                        let h = plane_from_image * n.push(1.0);
                        line[sx] = target.sample(h.xy() / h.z, per_mm);
                    }
                }
            }
        }
        Some(())
    }

    /// Pixels from samples: the kernel along rows, then along columns.
    fn blurred(&self, kernel: &[f32]) -> Vec<(f32, f32)> {
        let fine = self.width * SUB;
        let rows: Vec<(f32, f32)> = (0..self.height * SUB)
            .flat_map(|y| {
                let line = &self.samples[y * fine..(y + 1) * fine];
                (0..self.width).map(move |x| weighted(kernel, x, |i| line.get(i)))
            })
            .collect();
        (0..self.height * self.width)
            .map(|i| {
                let (x, y) = (i % self.width, i / self.width);
                weighted(kernel, y, |j| rows.get(j * self.width + x))
            })
            .collect()
    }
}

/// The kernel's sum about pixel `pixel`; samples outside count as bare wall.
fn weighted<'a>(
    kernel: &[f32],
    pixel: usize,
    sample: impl Fn(usize) -> Option<&'a (f32, f32)>,
) -> (f32, f32) {
    let margin = (kernel.len() - SUB) / 2;
    let first = kernel.len().min(margin.saturating_sub(pixel * SUB));
    kernel.iter().enumerate().skip(first).fold((0.0, 0.0), |sum, (k, &weight)| {
        let (label, ink) = sample(pixel * SUB + k - margin).copied().unwrap_or_default();
        (sum.0 + weight * label, sum.1 + weight * ink)
    })
}

/// Pixel coordinate of a fine sample, counted from the canvas' first pixel.
fn sample_place(origin: i64, index: usize) -> f64 {
    origin as f64 - 0.5 + (index as f64 + 0.5) / SUB as f64
}

/// Scale of the image at a target's centre, square root of the areas' ratio.
fn pixels_per_mm(view: &View, target: &PlacedTarget) -> Option<f64> {
    let step = target.radius / 10.0;
    let at = |right: f64, up: f64| view.project(&target.world_point(right, up));
    let (right, up) = (at(step, 0.0)? - at(-step, 0.0)?, at(0.0, step)? - at(0.0, -step)?);
    Some(right.perp(&up).abs().sqrt() / (2.0 * step))
}

/// Weights of the fine samples about one pixel: its own area, spread by the lens. Symmetric; the
/// sum is one.
fn kernel(psf_sigma_px: f64) -> Vec<f32> {
    let sigma = psf_sigma_px * SUB as f64;
    let margin = (4.0 * sigma).ceil() as usize;
    let spread = |distance: f64| {
        if sigma > 0.0 {
            (-distance * distance / (2.0 * sigma * sigma)).exp()
        } else {
            f64::from(u8::from(distance == 0.0))
        }
    };
    let weight =
        |k: usize| -> f64 { (margin..margin + SUB).map(|own| spread(k as f64 - own as f64)).sum() };
    let weights: Vec<f64> = (0..SUB + 2 * margin).map(weight).collect();
    let sum: f64 = weights.iter().sum();
    weights.into_iter().map(|w| (w / sum) as f32).collect()
}
