//! From readings to the result.

use beampose_photogrammetry::Pattern;

use super::allan::overlapping;
use super::effect::BeamAngles;
use super::hops::{self, Step, modes};
use super::judge::{judge, noise_note, too_few};
use super::model::Course;
use super::recommend::{HOUR, recommend};
use super::result::{
    AllanSegment, DriftLimitsApplied, ModeHop, PointMark, RoomAir, SeriesPoint, Settling,
    SteadyDrift, WarmUp, WavelengthDriftResult,
};
use super::series::Series;
use super::{Sample, WavelengthDriftInput, temperature};
use crate::COVERAGE_FACTOR;
use crate::fit::LineFit;
use crate::verdict::Verdict;

/// Fewer readings than this say nothing of a course.
const LEAST: usize = 30;
/// An evenly sampled part shorter than this has no Allan deviation.
const LEAST_EVEN: usize = 16;

/// A wavelength drift: what was found, and the readings with what was made of each.
#[derive(Debug, Clone, PartialEq)]
pub struct WavelengthDrift {
    /// What was found.
    pub result: WavelengthDriftResult,
    /// The readings of the stretch of light that was analysed.
    pub series: Vec<SeriesPoint>,
    /// What a rig says of the line of wavelength over temperature; filled in by who knows the sensors'
    /// names.
    pub rig_lines: Option<String>,
}

/// Analyses a wavelength drift.
#[must_use]
pub fn wavelength_drift(input: &WavelengthDriftInput<'_>) -> WavelengthDrift {
    let (from, to, notes) = longest_light(input);
    let all = Series::between(&input.wavelength, from, to);
    let noise = all.noise();
    let strays = all.strays(noise);
    let used = all.without(&strays);
    let hops = hops::find(&used, noise);
    let course = if used.len() < LEAST { None } else { Course::fit(&used, &hops) };
    let Some(course) = course else { return nothing(input, &all, notes) };
    let mut found = Found { input, used: &used, hops: &hops, course: &course, notes };
    let degc = |samples: &[Sample]| Series::between(samples, from, to);
    let (diode, room) = (degc(&input.diode_temperature), degc(&input.room_temperature));
    let mut result = found.result(noise, &diode, &room);
    result.stray_readings = strays.len();
    (result.verdict, result.reasons) = judge(&result);
    let series = points(&all, &strays, &found, &result, [&diode, &room]);
    WavelengthDrift { result, series, rig_lines: None }
}

/// The longest stretch of light, as seconds of the session, and what is said of the others.
fn longest_light(input: &WavelengthDriftInput<'_>) -> (f64, f64, Vec<String>) {
    let mut notes = Vec::new();
    let Some(first) = input.wavelength.first() else { return (0.0, f64::INFINITY, notes) };
    let mut begins = input.light_on_s.clone();
    begins.sort_by(f64::total_cmp);
    if begins.first().is_none_or(|begin| *begin > first.at_s) {
        notes
            .push("when the light came on is not known; times count from the first reading".into());
        begins.insert(0, first.at_s);
    }
    let ends = begins.iter().skip(1).copied().chain([f64::INFINITY]);
    let stretches: Vec<(f64, f64)> = begins.iter().copied().zip(ends).collect();
    let length = |stretch: &(f64, f64)| {
        let inside = input.wavelength.iter().filter(|s| s.at_s >= stretch.0 && s.at_s < stretch.1);
        inside.map(|s| s.at_s - stretch.0).fold(0.0, f64::max)
    };
    let read = stretches.iter().filter(|s| length(s) > 0.0).count();
    let longest = stretches.into_iter().fold(None, |longest: Option<(f64, f64)>, next| {
        longest.filter(|l| length(l) >= length(&next)).or(Some(next))
    });
    if read > 1 {
        let text = "the light was switched off in between: the longest of";
        notes.push(format!("{text} {read} stretches is analysed, from cold to its end"));
    }
    let (from, to) = longest.unwrap_or((first.at_s, f64::INFINITY));
    (from, to, notes)
}

/// What is known once the course is.
struct Found<'a> {
    input: &'a WavelengthDriftInput<'a>,
    used: &'a Series,
    hops: &'a [Step],
    course: &'a Course,
    notes: Vec<String>,
}

