//! The live progress bar: step, elapsed and remaining time, last pose. Quiet when standard error is
//! not a terminal.

use std::io::IsTerminal as _;
use std::time::Duration;

use beampose_engine::{Notice, Observer};
use beampose_photogrammetry::solve::Method;
use indicatif::{MultiProgress, ProgressBar, ProgressStyle};

use crate::pipeline::Solved;

/// Two bars: steps of the run, captures solved. Clones show on the same bars.
#[derive(Clone)]
pub struct Progress {
    steps: ProgressBar,
    solved: ProgressBar,
}

impl Progress {
    /// Bars for a run of `steps` steps and `captures` captures; hidden unless `shown` and standard
    /// error is a terminal.
    pub fn new(steps: u64, captures: u64, shown: bool) -> Self {
        if !shown || !std::io::stderr().is_terminal() {
            return Self { steps: ProgressBar::hidden(), solved: ProgressBar::hidden() };
        }
        let bars = MultiProgress::new();
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
                "  run    {bar:28.cyan/dim} {pos:>4}/{len:<4} {elapsed_precise} elapsed, {eta_precise} left  {wide_msg:.dim}",
            ),
            solved: bar(captures, "  solve  {bar:28.green/dim} {pos:>4}/{len:<4} {wide_msg}"),
        }
    }

    /// Bars for solving alone.
    pub fn solving(captures: u64, shown: bool) -> Self {
        let progress = Self::new(0, captures, shown);
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
    }
}

impl Observer for Progress {
    fn notice(&mut self, notice: &Notice) {
        match notice {
            Notice::StepStarted(step) => self.steps.set_message(step.to_string()),
            Notice::StepDone(_) => self.steps.inc(1),
            Notice::Closed(_) => self.steps.set_message("done"),
            Notice::Opened(_) | Notice::Event(_) | Notice::Captured(_) => {}
        }
    }
}
