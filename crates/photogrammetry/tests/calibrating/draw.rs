//! Draws a sheet of dots as a camera sees it: each pixel is the mean of samples sent through the
//! lens onto the sheet. Nothing of the finder is used, and no random numbers but its own, so that
//! the program's tests can draw the same pictures.

use beampose_photogrammetry::calibrate::Sheet;
use beampose_photogrammetry::pose::Station;
use beampose_photogrammetry::scene::ring_sectors;
use beampose_photogrammetry::{Camera, GrayImage};
use nalgebra::{Matrix3, Rotation3, Unit, Vector2, Vector3};

/// Samples along the side of a pixel.
const STEPS: usize = 4;
/// Width of the square that a pixel gathers light from, pixels: a lens is not sharper.
const SPREAD: f64 = 1.6;
/// Grey levels of ink, paper, and what is around.
const INK: f64 = 45.0;
const PAPER: f64 = 205.0;
const AROUND: f64 = 120.0;

/// A camera with the rays of all its samples.
pub struct Lens {
    camera: Camera,
    rays: Vec<Vector2<f64>>,
}

impl Lens {
    pub fn new(camera: Camera) -> Self {
        let shift = |k: usize| ((k as f64 + 0.5) / STEPS as f64 - 0.5) * SPREAD;
        let mut rays = Vec::with_capacity(camera.width * camera.height * STEPS * STEPS);
        for pixel in 0..camera.width * camera.height {
            let (x, y) = ((pixel % camera.width) as f64, (pixel / camera.width) as f64);
            for sample in 0..STEPS * STEPS {
                let at = Vector2::new(x + shift(sample % STEPS), y + shift(sample / STEPS));
                rays.push(camera.normalise(&at).unwrap());
            }
        }
        Self { camera, rays }
    }

    /// A picture with normal noise of so many grey levels; `strays` are more dots: place and radius
    /// in millimetres.
    pub fn photograph(
        &self,
        sheet: &Sheet,
        strays: &[(Vector2<f64>, f64)],
        station: &Station,
        noise: f64,
        seed: u64,
    ) -> GrayImage {
        let sheet_from_camera = station.rotation.into_inner();
        let value = |ray: &Vector2<f64>| {
            let direction = sheet_from_camera * ray.push(1.0);
            let distance = -station.centre.z / direction.z;
            let at = (station.centre + direction * distance).xy();
            let is_stray = || strays.iter().any(|(place, radius)| (at - place).norm() < *radius);
            if distance <= 0.0 {
                AROUND
            } else if is_stray() {
                INK
            } else {
                grey(sheet, &at)
            }
        };
        let mut random = Random(seed);
        let pixels = self.rays.chunks(STEPS * STEPS).map(|samples| {
            let mean = samples.iter().map(value).sum::<f64>() / samples.len() as f64;
            (mean + noise * random.normal()).round().clamp(0.0, 255.0) as u8
        });
        GrayImage { width: self.camera.width, height: self.camera.height, data: pixels.collect() }
    }
}

/// What is printed at a place, millimetres.
fn grey(sheet: &Sheet, at: &Vector2<f64>) -> f64 {
    let last = sheet.dot(sheet.columns - 1, sheet.rows - 1);
    let margin = sheet.pitch_mm;
    let is_on = |v: f64, last: f64| v > -margin && v < last + margin;
    if !(is_on(at.x, last.x) && is_on(at.y, last.y)) {
        return AROUND;
    }
    for mark in &sheet.control_marks {
        let offset = (at - mark.place()) / mark.radius_mm;
        let radius = offset.norm();
        if radius < 3.6 {
            let turn = offset.y.atan2(offset.x).rem_euclid(std::f64::consts::TAU);
            let sector = ((turn / std::f64::consts::TAU * 12.0) as usize).min(11);
            let is_ring = (2.0..3.0).contains(&radius) && ring_sectors(mark.code)[sector];
            return if radius < 1.0 || is_ring { INK } else { PAPER };
        }
    }
    let nearest = |v: f64, count: u32| {
        (v / sheet.pitch_mm).round().clamp(0.0, f64::from(count - 1)) * sheet.pitch_mm
    };
    let dot = Vector2::new(nearest(at.x, sheet.columns), nearest(at.y, sheet.rows));
    if (at - dot).norm() < sheet.dot_radius_mm() { INK } else { PAPER }
}

/// A camera that looks at a place of the sheet from `centre`, rolled about its axis.
pub fn look_at(centre: Vector3<f64>, target: Vector2<f64>, roll_deg: f64) -> Station {
    let z = (target.push(0.0) - centre).normalize();
    let x = Vector3::y().cross(&z).normalize();
    let level = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, z.cross(&x), z]));
    let roll =
        Rotation3::from_axis_angle(&Unit::new_unchecked(Vector3::z()), roll_deg.to_radians());
    Station { centre, rotation: level * roll }
}

/// Twelve stations as the dissertation has them: from four sides, each rolled by -90, 0 and 90
/// degrees, so that the sheet fills the picture.
pub fn twelve_stations(sheet: &Sheet, distance_mm: f64) -> Vec<Station> {
    let middle = sheet.dot(sheet.columns - 1, sheet.rows - 1) * 0.5;
    let mut stations = Vec::new();
    for (i, (x, y)) in [(0.6, 0.1), (-0.6, -0.1), (0.1, 0.6), (-0.1, -0.6)].into_iter().enumerate()
    {
        for (k, roll) in [-90.0, 0.0, 90.0].into_iter().enumerate() {
            // Not always aimed at the middle: points shall reach every corner of the picture.
            let aim = Vector2::new(i as f64 - 1.5, k as f64 - 1.0) * (1.5 * sheet.pitch_mm);
            let from = Vector3::new(x, y, -0.8) * distance_mm + middle.push(0.0);
            stations.push(look_at(from, middle + aim, roll));
        }
    }
    stations
}

/// Seeded deviates (the splitmix64 sequence).
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Standard normal (Box and Muller).
    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}
