//! `session.yaml` and the files that it names, in: every fault at once, with its place.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use beampose_core::{CaptureId, InstrumentName, UsedFile};
use beampose_photogrammetry::camera::read_camera_info;
use beampose_photogrammetry::pattern::{read_pattern_with, read_table};
use beampose_photogrammetry::scene::{RING_BITS, canonical_code};
use beampose_photogrammetry::{
    Artefact, ArtefactTarget, CalibratedCamera, Camera, InteriorSigma, ModulePrior, Pattern, Setup,
    TieTargets, wavelength,
};
use beampose_plan::source::text;
use beampose_plan::{Fault, Faults, Mark, Source};
use serde::Deserialize;
use serde_yaml::{Location, Spanned};

use crate::{Folder, SESSION_FILE};

/// Standard uncertainty of the focal length, by the focal length: 1.6 um of 6 mm, the published
/// repeatability of the calibration.
const FOCAL_RELATIVE_U: f64 = 1.6e-3 / 6.0;

/// Of the principal point (x, y), by the focal length: 1.4 and 0.6 um of 6 mm.
const PRINCIPAL_POINT_RELATIVE_U: [f64; 2] = [1.4e-3 / 6.0, 0.6e-3 / 6.0];

/// Fewer targets define no frame.
const LEAST_TARGETS: usize = 3;

/// A session that another program acquired.
pub struct ForeignSession {
    /// Its title.
    pub title: String,
    /// What solving needs.
    pub setup: Setup,
    /// The files of its calibrations and pattern.
    pub files: Vec<UsedFile>,
    /// Its captures, in the file's order.
    pub captures: Vec<ForeignCapture>,
    /// `session.yaml` as it stands.
    pub text: String,
}

/// One of its captures; the pictures are still in the folder.
pub struct ForeignCapture {
    /// Its name.
    pub id: CaptureId,
    /// Keyed as `rail_mm`.
    pub setpoints: BTreeMap<String, f64>,
    /// Keyed as `wavelength_nm`.
    pub readings: BTreeMap<String, f64>,
    /// The pictures' file names, in the order of the cameras' names.
    pub pictures: Vec<(InstrumentName, String)>,
}

