//! Runs on tiny fake instruments, in virtual time.

mod acquiring;
mod ending;
mod fakes;
mod lasers;
mod onlookers;
