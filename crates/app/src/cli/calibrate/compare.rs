//! `beampose calibrate compare`.

use std::path::{Path, PathBuf};

use beampose_photogrammetry::calibrate::{Stated, compare, read_stated};
use beampose_photogrammetry::camera::read_camera_info;

use super::{Ended, print_stability, put_stability};
use crate::camera_calibration::text_of;
use crate::output::{Exit, print};

/// Compare calibrations of one camera, in the order in which they were made
///
/// Mean, standard deviation, range and drift of focal length, principal point and distortion; and
/// which change is more than chance against the standard deviations that the files state. Files of
/// other programs state none: then only the scatter is told. The camera was kept on or switched
/// between two calibrations: compare each series by itself.
#[derive(clap::Args)]
pub struct Compare {
    /// camera_info files, two or more
    #[arg(required = true, num_args = 2.., value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Write stability.html and stability.json there
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Compare {
    pub fn execute(&self) -> Result<Exit, Ended> {
        let all: Result<Vec<_>, String> = self.files.iter().map(|path| read(path)).collect();
        let all = all.map_err(Ended::input)?;
        let found = compare(&all).map_err(|error| Ended::input(error.to_string()))?;
        if let Some(folder) = &self.out {
            put_stability(folder, &found)?;
        }
        if self.json {
            print(&beampose_analysis::stability_json(&found).to_string());
        } else {
            print_stability(&found);
            if let Some(folder) = &self.out {
                print(&folder.join("stability.html").display().to_string());
            }
        }
        Ok(Exit::Success)
    }
}

type Named = (String, beampose_photogrammetry::Camera, Option<Stated>);

fn read(path: &Path) -> Result<Named, String> {
    let shown = path.display();
    let text = text_of(path)?;
    let camera = read_camera_info(&text).map_err(|error| format!("{shown}: {error}"))?;
    let stated = read_stated(&text).map_err(|why| format!("{shown}: {why}"))?;
    let name = path.file_stem().map(|name| name.to_string_lossy().into_owned());
    Ok((name.unwrap_or_else(|| shown.to_string()), camera, stated))
}
