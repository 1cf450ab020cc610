//! Laser dots: Gaussian beams where they meet the walls, as the camera sees them.
//!
//! Each pixel is mapped through the true distortion to the nearest wall, and the irradiance there
//! follows from its distance from the beam's axis: the oblique footprint and its perspective image
//! come out by themselves. The lens' point spread and the pixel's area widen the footprint by their
//! second moments. The beam's width is taken as constant over one footprint.

use beampose_photogrammetry::{Beam, Order};
use nalgebra::{Matrix2, Matrix3x2, Vector2, Vector3};

use super::background::Illumination;
use super::rays::RayPatch;
use super::{UNIT, speckle};
use crate::config::{BeamConfig, PictureConfig};
use crate::geometry::View;
use crate::room::{Hit, Lit};
use crate::streams::Purpose;
use crate::world::{ImagedDot, ModuleState, World};

/// One beam's dot in one camera.
pub(super) struct Spot {
    /// The beam's place in the pattern.
    index: usize,
    order: Order,
    /// A point of the beam, as it reaches the wall.
    origin: Vector3<f64>,
    /// Unit vector along the beam there, and two across it.
    axis: Vector3<f64>,
    across: Matrix3x2<f64>,
    /// Inverse covariance in the plane across the beam, point spread included.
    form: Matrix2<f64>,
    /// Cosine of incidence that the amplitude holds for.
    cosine: f64,
    pixel: Vector2<f64>,
    image_covariance: Matrix2<f64>,
    amplitude_grey: f64,
}

/// Light of one dot, as signals.
pub(super) struct Patch {
    x: usize,
    y: usize,
    width: usize,
    signal: Vec<u16>,
}

impl Patch {
    /// Adds what falls on row `y` of the picture.
    pub(super) fn add_to_row(&self, y: usize, row: &mut [u16]) {
        let Some(line) = y.checked_sub(self.y).and_then(|i| self.signal.chunks(self.width).nth(i))
        else {
            return;
        };
        for (to, &light) in row[self.x..].iter_mut().zip(line) {
            *to = to.saturating_add(light);
        }
    }
}

/// The dots that a camera may see, whether inside its picture or beside it.
pub(super) fn spots(world: &World, camera: usize, module: &ModuleState) -> Vec<Spot> {
    let view = &world.cameras[camera].view;
    let light = Illumination::new(&view.camera, &world.config.picture);
    let mut spots = Vec::new();
    for (index, beam) in world.true_beams(module.wavelength_nm).into_iter().enumerate() {
        spots.extend(spot(world, view, module, (index, beam)).map(|mut spot| {
            spot.amplitude_grey *= light.lens(spot.pixel.x, spot.pixel.y);
            spot
        }));
    }
    spots
}

/// The light of all dots that fall into a picture.
pub(super) fn patches(
    world: &World,
    camera: usize,
    module: &ModuleState,
    capture: u64,
) -> Vec<Patch> {
    let speckle = &world.config.picture.speckle;
    let patch = |spot: &Spot| {
        let mut rng = world.streams.picture(Purpose::Speckle, camera, capture, spot.index);
        let grain = |width, height| {
            (speckle.contrast > 0.0).then(|| speckle::field(speckle, width, height, &mut rng))
        };
        spot.patch(world, &world.cameras[camera].view, grain)
    };
    spots(world, camera, module).iter().filter_map(patch).collect()
}

/// 1/e^2 radius at a distance, mm: a beam whose waist is at the module.
fn radius_mm(beam: &BeamConfig, distance: f64) -> f64 {
    f64::hypot(beam.diameter_mm / 2.0, beam.divergence_mrad / 2000.0 * distance)
}

fn spot(
    world: &World,
    view: &View,
    module: &ModuleState,
    (index, beam): (usize, Beam),
) -> Option<Spot> {
    let sent = module.world_from_module * beam.direction;
    let Lit { hit, origin, along: axis } = world.room.lit(&module.position, &sent)?;
    let from_camera = hit.point - view.position;
    let lit_side = hit.normal.dot(&axis) * hit.normal.dot(&from_camera) > 0.0;
    let hidden = world.room.seen(&view.position, &from_camera)?.distance < 1.0 - 1e-6;
    if !lit_side || hidden {
        return None;
    }
    let aside = if axis.y.abs() < 0.9 { Vector3::y() } else { Vector3::x() };
    let right = aside.cross(&axis).normalize();
    let across = Matrix3x2::from_columns(&[right, axis.cross(&right)]);
    let pixel = view.project(&hit.point)?;
    let jacobian = pixel_by_across(view, &hit, &axis, &across)?;
    let radius = radius_mm(&world.config.beam, hit.distance);
    let sharp = jacobian * jacobian.transpose() * (radius * radius / 4.0);
    let image_covariance = sharp + Matrix2::identity() * spread(&world.config.picture);
    let form = jacobian.transpose() * image_covariance.try_inverse()? * jacobian;
    let cosine = hit.normal.dot(&axis).abs();
    let dimmed = (sharp.determinant() / image_covariance.determinant()).sqrt();
    let amplitude_grey = peak_grey(world, beam.order, radius) * cosine * dimmed;
    Some(Spot {
        index,
        order: beam.order,
        origin,
        axis,
        across,
        form,
        cosine,
        pixel,
        image_covariance,
        amplitude_grey,
    })
}

