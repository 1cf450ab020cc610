//! `beampose calibrate pattern`.

mod session;
mod told;

use std::path::{Path, PathBuf};

use beampose_analysis::{FanReport, fan_html, fan_json};
use beampose_photogrammetry::calibrate::pattern::{
    BudgetSizes, FanCalibration, FanModel, FanOptions, MeasuredAngle, StageGeometry, budget,
    calibrate_fan, read_measured, write_fan_angles,
};

use self::told::in_words;
use super::super::{Database, close};
use super::camera::{is_file_name, named};
use super::{Ended, put};
use crate::calibration_record::of_stage;
use crate::camera_calibration::{input, text_of};
use crate::output::{Exit, print};
use crate::pipeline::SOFTWARE;

/// Draws of each line of the budget: its root mean square is then good to half a percent.
const DRAWS: usize = 20_000;

/// Calibrate the fan of beams from angles that were measured on a rotation stage, or from sessions
///
/// CSV is a file with one line a measurement under a heading that names the columns in any order:
/// `from_m`, `from_n` (the beam that stood at the reference place: m to the right, n down), `to_m`,
/// `to_n` (the beam that the stage brought there), `axis` (`horizontal`, or `vertical` where the module
/// is rolled by a quarter turn), `repeat` (a number for each repetition of a pair), `angle_deg` (how far
/// the stage turned; its sign does not count); and optional `u_deg` (its standard uncertainty),
/// `wavelength_nm` (in vacuum, read at it), `u_wavelength_nm` (of that reading alone).
///
/// Empty lines and what follows `#` are passed over. Each angle is corrected to the reference
/// wavelength: direction cosines scale with it (d sin theta = m lambda). Repetitions are averaged. Two
/// models are fitted, weighted: pitch and radial term on a plane, and a tilted crossed grating with two
/// periods; what all angles share (wavelength, misalignment of the grating from the stage's axis) is
/// estimated with what is known of it as prior.
///
/// Into the folder --out go NAME.yaml (the pattern, as rigs and `solve --with-pattern` take it),
/// NAME_angles.csv (all angles between neighbours with their standard uncertainties), NAME.json (all
/// of it, with the covariance of the parameters) and NAME.html; the calibration is recorded in the
/// database too, with what it was made from (`beampose calibrations`).
///
/// With --session no stage is needed: the photographs of stored sessions, solved before, are adjusted
/// together with the fan's common scale and each beam's error as unknowns, and the fan is read out of
/// it, as a table. What is known of the fan before is what its pattern states, or little (--nominal).
/// Sessions in which the module moves but never turns before one flat wall hardly tell the common
/// scale; the stated uncertainty then says so.
#[derive(clap::Args)]
pub struct Pattern {
    /// The measured angles
    #[arg(value_name = "CSV", required_unless_present = "session")]
    measured: Option<PathBuf>,
    /// Stored sessions instead, of one module and one set of cameras
    #[arg(long, value_name = "SESSION", num_args = 1.., conflicts_with = "measured")]
    session: Vec<String>,
    /// With --session: nothing is known of the fan but its data sheet, 1 % of the scale and 0.05
    /// degrees of each beam
    #[arg(long, requires = "session")]
    nominal: bool,
    /// With --session: standard uncertainty of the common scale before, in percent
    #[arg(long, value_name = "PERCENT", requires = "session", value_parser = above_zero)]
    u_scale_percent: Option<f64>,
    /// With --session: standard uncertainty of each beam before
    #[arg(long, value_name = "DEG", requires = "session", value_parser = above_zero)]
    u_beam_deg: Option<f64>,
    /// The fan's name [default: that of the file, or fan]
    #[arg(long)]
    name: Option<String>,
    /// Columns and rows of the fan, both odd
    #[arg(long, value_name = "COLUMNSxROWS", default_value = "11x11", value_parser = size)]
    size: [u32; 2],
    /// Wavelength in vacuum at which the result holds
    #[arg(long, value_name = "NM", default_value_t = 658.0, value_parser = wavelength)]
    reference_nm: f64,
    /// Model to take [default: what the angles say]
    #[arg(long, value_name = "radial-grid|grating", value_parser = model)]
    model: Option<FanModel>,
    /// Distance of the plane on which the pitch is stated
    #[arg(long, value_name = "MM", default_value_t = 1000.0, value_parser = above_zero)]
    grid_mm: f64,
    /// Distance from the stage's axis to the plane
    #[arg(long, value_name = "MM", default_value_t = 5000.0, value_parser = above_zero)]
    plane_mm: f64,
    /// Where the grating is known to stand off the axis: to the right, towards the plane, up
    #[arg(long, value_name = "X,Y,Z", default_value = "0,0,0", value_parser = triple, allow_hyphen_values = true)]
    offset_mm: [f64; 3],
    /// Standard uncertainty of that, to the right and towards the plane
    #[arg(long, value_name = "X,Y", default_value = "1,1", value_parser = pair)]
    u_offset_mm: [f64; 2],
    /// Estimate the misalignment to the right from the angles alone; the one towards the plane they do
    /// not show
    #[arg(long)]
    estimate_misalignment: bool,
    /// Known tilt of the module against the plane of the turn: upwards, and rolled about the middle beam
    #[arg(long, value_name = "UP,ROLL", default_value = "0,0", value_parser = tilt, allow_hyphen_values = true)]
    tilt_deg: [f64; 2],
    /// Standard uncertainty that all wavelengths share [default: 0.02 where they are read, 0.4 where
    /// not]
    #[arg(long, value_name = "NM", value_parser = not_below_zero)]
    u_wavelength_nm: Option<f64>,
    /// Standard uncertainty of an angle that states none [default: what the repetitions scatter by]
    #[arg(long, value_name = "DEG", value_parser = above_zero)]
    u_angle_deg: Option<f64>,
    /// Standard uncertainty of the right angle between the rows and columns of the grating
    #[arg(long, value_name = "DEG", default_value_t = 0.05, value_parser = not_below_zero)]
    u_square_deg: f64,
    /// Standard uncertainty of the difference of two readings of the stage that all repetitions of a
    /// pair share: its graduation
    #[arg(long, value_name = "DEG", default_value_t = 0.0005, value_parser = not_below_zero)]
    u_stage_deg: f64,
    /// For the budget: of the second dot's place, along the turn and in height
    #[arg(long, value_name = "ALONG,HEIGHT", default_value = "0.1,1", value_parser = pair)]
    u_dot_mm: [f64; 2],
    /// For the budget: seed of the draws
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Where to write
    #[arg(long, value_name = "FOLDER", default_value = "calibrations")]
    out: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

impl Pattern {
    pub async fn execute(&self) -> Result<Exit, Ended> {
        match &self.measured {
            Some(path) => self.of_stage(path).await,
            None => self.of_sessions().await,
        }
    }

