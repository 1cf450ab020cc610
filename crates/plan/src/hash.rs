//! The plan's hash: a session can only be resumed with the plan that it was begun with.

use crate::policy::Rules;
use crate::step::Step;

/// BLAKE3 over the steps as canonical JSON (members in the order of definition, maps sorted,
/// shortest decimals), and over the rules where they are not the usual ones, in hexadecimal.
#[must_use]
pub fn plan_hash(steps: &[Step], rules: &Rules) -> String {
    let mut hasher = blake3::Hasher::new();
    // A step holds numbers, text and maps with text keys: nothing that JSON cannot write, and a
    // hasher takes every byte. Should that ever change, the hash must not be that of less.
    if let Err(error) = serde_json::to_writer(&mut hasher, steps) {
        hasher.update(error.to_string().as_bytes());
    }
    if *rules != Rules::default()
        && let Err(error) = serde_json::to_writer(&mut hasher, rules)
    {
        hasher.update(error.to_string().as_bytes());
    }
    hasher.finalize().to_hex().to_string()
}
