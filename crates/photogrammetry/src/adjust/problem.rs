//! The unknowns and observations of an adjustment, as plain data.

use nalgebra::{Matrix2, SMatrix, Vector2, Vector3};

use crate::camera::{Camera, InteriorSigma};
use crate::pose::Station;

/// Whether a camera's interior orientation is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Interior {
    /// Taken as it is.
    Fixed,
    /// Focal length (fx and fy together) and principal point are unknowns, with the calibration as
    /// an observation of these standard uncertainties.
    Prior(InteriorSigma),
}

/// A camera: its pose and interior orientation are unknowns.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraStation {
    /// Pose; start value, then result.
    pub station: Station,
    /// The calibration.
    pub camera: Camera,
    /// What it is worth.
    pub interior: Interior,
    /// Corrections to (focal length, principal point x, y), pixels; start value, then result.
    pub correction: Vector3<f64>,
}

impl CameraStation {
    /// The camera with its corrections applied.
    #[must_use]
    pub fn corrected(&self) -> Camera {
        Camera {
            fx: self.camera.fx + self.correction.x,
            fy: self.camera.fy + self.correction.x,
            cx: self.camera.cx + self.correction.y,
            cy: self.camera.cy + self.correction.z,
            ..self.camera
        }
    }
}

/// The module: a camera that shines instead of seeing.
#[derive(Debug, Clone, PartialEq)]
pub struct ModuleStation {
    /// Pose; start value, then result.
    pub station: Station,
    /// Relative correction of the fan's scale; start value, then result.
    pub scale: f64,
    /// What the scale is known to before (from wavelength and calibration): value and standard
    /// uncertainty. Uncertainty 0 holds it fixed.
    pub scale_prior: (f64, f64),
}

/// What all modules of an adjustment share, when they are one module at several places: a common
/// error of the fan's scale, and the errors of its single beams.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SharedFan {
    /// Relative error of the scale, in addition to each module's own; start value, then result.
    pub scale: f64,
    /// Its standard uncertainty before; 0 holds it fixed.
    pub scale_sigma: f64,
    /// Errors of single beams as direction cosines (x, y); start values, then results.
    pub beams: Vec<Vector2<f64>>,
    /// Standard uncertainty of a beam's direction per axis before, radians.
    pub beam_sigma: f64,
}

/// A measured image point of a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageObservation {
    /// Index of the camera.
    pub camera: usize,
    /// Index of the point.
    pub point: usize,
    /// Where, pixels.
    pub at: Vector2<f64>,
    /// Inverse covariance, per square pixel.
    pub information: Matrix2<f64>,
}

/// A beam of a module that made a dot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BeamObservation {
    /// Index of the module.
    pub module: usize,
    /// Index of the point.
    pub point: usize,
    /// Direction cosines (x, y) of the beam at the reference wavelength, module frame.
    pub cosines: Vector2<f64>,
    /// Standard uncertainty of its direction per axis, radians; where the beam's error is an
    /// unknown of the shared fan, what is left beside it.
    pub sigma: f64,
    /// Index of the beam's error in the shared fan, if it is an unknown.
    pub shared: Option<usize>,
}

/// A beam on the plane z = 1, with its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tangent {
    /// (x, y) on the plane.
    pub at: Vector2<f64>,
    /// By the fan's relative scale.
    pub by_scale: Vector2<f64>,
    /// By the beam's direction cosines at the reference wavelength.
    pub by_cosines: Matrix2<f64>,
}

impl BeamObservation {
    /// The beam on the plane z = 1 when the fan is scaled by `1 + scale` and the beam is off by
    /// `error` (direction cosines). `None` when the beam would not leave the grating.
    #[must_use]
    pub fn tangent(&self, scale: f64, error: Vector2<f64>) -> Option<Tangent> {
        let cosines = self.cosines + error;
        let c = cosines * (1.0 + scale);
        let z2 = 1.0 - c.norm_squared();
        if z2 <= 0.0 {
            return None;
        }
        let z = z2.sqrt();
        let by_c = Matrix2::identity() / z + c * c.transpose() / (z2 * z);
        Some(Tangent { at: c / z, by_scale: by_c * cosines, by_cosines: by_c * (1.0 + scale) })
    }

    /// Inverse covariance on the plane z = 1: an angle `sigma` is `sigma (1 + r^2)` along the
    /// radius and `sigma sqrt(1 + r^2)` across it.
    #[must_use]
    pub fn information(&self, tangent: &Vector2<f64>) -> Matrix2<f64> {
        let stretch = 1.0 + tangent.norm_squared();
        // Covariance sigma^2 stretch (I + t t^T); its inverse by Sherman and Morrison.
        let outer = tangent * tangent.transpose() / stretch;
        (Matrix2::identity() - outer) / (self.sigma * self.sigma * stretch)
    }
}

/// A point whose place is known: a target of the artefact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Control {
    /// Index of the point.
    pub point: usize,
    /// Its known place, mm, up to the artefact's scale.
    pub at: Vector3<f64>,
    /// Standard uncertainty of each coordinate, mm.
    pub sigma: f64,
}

/// An adjustment: start values and observations in, results in the same places out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Problem {
    /// Cameras.
    pub cameras: Vec<CameraStation>,
    /// Modules (virtual cameras).
    pub modules: Vec<ModuleStation>,
    /// Points, world, mm; start values, then results.
    pub points: Vec<Vector3<f64>>,
    /// Image points.
    pub images: Vec<ImageObservation>,
    /// Beams.
    pub beams: Vec<BeamObservation>,
    /// Points of known place.
    pub controls: Vec<Control>,
    /// Relative correction of the artefact's scale; start value, then result.
    pub artefact_scale: f64,
    /// Its relative standard uncertainty; 0 holds the scale fixed.
    pub artefact_scale_sigma: f64,
    /// What the modules share.
    pub fan: SharedFan,
}

/// Where each unknown stands in the reduced normal equations.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Layout {
    /// Per camera: first of six pose unknowns, first of three interior ones if they are unknown.
    pub cameras: Vec<(usize, Option<usize>)>,
    /// Per module: first of six pose unknowns, and the scale's if it is unknown.
    pub modules: Vec<(usize, Option<usize>)>,
    /// The artefact's scale, if it is unknown.
    pub artefact_scale: Option<usize>,
    /// The shared fan's scale, if it is unknown.
    pub fan_scale: Option<usize>,
    /// First of two unknowns for each beam of the shared fan.
    pub fan_beams: usize,
    /// Number of unknowns.
    pub size: usize,
}

impl Layout {
    pub fn of(problem: &Problem) -> Self {
        let mut size = 0;
        let mut take = |count: usize| {
            size += count;
            size - count
        };
        let cameras = problem
            .cameras
            .iter()
            .map(|c| {
                let pose = take(6);
                (pose, matches!(c.interior, Interior::Prior(_)).then(|| take(3)))
            })
            .collect();
        let modules = problem
            .modules
            .iter()
            .map(|m| {
                let pose = take(6);
                (pose, (m.scale_prior.1 > 0.0).then(|| take(1)))
            })
            .collect();
        let artefact_scale = (problem.artefact_scale_sigma > 0.0).then(|| take(1));
        let fan_scale = (problem.fan.scale_sigma > 0.0).then(|| take(1));
        let fan_beams = take(2 * problem.fan.beams.len());
        Self { cameras, modules, artefact_scale, fan_scale, fan_beams, size }
    }
}

/// Rows of a Jacobian by one block of unknowns.
pub(super) type Rows<const N: usize> = SMatrix<f64, 2, N>;
