//! `beampose calibrate`: cameras, the sheets to calibrate them with, and the fan of beams.

mod camera;
mod compare;
mod pattern;
mod sheet;

use std::path::Path;

use anyhow::Context as _;
use beampose_analysis::{stability_html, stability_json, stability_verdict};
use beampose_photogrammetry::calibrate::Stability;

use super::Ended;
use crate::output::{Exit, print};

/// Calibrate cameras and the fan of beams, compare calibrations, print the sheet
#[derive(clap::Args)]
pub struct Calibrate {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    Camera(camera::Camera),
    Compare(compare::Compare),
    Pattern(Box<pattern::Pattern>),
    Sheet(sheet::Sheet),
}

impl Calibrate {
    pub async fn execute(&self) -> Result<Exit, Ended> {
        match &self.command {
            Command::Camera(camera) => camera.execute().await,
            Command::Compare(compare) => compare.execute(),
            Command::Pattern(pattern) => pattern.execute().await,
            Command::Sheet(sheet) => sheet.execute(),
        }
    }
}

/// Writes a file into a folder, which is made.
fn put(folder: &Path, name: &str, text: &str) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder)
        .with_context(|| format!("the folder {} cannot be made", folder.display()))?;
    let path = folder.join(name);
    std::fs::write(&path, text).with_context(|| format!("{} cannot be written", path.display()))
}

/// Writes the page and the JSON of a comparison.
fn put_stability(folder: &Path, found: &Stability) -> anyhow::Result<()> {
    put(folder, "stability.html", &stability_html(found))?;
    put(folder, "stability.json", &serde_json::to_string_pretty(&stability_json(found))?)
}

/// The comparison as a table in the terminal.
fn print_stability(found: &Stability) {
    let mut table = comfy_table::Table::new();
    table.load_preset(comfy_table::presets::NOTHING);
    table.set_header(["", "mean", "std. dev.", "range", "drift", "verdict"]);
    for p in &found.parameters {
        table.add_row([
            p.parameter.to_string(),
            digits(p.mean, 6),
            digits(p.scatter, 2),
            digits(p.range, 2),
            digits(p.drift, 2),
            stability_verdict(p).to_owned(),
        ]);
    }
    print(&format!(
        "{} calibrations, focal length and principal point in pixels",
        found.names.len()
    ));
    print(&table.to_string());
    print(&format!("scatter of the principal point: {:.3} px", found.principal_point_px));
}

/// So many significant digits.
fn digits(value: f64, count: u32) -> String {
    let exponent = value.abs().max(1e-9).log10().floor();
    let places = (f64::from(count) - 1.0 - exponent).clamp(0.0, 12.0) as usize;
    format!("{value:.places$}")
}
