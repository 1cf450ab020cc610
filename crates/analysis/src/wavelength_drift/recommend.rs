//! How long to warm up: until no measurement that begins later sees the wavelength change too much.

use super::model::{Course, WithHops};
use super::result::{Recommendation, Settling};

/// Seconds of an hour.
pub(super) const HOUR: f64 = 3600.0;

/// The largest change in a measurement that begins at a reading, and between which times.
#[derive(Clone, Copy)]
struct Change {
    by_nm: f64,
    from: f64,
    to: f64,
}

/// The shortest warm-up after which the wavelength, by its fitted course, changes by at most
/// `settled_within_nm` from the beginning of any measurement to any moment of it. Only measurements
/// that end within the test count. `None` where even the last of them sees more, or none fits.
pub(super) fn recommend(at_s: &[f64], course: &Course, asked: &Settling) -> Option<Recommendation> {
    let changes = changes(at_s, course, asked.measurement_s);
    let too_much = |change: &Change| change.by_nm > asked.settled_within_nm;
    let first = changes.iter().rposition(too_much).map_or(0, |last| last + 1);
    let later = changes.get(first..).filter(|later| !later.is_empty())?;
    let largest = later.iter().max_by(|a, b| a.by_nm.total_cmp(&b.by_nm))?;
    let (begin, end) = (at_s[first], *at_s.last()?);
    let hours = (end - begin) / HOUR;
    let drifted = course.without_hops(end) - course.without_hops(begin);
    let u_largest = course.change_u(largest.from, largest.to, WithHops::Yes);
    let band = at_s[first..].iter().map(|t| course.at(*t));
    Some(Recommendation {
        warm_up_s: begin,
        warm_up_standard_uncertainty_s: warm_up_u(&changes, first, course),
        largest_change_nm: largest.by_nm,
        // Both ends of a change may be off by what the course leaves.
        largest_change_standard_uncertainty_nm: u_largest.hypot(2.0_f64.sqrt() * course.misfit),
        drift_nm_per_hour: drifted / hours,
        drift_standard_uncertainty_nm_per_hour: course
            .change_u(begin, end, WithHops::No)
            .hypot(2.0_f64.sqrt() * course.misfit)
            / hours,
        band_nm: band.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], nm| {
            [low.min(nm), high.max(nm)]
        }),
    })
}

/// For each reading from which a measurement ends within the test, the largest change in it.
fn changes(at_s: &[f64], course: &Course, measurement_s: f64) -> Vec<Change> {
    let Some(end) = at_s.last() else { return Vec::new() };
    let nm: Vec<f64> = at_s.iter().map(|t| course.at(*t)).collect();
    let within = at_s.iter().take_while(|t| *t + measurement_s <= *end);
    let one = |(i, from): (usize, &f64)| {
        let last = from + measurement_s;
        let inside = at_s.iter().zip(&nm).skip(i).take_while(|(t, _)| **t <= last);
        let at_last = course.at(last);
        let ends = inside.map(|(t, nm)| (*t, *nm)).chain([(last, at_last)]);
        let changes =
            ends.map(|(to, there)| Change { by_nm: (there - nm[i]).abs(), from: *from, to });
        changes.fold(Change { by_nm: 0.0, from: *from, to: *from }, |most, change| {
            if change.by_nm > most.by_nm { change } else { most }
        })
    };
    within.enumerate().map(one).collect()
}

/// The uncertainty of a change, by how fast the change itself gets smaller, is that of the time; 0
/// where the wavelength is settled from the first reading on, none where a hop ends the warm-up.
fn warm_up_u(changes: &[Change], first: usize, course: &Course) -> Option<f64> {
    let Some(before) = first.checked_sub(1) else { return Some(0.0) };
    let (last, next) = (changes.get(before)?, changes.get(first)?);
    let hopped = |t: f64| course.hopped(t);
    if hopped(last.to) - hopped(last.from) != hopped(next.to) - hopped(next.from) {
        return None;
    }
    let per_second = (last.by_nm - next.by_nm) / (next.from - last.from);
    let u = course.change_u(next.from, next.to, WithHops::Yes).hypot(course.misfit);
    (per_second > 0.0).then(|| u / per_second)
}
