//! Files in: plans, rigs and what a rig refers to.

use std::path::{Path, PathBuf};

use beampose_plan::{
    AsRead, Plan, Rig, Summary, check_both, read_plan_as_it_is, read_rig, read_rig_as_it_is,
};

use crate::settings::Overrides;

/// A plan with its rig, read and checked.
pub struct Checked {
    /// The plan.
    pub plan: Plan,
    /// The rig.
    pub rig: Rig,
    /// The rig's file.
    pub rig_path: PathBuf,
    /// The folder that the rig's file names are relative to.
    pub rig_folder: PathBuf,
    /// Steps, estimates, warnings.
    pub summary: Summary,
}

/// Reads and checks a plan and its rig. Of the rig: `--rig`, else the one that the plan names.
///
/// # Errors
/// Every fault, as text for people.
pub fn checked(plan: &Path, rig: Option<&Path>, overrides: &Overrides) -> Result<Checked, String> {
    let plan_name = plan.display().to_string();
    let plan_read = file(plan, read_plan_as_it_is);
    // A rig that the plan names is relative to the plan's folder.
    let named = plan_read.value.as_ref().and_then(|p| p.rig.as_ref());
    let named = named.map(|rig| plan.parent().unwrap_or(Path::new("")).join(&rig.value));
    let Some(path) = rig.map(Path::to_path_buf).or(named) else {
        if plan_read.faults.is_empty() {
            return Err(format!(
                "{plan_name}: no rig\n  help: name one with --rig FILE, or in the plan: `rig: FILE`"
            ));
        }
        return Err(plan_read.faults.to_string());
    };
    if rig.is_none() {
        // Plans and rigs stand side by side in folders of their own.
        let beside = plan.parent().unwrap_or(Path::new("")).join("..");
        if let Err(Outside::Elsewhere) = within(&beside, &path) {
            return Err(format!(
                "{plan_name}: its rig is far from it: {}\n  help: name it with --rig FILE",
                path.display()
            ));
        }
    }
    let rig_read = file(&path, read_rig_as_it_is);
    let (plan, rig, summary) =
        check_both(plan_read, rig_read).map_err(|faults| faults.to_string())?;
    let rig_folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
    Ok(Checked { plan, rig: overrides.apply(rig)?, rig_path: path, rig_folder, summary })
}

/// Where a session's plan and rig came from, and what the command line changed: what resuming it
/// needs.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// The plan's file, absolute.
    pub plan: PathBuf,
    /// The rig's file, absolute.
    pub rig: PathBuf,
    /// What the command line changed of the rig.
    pub overrides: Overrides,
    /// How long the run was thought to take when it began, s: the estimate and its range.
    #[serde(default)]
    pub estimated_s: Option<[f64; 3]>,
}

impl Origin {
    /// The origin of what was read.
    ///
    /// # Errors
    /// When the current folder is not known.
    pub fn of(plan: &Path, checked: &Checked, overrides: Overrides) -> std::io::Result<Self> {
        let (plan, rig) = (std::path::absolute(plan)?, std::path::absolute(&checked.rig_path)?);
        let estimate = checked.summary.estimate.as_ref();
        let estimated_s = estimate.map(|e| [e.time.0, e.range[0].0, e.range[1].0]);
        Ok(Self { plan, rig, overrides, estimated_s })
    }
}

/// Reads and checks a rig alone.
///
/// # Errors
/// Every fault, as text for people.
pub fn rig(path: &Path, overrides: &Overrides) -> Result<Rig, String> {
    let name = path.display().to_string();
    let bytes = std::fs::read(path)
        .map_err(|error| beampose_plan::source::unreadable(&name, &error).to_string())?;
    overrides.apply(read_rig(&name, &bytes).map_err(|faults| faults.to_string())?)
}

fn file<T>(path: &Path, read: impl Fn(&str, &[u8]) -> AsRead<T>) -> AsRead<T> {
    let name = path.display().to_string();
    match std::fs::read(path) {
        Ok(bytes) => read(&name, &bytes),
        Err(error) => AsRead::unreadable(beampose_plan::source::unreadable(&name, &error)),
    }
}

/// Reads a text file that a rig refers to.
///
/// # Errors
/// Which file and why, for people.
pub fn referred(folder: &Path, name: &str, what: &str) -> Result<String, String> {
    let path = folder.join(name);
    let of_rig = |fault: &dyn std::fmt::Display| format!("{fault}\n  it is the rig's {what}");
    let unreadable = |error: &std::io::Error| {
        of_rig(&beampose_plan::source::unreadable(&path.display().to_string(), error))
    };
    within(folder, &path).map_err(|why| match why {
        Outside::Unreadable(error) => unreadable(&error),
        Outside::Elsewhere => of_rig(&format!(
            "{}: a rig's files are in its own folder; this one is elsewhere",
            path.display()
        )),
    })?;
    let size = std::fs::metadata(&path).map_err(|error| unreadable(&error))?.len();
    if size > MAX_REFERRED {
        let message = format!("{}: {size} bytes; at most {MAX_REFERRED} are read", path.display());
        return Err(of_rig(&message));
    }
    let text = std::fs::read(&path).map_err(|error| unreadable(&error))?;
    String::from_utf8(text)
        .map_err(|error| format!("{}: {what} is not UTF-8: {error}", path.display()))
}

/// More than any calibration, pattern or table of beams has.
const MAX_REFERRED: u64 = 16 << 20;

/// Why a file is not taken for one of a folder's.
enum Outside {
    Unreadable(std::io::Error),
    Elsewhere,
}

/// Whether a file is in a folder or below it, links followed: what comes from elsewhere names
/// nothing of this machine.
fn within(folder: &Path, path: &Path) -> Result<(), Outside> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let real = |path: &Path| path.canonicalize().map_err(Outside::Unreadable);
    if real(path)?.starts_with(real(folder)?) { Ok(()) } else { Err(Outside::Elsewhere) }
}
