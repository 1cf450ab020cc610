//! Writes the simulation's truth beside a session, apart from what was measured. Only `score` reads
//! it back.

use std::sync::Arc;

use beampose_core::{CaptureId, SessionId, Stamp};
use beampose_store::{Store, StoreError};
use beampose_virtual_lab::World;
use tokio::sync::mpsc::UnboundedReceiver;

/// Stores what the world drew, then the truth at each capture that comes in, until none comes.
///
/// # Errors
/// [`StoreError`]: the session is then without (all of) its truth; what was measured is not
/// concerned.
pub async fn record(
    store: &Store,
    session: SessionId,
    world: &Arc<World>,
    mut captures: UnboundedReceiver<(CaptureId, Stamp)>,
) -> Result<(), StoreError> {
    let mut parameters_stored = false;
    while let Some((capture, at)) = captures.recv().await {
        if !parameters_stored {
            let parameters = serde_json::json!(world.true_parameters()).to_string();
            beampose_store::truth::save_parameters(store, session, &parameters).await?;
            parameters_stored = true;
        }
        let truth = serde_json::json!(world.truth_at(at)).to_string();
        beampose_store::truth::save_capture(store, session, &capture, &truth).await?;
    }
    Ok(())
}
