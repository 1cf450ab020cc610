//! One method's distances, pass by pass, and what could not be used.

use std::collections::BTreeMap;

use beampose_core::Pose;
use beampose_photogrammetry::solve::Method;

use super::TravelCapture;
use super::uncertainty::Leg;
use crate::numbers::count;

/// A measured distance with the capture that it belongs to.
pub(super) struct Distance<'a> {
    pub capture: &'a TravelCapture,
    pub leg: Leg<'a>,
    /// Travel of the rail by readback, millimetres.
    pub travel_mm: f64,
    /// Measured distance minus that travel, millimetres.
    pub difference_mm: f64,
}

/// All distances of `method`, in the order of the captures, and notes on what was left out.
pub(super) fn distances(
    captures: &[TravelCapture],
    method: Method,
) -> (Vec<Distance<'_>>, Vec<String>) {
    let mut first_of_pass: BTreeMap<u32, &TravelCapture> = BTreeMap::new();
    for capture in captures {
        first_of_pass.entry(capture.pass).or_insert(capture);
    }
    let mut found = Vec::new();
    let mut notes = Vec::new();
    for (pass, first) in &first_of_pass {
        if pose(first, method).is_none() {
            let lost = captures.iter().filter(|c| c.pass == *pass && pose(c, method).is_some());
            notes.push(format!(
                "pass {pass}: no pose at its first stop ({}), so {} of that pass without distance",
                first.id,
                count(lost.count(), "other pose")
            ));
        }
    }
    let broken = captures.iter().filter(|c| is_solved(c, method) && pose(c, method).is_none());
    for capture in broken {
        notes.push(format!("{}: its pose or covariance is not a number; left out", capture.id));
    }
    for capture in captures {
        let Some(first) = first_of_pass.get(&capture.pass) else { continue };
        if let (Some(start), Some(end)) = (pose(first, method), pose(capture, method)) {
            found.push(distance((first, start), (capture, end)));
        }
    }
    (found, notes)
}

fn distance<'a>(
    (first, start): (&'a TravelCapture, &'a Pose),
    (capture, end): (&'a TravelCapture, &'a Pose),
) -> Distance<'a> {
    let leg = Leg { start: (&first.id, start), end: (&capture.id, end) };
    let travel_mm = (capture.readback.get() - first.readback.get()).abs();
    Distance { capture, leg, travel_mm, difference_mm: leg.distance() - travel_mm }
}

/// A pose that can be computed with.
fn pose(capture: &TravelCapture, method: Method) -> Option<&Pose> {
    let pose = capture.poses.get(&method)?.as_ref().ok()?;
    let mut numbers = pose.position_mm.iter().chain(pose.covariance.iter().flatten());
    numbers.all(|x| x.is_finite()).then_some(pose)
}

fn is_solved(capture: &TravelCapture, method: Method) -> bool {
    matches!(capture.poses.get(&method), Some(Ok(_)))
}

/// Groups distances by stop, by increasing setpoint. At a stop that is some passes' first and other
/// passes' later one, the zeros by definition are left out: they say nothing.
pub(super) fn by_stop<'d, 'a>(distances: &'d [Distance<'a>]) -> Vec<Vec<&'d Distance<'a>>> {
    let mut stops: BTreeMap<i64, Vec<&Distance<'a>>> = BTreeMap::new();
    for distance in distances {
        stops.entry(stop_key(distance.capture)).or_default().push(distance);
    }
    for group in stops.values_mut() {
        if group.iter().any(|d| !d.leg.is_first_stop()) {
            group.retain(|d| !d.leg.is_first_stop());
        }
    }
    stops.into_values().collect()
}

/// Setpoints equal to a micrometre are one stop.
fn stop_key(capture: &TravelCapture) -> i64 {
    (capture.setpoint.get() * 1000.0).round() as i64
}
