//! Runs on tiny fake instruments, in virtual time.

mod acquiring;
mod ending;
pub(crate) mod fakes;
mod interlock;
mod lasers;
mod machine;
mod onlookers;
mod policies;
mod steps;
mod stopping;
