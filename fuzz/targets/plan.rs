//! A plan: whatever the bytes, faults with places, and steps only of what a rig can do.

#![no_main]

use beampose_plan::{check, read_plan, read_rig};
use libfuzzer_sys::fuzz_target;

const RIG: &str = include_str!("../../experiments/rigs/simulated.yaml");

fuzz_target!(|bytes: &[u8]| {
    let Ok(rig) = read_rig("rig.yaml", RIG.as_bytes()) else { return };
    match read_plan("plan.yaml", bytes) {
        Ok(plan) => match check(&plan, &rig) {
            Ok(summary) => {
                assert!(summary.expected.0.is_finite());
                drop((summary.to_string(), summary.step_list()));
            }
            Err(faults) => drop(faults.to_string()),
        },
        Err(faults) => assert!(!faults.to_string().is_empty()),
    }
});