/// Variance of point spread and pixel area per axis, square pixels.
fn spread(picture: &PictureConfig) -> f64 {
    picture.psf_sigma_px * picture.psf_sigma_px + 1.0 / 12.0
}

/// Peak of a dot of 1/e^2 radius `radius` at perpendicular incidence: the same power on a larger
/// spot.
fn peak_grey(world: &World, order: Order, radius: f64) -> f64 {
    let beam = &world.config.beam;
    let reference = radius_mm(beam, beam.peak_distance_mm);
    let zero_order = world.truth.pattern.zero_order_relative_intensity.unwrap_or(1.0);
    let bright = if order == (Order { m: 0, n: 0 }) { zero_order } else { 1.0 };
    beam.peak_grey * bright * (reference / radius).powi(2)
}

/// d pixel / d (coordinates across the beam) where the beam meets the wall: a point across the
/// beam slides along it until it is on the wall.
fn pixel_by_across(
    view: &View,
    hit: &Hit,
    axis: &Vector3<f64>,
    across: &Matrix3x2<f64>,
) -> Option<Matrix2<f64>> {
    let slide = hit.normal.transpose() * across / hit.normal.dot(axis);
    let on_wall = across - axis * slide;
    let to_camera = view.world_from_camera.inverse().to_rotation_matrix().into_inner();
    let point = to_camera * (hit.point - view.position);
    let by_point = view.camera.project_with_derivatives(&point)?.by_point;
    Some(by_point * to_camera * on_wall)
}

impl Spot {
    pub(super) fn imaged(&self) -> ImagedDot {
        let c = &self.image_covariance;
        let (mean, half) = ((c.m11 + c.m22) / 2.0, f64::hypot((c.m11 - c.m22) / 2.0, c.m12));
        ImagedDot {
            order: self.order,
            pixel: self.pixel,
            sigma_px: [(mean + half).sqrt(), (mean - half).sqrt()],
            amplitude_grey: self.amplitude_grey,
        }
    }

    /// First and last column and row that get light of at least half a signal unit.
    fn bounds(&self, view: &View) -> Option<[usize; 4]> {
        let reach = (2.0 * (2.0 * UNIT * self.amplitude_grey).max(1.0).ln()).sqrt();
        let extent = |at: f64, variance: f64, size: usize| {
            let half = reach * variance.sqrt();
            let (low, high) =
                ((at - half).ceil().max(0.0), (at + half).floor().min(size as f64 - 1.0));
            (low <= high).then_some((low as usize, high as usize))
        };
        let (x0, x1) = extent(self.pixel.x, self.image_covariance.m11, view.camera.width)?;
        let (y0, y1) = extent(self.pixel.y, self.image_covariance.m22, view.camera.height)?;
        Some([x0, x1, y0, y1])
    }

    fn patch(
        &self,
        world: &World,
        view: &View,
        grain: impl FnOnce(usize, usize) -> Option<Vec<f32>>,
    ) -> Option<Patch> {
        let [x0, x1, y0, y1] = self.bounds(view)?;
        let corner = |x: usize, y: usize| Vector2::new(x as f64, y as f64);
        let rays = RayPatch::new(&view.camera, corner(x0, y0), corner(x1, y1))?;
        let to_world = view.world_from_camera.to_rotation_matrix();
        let width = x1 - x0 + 1;
        let mut light = Vec::with_capacity(width * (y1 - y0 + 1));
        for y in y0..=y1 {
            let row = rays.row(y as f64);
            let [a, b, c] = row.coefficients;
            let (a, b, c) =
                (to_world * a.push(1.0), to_world * b.push(0.0), to_world * c.push(0.0));
            for x in x0..=x1 {
                let t = row.parameter(x as f64);
                let ray = a + (b + c * t) * t;
                let hit = world.room.seen(&view.position, &ray);
                light.push(hit.map_or(0.0, |hit| self.grey_at(&hit)));
            }
        }
        if let Some(grain) = grain(width, y1 - y0 + 1) {
            light.iter_mut().zip(grain).for_each(|(light, factor)| *light *= f64::from(factor));
        }
        let signal = light.into_iter().map(super::to_signal).collect();
        Some(Patch { x: x0, y: y0, width, signal })
    }

    /// Grey levels that the beam adds at a point of a wall.
    fn grey_at(&self, hit: &Hit) -> f64 {
        let across = self.across.tr_mul(&(hit.point - self.origin));
        let incidence = hit.normal.dot(&self.axis).abs() / self.cosine;
        let exponent = across.dot(&(self.form * across)) / 2.0;
        self.amplitude_grey * incidence * (-exponent).exp()
    }
}
