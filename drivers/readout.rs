//! What drivers of readouts have in common: an axis that a person moves and a program only reads.

use beampose_core::InstrumentError;

/// What `move_to` of a readout does: nothing is sent and nothing moves, the person is asked by the
/// engine; a place that the rail does not reach is refused as by a motor.
///
/// # Errors
/// [`InstrumentError::Refused`] outside `limits` (millimetres, as `target`).
pub(crate) fn may_be_moved_to(target: f64, limits: [f64; 2]) -> Result<(), InstrumentError> {
    let [low, high] = limits;
    if (low..=high).contains(&target) {
        return Ok(());
    }
    Err(InstrumentError::Refused(format!("{target} mm is outside {low} to {high} mm")))
}
