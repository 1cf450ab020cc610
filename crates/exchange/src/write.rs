//! A stored session as an exchange folder. Numbers keep all their digits.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use beampose_core::SessionId;
use beampose_photogrammetry::camera::write_camera_info;
use beampose_photogrammetry::pattern::write_pattern;
use beampose_photogrammetry::{Artefact, Setup};
use beampose_store::{Store, StoreError, StoredCapture};
use serde_json::Value;

use crate::{PATTERN_FILE, SESSION_FILE, picture_kind};

/// What was written.
pub struct Exported {
    /// How many captures.
    pub captures: usize,
    /// How many pictures.
    pub pictures: usize,
    /// What could not be written and why, for people.
    pub left_out: Vec<String>,
}

/// Why a session was not written, or not whole: then there is no `session.yaml`.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// What the session says of its measurement.
    #[error("the session's measurement setup cannot be read: {0}")]
    Setup(#[from] serde_json::Error),
    /// A file of the folder.
    #[error("{} cannot be written: {source}", path.display())]
    NotWritten {
        /// Which.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
}

/// Makes the folder, or sees to it that it may be written into.
///
/// # Errors
/// Why not, for people.
pub fn prepare(folder: &Path, force: bool) -> Result<(), String> {
    let shown = folder.display();
    let cannot = |error: std::io::Error| format!("the folder {shown} cannot be made: {error}");
    match std::fs::read_dir(folder) {
        Ok(mut entries) => {
            if force || entries.next().is_none() {
                return Ok(());
            }
            Err(format!(
                "{shown} is not empty\n  help: with --force, files of the same names are replaced"
            ))
        }
        Err(error) if error.kind() == ErrorKind::NotFound => {
            std::fs::create_dir_all(folder).map_err(cannot)
        }
        Err(error) if error.kind() == ErrorKind::NotADirectory => {
            Err(format!("{shown} is a file, not a folder"))
        }
        Err(error) => Err(cannot(error)),
    }
}

/// Writes a session into a folder; `session.yaml` last, so that a folder that has it is whole.
///
/// # Errors
/// When the store cannot be read or a file cannot be written.
pub async fn export(store: &Store, id: SessionId, folder: &Path) -> Result<Exported, ExportError> {
    let session = store.session(id).await?;
    let setup: Setup = serde_json::from_str(&session.header.measurement_json)?;
    let captures = store.captures(id).await?;
    remove_stale(&folder.join(SESSION_FILE))?;
    let mut names = Names::default();
    let mut text = head(&session.header.title, &calibrations(&setup, folder, &mut names)?, &setup);
    put(&folder.join(PATTERN_FILE), write_pattern(&setup.pattern).as_bytes())?;
    text += if captures.is_empty() { "captures: []\n" } else { "captures:\n" };
    let exported = Exported { captures: captures.len(), pictures: 0, left_out: Vec::new() };
    let mut pictures = Pictures { store, id, setup: &setup, folder, names, exported };
    for capture in &captures {
        text += &entry(capture, &pictures.of(capture).await?);
    }
    put(&folder.join(SESSION_FILE), text.as_bytes())?;
    Ok(pictures.exported)
}

/// Writes pictures, one at a time.
struct Pictures<'a> {
    store: &'a Store,
    id: SessionId,
    setup: &'a Setup,
    folder: &'a Path,
    names: Names,
    exported: Exported,
}

impl Pictures<'_> {
    /// Writes those of a capture; gives their file names, as YAML, by camera. One that is damaged in
    /// the store is left out: the others are worth having.
    async fn of(
        &mut self,
        capture: &StoredCapture,
    ) -> Result<BTreeMap<String, String>, ExportError> {
        let mut images = BTreeMap::new();
        for picture in &capture.pictures {
            let camera = picture.camera.as_str();
            let bytes = if self.setup.cameras.contains_key(camera) {
                let read = self.store.picture(self.id, &capture.id, &picture.camera).await;
                read.map_err(|error| error.to_string())
            } else {
                Err("the camera has no calibration".to_owned())
            };
            match bytes {
                Ok(bytes) => {
                    let stem = format!("{}_{camera}", capture.id);
                    let name = self.names.of(&stem, picture_kind(&bytes).unwrap_or("bin"));
                    put(&self.folder.join(&name), &bytes)?;
                    images.insert(camera.to_owned(), scalar(&name));
                }
                Err(why) => {
                    self.exported.left_out.push(format!("{}, {camera}: {why}", capture.id));
                }
            }
        }
        self.exported.pictures += images.len();
        Ok(images)
    }
}

/// Writes the calibrations; gives their file names by camera.
fn calibrations(
    setup: &Setup,
    folder: &Path,
    names: &mut Names,
) -> Result<BTreeMap<String, String>, ExportError> {
    let mut files = BTreeMap::new();
    for (camera, calibrated) in &setup.cameras {
        let name = names.of(camera, "yaml");
        let text = write_camera_info(&scalar(camera), &calibrated.model);
        put(&folder.join(&name), text.as_bytes())?;
        files.insert(camera.clone(), name);
    }
    Ok(files)
}

fn put(path: &Path, bytes: &[u8]) -> Result<(), ExportError> {
    std::fs::write(path, bytes)
        .map_err(|source| ExportError::NotWritten { path: path.to_owned(), source })
}

fn remove_stale(path: &Path) -> Result<(), ExportError> {
    match std::fs::remove_file(path) {
        Err(source) if source.kind() != ErrorKind::NotFound => {
            Err(ExportError::NotWritten { path: path.to_owned(), source })
        }
        _ => Ok(()),
    }
}

