//! Camera calibration: against OpenCV on its own corners, and on pictures of a sheet that are drawn
//! through a known camera.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod draw;
mod fan;
mod opencv;
mod pictures;
mod repeated;
mod statistics;
