//! Whence the wavelengths are that the fan was corrected to.

use std::collections::BTreeMap;

use beampose_photogrammetry::solve::Method;
use beampose_photogrammetry::{Wavelength, WavelengthSource};
use maud::{Markup, html};

use super::input::ReportInput;
use super::plots::title;
use crate::numbers::{NONE, fixed, plain};

/// A line for each method and source; nothing where no solution says.
pub fn table(input: &ReportInput) -> Markup {
    let used = used(input);
    if used.is_empty() {
        return html! {};
    }
    html! {
        h3 { "Wavelength that the fan is corrected to" }
        div.scroll { table {
            thead { tr {
                th.text { "method" } th.text { "from" } th { "captures" br; "\u{a0}" }
                th { "wavelength" br; "nm" } th { "u" br; "nm" } th { "oldest reading" br; "s" }
            } }
            tbody { @for ((method, source), all) in &used { (row(*method, *source, all)) } }
        } }
        p.note {
            "What was known before solving; u is the standard uncertainty. The virtual camera and the \
             session adjustment estimate the fan's scale with it as prior."
            @if used.keys().any(|(_, source)| *source == WavelengthSource::Nominal) {
                " Where it is not corrected, what the true wavelength does is in no uncertainty here."
            }
        }
    }
}

type Used<'a> = BTreeMap<(Method, WavelengthSource), Vec<&'a Wavelength>>;

fn used(input: &ReportInput) -> Used<'_> {
    let mut used = Used::new();
    for solution in input.captures.iter().filter_map(|c| c.solution.as_ref().ok()) {
        for result in &solution.results {
            if let Some(known) = &result.wavelength {
                used.entry((result.method, known.source)).or_default().push(known);
            }
        }
    }
    used
}

fn row(method: Method, source: WavelengthSource, all: &[&Wavelength]) -> Markup {
    let span = |values: Vec<f64>, text: &dyn Fn(f64) -> String| {
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let (low, high) = (text(low), text(high));
        if low == high { low } else { format!("{low} to {high}") }
    };
    let age = all.iter().filter_map(|known| known.age_s).reduce(f64::max);
    html! {
        tr {
            td.text { (title(method)) }
            td.text { (words(source)) }
            td { (all.len()) }
            td { (span(all.iter().map(|known| known.nm).collect(), &|nm| fixed(nm, 3))) }
            td.u { (span(all.iter().map(|known| known.u_nm()).collect(), &plain)) }
            td.u { (age.map_or_else(|| NONE.to_owned(), |age| fixed(age, 1))) }
        }
    }
}

/// A source in words.
pub fn words(source: WavelengthSource) -> &'static str {
    match source {
        WavelengthSource::Read => "read at the capture",
        WavelengthSource::Interpolated => "interpolated between readings",
        WavelengthSource::Held => "nearest reading, held",
        WavelengthSource::FromTemperature => "from the diode's temperature",
        WavelengthSource::Estimated => "nothing read: estimated",
        WavelengthSource::Nominal => "not corrected: nominal",
    }
}
