//! Checks of numbers, named in the definition of a record: `speed: Millimetre => positive`.

use std::collections::BTreeMap;

use crate::fault::At;
use crate::quantity::Quantity;

use super::{Maybe, Needed};

/// Whatever holds numbers that a check can look at.
pub(crate) trait Numbers {
    /// Whether `test` holds for every number inside.
    fn all(&self, test: fn(f64) -> bool) -> bool;
}

impl<Q: Quantity> Numbers for Q {
    fn all(&self, test: fn(f64) -> bool) -> bool {
        test(self.number())
    }
}

macro_rules! plain {
    ($($ty:ty),*) => {$(
        impl Numbers for $ty {
            fn all(&self, test: fn(f64) -> bool) -> bool {
                test(f64::from(*self))
            }
        }
    )*};
}
plain!(f64, u32, u16);

macro_rules! through {
    ($(impl<$t:ident $(, const $n:ident)?> $ty:ty;)*) => {$(
        impl<$t: Numbers $(, const $n: usize)?> Numbers for $ty {
            fn all(&self, test: fn(f64) -> bool) -> bool {
                self.iter().all(|inner| inner.all(test))
            }
        }
    )*};
}
through! {
    impl<T> Option<T>;
    impl<T> Vec<T>;
    impl<T, const N> [T; N];
}

impl<T: Numbers> Numbers for At<T> {
    fn all(&self, test: fn(f64) -> bool) -> bool {
        self.value.all(test)
    }
}

impl<T: Numbers> Numbers for Needed<T> {
    fn all(&self, test: fn(f64) -> bool) -> bool {
        self.0.all(test)
    }
}

impl<T: Numbers> Numbers for Maybe<T> {
    fn all(&self, test: fn(f64) -> bool) -> bool {
        if let Self::Given(inner) = self { inner.all(test) } else { true }
    }
}

impl<T: Numbers> Numbers for BTreeMap<String, T> {
    fn all(&self, test: fn(f64) -> bool) -> bool {
        self.values().all(|inner| inner.all(test))
    }
}

/// Above zero.
pub(crate) fn positive<T: Numbers>(value: &T) -> Result<(), &'static str> {
    if value.all(|n| n > 0.0) { Ok(()) } else { Err("must be above zero") }
}

/// Zero or above.
pub(crate) fn not_negative<T: Numbers>(value: &T) -> Result<(), &'static str> {
    if value.all(|n| n >= 0.0) { Ok(()) } else { Err("must not be below zero") }
}

/// From 0 to 1.
pub(crate) fn fraction<T: Numbers>(value: &T) -> Result<(), &'static str> {
    if value.all(|n| (0.0..=1.0).contains(&n)) { Ok(()) } else { Err("must be from 0 to 1") }
}

/// Above 0, at most 1.
pub(crate) fn unit_range<T: Numbers>(value: &T) -> Result<(), &'static str> {
    if value.all(|n| n > 0.0 && n <= 1.0) { Ok(()) } else { Err("must be above 0 and at most 1") }
}

/// From 1 to 100.
pub(crate) fn percent<T: Numbers>(value: &T) -> Result<(), &'static str> {
    if value.all(|n| (1.0..=100.0).contains(&n)) { Ok(()) } else { Err("must be from 1 to 100") }
}