impl Found<'_> {
    fn result(&mut self, noise: f64, diode: &Series, room: &Series) -> WavelengthDriftResult {
        let (input, course, at_s) = (self.input, self.course, &self.used.at_s);
        let mut result = bare(input, self.used, noise);
        result.warm_up = course.warm_up().map(|[(amplitude, u), (tau, u_tau)]| WarmUp {
            time_constant_s: tau,
            time_constant_standard_uncertainty_s: u_tau,
            // The exponential falls from its amplitude to zero.
            rise_nm: -amplitude,
            rise_standard_uncertainty_nm: u,
        });
        let (drift, u) = course.drift();
        result.steady_drift = Some(SteadyDrift {
            drift_nm_per_hour: drift * HOUR,
            standard_uncertainty_nm_per_hour: u * HOUR,
            misfit_nm: course.misfit,
        });
        result.recommendation = recommend(at_s, course, &result.settling);
        if !diode.at_s.is_empty() {
            match temperature::coefficient(self.used, self.hops, course, diode) {
                Ok(coefficient) => result.temperature = Some(coefficient),
                Err(reason) => self.notes.push(format!("no temperature coefficient: {reason}")),
            }
        }
        result.room = room_air(room);
        result.hops = self.hops.iter().map(|hop| self.hop(hop)).collect();
        result.allan = self.allan();
        self.effects(&mut result, input.pattern);
        if let Some(stated) = result.stated_standard_uncertainty_nm.filter(|u| noise > 1.5 * u) {
            self.notes.push(noise_note(noise, stated));
        }
        result.notes = std::mem::take(&mut self.notes);
        result
    }

    fn hop(&self, step: &Step) -> ModeHop {
        let (before, behind) = (self.used.at_s[step.after], self.used.at_s[step.after + 1]);
        ModeHop {
            at_s: f64::midpoint(before, behind),
            // Anywhere between two readings: rectangular.
            at_standard_uncertainty_s: (behind - before) / 12.0_f64.sqrt(),
            by_nm: step.by_nm,
            by_standard_uncertainty_nm: step.u_nm,
            significance: (step.by_nm / step.u_nm).abs(),
        }
    }

    fn allan(&self) -> Vec<AllanSegment> {
        let course = self.course;
        let stepped = |i: usize| self.used.value[i] - course.hopped(self.used.at_s[i]);
        let segment = |part: std::ops::Range<usize>| {
            let values: Vec<f64> = part.clone().map(stepped).collect();
            let span = self.used.at_s[part.end - 1] - self.used.at_s[part.start];
            let interval_s = span / (part.len() - 1) as f64;
            let points = overlapping(&values, interval_s);
            AllanSegment { interval_s, readings: part.len(), points }
        };
        self.used.even_parts(LEAST_EVEN).into_iter().map(segment).collect()
    }

    /// What the changes do to angles and position, at the wavelength of the end.
    fn effects(&self, result: &mut WavelengthDriftResult, pattern: &Pattern) {
        use super::model::WithHops;
        let (at_s, course) = (&self.used.at_s, self.course);
        let Some(end) = at_s.last() else { return };
        result.beams = BeamAngles::of(pattern, course.at(*end));
        let Some(beams) = &result.beams else { return };
        let by = |a: &&f64, b: &&f64| course.at(**a).total_cmp(&course.at(**b));
        if let (Some(low), Some(high)) = (at_s.iter().min_by(by), at_s.iter().max_by(by)) {
            let u = course.change_u(*low, *high, WithHops::Yes).hypot(course.misfit);
            let change = course.at(*high) - course.at(*low);
            result.whole_test = Some(beams.effect(change, u, result.distance_mm));
        }
        result.after_warm_up = result.recommendation.map(|left| {
            let u = left.largest_change_standard_uncertainty_nm;
            beams.effect(left.largest_change_nm, u, result.distance_mm)
        });
    }
}

