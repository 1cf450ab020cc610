//! `beampose calibrate sheet`.

use std::path::PathBuf;

use beampose_photogrammetry::print::{dot_page, svg};

use super::Ended;
use crate::camera_calibration::sheet_of;
use crate::cli::targets::deliver;
use crate::output::Exit;

/// Print the sheet of dots that a description names, as SVG to true scale
///
/// On A4 or A3 where it fits, else on a page of its own size, for a plotter. Measure the ruler on the
/// print, and the distance of the outermost dots: what it is goes into `pitch_mm`.
#[derive(clap::Args)]
pub struct Sheet {
    /// The sheet's description (see `beampose help calibrate camera`)
    #[arg(value_name = "SHEET")]
    sheet: PathBuf,
    /// Write the SVG there instead of to standard output
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

impl Sheet {
    pub fn execute(&self) -> Result<Exit, Ended> {
        let (sheet, _) = sheet_of(&self.sheet).map_err(Ended::input)?;
        deliver(&svg(&dot_page(&sheet)), self.out.as_deref())
    }
}
