//! Runs on tiny fake instruments, in virtual time.

mod acquiring;
mod ending;
pub(crate) mod fakes;
mod lasers;
mod onlookers;
