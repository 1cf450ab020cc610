//! Units as types, for every public signature outside the numeric core.
//!
//! A value is stored in one unit (millimetre, degree, second, nanometre, degree Celsius) and the
//! unit is its type; at text boundaries the unit is written out (`100 mm`) or is the suffix of the
//! key (`rail_mm`). The numeric core (`photogrammetry`) uses plain `f64` in millimetres, radians
//! and pixels and says so.

use std::fmt;

use serde::{Deserialize, Serialize};

macro_rules! unit {
    ($(#[$doc:meta])* $name:ident, $symbol:literal, $suffix:literal) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default, Serialize, Deserialize)]
        #[serde(transparent)]
        pub struct $name(pub f64);

        impl $name {
            /// How the unit is written after a number, as in `100 mm`.
            pub const SYMBOL: &'static str = $symbol;
            /// How the unit ends a key, as in `rail_mm`.
            pub const SUFFIX: &'static str = $suffix;

            /// The bare number in this unit.
            #[must_use]
            pub const fn get(self) -> f64 {
                self.0
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{} {}", self.0, $symbol)
            }
        }
    };
}

unit!(
    /// A length in millimetres.
    Millimetre, "mm", "mm"
);
unit!(
    /// An angle in degrees, as people write it. Inside the numeric core angles are radians.
    Degree, "deg", "deg"
);
unit!(
    /// A wavelength in vacuum, in nanometres.
    Nanometre, "nm", "nm"
);
unit!(
    /// A temperature in degrees Celsius.
    Celsius, "degC", "degc"
);
unit!(
    /// A current in milliamperes.
    Milliampere, "mA", "ma"
);
unit!(
    /// A duration in seconds, as people write it.
    Second, "s", "s"
);

impl Degree {
    /// The angle in radians.
    #[must_use]
    pub fn radians(self) -> f64 {
        self.0.to_radians()
    }
}

impl Second {
    /// The duration for timers; a negative or non-finite number of seconds counts as none.
    #[must_use]
    pub fn duration(self) -> std::time::Duration {
        std::time::Duration::try_from_secs_f64(self.0).unwrap_or_default()
    }
}

impl From<std::time::Duration> for Second {
    fn from(duration: std::time::Duration) -> Self {
        Self(duration.as_secs_f64())
    }
}