    async fn of_stage(&self, path: &Path) -> Result<Exit, Ended> {
        let name = self.name.clone().unwrap_or_else(|| named(path));
        if !is_file_name(&name) {
            return Err(Ended::input(format!("`{name}` is no name for files: --name gives one")));
        }
        let text = text_of(path).map_err(Ended::input)?;
        let shown = path.display();
        let measured =
            read_measured(&text).map_err(|error| Ended::input(format!("{shown}:{error}")))?;
        let was_read = measured.iter().all(|a| a.wavelength_nm.is_some());
        let options = self.options(was_read);
        let found = calibrate_fan(&measured, &options)
            .map_err(|error| Ended::input(format!("{shown}: {error}")))?;
        let sizes = self.sizes(&found, &options);
        let report = FanReport {
            name,
            found: &found,
            options: &options,
            budget: &budget(&sizes, DRAWS, self.seed),
            sizes: &sizes,
            measurements: measured.len(),
            wavelength_was_read: was_read,
            inputs: &[input(path, text.as_bytes())],
            command: self.command(&options),
            software: SOFTWARE.to_owned(),
        };
        self.tell(&report, &measured).await
    }

    fn options(&self, was_read: bool) -> FanOptions {
        let unread = if was_read { 0.02 } else { 0.4 };
        let [across, along] = self.u_offset_mm;
        let across = if self.estimate_misalignment { f64::INFINITY } else { across };
        FanOptions {
            size: self.size,
            reference_wavelength_nm: self.reference_nm,
            grid_distance: self.grid_mm,
            geometry: StageGeometry {
                distance: self.plane_mm,
                offset: self.offset_mm,
                tilt: self.tilt_deg.map(f64::to_radians),
            },
            u_offset: [across, along],
            u_wavelength_nm: self.u_wavelength_nm.unwrap_or(unread),
            u_angle: self.u_angle_deg.map(f64::to_radians),
            u_stage: self.u_stage_deg.to_radians(),
            non_orthogonality: self.u_square_deg.to_radians(),
            model: self.model,
        }
    }

    /// The budget is that of the mean angle between neighbours.
    fn sizes(&self, found: &FanCalibration, options: &FanOptions) -> BudgetSizes {
        let [along, height] = self.u_dot_mm;
        let neighbours = found.angles.iter().filter(|a| {
            let (dm, dn) = (a.pair.b.m - a.pair.a.m, a.pair.b.n - a.pair.a.n);
            (dm, dn) == (1, 0) || (dm, dn) == (0, 1)
        });
        let all: Vec<f64> = neighbours.map(|a| a.angle).collect();
        BudgetSizes {
            angle: all.iter().sum::<f64>() / all.len().max(1) as f64,
            distance: self.plane_mm,
            stage_reading: self.u_stage_deg.to_radians(),
            offset_across: self.u_offset_mm[0],
            offset_along: self.u_offset_mm[1],
            dot_across: along,
            dot_height: height,
            wavelength: options.u_wavelength_nm / options.reference_wavelength_nm,
        }
    }

