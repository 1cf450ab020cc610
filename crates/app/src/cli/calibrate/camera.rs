//! `beampose calibrate camera`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use beampose_analysis::{CalibrationReport, calibration_html, calibration_json};
use beampose_photogrammetry::calibrate::{Coverage, Stated, Unknowns, compare};
use beampose_store::Store;

use super::super::{Database, close};
use super::{Ended, digits, print_stability, put, put_stability};
use crate::calibration_record::{of_sheet, told};
use crate::camera_calibration::{Calibrated, Method, Source, calibrate};
use crate::output::{Exit, complain, print};
use crate::pipeline::SOFTWARE;

/// Calibrate a camera from pictures of a sheet of dots, or from points that another program found
///
/// Each SOURCE is a folder with pictures (JPEG or PNG, about twelve, from several sides, tilted and
/// rolled) and `sheet.yaml`, or a CSV file of points. The sheet:
///
///     version: 1
///     rows: 8
///     columns: 10
///     pitch_mm: 25
///     dot_diameter_mm: 15
///     control_marks:     # optional: ring-coded targets that fix the orientation
///       - {code: 45, x_mm: 50, y_mm: 75, radius_mm: 3}
///
/// x runs along the rows and y down the columns, from the first dot. `beampose calibrate sheet`
/// prints it. The CSV has a heading with the columns `image`, `x_px`, `y_px` and `board_x_mm`,
/// `board_y_mm` (or `board_x_square`, `board_y_square`, see --square-mm), in any order; the centre of
/// the top-left pixel is (0, 0).
///
/// Into the folder --out go NAME.yaml (ROS `camera_info`, as rigs take it, with a section on what it
/// is worth), NAME.json and NAME.html; it is recorded in the database too (`beampose calibrations`).
/// Several sources, calibrations of one camera in the order in
/// which they were made, are compared as `beampose calibrate compare` does.
#[derive(clap::Args)]
pub struct Camera {
    /// Folders with pictures, or CSV files
    #[arg(required = true, value_name = "FOLDER|CSV")]
    sources: Vec<PathBuf>,
    /// The sheet's description [default: sheet.yaml beside the pictures]
    #[arg(long, value_name = "FILE")]
    sheet: Option<PathBuf>,
    /// The camera's name [default: that of the folder or file]; with several sources they are
    /// numbered
    #[arg(long)]
    name: Option<String>,
    /// What is estimated, with commas: f (one focal length) or fx,fy; cx,cy; k1,k2,k3; p1,p2. What is
    /// not is held at --start, or else at no distortion and the middle of the picture
    #[arg(long, value_name = "LIST", default_value = "fx,fy,cx,cy,k1,k2,p1,p2,k3")]
    estimate: Unknowns,
    /// A camera_info file to start from and to hold values of
    #[arg(long, value_name = "FILE")]
    start: Option<PathBuf>,
    /// Leave out points whose residual is longer than this many sigma; without it every point counts
    #[arg(long, value_name = "SIGMAS", value_parser = limit)]
    reject: Option<f64>,
    /// Size of the pictures of a CSV file, as 640x480
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
    size: Option<[usize; 2]>,
    /// Size of a square of a CSV file in squares, millimetres; the camera does not depend on it
    #[arg(long, value_name = "MM", default_value_t = 1.0, value_parser = square)]
    square_mm: f64,
    /// Where to write
    #[arg(long, value_name = "FOLDER", default_value = "calibrations")]
    out: PathBuf,
    /// Print one JSON object for each calibration, and one for the comparison
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

impl Camera {
    pub async fn execute(&self) -> Result<Exit, Ended> {
        let method = Method {
            sheet: self.sheet.clone(),
            unknowns: self.estimate.clone(),
            start: self.start.clone(),
            reject: self.reject,
            size: self.size,
            square_mm: self.square_mm,
        };
        let names = self.names()?;
        let mut all = Vec::new();
        let mut store: Option<Arc<Store>> = None;
        for (path, name) in self.sources.iter().zip(names) {
            let source = Source { path: path.clone(), name };
            let found = calibrate(&source, &method).map_err(Ended::input)?;
            // Of a broken input nothing is made, no database either.
            let store = match &mut store {
                Some(store) => store,
                None => store.insert(self.database.open().await?),
            };
            self.tell(store, &source.name, &found).await?;
            let unknowns: Vec<_> = found.result.unknowns.iter().collect();
            let rows = found.result.covariance.row_iter();
            let covariance = rows.map(|r| r.iter().copied().collect()).collect();
            let stated = Stated { parameters: unknowns, covariance };
            all.push((source.name, found.result.camera, Some(stated)));
        }
        if let Some(store) = store {
            close(store).await;
        }
        if all.len() > 1 {
            let stability = compare(&all).map_err(|error| Ended::input(error.to_string()))?;
            put_stability(&self.out, &stability)?;
            if self.json {
                print(&beampose_analysis::stability_json(&stability).to_string());
            } else {
                print_stability(&stability);
                print(&self.out.join("stability.html").display().to_string());
            }
        }
        Ok(Exit::Success)
    }

