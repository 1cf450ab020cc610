//! The dry run: can this plan be done with this rig, and what will it take?

use std::fmt;

use beampose_core::units::Second;

use crate::estimate::Estimate;
use crate::expand::{Expanded, expand_with_warnings};
use crate::fault::{AsRead, Fault, Faults};
use crate::hash::plan_hash;
use crate::plan::Plan;
use crate::policy::Rules;
use crate::rig::{Instrument, Rig};
use crate::step::{Action, Section, Step};

/// A picture of nine megapixels as JPEG, where the rig says nothing.
const PICTURE_BYTES: f64 = 3e6;
/// Rays from two cameras cross in a point, but nothing checks it.
const ENOUGH_CAMERAS: usize = 3;

/// What a plan will do and take.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// The plan's title.
    pub title: String,
    /// The rig's title.
    pub rig_title: String,
    /// All steps, `finally` included.
    pub steps: Vec<Step>,
    /// What holds for all main steps.
    pub rules: Rules,
    /// BLAKE3 over both, in hexadecimal.
    pub plan_hash: String,
    /// How long it should take, by the session's clock.
    pub expected: Second,
    /// How long it will take by what is stored of the same rig, where somebody looked.
    pub estimate: Option<Estimate>,
    /// How many captures.
    pub captures: usize,
    /// How many pictures in them.
    pub pictures: usize,
    /// How much disk they will need, about, in bytes.
    pub picture_bytes: u64,
    /// What is not wrong, but odd.
    pub warnings: Vec<Fault>,
}

/// Checks a plan against a rig without doing anything.
///
/// # Errors
/// Every fault in which the plan asks for what the rig does not have.
pub fn check(plan: &Plan, rig: &Rig) -> Result<Summary, Faults> {
    let Expanded { steps, rules, warnings: odd } = expand_with_warnings(plan, rig)?;
    let mut warnings = plan.warnings.clone();
    warnings.extend(odd);
    let pictures: Vec<_> = steps.iter().filter_map(cameras_of).collect();
    if !plan.methods.is_empty() && pictures.iter().any(|names| names.len() < ENOUGH_CAMERAS) {
        let message = format!("solving with fewer than {ENOUGH_CAMERAS} cameras in a capture");
        warnings.push(Fault::of_file(plan.source.name(), message).into_warning());
    }
    let bytes: f64 = pictures.iter().flat_map(|names| names.iter()).map(|n| size(rig, n)).sum();
    Ok(Summary {
        title: plan.title.clone(),
        rig_title: rig.title.clone(),
        plan_hash: plan_hash(&steps, &rules),
        expected: Second(steps.iter().map(|step| step.expected.0).sum()),
        estimate: None,
        captures: pictures.len(),
        pictures: pictures.iter().map(|names| names.len()).sum(),
        picture_bytes: bytes.round() as u64,
        steps,
        rules,
        warnings,
    })
}

/// Holds a plan against a rig, both as they are: every fault of both files and of their match.
///
/// # Errors
/// All faults, in the order of files and lines.
pub fn check_both(plan: AsRead<Plan>, rig: AsRead<Rig>) -> Result<(Plan, Rig, Summary), Faults> {
    let mut faults = plan.faults;
    faults.extend(rig.faults);
    let (Some(plan), Some(rig)) = (plan.value, rig.value) else { return Err(faults) };
    match check(&plan, &rig) {
        Ok(summary) if faults.is_empty() => Ok((plan, rig, summary)),
        Ok(_) => Err(faults),
        Err(more) => {
            faults.extend_elsewhere(more);
            Err(faults)
        }
    }
}

/// The cameras whose pictures a step leaves.
pub(crate) fn cameras_of(step: &Step) -> Option<&[beampose_core::InstrumentName]> {
    match &step.action {
        Action::Capture { cameras, .. } => Some(cameras),
        Action::Align { camera, .. } => Some(std::slice::from_ref(camera)),
        _ => None,
    }
}

fn size(rig: &Rig, camera: &beampose_core::InstrumentName) -> f64 {
    let Some(found @ Instrument::Camera(camera)) = rig.instruments.get(camera) else {
        return PICTURE_BYTES;
    };
    let scale = match &rig.simulation {
        Some(simulation) if found.is_of_simulated_world() => simulation.picture.scale,
        _ => 1.0,
    };
    camera.picture_size.map_or(PICTURE_BYTES, |bytes| bytes.0) * scale * scale
}

impl Summary {
    /// The steps as a numbered list, one a line.
    #[must_use]
    pub fn step_list(&self) -> String {
        let width = self.steps.len().to_string().len();
        let line = |step: &Step| {
            let last = if step.section == Section::Finally { "finally: " } else { "" };
            format!("{:>width$}  {last}{step}\n", step.number.0)
        };
        self.steps.iter().map(line).collect()
    }
}

/// The summary in a few lines, without the list of steps.
impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "plan      {}", self.title)?;
        writeln!(f, "rig       {}", self.rig_title)?;
        writeln!(f, "steps     {}", self.steps.len())?;
        writeln!(f, "captures  {} with {} pictures", self.captures, self.pictures)?;
        match &self.estimate {
            Some(estimate) => writeln!(f, "{estimate}")?,
            None => {
                writeln!(f, "time      about {} (as the rig says)", clock(self.expected))?;
                writeln!(f, "disk      about {:.0} MB", self.picture_bytes as f64 / 1e6)?;
            }
        }
        write!(f, "hash      {}", self.plan_hash)?;
        for warning in &self.warnings {
            write!(f, "\n\n{warning}")?;
        }
        Ok(())
    }
}

/// Two lines of a summary.
impl fmt::Display for Estimate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [from, to] = self.range.map(clock);
        let sessions = match self.sessions {
            1 => "1 session".to_owned(),
            n => format!("{n} sessions"),
        };
        let time = clock(self.time);
        writeln!(f, "time      about {time} ({from} to {to}; from {sessions} on this rig)")?;
        write!(f, "disk      about {:.0} MB", self.bytes / 1e6)
    }
}

/// `1 h 23 min`, `12 min 5 s`, `9 s`.
#[must_use]
pub fn clock(time: Second) -> String {
    let seconds = time.0.round() as u64;
    match (seconds / 3600, seconds / 60 % 60, seconds % 60) {
        (0, 0, s) => format!("{s} s"),
        (0, m, s) => format!("{m} min {s} s"),
        (h, m, _) => format!("{h} h {m} min"),
    }
}
