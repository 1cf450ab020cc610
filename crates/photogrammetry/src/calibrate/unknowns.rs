//! Which numbers of the interior orientation a calibration estimates.

use std::collections::BTreeSet;
use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

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

    /// The columns of `Projection::by_interior` that move with it.
    pub(super) const fn columns(self) -> &'static [usize] {
        match self {
            Self::F => &[0, 1],
            Self::Fx => &[0],
            Self::Fy => &[1],
            Self::Cx => &[2],
            Self::Cy => &[3],
            Self::K1 => &[4],
            Self::K2 => &[5],
            Self::P1 => &[6],
            Self::P2 => &[7],
            Self::K3 => &[8],
        }
    }

    pub(super) fn add(self, camera: &mut Camera, step: f64) {
        match self {
            Self::F => {
                camera.fx += step;
                camera.fy += step;
            }
            Self::Fx => camera.fx += step,
            Self::Fy => camera.fy += step,
            Self::Cx => camera.cx += step,
            Self::Cy => camera.cy += step,
            Self::K1 => camera.k1 += step,
            Self::K2 => camera.k2 += step,
            Self::P1 => camera.p1 += step,
            Self::P2 => camera.p2 += step,
            Self::K3 => camera.k3 += step,
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
    use nalgebra::Vector2;

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
    fn a_step_moves_the_columns_that_its_derivative_sums() {
        let camera = Camera {
            width: 640,
            height: 480,
            fx: 500.0,
            fy: 510.0,
            cx: 320.0,
            cy: 240.0,
            k1: -0.2,
            k2: 0.05,
            p1: 1e-3,
            p2: 2e-3,
            k3: 0.01,
        };
        let point = nalgebra::Vector3::new(0.3, -0.2, 1.0);
        let at = camera.project_with_derivatives(&point).unwrap();
        for unknown in Interior::ALL {
            let mut moved = camera;
            unknown.add(&mut moved, 1e-6);
            let slope = (moved.project(&point).unwrap() - at.pixel) / 1e-6;
            let stated: Vector2<f64> =
                unknown.columns().iter().map(|&c| Vector2::from(at.by_interior.column(c))).sum();
            // The pixel is linear in each: what differs is the rounding of 1e-13 over 1e-6.
            assert!((slope - stated).norm() < 1e-6, "{unknown}");
        }
    }
}
