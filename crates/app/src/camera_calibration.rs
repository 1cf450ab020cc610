//! From a folder of pictures or a file of points to a calibrated camera.

use std::path::{Path, PathBuf};

use beampose_analysis::{InputFile, LeftOut};
use beampose_photogrammetry::calibrate::{
    SelfCalibration, Sheet, Unknowns, View, find_sheet, read_observations, read_sheet,
    self_calibrate, self_calibrate_robustly, start_camera,
};
use beampose_photogrammetry::camera::read_camera_info;
use beampose_photogrammetry::{Camera, decode};
use beampose_plan::source::unreadable;
use rayon::prelude::*;

/// The description that is looked for beside the pictures.
const SHEET_FILE: &str = "sheet.yaml";
/// Fewer pictures leave too little to check anything by.
const LEAST_PICTURES: usize = 3;

/// Where the points come from.
pub struct Source {
    /// A folder of pictures, or a file of points.
    pub path: PathBuf,
    /// The calibration's name.
    pub name: String,
}

/// How it is calibrated.
pub struct Method {
    /// The sheet's description, if it is not beside the pictures.
    pub sheet: Option<PathBuf>,
    /// What is estimated.
    pub unknowns: Unknowns,
    /// A calibration to start from.
    pub start: Option<PathBuf>,
    /// Points beyond so many sigma are left out.
    pub reject: Option<f64>,
    /// Size of the pictures, for a file of points.
    pub size: Option<[usize; 2]>,
    /// Size of a square, for a file of points in squares.
    pub square_mm: f64,
}

/// What came of it.
pub struct Calibrated {
    /// The camera.
    pub result: SelfCalibration,
    /// Pictures that could not be used.
    pub left_out: Vec<LeftOut>,
    /// The files that went in.
    pub inputs: Vec<InputFile>,
}

/// What was seen of a sheet.
struct Seen {
    views: Vec<View>,
    size: [usize; 2],
    left_out: Vec<LeftOut>,
    inputs: Vec<InputFile>,
}

/// Calibrates.
///
/// # Errors
/// What is wrong with which file, or why the points give no camera, for people.
pub fn calibrate(source: &Source, method: &Method) -> Result<Calibrated, String> {
    let start = method.start.as_deref().map(read_start).transpose()?;
    let seen = if source.path.is_dir() {
        in_pictures(&source.path, method)?
    } else {
        in_file(&source.path, method, start.as_ref())?
    };
    let shown = source.path.display();
    let said =
        |error: beampose_photogrammetry::calibrate::CalibrationError| format!("{shown}: {error}");
    if let Some(start) = start.filter(|s| [s.width, s.height] != seen.size) {
        let [width, height] = seen.size;
        return Err(format!(
            "{shown}: the pictures have {width} x {height} pixels, --start is for {} x {}",
            start.width, start.height
        ));
    }
    let start = match start {
        Some(start) => start,
        None => start_camera(&seen.views, seen.size).map_err(said)?,
    };
    let result = match method.reject {
        Some(limit) => self_calibrate_robustly(&seen.views, &start, &method.unknowns, limit),
        None => self_calibrate(&seen.views, &start, &method.unknowns),
    };
    Ok(Calibrated { result: result.map_err(said)?, left_out: seen.left_out, inputs: seen.inputs })
}

fn read_start(path: &Path) -> Result<Camera, String> {
    read_camera_info(&text_of(path)?).map_err(|error| format!("{}: {error}", path.display()))
}

fn bytes_of(path: &Path) -> Result<Vec<u8>, String> {
    let shown = path.display().to_string();
    std::fs::read(path).map_err(|error| unreadable(&shown, &error).to_string())
}

/// A file as text.
///
/// # Errors
/// Why it cannot be read, for people.
pub fn text_of(path: &Path) -> Result<String, String> {
    String::from_utf8(bytes_of(path)?)
        .map_err(|error| format!("{}: it is not UTF-8: {error}", path.display()))
}

/// A file as a report names it.
pub fn input(path: &Path, bytes: &[u8]) -> InputFile {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned());
    InputFile { name: name.unwrap_or_default(), blake3: blake3::hash(bytes).to_hex().to_string() }
}

/// A sheet's description.
///
/// # Errors
/// What is wrong with it, for people.
pub fn sheet_of(path: &Path) -> Result<(Sheet, InputFile), String> {
    let text = text_of(path)?;
    let sheet = read_sheet(&text).map_err(|error| format!("{}: {error}", path.display()))?;
    Ok((sheet, input(path, text.as_bytes())))
}

