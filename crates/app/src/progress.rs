//! The live progress bar: step, elapsed and remaining time, last pose. Quiet when standard error is
//! not a terminal.

use std::io::IsTerminal as _;
use std::sync::Arc;
use std::time::Duration;

use beampose_core::instrument::AxisUnit;
use beampose_core::units::Second;
use beampose_engine::{Notice, Observer};
use beampose_photogrammetry::solve::Method;
use beampose_plan::Summary;
use beampose_plan::check::clock;
use indicatif::{MultiProgress, ProgressBar, ProgressStyle};

use crate::output::{complain, make_room};
use crate::pipeline::Solved;

/// Two bars: steps of the run, captures solved. Clones show on the same bars.
#[derive(Clone)]
pub struct Progress {
    steps: ProgressBar,
    solved: ProgressBar,
    /// How long each step should take, s, in their order.
    each: Arc<[f64]>,
    /// What of that is left.
    left: f64,
}

impl Progress {
    /// Bars for a run; hidden unless `shown` and standard error is a terminal.
    pub fn new(summary: &Summary, shown: bool) -> Self {
        let each: Arc<[f64]> = match &summary.estimate {
            Some(estimate) => estimate.each.iter().map(|time| time.0).collect(),
            None => summary.steps.iter().map(|step| step.expected.0).collect(),
        };
        Self::with(each, summary.captures as u64, shown)
    }

    fn with(each: Arc<[f64]>, captures: u64, shown: bool) -> Self {
        let left = each.iter().sum();
        if !shown || !std::io::stderr().is_terminal() {
            let (steps, solved) = (ProgressBar::hidden(), ProgressBar::hidden());
            return Self { steps, solved, each, left };
        }
        let steps = each.len() as u64;
        let bars = MultiProgress::new();
        make_room(Some(bars.clone()));
        let bar = |length: u64, template: &str| {
            let style = ProgressStyle::with_template(template)
                .unwrap_or_else(|_| ProgressStyle::default_bar())
                .progress_chars("━╸─");
            let bar = bars.add(ProgressBar::new(length).with_style(style));
            bar.enable_steady_tick(Duration::from_millis(200));
            bar
        };
        Self {
            steps: bar(
                steps,
                "  run    {bar:28.cyan/dim} {pos:>4}/{len:<4} {elapsed_precise} elapsed  {wide_msg:.dim}",
            ),
            each,
            left,
            solved: bar(captures, "  solve  {bar:28.green/dim} {pos:>4}/{len:<4} {wide_msg}"),
        }
    }

    /// Bars for solving alone.
    pub fn solving(captures: u64, shown: bool) -> Self {
        let progress = Self::with(Arc::from([]), captures, shown);
        progress.steps.finish_and_clear();
        progress
    }

    /// A capture was solved, or not.
    pub fn solved(&self, solved: &Solved) {
        let best = solved
            .solution
            .results
            .iter()
            .max_by_key(|r| (r.pose.is_ok(), r.method == Method::VirtualCamera));
        let message = match best.map(|r| &r.pose) {
            Some(Ok(pose)) => {
                let [x, y, z] = pose.position_mm;
                let u = (0..3).map(|i| pose.covariance[i][i]).sum::<f64>().sqrt();
                format!("{}: {x:.2} {y:.2} {z:.2} mm, u {u:.2} mm", solved.capture)
            }
            Some(Err(reason)) => format!("{}: {reason}", solved.capture),
            None => format!("{}: no method", solved.capture),
        };
        self.solved.set_message(message);
        self.solved.inc(1);
    }

    /// So many captures were solved before.
    pub fn skip(&self, captures: u64) {
        self.solved.inc(captures);
    }

    /// Prints something while the bars are out of the way.
    pub fn suspend(&self, printing: impl FnOnce()) {
        self.solved.suspend(printing);
    }

    /// Takes the bars away.
    pub fn finish(&self) {
        self.steps.finish_and_clear();
        self.solved.finish_and_clear();
        make_room(None);
    }
}

impl Observer for Progress {
    fn notice(&mut self, notice: &Notice) {
        match notice {
            // By the session's clock: in virtual time it is over sooner.
            Notice::StepStarted(step) => {
                let left = clock(Second(self.left.max(0.0)));
                self.steps.set_message(format!("{left} left  {step}"));
            }
            Notice::StepDone(record) => {
                let place = usize::try_from(record.number.0).unwrap_or(0).wrapping_sub(1);
                self.left -= self.each.get(place).copied().unwrap_or(0.0);
                self.steps.inc(1);
            }
            Notice::Closed(_) => self.steps.set_message("done"),
            Notice::Paused { reason } => complain(&format!(
                "beampose: paused, everything is safe: {reason}\n  Enter or `beampose tell SESSION go-on` goes on"
            )),
            Notice::Continued => complain("beampose: the run goes on"),
            Notice::ByHand { axis, unit, target, reading } => {
                let unit = if *unit == AxisUnit::Millimetre { "mm" } else { "deg" };
                self.steps.set_message(format!(
                    "{axis}: {reading:.3} {unit}, move it to {target} {unit}"
                ));
            }
            Notice::Opened(_) | Notice::Event(_) | Notice::Captured(_) => {}
        }
    }
}
