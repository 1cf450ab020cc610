//! `beampose targets`.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use beampose_photogrammetry::detect::usable_codes;
use beampose_photogrammetry::print::{
    Paper, Style, TargetSheet, check_code, room, svg, target_page,
};

use super::Ended;
use crate::output::{Exit, print};

/// Print a sheet of ring-coded targets, as SVG to true scale
///
/// Each target has its code printed small beside it. The ruler at the bottom shows whether the print
/// has its true size. Codes are 12 bits, named by the smallest of their rotations; those that serve
/// badly (few changes around the ring, or alike when turned) are refused.
#[derive(clap::Args)]
pub struct Targets {
    /// Codes and ranges of codes, as 45,75,101-150; of a range those that serve [default: as many as
    /// there is room for, from the lowest]
    #[arg(long, value_name = "LIST")]
    codes: Option<String>,
    /// Radius of the centre disc, millimetres; the ring reaches to three times that
    #[arg(long, value_name = "MM", default_value_t = 6.0)]
    radius_mm: f64,
    /// Paper
    #[arg(long, value_enum, default_value_t = PaperName::A4)]
    page: PaperName,
    /// Turn the paper on its side
    #[arg(long)]
    landscape: bool,
    /// Targets across [default: as many as fit]
    #[arg(long, value_name = "N")]
    columns: Option<usize>,
    /// Targets down [default: as many as fit]
    #[arg(long, value_name = "N")]
    rows: Option<usize>,
    /// Colours
    #[arg(long, value_enum, default_value_t = StyleName::DarkOnLight)]
    style: StyleName,
    /// Write the SVG there instead of to standard output
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum PaperName {
    A4,
    A3,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum StyleName {
    DarkOnLight,
    LightOnDark,
}

impl Targets {
    pub fn execute(&self) -> Result<Exit, Ended> {
        let mut sheet = self.empty();
        let told = |error: beampose_photogrammetry::print::TargetSheetError| {
            Ended::input(error.to_string())
        };
        sheet.codes = match &self.codes {
            Some(list) => codes(list).map_err(Ended::input)?,
            None => {
                let room = room(&sheet).map_err(told)?;
                usable_codes().into_iter().take(room).collect()
            }
        };
        deliver(&svg(&target_page(&sheet).map_err(told)?), self.out.as_deref())
    }

    /// The sheet without its codes.
    fn empty(&self) -> TargetSheet {
        let paper = match self.page {
            PaperName::A4 => Paper::A4,
            PaperName::A3 => Paper::A3,
        };
        let [width, height] = paper.size_mm();
        TargetSheet {
            codes: Vec::new(),
            radius_mm: self.radius_mm,
            style: match self.style {
                StyleName::DarkOnLight => Style::DarkOnLight,
                StyleName::LightOnDark => Style::LightOnDark,
            },
            paper,
            size_mm: if self.landscape { [height, width] } else { [width, height] },
            columns: self.columns,
            rows: self.rows,
        }
    }
}

/// A list of codes and ranges.
fn codes(list: &str) -> Result<Vec<u16>, String> {
    let mut codes = Vec::new();
    for part in list.split(',').map(str::trim) {
        let number = |text: &str| {
            let text = text.trim();
            text.parse::<u32>().map_err(|_| format!("`{text}` in --codes is no whole number"))
        };
        if let Some((first, last)) = part.split_once('-') {
            let range = number(first)?..=number(last)?;
            let of_range = usable_codes().into_iter().filter(|c| range.contains(&u32::from(*c)));
            let before = codes.len();
            codes.extend(of_range);
            if codes.len() == before {
                return Err(format!("no code of {part} serves"));
            }
        } else {
            codes.push(check_code(number(part)?).map_err(|error| error.to_string())?);
        }
    }
    Ok(codes)
}

/// To a file, whose name is then printed, or to standard output.
///
/// # Errors
/// That it cannot be written.
pub fn deliver(text: &str, out: Option<&Path>) -> Result<Exit, Ended> {
    match out {
        Some(path) => {
            let shown = path.display();
            std::fs::write(path, text).with_context(|| format!("{shown} cannot be written"))?;
            print(&shown.to_string());
        }
        None => print(text.trim_end()),
    }
    Ok(Exit::Success)
}
