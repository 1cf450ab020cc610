//! Calibrations: a camera, a pattern, a sheet, what a calibration states.

#![no_main]

use beampose_photogrammetry::calibrate::{read_sheet, read_stated};
use beampose_photogrammetry::camera::read_camera_info;
use beampose_photogrammetry::pattern::read_pattern;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    drop(read_camera_info(text));
    drop(read_stated(text));
    drop(read_sheet(text));
    if let Ok(pattern) = read_pattern(text) {
        for beam in pattern.beams(1.0) {
            assert!(beam.direction.iter().all(|x| x.is_finite()));
        }
    }
});