    /// Records the calibration, writes its files and says what came out.
    async fn tell(
        &self,
        report: &FanReport<'_>,
        measured: &[MeasuredAngle],
    ) -> Result<Exit, Ended> {
        let (name, found) = (&report.name, report.found);
        let record = of_stage(report, Vec::new());
        let store = self.database.open().await?;
        store.record_calibration(&record).await?;
        close(store).await;
        let mut json = fan_json(report);
        json["calibration"] = record.head.blake3.as_str().into();
        put(&self.out, &format!("{name}.yaml"), &record.content)?;
        put(&self.out, &format!("{name}_angles.csv"), &write_fan_angles(&found.angles))?;
        put(&self.out, &format!("{name}.json"), &serde_json::to_string_pretty(&json)?)?;
        put(&self.out, &format!("{name}.html"), &fan_html(report))?;
        if self.json {
            print(&json.to_string());
        } else {
            print(&in_words(report, measured.len()));
            print(&crate::calibration_record::told(&record));
            print(&self.out.join(format!("{name}.html")).display().to_string());
        }
        Ok(Exit::Success)
    }

    /// What the result depends on, as it would be typed.
    fn command(&self, options: &FanOptions) -> String {
        let list = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
        let [columns, rows] = self.size;
        let mut text = format!(
            "--size {columns}x{rows} --reference-nm {} --grid-mm {} --plane-mm {} --offset-mm={} \
             --u-offset-mm {} --tilt-deg={} --u-wavelength-nm {} --u-square-deg {} --u-stage-deg {} \
             --u-dot-mm {} --seed {}",
            self.reference_nm,
            self.grid_mm,
            self.plane_mm,
            list(&self.offset_mm),
            list(&self.u_offset_mm),
            list(&self.tilt_deg),
            options.u_wavelength_nm,
            self.u_square_deg,
            self.u_stage_deg,
            list(&self.u_dot_mm),
            self.seed
        );
        if self.estimate_misalignment {
            text.push_str(" --estimate-misalignment");
        }
        if let Some(model) = self.model {
            text.push_str(&format!(" --model {}", model.name()));
        }
        if let Some(u) = self.u_angle_deg {
            text.push_str(&format!(" --u-angle-deg {u}"));
        }
        text
    }
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let told = || "expected COLUMNSxROWS, odd numbers from 3 to 201, as 11x11".to_owned();
    let (columns, rows) = text.split_once('x').ok_or_else(told)?;
    let odd = |text: &str| text.parse::<u32>().ok().filter(|n| n % 2 == 1 && (3..=201).contains(n));
    Ok([odd(columns).ok_or_else(told)?, odd(rows).ok_or_else(told)?])
}

fn model(text: &str) -> Result<FanModel, String> {
    let known = FanModel::ALL.map(FanModel::name).join(" or ");
    FanModel::ALL.into_iter().find(|m| m.name() == text).ok_or_else(|| format!("expected {known}"))
}

fn finite(text: &str) -> Result<f64, String> {
    let number = text.trim().parse::<f64>().ok().filter(|n| n.is_finite());
    number.ok_or_else(|| format!("expected a number, found `{text}`"))
}

fn wavelength(text: &str) -> Result<f64, String> {
    let nm = finite(text)?;
    if (200.0..=2000.0).contains(&nm) { Ok(nm) } else { Err("expected 200 to 2000".to_owned()) }
}

fn above_zero(text: &str) -> Result<f64, String> {
    let number = finite(text)?;
    if number > 0.0 { Ok(number) } else { Err("expected more than 0".to_owned()) }
}

fn not_below_zero(text: &str) -> Result<f64, String> {
    let number = finite(text)?;
    if number >= 0.0 { Ok(number) } else { Err("expected 0 or more".to_owned()) }
}

fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let all: Result<Vec<f64>, String> = text.split(',').map(finite).collect();
    <[f64; N]>::try_from(all?).map_err(|_| format!("expected {N} numbers with commas between"))
}

fn pair(text: &str) -> Result<[f64; 2], String> {
    let both = numbers::<2>(text)?;
    if both.iter().all(|n| *n >= 0.0) { Ok(both) } else { Err("expected 0 or more".to_owned()) }
}

fn tilt(text: &str) -> Result<[f64; 2], String> {
    let both = numbers::<2>(text)?;
    if both.iter().all(|n| n.abs() <= 45.0) {
        Ok(both)
    } else {
        Err("expected 45 at most".to_owned())
    }
}

fn triple(text: &str) -> Result<[f64; 3], String> {
    numbers::<3>(text)
}
