//! When to stop a program so that it is at work.

use std::time::Duration;

/// Between which instants of a program's life its work is under way. Learnt from each signal that
/// came too soon or too late, since the same run takes half or twice as long as the machine is busy.
pub struct UnderWay {
    from: Duration,
    to: Duration,
}

impl UnderWay {
    /// Somewhere in the time that a whole run took.
    pub fn within(whole: Duration) -> Self {
        Self { from: Duration::ZERO, to: whole }
    }

    fn width(&self) -> Duration {
        self.to.saturating_sub(self.from)
    }

    /// The instant at this share of the work.
    pub fn instant(&self, share: f64) -> Duration {
        self.from + self.width().mul_f64(share)
    }

    /// A signal at this instant came before the work began.
    pub fn too_soon(&mut self, at: Duration) {
        self.from = (self.from + at) / 2 + self.width().mul_f64(0.05);
        self.to = self.to.max(at.mul_f64(1.2));
    }

    /// The work was over at this instant.
    pub fn too_late(&mut self, at: Duration) {
        self.to = at.saturating_sub(self.width().mul_f64(0.05));
        self.from = self.from.min(at.mul_f64(0.8));
    }

    /// A signal met the work: a little wider, so that its first and last instants are tried again.
    pub fn met(&mut self) {
        self.from = self.from.mul_f64(0.97);
        self.to = self.to.mul_f64(1.03);
    }
}
