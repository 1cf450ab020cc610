//! The unknowns and observations of an adjustment, as plain data.

use nalgebra::{Matrix2, Vector2, Vector3};

use crate::camera::{Camera, InteriorSigma};
use crate::pose::Station;

/// One number of a camera's interior orientation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum InteriorParameter {
    /// Focal length, fx and fy together, pixels; its value is fx.
    Focal,
    /// Focal length along x, pixels.
    FocalX,
    /// Focal length along y, pixels.
    FocalY,
    /// Principal point, x, pixels.
    PrincipalX,
    /// Principal point, y, pixels.
    PrincipalY,
    /// Radial distortion, second order.
    K1,
    /// Radial distortion, fourth order.
    K2,
    /// Tangential distortion.
    P1,
    /// Tangential distortion.
    P2,
    /// Radial distortion, sixth order.
    K3,
}

impl InteriorParameter {
    /// Adds `change` to this number of `camera`.
    pub(super) fn add(self, camera: &mut Camera, change: f64) {
        match self {
            Self::Focal => {
                camera.fx += change;
                camera.fy += change;
            }
            Self::FocalX => camera.fx += change,
            Self::FocalY => camera.fy += change,
            Self::PrincipalX => camera.cx += change,
            Self::PrincipalY => camera.cy += change,
            Self::K1 => camera.k1 += change,
            Self::K2 => camera.k2 += change,
            Self::P1 => camera.p1 += change,
            Self::P2 => camera.p2 += change,
            Self::K3 => camera.k3 += change,
        }
    }

    /// This number of `camera`.
    #[must_use]
    pub fn of(self, camera: &Camera) -> f64 {
        match self {
            Self::Focal | Self::FocalX => camera.fx,
            Self::FocalY => camera.fy,
            Self::PrincipalX => camera.cx,
            Self::PrincipalY => camera.cy,
            Self::K1 => camera.k1,
            Self::K2 => camera.k2,
            Self::P1 => camera.p1,
            Self::P2 => camera.p2,
            Self::K3 => camera.k3,
        }
    }
}

/// A number known beforehand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// The value.
    pub value: f64,
    /// Its standard uncertainty, above zero.
    pub sigma: f64,
}

/// An unknown of the interior orientation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InteriorUnknown {
    /// Which number.
    pub parameter: InteriorParameter,
    /// What is known of it beforehand; `None` leaves it free.
    pub prior: Option<Prior>,
}

/// An interior orientation, of one camera station or shared by many.
#[derive(Debug, Clone, PartialEq)]
pub struct InteriorOrientation {
    /// Start value, then result.
    pub camera: Camera,
    /// Its unknowns; what is not named is taken as it is.
    pub unknowns: Vec<InteriorUnknown>,
}

impl InteriorOrientation {
    /// Taken as it is.
    #[must_use]
    pub fn fixed(camera: Camera) -> Self {
        Self { camera, unknowns: Vec::new() }
    }

    /// These numbers unknown and nothing known of them but start values.
    #[must_use]
    pub fn free(camera: Camera, parameters: &[InteriorParameter]) -> Self {
        let unknown = |parameter: &_| InteriorUnknown { parameter: *parameter, prior: None };
        Self { camera, unknowns: parameters.iter().map(unknown).collect() }
    }

    /// Focal length (fx and fy together) and principal point unknown, with the calibration as an
    /// observation. Numbers with no uncertainty are taken as they are.
    #[must_use]
    pub fn calibrated(camera: Camera, sigma: &InteriorSigma) -> Self {
        use InteriorParameter::{Focal, PrincipalX, PrincipalY};
        let [x, y] = sigma.principal_point_px;
        let unknowns = [(Focal, sigma.focal_px), (PrincipalX, x), (PrincipalY, y)]
            .into_iter()
            .filter(|(_, sigma)| *sigma > 0.0)
            .map(|(parameter, sigma)| {
                let prior = Some(Prior { value: parameter.of(&camera), sigma });
                InteriorUnknown { parameter, prior }
            })
            .collect();
        Self { camera, unknowns }
    }
}

/// A camera at a place: its pose is unknown unless it is held.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraStation {
    /// Pose; start value, then result.
    pub station: Station,
    /// Index of its interior orientation.
    pub interior: usize,
    /// True where the pose is known exactly and takes no part.
    pub is_held: bool,
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

impl ModuleStation {
    /// Six of its pose, and its scale where that is not fixed.
    pub(super) fn unknowns(&self) -> usize {
        if self.scale_prior.1 > 0.0 { 7 } else { 6 }
    }
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

/// A measured distance between two points: a scale bar.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScaleBar {
    /// Indices of the points at its ends.
    pub ends: [usize; 2],
    /// Its length, mm.
    pub length: f64,
    /// Standard uncertainty of the length, mm.
    pub sigma: f64,
}

/// An adjustment: start values and observations in, results in the same places out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Problem {
    /// Interior orientations of the cameras.
    pub interiors: Vec<InteriorOrientation>,
    /// Cameras.
    pub cameras: Vec<CameraStation>,
    /// Modules (virtual cameras).
    pub modules: Vec<ModuleStation>,
    /// Points, world, mm; start values, then results.
    pub points: Vec<Vector3<f64>>,
    /// Points that are known exactly (indices): taken as they are.
    pub held_points: Vec<usize>,
    /// Image points.
    pub images: Vec<ImageObservation>,
    /// Beams.
    pub beams: Vec<BeamObservation>,
    /// Points of known place.
    pub controls: Vec<Control>,
    /// Measured distances between points.
    pub scale_bars: Vec<ScaleBar>,
    /// Relative correction of the artefact's scale; start value, then result.
    pub artefact_scale: f64,
    /// Its relative standard uncertainty; 0 holds the scale fixed.
    pub artefact_scale_sigma: f64,
    /// What the modules share.
    pub fan: SharedFan,
}

impl Problem {
    /// The interior orientation of a camera station.
    #[must_use]
    pub fn interior(&self, camera: usize) -> &Camera {
        &self.interiors[self.cameras[camera].interior].camera
    }

    /// The image of a point in a camera; `None` where it has none.
    #[must_use]
    pub fn image_of(&self, camera: usize, point: usize) -> Option<Vector2<f64>> {
        let station = &self.cameras[camera].station;
        self.interior(camera).project(&station.station_point(&self.points[point]))
    }
}
