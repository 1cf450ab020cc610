//! A picture: decoded or refused, never more memory than a picture may take; then dots and targets.

#![no_main]

use beampose_photogrammetry::decode;
use beampose_photogrammetry::detect::{DotOptions, find_dots};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(image) = decode(bytes) else { return };
    // Larger ones take longer and show nothing else.
    if image.width * image.height <= 1 << 18 {
        let dots = find_dots(&image, &DotOptions::default());
        drop(dots);
    }
});
