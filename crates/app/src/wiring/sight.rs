//! The eyes of a closing-in: the detector that solving uses, and the nominal fan.

use beampose_core::InstrumentName;
use beampose_engine::Sight;
use beampose_photogrammetry::detect::{DotOptions, find_dots};
use beampose_photogrammetry::{Order, Pattern, decode};

/// A picture with few dots says little of its noise, and what is no dot does not move as the axis
/// does: more is let through here than where every dot counts.
const OPTIONS: DotOptions =
    DotOptions { max_reduced_chi_square: 30.0, max_shape_departure: 0.5, ..DotOptions::USUAL };

/// Finds dots in pictures of a known scale.
pub struct PatternSight {
    pattern: Pattern,
    /// Size of the pictures against that of the calibrations.
    scale: f64,
}

impl PatternSight {
    /// With a nominal fan, for pictures of that size against the calibrations'.
    pub fn new(pattern: Pattern, scale: f64) -> Self {
        Self { pattern, scale }
    }
}

impl Sight for PatternSight {
    fn spots(&self, _: &InstrumentName, picture: &[u8]) -> Result<Vec<[f64; 2]>, String> {
        let image = decode(picture).map_err(|error| error.to_string())?;
        let found = find_dots(&image, &OPTIONS);
        // The centre of the first pixel is 0 at any size.
        let full_size = |x: f64| (x + 0.5) / self.scale - 0.5;
        let dots = found.dots.iter();
        Ok(dots.map(|dot| [full_size(dot.point.at.x), full_size(dot.point.at.y)]).collect())
    }

    fn off_zero_deg(&self, [m, n]: [i32; 2]) -> Option<f64> {
        let tangent = self.pattern.tangent(Order { m, n })?;
        // One of the two is zero: the beam is of the zero order's row or column.
        let along = if n == 0 { tangent.x } else { tangent.y };
        Some(along.atan().to_degrees())
    }
}
