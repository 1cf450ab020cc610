//! A stored beam-angle calibration as the input of its analysis, and the files of its result.

use std::f64::consts::SQRT_2;
use std::path::Path;

use anyhow::Context as _;
use beampose_analysis::beam_angles::Trace;
use beampose_analysis::{
    BeamAngleLimits, BeamAngles, BeamAnglesInput, InputFile, beam_angles, fan_html, fan_json,
};
use beampose_core::{InstrumentName, Look, Reading, SessionId, StepNumber, StepOutcome};
use beampose_photogrammetry::calibrate::pattern::{
    BudgetSizes, FanOptions, MeasuredAngle, StageAxis, StageGeometry, write_fan_angles,
    write_measured,
};
use beampose_photogrammetry::pattern::write_pattern;
use beampose_photogrammetry::{Order, wavelength};
use beampose_plan::rig::Goniometer;
use beampose_plan::{Accept, Action, Analyse, Plan, Rig, Step, expand, read_rig};
use beampose_store::{Store, StoredReading, StoredStep};

use crate::calibration::wavelength_u_nm;
use crate::pipeline::SOFTWARE;

/// Looks nearer to the pixel than this tell together where the dot is, pixels: as when closing in.
const NEAR_PX: f64 = 2.0;
/// Looks farther apart than this tell how far the dot moves for each unit of the axis, pixels.
const APART_PX: f64 = 5.0;

/// What of a session the analysis needs.
pub struct Angles {
    rig: Rig,
    steps: Vec<Step>,
    stored: Vec<StoredStep>,
    looks: Vec<(StepNumber, Look)>,
    readings: Vec<StoredReading>,
}

/// Reads it, where the plan is of a beam-angle calibration.
///
/// # Errors
/// When the store fails, or the session's rig cannot be read.
pub async fn angles(
    store: &Store,
    id: SessionId,
    plan: Option<&Plan>,
    rig_text: &str,
) -> anyhow::Result<Option<Angles>> {
    let Some(plan) = plan else { return Ok(None) };
    if !matches!(plan.analyse, Some(Analyse::BeamAngles { .. })) {
        return Ok(None);
    }
    let rig = read_rig("stored rig", rig_text.as_bytes())
        .map_err(|faults| anyhow::anyhow!("the session's rig cannot be read:\n{faults}"))?;
    let steps = expand(plan, &rig)
        .map_err(|faults| anyhow::anyhow!("the session's plan cannot be read:\n{faults}"))?;
    let (stored, looks) = (store.steps(id).await?, store.looks(id).await?);
    Ok(Some(Angles { rig, steps, stored, looks, readings: store.readings(id).await? }))
}

/// A dot brought to its pixel.
struct Aligned {
    beam: [i32; 2],
    /// Where the axis would read with the dot exactly there, in its unit.
    at: f64,
    look: Look,
    repeat: u32,
}

impl Angles {
    /// The plan's analysis of it.
    pub fn analysed(&self, plan: &Plan) -> Option<BeamAngles> {
        let Some(Analyse::BeamAngles { wavelength }) = &plan.analyse else { return None };
        let goniometer = self.rig.measurement.goniometer.as_ref()?;
        let aligns = || self.steps.iter().filter_map(|step| self.looks_of(step));
        let traces = aligns().map(|(step, looks, done)| trace(step, &looks, done)).collect();
        let aligned: Vec<Aligned> =
            aligns().filter(|(.., done)| *done).filter_map(|(s, l, _)| aligned(s, &l)).collect();
        let wavelength = wavelength.as_ref().map(|sensor| &sensor.value);
        let measured =
            aligned.windows(2).filter_map(|two| self.angle(&two[0], &two[1], wavelength)).collect();
        let (options, sizes) = self.declared(goniometer, wavelength.is_some());
        let limits = limits(&plan.accept);
        Some(beam_angles(BeamAnglesInput { measured, options, sizes, traces, limits }))
    }

