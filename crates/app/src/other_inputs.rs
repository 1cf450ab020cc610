//! Other inputs than a session was run with: calibrations, pattern, rig, options.

use std::path::{Path, PathBuf};

use beampose_core::{InstrumentName, UsedFile};
use beampose_photogrammetry::camera::{Camera, read_camera_info};
use beampose_photogrammetry::pattern::{Pattern, read_pattern_with, read_table};
use beampose_plan::read_rig;

use crate::calibration::{self, MeasuredWith};
use crate::input::referred;

/// What the command line names.
#[derive(Debug, Clone, Default, clap::Args)]
#[command(next_help_heading = "Other inputs than those of the session")]
pub struct OtherInputs {
    /// A camera's calibration, a ROS `camera_info` file: cam_a=monday.yaml; what it is worth stays as
    /// it was
    #[arg(long, value_name = "CAMERA=FILE", value_parser = named_file)]
    with_calibration: Vec<(String, PathBuf)>,
    /// The fan of beams, a pattern file
    #[arg(long, value_name = "FILE")]
    with_pattern: Option<PathBuf>,
    /// All of a rig's calibrations, pattern, artefact and prior, at full picture size
    #[arg(long, value_name = "FILE")]
    with_rig: Option<PathBuf>,
    /// No prior orientation of the module
    #[arg(long)]
    without_prior: bool,
    /// Standard uncertainty of the wavelength reading
    #[arg(long, value_name = "NM", value_parser = uncertainty)]
    with_wavelength_u: Option<f64>,
}

fn named_file(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((camera, file)) if !camera.is_empty() && !file.is_empty() => {
            Ok((camera.to_owned(), PathBuf::from(file)))
        }
        _ => Err("expected CAMERA=FILE, as in cam_a=monday.yaml".to_owned()),
    }
}

fn uncertainty(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(nm) if nm > 0.0 && nm.is_finite() => Ok(nm),
        _ => Err("expected nanometres, more than 0".to_owned()),
    }
}

/// The files, read.
pub struct Inputs {
    cameras: Vec<(UsedFile, PathBuf, Camera)>,
    pattern: Option<(Pattern, UsedFile)>,
    rig: Option<MeasuredWith>,
    without_prior: bool,
    wavelength_u_nm: Option<f64>,
}

impl OtherInputs {
    /// Reads what is named, before anything is begun.
    ///
    /// # Errors
    /// Which file is at fault and why, for people.
    pub fn read(&self) -> Result<Inputs, String> {
        let mut cameras = Vec::new();
        for (camera, file) in &self.with_calibration {
            let text = text(file, "camera calibration")?;
            let model =
                read_camera_info(&text).map_err(|error| format!("{}: {error}", file.display()))?;
            let camera = InstrumentName(camera.clone());
            cameras.push((UsedFile::of(Some(&camera), &named(file), &text), file.clone(), model));
        }
        Ok(Inputs {
            cameras,
            pattern: self.with_pattern.as_deref().map(used_pattern).transpose()?,
            rig: self.with_rig.as_deref().map(rig).transpose()?,
            without_prior: self.without_prior,
            wavelength_u_nm: self.with_wavelength_u,
        })
    }
}

fn text(file: &Path, what: &str) -> Result<String, String> {
    // Whoever names a file on the command line may name any.
    let folder = file.parent().unwrap_or(Path::new(""));
    let name =
        file.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    referred(folder, &name, what)
}

/// A pattern file.
///
/// # Errors
/// What is wrong with it, for people.
pub fn pattern(file: &Path) -> Result<Pattern, String> {
    used_pattern(file).map(|(pattern, _)| pattern)
}

fn used_pattern(file: &Path) -> Result<(Pattern, UsedFile), String> {
    let beside = file.parent().unwrap_or(Path::new(""));
    let text = text(file, "pattern")?;
    let read = read_pattern_with(&text, |table, size| {
        read_table(table, &referred(beside, table, "table of beams")?, size)
    });
    let read = read.map_err(|error| format!("{}: {error}", file.display()))?;
    Ok((read, UsedFile::of(None, &named(file), &text)))
}

/// A file without its folder, which means nothing on another machine.
fn named(file: &Path) -> String {
    file.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn rig(file: &Path) -> Result<MeasuredWith, String> {
    let name = file.display().to_string();
    let bytes = std::fs::read(file)
        .map_err(|error| beampose_plan::source::unreadable(&name, &error).to_string())?;
    let rig = read_rig(&name, &bytes).map_err(|faults| faults.to_string())?;
    calibration::setup(&rig, file.parent().unwrap_or(Path::new("")))
}

impl Inputs {
    /// True where nothing else is named.
    pub fn is_none(&self) -> bool {
        self.cameras.is_empty()
            && self.pattern.is_none()
            && self.rig.is_none()
            && !self.without_prior
            && self.wavelength_u_nm.is_none()
    }

    /// What a session is solved with instead of its own setup.
    ///
    /// # Errors
    /// Which camera the session does not have, for people.
    pub fn instead(&self, own: MeasuredWith) -> Result<MeasuredWith, String> {
        let MeasuredWith { mut setup, mut files } = self.rig.clone().unwrap_or(own);
        let mut replace = |other: &UsedFile| {
            files.retain(|file| file.camera != other.camera);
            files.push(other.clone());
        };
        for (used, file, model) in &self.cameras {
            let name = used.camera.as_ref().map_or("", InstrumentName::as_str);
            let known: Vec<String> = setup.cameras.keys().cloned().collect();
            let camera = setup.cameras.get_mut(name).ok_or_else(|| {
                let file = file.display();
                format!("{file}: there is no camera {name:?}, only {}", known.join(", "))
            })?;
            camera.model = *model;
            replace(used);
        }
        if let Some((pattern, used)) = &self.pattern {
            setup.pattern = pattern.clone();
            replace(used);
        }
        if self.without_prior {
            setup.module_prior = None;
        }
        setup.wavelength_u_nm = self.wavelength_u_nm.unwrap_or(setup.wavelength_u_nm);
        Ok(MeasuredWith { setup, files })
    }
}