/// `session.yaml` up to the captures.
fn head(title: &str, calibrations: &BTreeMap<String, String>, setup: &Setup) -> String {
    let mut text = format!("version: 1\ntitle: {}\n", scalar(title));
    text += if calibrations.is_empty() { "cameras: {}\n" } else { "cameras:\n" };
    for (camera, file) in calibrations {
        let _ = writeln!(text, "  {}: {{calibration: {}}}", scalar(camera), scalar(file));
    }
    let _ = writeln!(text, "pattern: {PATTERN_FILE}");
    text += &artefact(&setup.artefact);
    if let Some(tie) = &setup.tie_targets {
        let _ = writeln!(text, "tie_targets: {{radius_mm: {}}}", tie.radius_mm);
    }
    if let Some(prior) = &setup.module_prior {
        let _ = writeln!(
            text,
            "module_prior: {{rotation_omega_phi_kappa_deg: {}, within_deg: {}}}",
            triple(prior.rotation_omega_phi_kappa_deg),
            prior.within_deg
        );
    }
    text
}

fn artefact(artefact: &Artefact) -> String {
    let mut text = "artefact:\n".to_owned();
    text += if artefact.targets.is_empty() { "  targets: []\n" } else { "  targets:\n" };
    for t in &artefact.targets {
        let _ = writeln!(
            text,
            "    - {{code: {}, xyz_mm: {}, u_mm: {}, radius_mm: {}}}",
            t.code,
            triple(t.xyz_mm),
            t.u_mm,
            t.radius_mm
        );
    }
    let _ = writeln!(text, "  scale_relative_u: {}", artefact.scale_relative_u);
    text
}

fn triple([x, y, z]: [f64; 3]) -> String {
    format!("[{x}, {y}, {z}]")
}

fn entry(capture: &StoredCapture, images: &BTreeMap<String, String>) -> String {
    format!(
        "  - id: {}\n    setpoints: {}\n    readings: {}\n    images: {}\n",
        scalar(capture.id.as_str()),
        map(&capture.setpoints),
        map(&capture.readings),
        map(images)
    )
}

fn map(values: &BTreeMap<String, impl std::fmt::Display>) -> String {
    let entries: Vec<String> =
        values.iter().map(|(key, value)| format!("{}: {value}", scalar(key))).collect();
    format!("{{{}}}", entries.join(", "))
}

/// A text as YAML: plain where it cannot be taken for anything else, else quoted as in JSON, which
/// YAML reads too.
fn scalar(text: &str) -> String {
    const WORDS: [&str; 8] = ["null", "true", "false", "yes", "no", "on", "off", "nan"];
    let plain = text.starts_with(|c: char| c.is_ascii_alphabetic())
        && text.chars().all(|c| c.is_ascii_alphanumeric() || "_-.".contains(c))
        && text.len() > 1
        && !WORDS.contains(&text.to_lowercase().as_str());
    if plain { text.to_owned() } else { Value::from(text).to_string() }
}

/// Names of files that are safe, and each of which is given once.
struct Names {
    taken: BTreeSet<String>,
}

impl Default for Names {
    fn default() -> Self {
        Self { taken: [SESSION_FILE, PATTERN_FILE].map(str::to_owned).into() }
    }
}

impl Names {
    /// A name close to `stem`; letters' case does not tell names apart, as on some file systems.
    fn of(&mut self, stem: &str, ending: &str) -> String {
        const LONGEST: usize = 100;
        let safe = |c: char| if c.is_ascii_alphanumeric() || "_-".contains(c) { c } else { '_' };
        let stem: String = stem.chars().take(LONGEST).map(safe).collect();
        let mut name = format!("{stem}.{ending}");
        let mut turn = 1;
        while !self.taken.insert(name.to_lowercase()) {
            turn += 1;
            name = format!("{stem}-{turn}.{ending}");
        }
        name
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_are_safe_and_differ() {
        let mut names = Names::default();
        assert_eq!(names.of("p000_cam_a", "jpg"), "p000_cam_a.jpg");
        assert_eq!(names.of("P000_cam_a", "jpg"), "P000_cam_a-2.jpg");
        assert_eq!(names.of("../up", "jpg"), "___up.jpg");
        assert_eq!(names.of("session", "yaml"), "session-2.yaml");
    }

    #[test]
    fn texts_read_back_as_the_texts_they_are() {
        let odd =
            ["a: b", "12", "0x1f", "no", "n", "Null", "", " x", "é # \"q\"\n\\", "{", "-", "~"];
        for text in odd.into_iter().chain(["cam_a", "p000.jpg", "rail test, by hand"]) {
            let yaml = format!("{{{}: {}}}", scalar(text), scalar(text));
            let read: BTreeMap<String, String> = serde_yaml::from_str(&yaml).unwrap();
            assert_eq!(read, BTreeMap::from([(text.to_owned(), text.to_owned())]), "{yaml}");
        }
    }

    #[test]
    fn numbers_read_back_bit_for_bit() {
        let numbers = [0.0, -0.0, 1.0, 0.1, 1.0 / 3.0, 658.020_000_000_1, 1e-9, 1e22, f64::MAX];
        for number in numbers.into_iter().chain([f64::MIN_POSITIVE, -f64::EPSILON]) {
            let yaml = map(&BTreeMap::from([("x_mm".to_owned(), number)]));
            let read: BTreeMap<String, f64> = serde_yaml::from_str(&yaml).unwrap();
            assert_eq!(read["x_mm"].to_bits(), number.to_bits(), "{yaml}");
        }
    }
}
