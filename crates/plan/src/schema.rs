//! JSON Schemas of plans and rigs, for editors. Made of the same definitions as the readers.

use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde_json::Value;

/// The schema of plan files.
#[must_use]
pub fn plan_schema() -> Value {
    schema::<crate::plan::PlanFile>("beampose plan")
}

/// The schema of rig files.
#[must_use]
pub fn rig_schema() -> Value {
    schema::<crate::rig::RigFile>("beampose rig")
}

fn schema<T: JsonSchema>(title: &str) -> Value {
    // Draft 7 is what yaml-language-server reads best.
    let mut schema = SchemaSettings::draft07().into_generator().into_root_schema_for::<T>();
    schema.insert("title".to_owned(), title.into());
    schema.to_value()
}
