//! Where a stored session was interrupted, for `sessions show` and the report.

use beampose_analysis::report::{Interruption, RedoneStep};
use beampose_core::{SessionId, StepOutcome};
use beampose_store::{Store, StoreError};

/// The gaps of a session, each with the steps that were done again after it.
///
/// # Errors
/// When the store cannot be read.
pub async fn interruptions(
    store: &Store,
    session: SessionId,
) -> Result<Vec<Interruption>, StoreError> {
    let attempts = store.attempts(session).await?;
    let gaps = store.gaps(session).await?;
    let all = gaps.into_iter().enumerate().map(|(i, gap)| Interruption {
        stopped: gap.stopped,
        resumed: gap.resumed,
        reason: gap.reason,
        restored: gap.restored,
        redone: attempts
            .iter()
            .filter(|attempt| attempt.gap == i)
            .map(|attempt| RedoneStep {
                number: attempt.step.number.0,
                label: attempt.step.label.clone(),
                before: match &attempt.step.outcome {
                    StepOutcome::Done => "done".to_owned(),
                    StepOutcome::Skipped => "skipped".to_owned(),
                    StepOutcome::Failed { reason } => format!("failed: {reason}"),
                    StepOutcome::PassedOver { reason } => format!("passed over: {reason}"),
                },
            })
            .collect(),
    });
    Ok(all.collect())
}
