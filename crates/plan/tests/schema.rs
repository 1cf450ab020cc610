//! The JSON Schemas in `experiments/schema` are those of the readers.
//! `BEAMPOSE_UPDATE_SCHEMA=1 cargo test -p beampose-plan` writes them anew.

#![expect(clippy::unwrap_used, reason = "helpers of tests stop the test")]

use std::path::{Path, PathBuf};

fn fresh(name: &str, schema: &serde_json::Value) {
    let path: PathBuf =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../experiments/schema").join(name);
    let text = serde_json::to_string_pretty(schema).unwrap() + "\n";
    if std::env::var_os("BEAMPOSE_UPDATE_SCHEMA").is_some() {
        std::fs::write(&path, &text).unwrap();
    }
    // Values, not texts: the order of members depends on what else is built.
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    let kept: serde_json::Value = serde_json::from_str(&kept).unwrap_or_default();
    assert!(kept == *schema, "{name} is stale: run this test with BEAMPOSE_UPDATE_SCHEMA=1");
}

#[test]
fn the_schema_of_plans_is_that_of_their_reader() {
    fresh("plan.schema.json", &beampose_plan::plan_schema());
}

#[test]
fn the_schema_of_rigs_is_that_of_their_reader() {
    fresh("rig.schema.json", &beampose_plan::rig_schema());
}
