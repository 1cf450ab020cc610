//! Solving on sightings made from a known scene: projection with noise, every error that a rig
//! declares drawn anew. No picture is rendered here; `virtual_lab` does that.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod capture;
mod corner;
mod fan;
mod scene;
mod session;
mod truth;