    /// The looks of a closing-in that was begun, and whether it came to its end.
    fn looks_of<'a>(&'a self, step: &'a Step) -> Option<(&'a Step, Vec<Look>, bool)> {
        matches!(step.action, Action::Align { .. }).then_some(())?;
        let of_step = self.looks.iter().filter(|(number, _)| *number == step.number);
        let looks: Vec<Look> = of_step.map(|(_, look)| *look).collect();
        let stored = self.stored.iter().find(|stored| stored.number == step.number)?;
        (!looks.is_empty()).then(|| (step, looks, stored.outcome == StepOutcome::Done))
    }

    /// The angle between two dots that were brought to the pixel one after the other, where they are
    /// neighbours.
    fn angle(
        &self,
        from: &Aligned,
        to: &Aligned,
        wavelength: Option<&InstrumentName>,
    ) -> Option<MeasuredAngle> {
        let apart = [0, 1].map(|i| (to.beam[i] - from.beam[i]).abs());
        let axis = match apart {
            [1, 0] => StageAxis::Horizontal,
            [0, 1] => StageAxis::Vertical,
            _ => return None,
        };
        let order = |[m, n]: [i32; 2]| Order { m, n };
        let middle =
            f64::midpoint(from.look.at.monotonic.as_secs_f64(), to.look.at.monotonic.as_secs_f64());
        let read = wavelength.and_then(|sensor| self.nearest(sensor, middle));
        Some(MeasuredAngle {
            from: order(from.beam),
            to: order(to.beam),
            axis,
            repeat: to.repeat,
            angle: (to.at - from.at).abs().to_radians(),
            u: None,
            wavelength_nm: read.map(|reading| reading.value),
            // What single readings scatter by is far below what they share.
            u_wavelength_nm: 0.0,
        })
    }

    fn nearest(&self, sensor: &InstrumentName, at_s: f64) -> Option<&Reading> {
        let away = |reading: &Reading| (reading.at.monotonic.as_secs_f64() - at_s).abs();
        let of_sensor = self.readings.iter().filter(|row| row.instrument == *sensor);
        of_sensor.map(|row| &row.reading).min_by(|a, b| away(a).total_cmp(&away(b)))
    }

    /// Geometry and uncertainties as the rig declares them.
    fn declared(
        &self,
        goniometer: &Goniometer,
        wavelength_is_read: bool,
    ) -> (FanOptions, BudgetSizes) {
        let [across, along, _] = goniometer.misalignment_u.map(|u| u.0);
        let [dot_across, dot_height] = goniometer.dot_u.map(|u| u.0);
        let axis = self.rig.instruments.get(&goniometer.axis.value);
        let encoder = match axis {
            Some(beampose_plan::Instrument::RotaryAxis(axis)) => axis.u.map_or(0.0, |u| u.0),
            _ => 0.0,
        };
        // Of the difference of two readings, and the same each time that a pair is measured: the stage
        // stands at the same places of its graduation.
        let u_stage = SQRT_2 * encoder.to_radians();
        // Unread, it is anywhere in what a diode drifts by.
        let u_wavelength_nm = if wavelength_is_read {
            wavelength_u_nm(&self.rig).unwrap_or(wavelength::UNSTATED_U_NM)
        } else {
            FanOptions::default().u_wavelength_nm
        };
        let options = FanOptions {
            geometry: StageGeometry::aligned(goniometer.distance.0),
            u_offset: [across, along],
            u_wavelength_nm,
            u_stage,
            ..FanOptions::default()
        };
        let sizes = BudgetSizes {
            angle: 0.0,
            distance: goniometer.distance.0,
            stage_reading: u_stage,
            offset_across: across,
            offset_along: along,
            dot_across,
            dot_height,
            wavelength: u_wavelength_nm / options.reference_wavelength_nm,
        };
        (options, sizes)
    }
}

fn trace(step: &Step, looks: &[Look], closed: bool) -> Trace {
    let Action::Align { dot, target_px, px_per_unit, .. } = &step.action else {
        return Trace { step: step.number.0, beam: [0, 0], closed, off_px: Vec::new() };
    };
    let off = |look: &Look| look.dot_px.map(|at| along(at, *target_px, *px_per_unit));
    Trace { step: step.number.0, beam: *dot, closed, off_px: looks.iter().map(off).collect() }
}

/// Where the axis reads with the dot at its pixel: what the looks near it say together.
fn aligned(step: &Step, looks: &[Look]) -> Option<Aligned> {
    let Action::Align { dot, target_px, px_per_unit, .. } = &step.action else { return None };
    let places: Vec<(f64, f64)> = looks
        .iter()
        .filter_map(|look| Some((look.read, along(look.dot_px?, *target_px, *px_per_unit))))
        .collect();
    let near: Vec<&(f64, f64)> = places.iter().filter(|place| place.1.abs() < NEAR_PX).collect();
    let (first, last) = (places.first()?, places.last()?);
    let rough = f64::hypot(px_per_unit[0], px_per_unit[1]);
    let is_apart = (last.1 - first.1).abs() > APART_PX;
    let gain = if is_apart { (last.1 - first.1) / (last.0 - first.0) } else { rough };
    let at = near.iter().map(|(read, off)| read - off / gain).sum::<f64>() / near.len() as f64;
    let repeat = step.context.values().next().copied().unwrap_or(1.0);
    at.is_finite().then_some(Aligned {
        beam: *dot,
        at,
        look: *looks.last()?,
        // Loop counters are small whole numbers.
        repeat: repeat as u32,
    })
}

/// How far a dot stands from its pixel along the way that the axis moves it, pixels.
fn along(at: [f64; 2], target: [f64; 2], way: [f64; 2]) -> f64 {
    let off = [0, 1].map(|i| at[i] - target[i]);
    (off[0] * way[0] + off[1] * way[1]) / f64::hypot(way[0], way[1])
}

fn limits(accept: &Accept) -> BeamAngleLimits {
    let Some(limits) = &accept.beam_angles else { return BeamAngleLimits::default() };
    BeamAngleLimits {
        max_standard_deviation: limits.max_standard_deviation,
        max_standard_uncertainty: limits.max_standard_uncertainty,
    }
}

/// The angles that a session measured, as a file, and that file as an input.
pub fn measured_csv(angles: &BeamAngles, session: SessionId) -> (String, InputFile) {
    let csv = write_measured(&angles.input.measured);
    let blake3 = blake3::hash(csv.as_bytes()).to_hex().to_string();
    (csv, InputFile { name: format!("measured.csv of session {session}"), blake3 })
}

/// Writes `measured.csv` and, where there is a fan, `fan.yaml`, `fan_angles.csv`, `fan.json` and
/// `fan.html` into a report's folder.
///
/// # Errors
/// Which file cannot be written.
pub fn write_fan(angles: &BeamAngles, session: SessionId, folder: &Path) -> anyhow::Result<()> {
    let put = |name: &str, text: &str| {
        let path = folder.join(name);
        std::fs::write(&path, text).with_context(|| format!("{} cannot be written", path.display()))
    };
    let (csv, input) = measured_csv(angles, session);
    put("measured.csv", &csv)?;
    let inputs = [input];
    if let Some(fan) = angles.fan("fan", &inputs, format!("session {session}"), SOFTWARE) {
        put("fan.yaml", &write_pattern(&fan.found.pattern))?;
        put("fan_angles.csv", &write_fan_angles(&fan.found.angles))?;
        put("fan.json", &serde_json::to_string_pretty(&fan_json(&fan))?)?;
        put("fan.html", &fan_html(&fan))?;
    }
    Ok(())
}