    /// A name for each source, no two alike.
    fn names(&self) -> Result<Vec<String>, Ended> {
        let several = self.sources.len() > 1;
        let names: Vec<String> = match &self.name {
            Some(name) if several => {
                (1..=self.sources.len()).map(|i| format!("{name}_{i}")).collect()
            }
            Some(name) => vec![name.clone()],
            None => self.sources.iter().map(|path| named(path)).collect(),
        };
        if let Some(bad) = names.iter().find(|n| !is_file_name(n)) {
            return Err(Ended::input(format!("`{bad}` is no name for files: --name gives one")));
        }
        let repeated = names.iter().enumerate().find(|(i, n)| names[..*i].contains(n));
        if let Some((_, name)) = repeated {
            let help = "--name gives one that is numbered";
            return Err(Ended::input(format!("two sources are called {name}\n  help: {help}")));
        }
        Ok(names)
    }

    /// Records a calibration, writes its files and says what came out.
    async fn tell(&self, store: &Store, name: &str, found: &Calibrated) -> Result<(), Ended> {
        let coverage = Coverage::of(&found.result.camera, &found.result.views);
        let report = CalibrationReport {
            name: name.to_owned(),
            found: &found.result,
            coverage: &coverage,
            left_out: &found.left_out,
            inputs: &found.inputs,
            options: self.options(),
            software: SOFTWARE.to_owned(),
        };
        let record = of_sheet(&report);
        store.record_calibration(&record).await?;
        let mut json = calibration_json(&report);
        json["calibration"] = record.head.blake3.as_str().into();
        put(&self.out, &format!("{name}.yaml"), &record.content)?;
        put(&self.out, &format!("{name}.html"), &calibration_html(&report))?;
        put(&self.out, &format!("{name}.json"), &serde_json::to_string_pretty(&json)?)?;
        if self.json {
            print(&json.to_string());
        } else {
            print(&in_words(name, found));
            print(&told(&record));
            print(&self.out.join(format!("{name}.html")).display().to_string());
        }
        for one in &found.left_out {
            complain(&format!("{name}: {} is left out: {}", one.name, one.reason));
        }
        Ok(())
    }

    fn options(&self) -> String {
        let unknowns: Vec<&str> = self.estimate.iter().map(|u| u.name()).collect();
        let mut text = format!("--estimate {}", unknowns.join(","));
        if let Some(limit) = self.reject {
            text.push_str(&format!(" --reject {limit}"));
        }
        if let Some(start) = &self.start {
            text.push_str(&format!(" --start {}", start.display()));
        }
        text
    }
}

fn in_words(name: &str, found: &Calibrated) -> String {
    let result = &found.result;
    let mut lines = vec![format!(
        "{name}: {} pictures, {} points, RMS of a point {:.4} px, sigma of a coordinate {:.4} px",
        result.views.len(),
        result.points(),
        result.rms_px,
        result.sigma0_px
    )];
    for unknown in result.unknowns.iter() {
        let sigma = result.standard_deviation(unknown).unwrap_or(f64::NAN);
        let unit = if unknown.is_in_pixels() { " px" } else { "" };
        let value = digits(unknown.of(&result.camera), 7);
        lines.push(format!("  {unknown:<3} {value:>13}  sigma {}{unit}", digits(sigma, 4)));
    }
    lines.join("\n")
}

/// The name of a folder, or of a file without its ending.
pub(super) fn named(path: &Path) -> String {
    let whole = path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
    let part = if whole.is_dir() { whole.file_name() } else { whole.file_stem() };
    part.map_or_else(|| "camera".to_owned(), |name| name.to_string_lossy().into_owned())
}

/// A name that makes files in a folder, and stands unquoted in YAML.
pub(super) fn is_file_name(name: &str) -> bool {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "_-.".contains(c);
    !name.is_empty() && !name.starts_with(['.', '-']) && name.chars().all(is_plain)
}

fn size(text: &str) -> Result<[usize; 2], String> {
    let told = || "expected WIDTHxHEIGHT in pixels, as 640x480".to_owned();
    let (width, height) = text.split_once('x').ok_or_else(told)?;
    let number = |text: &str| text.parse::<usize>().ok().filter(|n| (1..=100_000).contains(n));
    Ok([number(width).ok_or_else(told)?, number(height).ok_or_else(told)?])
}

fn square(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|mm| mm.is_finite() && *mm > 0.0);
    number.ok_or_else(|| "expected a length above 0, in millimetres".to_owned())
}

fn limit(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|limit| *limit >= 3.0);
    number.ok_or_else(|| "expected a number of 3 or more: below it good points are lost".to_owned())
}
