//! An exchange folder from elsewhere: `session.yaml`, and behind lines of `%%` a calibration, a
//! pattern and its table of beams; what is left out is a sound one.

#![no_main]

use std::path::Path;

use beampose_exchange::{Folder, SESSION_FILE, read};
use beampose_photogrammetry::pattern::read_table;
use libfuzzer_sys::fuzz_target;

const CALIBRATION: &str = include_str!("../../experiments/rigs/simulated/cam_a.yaml");
const PATTERN: &str = include_str!("../../experiments/rigs/simulated/pattern.yaml");

fn put(folder: &Path, name: &str, text: &str) -> bool {
    std::fs::write(folder.join(name), text).is_ok()
}

fuzz_target!(|bytes: &[u8]| {
    let (Ok(text), Ok(outside)) = (std::str::from_utf8(bytes), tempfile::tempdir()) else { return };
    let folder = outside.path().join("session");
    let mut parts = text.split("\n%%\n");
    let mut part = |sound| parts.next().unwrap_or(sound);
    let written = std::fs::create_dir(&folder).is_ok()
        && put(outside.path(), "outside.jpg", "not to be read")
        && put(&folder, SESSION_FILE, part(""))
        && put(&folder, "cam_a.yaml", part(CALIBRATION))
        && put(&folder, "pattern.yaml", part(PATTERN))
        && put(&folder, "beams.csv", part("m,n,x,y\n0,0,0,0\n"))
        && put(&folder, "p.jpg", "a picture");
    let Ok(opened) = Folder::open(&folder) else { return };
    if !written {
        return;
    }
    if let Ok(session) = read(&opened) {
        for (_, picture) in session.captures.iter().flat_map(|capture| &capture.pictures) {
            assert_ne!(opened.bytes(picture).ok().as_deref(), Some(&b"not to be read"[..]));
        }
    }
    for size in [[1, 1], [3, 3]] {
        if let Ok(beams) = read_table("beams.csv", text, size) {
            assert!(beams.iter().flatten().all(|tangent| tangent.is_finite()));
        }
    }
});