#[derive(Deserialize)]
struct AnyVersion {
    version: Spanned<u64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SessionFile {
    #[expect(dead_code, reason = "it is read on its own, before the rest")]
    version: u64,
    title: String,
    cameras: BTreeMap<String, CameraFile>,
    pattern: Spanned<String>,
    artefact: ArtefactFile,
    tie_targets: Option<Spanned<TieTargets>>,
    module_prior: Option<Spanned<ModulePrior>>,
    captures: Vec<CaptureFile>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    calibration: Spanned<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ArtefactFile {
    targets: Spanned<Vec<Spanned<ArtefactTarget>>>,
    scale_relative_u: Spanned<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CaptureFile {
    id: Spanned<String>,
    setpoints: Option<BTreeMap<String, f64>>,
    readings: Option<BTreeMap<String, f64>>,
    images: BTreeMap<String, Spanned<String>>,
}

/// Reads `session.yaml`, the calibrations and the pattern; of the pictures it sees to it that they
/// are there.
///
/// # Errors
/// Everything that is wrong.
pub fn read(folder: &Folder) -> Result<ForeignSession, Faults> {
    let source = source(folder, SESSION_FILE)?;
    let file = parse(&source)?;
    let (faults, files) = (Faults::default(), Vec::new());
    let mut reader = Reader { folder, source: &source, faults, files };
    let cameras = reader.cameras(&file.cameras);
    let pattern = reader.pattern(&file.pattern);
    let artefact = reader.artefact(&file.artefact);
    let tie_targets = file.tie_targets.map(|t| reader.tie_targets(&t));
    let module_prior = file.module_prior.map(|p| reader.module_prior(&p));
    let captures = reader.captures(&file.captures, &file.cameras);
    let Reader { faults, files, .. } = reader;
    let Some(pattern) = pattern.filter(|_| faults.is_empty()) else {
        return Err(faults);
    };
    let setup = Setup {
        cameras,
        pattern,
        artefact,
        tie_targets,
        module_prior,
        wavelength_u_nm: wavelength::UNSTATED_U_NM,
        wavelength_by_temperature: None,
    };
    let text = source.text().to_owned();
    Ok(ForeignSession { title: file.title, setup, files, captures, text })
}

fn source(folder: &Folder, name: &str) -> Result<Source, Fault> {
    let shown = folder.shown(name);
    let bytes = folder.bytes(name).map_err(|why| Fault::of_file(&shown, why))?;
    text(&shown, Ok(bytes))
}

/// The version first: what another version means, this program cannot say.
fn parse(source: &Source) -> Result<SessionFile, Fault> {
    let syntax = |error: &serde_yaml::Error| {
        let error = error.without_snippet();
        let said = error.to_string();
        let first = said.lines().next().unwrap_or_default();
        let first = first.split(" at line ").next().unwrap_or(first);
        source.error(error.location().map(point).unwrap_or_default(), first)
    };
    let any: AnyVersion = serde_yaml::from_str(source.text()).map_err(|error| syntax(&error))?;
    if any.version.value != 1 {
        let message = format!("version is {}, this program reads version 1", any.version.value);
        return Err(source.error(mark(&any.version), message));
    }
    serde_yaml::from_str(source.text()).map_err(|error| syntax(&error))
}

fn mark<T>(spanned: &Spanned<T>) -> Mark {
    let at = spanned.referenced;
    let length = u32::try_from(at.span().len()).unwrap_or(u32::MAX);
    Mark { length: length.max(1), ..point(at) }
}

fn point(location: Location) -> Mark {
    let small = |n: u64| u32::try_from(n).unwrap_or(u32::MAX);
    Mark { line: small(location.line()), column: small(location.column()), length: 1 }
}

/// A calibration from elsewhere does not say what it is worth: as published, by the focal length.
fn calibrated(model: Camera) -> CalibratedCamera {
    let sigma = InteriorSigma {
        focal_px: FOCAL_RELATIVE_U * model.fx,
        principal_point_px: PRINCIPAL_POINT_RELATIVE_U.map(|u| u * model.fx),
    };
    CalibratedCamera { model, sigma }
}

/// Collects the faults of a session. Numbers are finite: the YAML reader refuses others.
struct Reader<'a> {
    folder: &'a Folder,
    source: &'a Source,
    faults: Faults,
    files: Vec<UsedFile>,
}

impl Reader<'_> {
    fn fault<T>(&mut self, at: &Spanned<T>, message: impl Into<String>) {
        self.faults.push(self.source.error(mark(at), message));
    }

    fn require<T>(&mut self, holds: bool, at: &Spanned<T>, message: &str) {
        if !holds {
            self.fault(at, message);
        }
    }

    /// The text of a file that the session names.
    fn named(&mut self, name: &Spanned<String>, what: &str) -> Option<Source> {
        if let Err(why) = self.folder.check(&name.value) {
            self.fault(name, format!("{what} `{}`: {why}", name.value));
            return None;
        }
        match source(self.folder, &name.value) {
            Ok(source) => Some(source),
            Err(fault) => {
                self.faults.push(fault);
                None
            }
        }
    }

    fn cameras(
        &mut self,
        files: &BTreeMap<String, CameraFile>,
    ) -> BTreeMap<String, CalibratedCamera> {
        if files.is_empty() {
            self.faults.push(Fault::of_file(self.source.name(), "there are no cameras"));
        }
        let mut cameras = BTreeMap::new();
        for (name, file) in files {
            let Some(text) = self.named(&file.calibration, "calibration") else { continue };
            match read_camera_info(text.text()) {
                Ok(model) => {
                    cameras.insert(name.clone(), calibrated(model));
                    let camera = InstrumentName(name.clone());
                    self.files.push(UsedFile::of(
                        Some(&camera),
                        &file.calibration.value,
                        text.text(),
                    ));
                }
                Err(error) => self.faults.push(Fault::of_file(text.name(), error.to_string())),
            }
        }
        cameras
    }

    fn pattern(&mut self, name: &Spanned<String>) -> Option<Pattern> {
        let text = self.named(name, "pattern")?;
        let folder = self.folder;
        let read = read_pattern_with(text.text(), |file, size| {
            let beside = Path::new(&name.value).with_file_name(file);
            let path = if Path::new(file).is_absolute() { Path::new(file) } else { &beside };
            let table = path.display().to_string();
            let bytes = folder.bytes(&table).map_err(|why| format!("table `{file}`: {why}"))?;
            let text = String::from_utf8(bytes).map_err(|error| format!("{file}: {error}"))?;
            read_table(file, &text, size)
        });
        match read {
            Ok(pattern) => {
                self.files.push(UsedFile::of(None, &name.value, text.text()));
                Some(pattern)
            }
            Err(error) => {
                self.faults.push(Fault::of_file(text.name(), error.to_string()));
                None
            }
        }
    }

    fn artefact(&mut self, file: &ArtefactFile) -> Artefact {
        let targets = &file.targets;
        if targets.value.len() < LEAST_TARGETS {
            let found = targets.value.len();
            let message = format!(
                "expected at least {LEAST_TARGETS} targets to define the frame, found {found}"
            );
            self.fault(targets, message);
        }
        let mut codes = BTreeSet::new();
        for target in &targets.value {
            self.target(target);
            if !codes.insert(target.value.code) {
                self.fault(target, format!("code {} repeats", target.value.code));
            }
        }
        let u = &file.scale_relative_u;
        self.require(u.value >= 0.0, u, "scale_relative_u must not be below 0");
        Artefact {
            targets: targets.value.iter().map(|t| t.value).collect(),
            scale_relative_u: u.value,
        }
    }

    fn target(&mut self, target: &Spanned<ArtefactTarget>) {
        let ArtefactTarget { code, u_mm, radius_mm, .. } = target.value;
        let last = (1u16 << RING_BITS) - 2;
        if !(1..=last).contains(&code) {
            self.fault(target, format!("a code is from 1 to {last}, found {code}"));
        } else if canonical_code(code) != code {
            let smallest = canonical_code(code);
            let message = format!("code {code} is not the smallest of its rotations");
            let fault = self.source.error(mark(target), message);
            self.faults.push(fault.help(format!("the same ring reads {smallest}")));
        }
        self.require(u_mm > 0.0, target, "u_mm must be above 0");
        self.require(radius_mm > 0.0, target, "radius_mm must be above 0");
    }

    fn tie_targets(&mut self, tie: &Spanned<TieTargets>) -> TieTargets {
        self.require(tie.value.radius_mm > 0.0, tie, "radius_mm must be above 0");
        tie.value
    }

    fn module_prior(&mut self, prior: &Spanned<ModulePrior>) -> ModulePrior {
        self.require(prior.value.within_deg > 0.0, prior, "within_deg must be above 0");
        prior.value
    }

    fn captures(
        &mut self,
        files: &[CaptureFile],
        cameras: &BTreeMap<String, CameraFile>,
    ) -> Vec<ForeignCapture> {
        let mut ids = BTreeSet::new();
        let mut captures = Vec::new();
        for file in files {
            let id = &file.id.value;
            self.require(!id.trim().is_empty(), &file.id, "a capture needs an id");
            if !ids.insert(id) {
                self.fault(&file.id, format!("capture {id} repeats"));
            }
            for (camera, image) in &file.images {
                self.image(camera, image, cameras);
            }
            captures.push(ForeignCapture {
                id: CaptureId(id.clone()),
                setpoints: file.setpoints.clone().unwrap_or_default(),
                readings: file.readings.clone().unwrap_or_default(),
                pictures: file
                    .images
                    .iter()
                    .map(|(camera, image)| (InstrumentName(camera.clone()), image.value.clone()))
                    .collect(),
            });
        }
        captures
    }

    fn image(
        &mut self,
        camera: &str,
        image: &Spanned<String>,
        cameras: &BTreeMap<String, CameraFile>,
    ) {
        if !cameras.contains_key(camera) {
            let known: Vec<&str> = cameras.keys().map(String::as_str).collect();
            let fault = self.source.error(mark(image), format!("there is no camera `{camera}`"));
            self.faults.push(fault.help(format!("there is {}", known.join(", "))));
        }
        if let Err(why) = self.folder.check(&image.value) {
            self.fault(image, format!("picture `{}`: {why}", image.value));
        }
    }
}
