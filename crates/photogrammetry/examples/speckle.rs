//! Detection in speckle of known contrast and grain: prints a Markdown table of what was found, and
//! writes the pictures (PNG) and the true centres (CSV) where a folder is named, for other programs:
//! `cargo run --release -p beampose-photogrammetry --example speckle -- [FOLDER]`.

use std::error::Error;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::Path;

use beampose_photogrammetry::GrayImage;
use beampose_photogrammetry::detect::{Dot, DotOptions, find_dots};
use nalgebra::Vector2;

#[path = "../src/detect/testing.rs"]
#[expect(dead_code, reason = "shared with the unit tests, which use all of it")]
mod testing;

use testing::{Spot, speckle_cell};

/// Pictures per cell of the table.
const PICTURES: u64 = 4;
/// Dots along a side of a picture.
const COUNT: usize = 11;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1);
    if let Some(folder) = &folder {
        std::fs::create_dir_all(folder)?;
    }
    println!("| contrast | grain px | found of 121 | rms px | stated / true variance |");
    println!("|---|---|---|---|---|");
    for contrast in [0.1, 0.2, 0.35, 0.6] {
        for grain in [0.7, 1.0, 2.0] {
            let mut cell = Cell::default();
            for seed in 0..PICTURES {
                let (image, spots) = speckle_cell(contrast, grain, COUNT, 100 + seed);
                if let Some(folder) = &folder {
                    let name = format!("c{contrast}_g{grain}_{seed}");
                    write(Path::new(folder), &name, &image, &spots)?;
                }
                cell.add(&find_dots(&image, &DotOptions::default()).dots, &spots);
            }
            let [found, rms, ratio] = cell.figures();
            println!("| {contrast} | {grain} | {found:.2} | {rms:.4} | {ratio:.2} |");
        }
    }
    Ok(())
}

/// Sums over the dots of a cell.
#[derive(Default)]
struct Cell {
    found: f64,
    squares: f64,
    stated: f64,
}

impl Cell {
    fn add(&mut self, dots: &[Dot], spots: &[Spot]) {
        for spot in spots {
            let truth = Vector2::from(spot.at);
            let near = |dot: &&Dot| (dot.point.at - truth).norm() < 3.0;
            if let Some(dot) = dots.iter().find(near) {
                self.found += 1.0;
                self.squares += (dot.point.at - truth).norm_squared();
                self.stated += dot.point.covariance.trace();
            }
        }
    }

    /// Dots found per picture, rms of a coordinate in pixels, stated over true variance.
    fn figures(&self) -> [f64; 3] {
        let rms = (self.squares / (2.0 * self.found)).sqrt();
        [self.found / PICTURES as f64, rms, self.stated / self.squares]
    }
}

fn write(
    folder: &Path,
    name: &str,
    image: &GrayImage,
    spots: &[Spot],
) -> Result<(), Box<dyn Error>> {
    let file = BufWriter::new(File::create(folder.join(format!("{name}.png")))?);
    let mut encoder = png::Encoder::new(file, image.width as u32, image.height as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.write_header()?.write_image_data(&image.data)?;
    let mut truth = BufWriter::new(File::create(folder.join(format!("{name}.csv")))?);
    for spot in spots {
        writeln!(truth, "{},{}", spot.at[0], spot.at[1])?;
    }
    Ok(())
}