fn room_air(room: &Series) -> Option<RoomAir> {
    let points: Vec<(f64, f64)> =
        room.at_s.iter().zip(&room.value).map(|(t, degc)| (t / HOUR, *degc)).collect();
    let line = LineFit::through(&points)?;
    Some(RoomAir {
        mean_degc: points.iter().map(|p| p.1).sum::<f64>() / points.len() as f64,
        drift_degc_per_hour: line.slope,
        drift_standard_uncertainty_degc_per_hour: line.slope_error?,
    })
}

/// A result that says what was asked, and nothing of what was found.
fn bare(input: &WavelengthDriftInput<'_>, used: &Series, noise: f64) -> WavelengthDriftResult {
    let ends = [used.at_s.first(), used.at_s.last()];
    WavelengthDriftResult {
        experiment: "wavelength-drift".to_owned(),
        verdict: Verdict::Inconclusive,
        reasons: Vec::new(),
        readings: used.len(),
        span_s: ends.map(|t| t.copied().unwrap_or(0.0)),
        noise_nm: noise,
        stray_readings: 0,
        stated_standard_uncertainty_nm: input
            .wavelength
            .iter()
            .find_map(|s| s.standard_uncertainty),
        warm_up: None,
        steady_drift: None,
        recommendation: None,
        temperature: None,
        room: None,
        hops: Vec::new(),
        allan: Vec::new(),
        beams: None,
        whole_test: None,
        after_warm_up: None,
        distance_mm: input.distance.get(),
        settling: Settling {
            settled_within_nm: input.settled_within.get(),
            measurement_s: input.measurement.get(),
        },
        limits: DriftLimitsApplied::of(&input.limits),
        coverage_factor: COVERAGE_FACTOR,
        notes: Vec::new(),
    }
}

/// Of too few readings.
fn nothing(input: &WavelengthDriftInput<'_>, all: &Series, notes: Vec<String>) -> WavelengthDrift {
    let mut result = bare(input, all, all.noise());
    (result.verdict, result.reasons) = too_few(all.len());
    result.notes = notes;
    let point = |(at_s, nm): (&f64, &f64)| SeriesPoint {
        at_s: *at_s,
        wavelength_nm: *nm,
        fitted_nm: f64::NAN,
        diode_degc: None,
        room_degc: None,
        mode: 0,
        mark: PointMark::WarmingUp,
    };
    let series = all.at_s.iter().zip(&all.value).map(point).collect();
    WavelengthDrift { result, series, rig_lines: None }
}

fn points(
    all: &Series,
    strays: &[usize],
    found: &Found<'_>,
    result: &WavelengthDriftResult,
    temperatures: [&Series; 2],
) -> Vec<SeriesPoint> {
    let modes = modes(found.used.len(), found.hops);
    let settled = result.recommendation.map_or(f64::INFINITY, |r| r.warm_up_s);
    let mut kept = 0;
    let point = |i: usize| {
        let at_s = all.at_s[i];
        let is_stray = strays.binary_search(&i).is_ok();
        let here = kept.min(modes.len().saturating_sub(1));
        let mode = modes.get(here).copied().unwrap_or(0);
        let is_first = kept > 0 && modes.get(kept - 1).is_some_and(|before| *before != mode);
        kept += usize::from(!is_stray);
        let mark = match () {
            () if is_stray => PointMark::Stray,
            () if is_first => PointMark::Hop,
            () if at_s >= settled => PointMark::Settled,
            () => PointMark::WarmingUp,
        };
        let read = |series: &Series| nearest(series, at_s, all.interval(i));
        SeriesPoint {
            at_s,
            wavelength_nm: all.value[i],
            fitted_nm: found.course.at(at_s),
            diode_degc: read(temperatures[0]),
            room_degc: read(temperatures[1]),
            mode,
            mark,
        }
    };
    (0..all.len()).map(point).collect()
}

/// The reading nearest to a time, unless it is another time's.
fn nearest(series: &Series, at_s: f64, interval: f64) -> Option<f64> {
    let behind = series.at_s.partition_point(|t| *t < at_s);
    let around = [behind.checked_sub(1), Some(behind)].into_iter().flatten();
    let away = |i: &usize| (series.at_s[*i] - at_s).abs();
    let near = around.filter(|i| *i < series.len()).min_by(|a, b| away(a).total_cmp(&away(b)))?;
    (away(&near) <= interval / 2.0).then(|| series.value[near])
}