fn in_file(path: &Path, method: &Method, start: Option<&Camera>) -> Result<Seen, String> {
    let text = text_of(path)?;
    let shown = path.display();
    let views =
        read_observations(&text, method.square_mm).map_err(|error| format!("{shown}:{error}"))?;
    let of_start = start.map(|s| [s.width, s.height]);
    let size = method.size.or(of_start).ok_or_else(|| {
        format!("{shown}: points do not tell the size of the pictures\n  help: --size 640x480")
    })?;
    // The half pixel around the border's centres belongs to the picture.
    let is_inside = |v: f64, size: usize| v >= -0.5 && v <= size as f64 - 0.5;
    for view in &views {
        let outside = view
            .points
            .iter()
            .find(|p| !(is_inside(p.pixel.x, size[0]) && is_inside(p.pixel.y, size[1])));
        if let Some(point) = outside {
            return Err(format!(
                "{shown}: {}: the point ({}, {}) is outside of {} x {} pixels",
                view.name, point.pixel.x, point.pixel.y, size[0], size[1]
            ));
        }
    }
    Ok(Seen { views, size, left_out: Vec::new(), inputs: vec![input(path, text.as_bytes())] })
}

/// A picture read, and what it shows.
struct Shot {
    input: InputFile,
    size: [usize; 2],
    view: Result<View, String>,
}

fn in_pictures(folder: &Path, method: &Method) -> Result<Seen, String> {
    let beside = folder.join(SHEET_FILE);
    let (sheet, sheet_input) = sheet_of(method.sheet.as_ref().unwrap_or(&beside))?;
    let paths = pictures(folder)?;
    // In the order of the names, whoever is done first.
    let shots: Result<Vec<Shot>, String> =
        paths.par_iter().map(|path| shot(path, &sheet)).collect();
    let shots = shots?;
    let size = same_size(folder, &shots)?;
    let mut seen =
        Seen { views: Vec::new(), size, left_out: Vec::new(), inputs: vec![sheet_input] };
    for shot in shots {
        match shot.view {
            Ok(view) => seen.views.push(view),
            Err(reason) => seen.left_out.push(LeftOut { name: shot.input.name.clone(), reason }),
        }
        seen.inputs.push(shot.input);
    }
    if seen.views.len() < LEAST_PICTURES {
        let reasons = seen.left_out.iter().map(|l| format!("\n  {}: {}", l.name, l.reason));
        return Err(format!(
            "{}: the sheet is seen in {} of {} pictures, at least {LEAST_PICTURES} are needed{}",
            folder.display(),
            seen.views.len(),
            paths.len(),
            reasons.collect::<String>()
        ));
    }
    Ok(seen)
}

/// The pictures of a folder, by their names' endings, in the order of their names.
fn pictures(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let shown = folder.display().to_string();
    let said = |error: std::io::Error| unreadable(&shown, &error).to_string();
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(said)? {
        let path = entry.map_err(said)?.path();
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        if ending.is_some_and(|e| ["jpg", "jpeg", "png"].contains(&e.as_str())) {
            paths.push(path);
        }
    }
    paths.sort();
    if paths.is_empty() {
        return Err(format!("{shown}: there is no JPEG or PNG picture in it"));
    }
    Ok(paths)
}

fn shot(path: &Path, sheet: &Sheet) -> Result<Shot, String> {
    let bytes = bytes_of(path)?;
    let input = input(path, &bytes);
    Ok(match decode(&bytes) {
        Ok(image) => {
            let view = find_sheet(&input.name, &image, sheet);
            Shot { input, size: [image.width, image.height], view }
        }
        Err(error) => Shot { input, size: [0, 0], view: Err(error.to_string()) },
    })
}

/// The size of all pictures that could be decoded: one camera makes one size.
fn same_size(folder: &Path, shots: &[Shot]) -> Result<[usize; 2], String> {
    let mut sized = shots.iter().filter(|s| s.size != [0, 0]);
    let Some(first) = sized.next() else {
        return Err(format!("{}: none of the pictures can be read", folder.display()));
    };
    match sized.find(|s| s.size != first.size) {
        Some(other) => Err(format!(
            "{}: {} has {} x {} pixels, {} {} x {}: not from one camera, or turned by a program",
            folder.display(),
            other.input.name,
            other.size[0],
            other.size[1],
            first.input.name,
            first.size[0],
            first.size[1]
        )),
        None => Ok(first.size),
    }
}
