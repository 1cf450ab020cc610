//! The values of a sweep.

use beampose_core::instrument::AxisUnit;

use super::file::SweepFile;
use crate::fault::{At, Mark};
use crate::quantity::AxisPosition;
use crate::reader::{Maybe, Reader};

/// More stops than this are a slip of the finger.
const MAX_VALUES: f64 = 10_000.0;
/// So much of a step may be missing at the end, for the rounding of numbers in tenths.
const TOLERANCE: f64 = 1e-6;

/// The values, or `None` after noting why there are none.
pub(super) fn values(
    sweep: &SweepFile,
    mark: Mark,
    reader: &mut Reader,
) -> Option<Vec<At<AxisPosition>>> {
    let ends = [("from", &sweep.from), ("to", &sweep.to), ("step", &sweep.step)];
    let given = ends.iter().any(|(_, end)| !matches!(end, Maybe::Absent));
    let values = match &sweep.values {
        Maybe::Broken => return None,
        Maybe::Given(values) if given => {
            reader.fault(values.mark, "a sweep has `values`, or `from`, `to` and `step`, not both");
            return None;
        }
        Maybe::Given(values) => values.value.clone(),
        Maybe::Absent => {
            for (name, _) in ends.iter().filter(|(_, end)| matches!(end, Maybe::Absent)) {
                let help = "a sweep has `from`, `to` and `step`, or `values`".to_owned();
                reader.fault_help(mark, format!("missing key `{name}`"), Some(help));
            }
            let (Maybe::Given(from), Maybe::Given(to), Maybe::Given(step)) =
                (&sweep.from, &sweep.to, &sweep.step)
            else {
                return None;
            };
            range(from, to, step, reader)?
        }
    };
    same_kind(&values, reader)?;
    (!values.is_empty()).then_some(values)
}

fn range(
    from: &At<AxisPosition>,
    to: &At<AxisPosition>,
    step: &At<AxisPosition>,
    reader: &mut Reader,
) -> Option<Vec<At<AxisPosition>>> {
    same_kind(&[from.clone(), to.clone(), step.clone()], reader)?;
    let (first, last, pitch) = (from.value.number(), to.value.number(), step.value.number());
    if pitch == 0.0 {
        reader.fault(step.mark, "`step` must not be zero");
        return None;
    }
    let count = (last - first) / pitch;
    let whole = count.round();
    if count < 0.0 {
        let message = format!(
            "the sweep is empty: steps of {} do not lead from {} to {}",
            step.value, from.value, to.value
        );
        reader.fault_help(step.mark, message, Some(format!("is it `{}`?", step.value.at(-pitch))));
        return None;
    }
    if count > MAX_VALUES {
        reader.fault(step.mark, format!("the sweep has {whole} values; at most {MAX_VALUES}"));
        return None;
    }
    if (count - whole).abs() > TOLERANCE {
        let reached = step.value.at(rounded(first + count.floor() * pitch));
        let message =
            format!("steps of {} from {} do not hit {}", step.value, from.value, to.value);
        reader.fault_help(to.mark, message, Some(format!("the last value would be `{reached}`")));
        return None;
    }
    // The first value is where `from` stands; of the others `to` decides how far they go.
    let value = |i: u32| {
        let end = if i == 0 { from } else { to };
        end.with(step.value.at(rounded(first + f64::from(i) * pitch)))
    };
    Some((0..=whole as u32).map(value).collect())
}

/// 0.3, not 0.30000000000000004: a millionth of a unit is finer than any stage.
fn rounded(number: f64) -> f64 {
    (number * 1e6).round() / 1e6
}

fn same_kind(values: &[At<AxisPosition>], reader: &mut Reader) -> Option<()> {
    let unit = values.first()?.value.unit();
    let others: Vec<Mark> =
        values.iter().filter(|v| v.value.unit() != unit).map(|v| v.mark).collect();
    let name = if unit == AxisUnit::Millimetre { "lengths" } else { "angles" };
    for mark in &others {
        reader.fault(*mark, format!("the other values of this sweep are {name}"));
    }
    others.is_empty().then_some(())
}
