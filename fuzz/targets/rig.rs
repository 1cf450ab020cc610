//! A rig: whatever the bytes, faults with places.

#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    match beampose_plan::read_rig("rig.yaml", bytes) {
        Ok(rig) => drop(rig.cameras().count()),
        Err(faults) => assert!(!faults.to_string().is_empty()),
    }
});
