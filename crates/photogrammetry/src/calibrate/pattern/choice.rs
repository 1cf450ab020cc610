//! Which model of the fan to take.

use super::{FanFit, FanFitError, FanModel};

/// A model that was tried.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Which.
    pub model: FanModel,
    /// Its fit, or why there is none.
    pub fit: Result<FanFit, FanFitError>,
}

/// A criterion that is lower by less than this says nothing (Burnham and Anderson 2002, section 2.6).
const SAYS_NOTHING: f64 = 2.0;

/// The index of the model to take: that of the lowest corrected Akaike criterion, or the first of
/// those that come as near as to be no worse. `candidates` stand in order of their parameters.
#[must_use]
pub fn choose(candidates: &[Candidate]) -> Option<usize> {
    let aicc = |c: &Candidate| c.fit.as_ref().ok().map(FanFit::aicc);
    let best = candidates.iter().filter_map(aicc).min_by(f64::total_cmp)?;
    // With so few angles that no criterion exists (infinite), the simplest is right.
    let near = |c: &Candidate| aicc(c).is_some_and(|a| a <= best + SAYS_NOTHING);
    candidates.iter().position(near)
}
