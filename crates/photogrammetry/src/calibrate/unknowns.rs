//! Which numbers of the interior orientation a calibration estimates.

use std::collections::BTreeSet;
use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::adjust::InteriorParameter;
use crate::camera::Camera;

/// One number of the interior orientation, in the order of `Projection::by_interior`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Interior {
    /// One focal length for both axes.
    F,
    /// Focal length along x, pixels.
    Fx,
    /// Focal length along y, pixels.
    Fy,
    /// Principal point, x, pixels.
    Cx,
    /// Principal point, y, pixels.
    Cy,
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

impl Interior {
    /// All of them.
    pub const ALL: [Self; 10] = [
        Self::F,
        Self::Fx,
        Self::Fy,
        Self::Cx,
        Self::Cy,
        Self::K1,
        Self::K2,
        Self::P1,
        Self::P2,
        Self::K3,
    ];

    /// The name in files and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::F => "f",
            Self::Fx => "fx",
            Self::Fy => "fy",
            Self::Cx => "cx",
            Self::Cy => "cy",
            Self::K1 => "k1",
            Self::K2 => "k2",
            Self::P1 => "p1",
            Self::P2 => "p2",
            Self::K3 => "k3",
        }
    }

    /// Whether it is in pixels; the others have no unit.
    #[must_use]
    pub const fn is_in_pixels(self) -> bool {
        matches!(self, Self::F | Self::Fx | Self::Fy | Self::Cx | Self::Cy)
    }

    /// Its value; of the common focal length the mean.
    #[must_use]
    pub fn of(self, camera: &Camera) -> f64 {
        match self {
            Self::F => 0.5 * (camera.fx + camera.fy),
            Self::Fx => camera.fx,
            Self::Fy => camera.fy,
            Self::Cx => camera.cx,
            Self::Cy => camera.cy,
            Self::K1 => camera.k1,
            Self::K2 => camera.k2,
            Self::P1 => camera.p1,
            Self::P2 => camera.p2,
            Self::K3 => camera.k3,
        }
    }

    /// Its name in the adjustment.
    pub(super) const fn parameter(self) -> InteriorParameter {
        match self {
            Self::F => InteriorParameter::Focal,
            Self::Fx => InteriorParameter::FocalX,
            Self::Fy => InteriorParameter::FocalY,
            Self::Cx => InteriorParameter::PrincipalX,
            Self::Cy => InteriorParameter::PrincipalY,
            Self::K1 => InteriorParameter::K1,
            Self::K2 => InteriorParameter::K2,
            Self::P1 => InteriorParameter::P1,
            Self::P2 => InteriorParameter::P2,
            Self::K3 => InteriorParameter::K3,
        }
    }

    /// Pixels by which one unit of it moves an image point at a focal length in pixels and a
    /// normalised radius, at most.
    pub(super) fn moves(self, focal: f64, radius: f64) -> f64 {
        match self {
            Self::F | Self::Fx | Self::Fy => radius,
            Self::Cx | Self::Cy => 1.0,
            Self::K1 => focal * radius.powi(3),
            Self::K2 => focal * radius.powi(5),
            Self::P1 | Self::P2 => 3.0 * focal * radius.powi(2),
            Self::K3 => focal * radius.powi(7),
        }
    }
}

impl fmt::Display for Interior {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// The numbers that are estimated, each once, in a fixed order; what is not among them keeps its
/// start value.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Unknowns(BTreeSet<Interior>);

/// Why a list of unknowns is none.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum UnknownsError {
    /// A name that is none.
    #[error("`{0}` is no parameter; those are f, fx, fy, cx, cy, k1, k2, p1, p2, k3")]
    Unknown(String),
    /// Twice the same.
    #[error("`{0}` is there twice")]
    Twice(String),
    /// One focal length and two.
    #[error("`f` is one focal length for both axes: it excludes `fx` and `fy`")]
    Both,
}

impl Unknowns {
    /// In order.
    pub fn iter(&self) -> impl Iterator<Item = Interior> + '_ {
        self.0.iter().copied()
    }

    /// How many.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there is none: then only poses are estimated.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether this one is estimated.
    #[must_use]
    pub fn contains(&self, unknown: Interior) -> bool {
        self.0.contains(&unknown)
    }
}

/// All nine: two focal lengths, principal point, five coefficients of distortion.
impl Default for Unknowns {
    fn default() -> Self {
        Self(Interior::ALL.into_iter().filter(|u| *u != Interior::F).collect())
    }
}

impl FromStr for Unknowns {
    type Err = UnknownsError;

    /// Names with commas between.
    fn from_str(text: &str) -> Result<Self, UnknownsError> {
        let mut set = BTreeSet::new();
        for name in text.split(',').map(str::trim) {
            let found = Interior::ALL.into_iter().find(|u| u.name() == name);
            let unknown = found.ok_or_else(|| UnknownsError::Unknown(name.to_owned()))?;
            if !set.insert(unknown) {
                return Err(UnknownsError::Twice(name.to_owned()));
            }
        }
        let has = |u| set.contains(&u);
        if has(Interior::F) && (has(Interior::Fx) || has(Interior::Fy)) {
            return Err(UnknownsError::Both);
        }
        Ok(Self(set))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_in_any_order_and_kept_in_one() {
        let unknowns: Unknowns = "k1, cx,f,cy".parse().unwrap();
        let names: Vec<&str> = unknowns.iter().map(Interior::name).collect();
        assert_eq!(names, ["f", "cx", "cy", "k1"]);
    }

    #[test]
    fn a_list_that_contradicts_itself_is_refused() {
        let cases = [
            ("fx,k4", UnknownsError::Unknown("k4".to_owned())),
            ("fx,fx", UnknownsError::Twice("fx".to_owned())),
            ("f,fy", UnknownsError::Both),
        ];
        for (text, expected) in cases {
            assert_eq!(text.parse::<Unknowns>(), Err(expected));
        }
    }

    #[test]
    fn what_a_parameter_moves_is_the_length_of_its_derivative() {
        let camera = Camera::without_distortion([640, 480], [500.0, 500.0], [320.0, 240.0]);
        let (sin, cos) = 0.3f64.sin_cos();
        let radius = 0.4;
        let point = nalgebra::Vector3::new(radius * cos, radius * sin, 1.0);
        let by_interior = camera.project_with_derivatives(&point).unwrap().by_interior;
        // Of focal lengths and tangential terms the derivative depends on the direction: at most so.
        for (column, unknown) in Unknowns::default().iter().enumerate() {
            let (here, most) = (by_interior.column(column).norm(), unknown.moves(500.0, radius));
            assert!(here <= most * (1.0 + 1e-12) && here > 0.25 * most, "{unknown}: {here} {most}");
        }
        for unknown in [Interior::K1, Interior::K2, Interior::K3] {
            let column = Unknowns::default().iter().position(|u| u == unknown).unwrap();
            let here = by_interior.column(column).norm();
            assert!((here / unknown.moves(500.0, radius) - 1.0).abs() < 1e-12, "{unknown}");
        }
    }
}
