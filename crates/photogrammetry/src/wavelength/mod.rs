//! What is known of the wavelength at a capture, and whence: the fan is corrected to it.
//!
//! To add a source: a variant of [`WavelengthSource`], its rule in `choose`, its word in the
//! migration that lists them. Does not read sensors or know which instrument is which.

mod choose;
#[cfg(test)]
mod tests;

pub use choose::{Known, Sample, wavelength};

use serde::{Deserialize, Serialize};

use crate::pattern::Pattern;
use crate::scene::Setup;

/// Relative uncertainty of the wavelength where nothing read it: a diode's 0.4 nm of 658 nm.
pub const UNREAD: f64 = 6e-4;

/// Standard uncertainty of a reading whose meter states none, nanometres: what a simple wavelength
/// meter has.
pub const UNSTATED_U_NM: f64 = 0.1;

/// Whence a wavelength is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WavelengthSource {
    /// Read at the capture: since anything moved, before the pictures.
    Read,
    /// Between the readings before and after the capture, linear in time.
    Interpolated,
    /// The nearest reading, where there is none on the other side of the capture.
    Held,
    /// From the diode's temperature and its measured coefficient.
    FromTemperature,
    /// Nothing was read: the reference wavelength with a wide prior, estimated where a method can.
    Estimated,
    /// Not corrected: the fan is taken at its reference wavelength, as if that were exact.
    Nominal,
}

impl WavelengthSource {
    /// The word in files, in the store and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Interpolated => "interpolated",
            Self::Held => "held",
            Self::FromTemperature => "from_temperature",
            Self::Estimated => "estimated",
            Self::Nominal => "nominal",
        }
    }
}

/// Which of what is known a processing uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum WavelengthUse {
    /// The reading at the capture; else what is less uncertain of the readings before and after it
    /// and the diode's temperature; else nothing.
    #[default]
    Best,
    /// As [`Self::Best`], by what had been read when the capture was taken: as a run solves.
    Live,
    /// The reading at the capture; else nothing.
    Read,
    /// The reading at the capture; else those before and after it; else nothing.
    Interpolated,
    /// The diode's temperature; else nothing.
    Temperature,
    /// No correction.
    Nominal,
}

impl WavelengthUse {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Best, Self::Live, Self::Read, Self::Interpolated, Self::Temperature, Self::Nominal];

    /// The word in a processing's options and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Best => "best",
            Self::Live => "live",
            Self::Read => "read",
            Self::Interpolated => "interpolated",
            Self::Temperature => "temperature",
            Self::Nominal => "nominal",
        }
    }

    /// The one of that name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|one| one.name() == name)
    }

    /// What all captures of a session together use: it is over then, and all of it has been read.
    #[must_use]
    pub const fn of_session(self) -> Self {
        match self {
            Self::Live => Self::Best,
            other => other,
        }
    }
}

/// What is known of the wavelength at a capture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wavelength {
    /// Whence.
    pub source: WavelengthSource,
    /// In vacuum, nanometres.
    pub nm: f64,
    /// Standard uncertainty that is this capture's own (time that passed, nothing read), nanometres.
    pub own_u_nm: f64,
    /// Standard uncertainty that the captures of a session share (the meter's error), nanometres.
    pub common_u_nm: f64,
    /// Seconds between the capture and the nearest reading that was used; `None` where that was
    /// taken at the capture or none was used.
    pub age_s: Option<f64>,
}

impl Wavelength {
    /// Standard uncertainty, nanometres.
    #[must_use]
    pub fn u_nm(&self) -> f64 {
        self.own_u_nm.hypot(self.common_u_nm)
    }

    /// The fan's relative scale with its standard uncertainty: wavelength and calibration together.
    #[must_use]
    pub fn fan_scale(&self, pattern: &Pattern) -> (f64, f64) {
        let of_wavelength = self.u_nm() / pattern.reference_wavelength_nm;
        (pattern.scale_at(self.nm), pattern.u.common_relative.hypot(of_wavelength))
    }
}

impl Setup {
    /// The wavelength where it was read at the capture, or where nothing is known of it.
    #[must_use]
    pub fn wavelength(&self, read_nm: Option<f64>) -> Wavelength {
        let reference = self.pattern.reference_wavelength_nm;
        match read_nm {
            Some(nm) => Wavelength {
                source: WavelengthSource::Read,
                nm,
                own_u_nm: 0.0,
                common_u_nm: self.wavelength_u_nm,
                age_s: None,
            },
            None => Wavelength {
                source: WavelengthSource::Estimated,
                nm: reference,
                own_u_nm: UNREAD * reference,
                common_u_nm: 0.0,
                age_s: None,
            },
        }
    }
}
