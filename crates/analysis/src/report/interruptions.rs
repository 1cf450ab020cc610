//! Where a session was interrupted and went on.

use maud::{Markup, html};

use super::input::{Interruption, ReportInput};
use super::provenance::time;
use crate::numbers::coarse;

/// Each interruption: when, how long, why, what was restored, what was done again. Nothing where
/// there was none.
pub fn interruptions(input: &ReportInput) -> Markup {
    html! {
        @if !input.interruptions.is_empty() {
            section {
                h2 { "Interruptions" }
                p.note {
                    "The session stopped and went on later. Steps that were done again are kept as they \
                     ended before; results are made of the steps as they ended last."
                }
                @for one in &input.interruptions { (interruption(one)) }
            }
        }
    }
}

fn interruption(one: &Interruption) -> Markup {
    html! {
        dl.facts {
            dt { "stopped" } dd { (time(&one.stopped)) ": " (one.reason) }
            dt { "went on" } dd { (time(&one.resumed)) ", " (lasted(one.seconds())) " later" }
            dt { "first restored" }
            dd { @if one.restored.is_empty() { "nothing" } @else { (one.restored.join("; ")) } }
            dt { "done again" }
            dd {
                @if one.redone.is_empty() { "no step" }
                @for (i, step) in one.redone.iter().enumerate() {
                    @if i > 0 { br; }
                    "step " (step.number) ", " (step.label) " (" (step.before) ")"
                }
            }
        }
    }
}

/// A time as people say it.
fn lasted(seconds: f64) -> String {
    let (value, unit) = match seconds {
        s if s < 120.0 => (s, "s"),
        s if s < 7200.0 => (s / 60.0, "min"),
        s => (s / 3600.0, "h"),
    };
    format!("{} {unit}", coarse(value))
}
