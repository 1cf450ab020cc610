//! Files in: plans, rigs and what a rig refers to.

use std::path::{Path, PathBuf};

use beampose_plan::{Plan, Rig, Summary, check, read_plan, read_rig};

use crate::settings::Overrides;

/// A plan with its rig, read and checked.
pub struct Checked {
    /// The plan.
    pub plan: Plan,
    /// The rig.
    pub rig: Rig,
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
    let plan_text = std::fs::read(plan);
    let plan_file = bytes(&plan_name, plan_text)?;
    let read = read_plan(&plan_name, &plan_file);
    // A rig that the plan names is relative to the plan's folder.
    let named = read.as_ref().ok().and_then(|p| p.rig.as_ref()).map(|rig| {
        plan.parent().unwrap_or(Path::new("")).join(&rig.value)
    });
    let rig_read = match rig.map(Path::to_path_buf).or(named) {
        Some(path) => Some(read_rig_file(&path)),
        None => None,
    };
    // All faults of both files at once.
    let (plan, (rig, rig_folder)) = match (read, rig_read) {
        (Ok(plan), Some(Ok(rig))) => (plan, rig),
        (Ok(_), None) => {
            return Err(format!(
                "{plan_name}: no rig\n  help: name one with --rig FILE, or in the plan: `rig: FILE`"
            ));
        }
        (Err(faults), Some(Err(more))) => return Err(format!("{faults}\n{more}")),
        (Err(faults), _) => return Err(faults.to_string()),
        (Ok(_), Some(Err(faults))) => return Err(faults),
    };
    let summary = check(&plan, &rig).map_err(|faults| faults.to_string())?;
    let rig = overrides.apply(rig);
    Ok(Checked { plan, rig, rig_folder, summary })
}

fn read_rig_file(path: &Path) -> Result<(Rig, PathBuf), String> {
    let name = path.display().to_string();
    let file = bytes(&name, std::fs::read(path))?;
    let rig = read_rig(&name, &file).map_err(|faults| faults.to_string())?;
    Ok((rig, path.parent().unwrap_or(Path::new("")).to_path_buf()))
}

fn bytes(name: &str, read: std::io::Result<Vec<u8>>) -> Result<Vec<u8>, String> {
    read.map_err(|error| beampose_plan::source::unreadable(name, &error).to_string())
}

/// Reads a text file that a rig refers to.
///
/// # Errors
/// Which file and why, for people.
pub fn referred(folder: &Path, name: &str, what: &str) -> Result<String, String> {
    let path = folder.join(name);
    let text = std::fs::read(&path).map_err(|error| {
        let fault = beampose_plan::source::unreadable(&path.display().to_string(), &error);
        format!("{fault}\n  it is the rig's {what}")
    })?;
    String::from_utf8(text)
        .map_err(|error| format!("{}: {what} is not UTF-8: {error}", path.display()))
}
