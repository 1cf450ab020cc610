//! How long a run will take, by what is stored of the same rig.

use beampose_plan::{Estimate, History, Summary, estimate, read_rig_as_it_is};
use beampose_store::Store;

/// The estimate for a checked plan; `None` where nothing is stored of its rig.
///
/// # Errors
/// When the store fails.
pub async fn learned(store: &Store, summary: &Summary) -> anyhow::Result<Option<Estimate>> {
    let mut history = History::default();
    for past in store.past_sessions().await? {
        // The same rig is one of the same title: a limit or a calibration may have changed since.
        let rig = read_rig_as_it_is("stored rig", past.rig_text.as_bytes()).value;
        if rig.is_none_or(|rig| rig.title != summary.rig_title) || past.steps.is_empty() {
            continue;
        }
        history.sessions += 1;
        if let Some(took) = past.took_s {
            let in_steps: f64 = past.steps.iter().map(|(_, took)| took).sum();
            history.between.push((took - in_steps) / past.steps.len() as f64);
        }
        history.steps.extend(past.steps);
        history.pictures.extend(past.pictures);
    }
    if history.sessions == 0 {
        return Ok(None);
    }
    Ok(Some(estimate(&summary.steps, summary.picture_bytes as f64, &history)))
}
