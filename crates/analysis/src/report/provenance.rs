//! Where the report comes from, and what could not be solved.

use std::collections::BTreeMap;

use beampose_core::Stamp;
use beampose_photogrammetry::solve::Method;
use maud::{Markup, html};

use super::input::{Provenance, ReportInput, SourceOrigin};
use super::plots::title;

/// Remarks and failures, equal ones together.
pub fn notes(input: &ReportInput) -> Markup {
    let failures = failures(input);
    let remarks = remarks(input);
    html! {
        @if failures.is_empty() && !input.captures.is_empty() {
            p { "Every capture gives a pose by every method." }
        }
        @if !failures.is_empty() {
            h3 { "Captures not solved" }
            (grouped(&failures))
        }
        @if !remarks.is_empty() {
            h3 { "Remarks" }
            (grouped(&remarks))
        }
    }
}

/// Captures by what is said of them.
type Said = BTreeMap<String, Vec<String>>;

fn failures(input: &ReportInput) -> Said {
    let mut said = Said::new();
    let mut say = |what: String, id: String| said.entry(what).or_default().push(id);
    for capture in &input.captures {
        let solution = match &capture.solution {
            Ok(solution) => solution,
            Err(reason) => {
                say(reason.clone(), capture.id.to_string());
                continue;
            }
        };
        for result in &solution.results {
            if let Err(reason) = &result.pose {
                say(format!("{}: {reason}", title(result.method)), capture.id.to_string());
            }
        }
        let missing = |m: &&Method| !solution.results.iter().any(|r| r.method == **m);
        for method in input.methods.iter().filter(missing) {
            say(format!("{}: not computed", title(*method)), capture.id.to_string());
        }
    }
    said
}

fn remarks(input: &ReportInput) -> Said {
    let mut said = Said::new();
    for note in &input.notes {
        said.entry(note.clone()).or_default();
    }
    for (method, of_method) in input.translation.iter().flat_map(|t| &t.methods) {
        for note in &of_method.notes {
            said.entry(format!("{}: {note}", title(*method))).or_default();
        }
    }
    for capture in &input.captures {
        for note in capture.solution.iter().flat_map(|s| &s.notes) {
            said.entry(note.clone()).or_default().push(capture.id.to_string());
        }
    }
    said
}

fn grouped(said: &Said) -> Markup {
    html! {
        div.scroll { table.full {
            thead { tr { th.text { "what" } th { "captures" } th.text { "which" } } }
            tbody {
                @for (what, ids) in said {
                    tr {
                        td.text { (what) }
                        td { @if ids.is_empty() { "session" } @else { (ids.len()) } }
                        td.text { (listed(ids)) }
                    }
                }
            }
        } }
    }
}

/// The first dozen names, and how many more there are.
fn listed(ids: &[String]) -> String {
    const SHOWN: usize = 12;
    let mut text = ids.iter().take(SHOWN).cloned().collect::<Vec<_>>().join(", ");
    if ids.len() > SHOWN {
        text.push_str(&format!(" and {} more", ids.len() - SHOWN));
    }
    text
}

/// Ids, versions, hashes, options, instruments, plan and rig.
pub fn provenance(p: &Provenance) -> Markup {
    html! {
        dl.facts {
            dt { "session" } dd { code { (p.session) } }
            dt { "processing" } dd { code { (p.processing) } }
            dt { "acquired with" } dd { (p.acquired_with) }
            dt { "processed with" } dd { (p.processed_with) }
            dt { "began" } dd { (time(&p.opened)) }
            dt { "ended" } dd { @match &p.closed { Some(at) => (time(at)), None => "not recorded" } }
            @if let Some(seed) = p.seed { dt { "simulation's seed" } dd { (seed) } }
            @for (what, hash) in &p.hashes { dt { (what) " hash" } dd { code { (hash) } } }
        }
        @if !p.options.is_empty() { h3 { "Options of the processing" } (pairs(&p.options)) }
        @if !p.inputs.is_empty() { h3 { "Calibrations" } (inputs(p)) }
        @if !p.instruments.is_empty() { h3 { "Instruments" } (instruments(p)) }
        (text("Plan as run", &p.plan_text))
        (text("Rig as run", &p.rig_text))
    }
}

/// `2026-11-20 08:30:00 UTC`.
pub fn time(stamp: &Stamp) -> String {
    let text = stamp.utc.to_string();
    let seconds = text.split(['.', 'Z']).next().unwrap_or_default();
    format!("{} UTC", seconds.replace('T', " "))
}

fn pairs(pairs: &BTreeMap<String, String>) -> Markup {
    html! {
        dl.facts { @for (name, value) in pairs { dt { (name) } dd { (value) } } }
    }
}

/// Which file each calibration was read from, and where that comes from.
fn inputs(p: &Provenance) -> Markup {
    html! {
        div.scroll { table {
            thead { tr { th.text { "of" } th.text { "file" } th.text { "BLAKE3" } th.text { "recorded as" } th.text { "made from" } } }
            tbody {
                @for input in &p.inputs {
                    tr {
                        td.text { (input.camera.as_deref().unwrap_or("pattern")) }
                        td.text { (input.file) }
                        td.text { code { (input.blake3.get(..12).unwrap_or_default()) } }
                        @match &input.calibration {
                            Some(c) => {
                                td.text { (c.name) ", " (c.method) ", " (c.created_utc.get(..10).unwrap_or_default()) }
                                td.text { @for source in &c.made_from { div { (made_from(source)) } } }
                            }
                            None => { td.text { "–" } td.text { "not recorded here" } }
                        }
                    }
                }
            }
        } }
    }
}

fn made_from(source: &SourceOrigin) -> Markup {
    html! {
        @match source {
            SourceOrigin::Session { session, title, state, .. } => {
                "session " code { (session) } " (" (title) "; " (state) ")"
            }
            SourceOrigin::File { name, blake3 } => {
                (name) " " code { (blake3.get(..12).unwrap_or_default()) }
            }
        }
    }
}

fn instruments(p: &Provenance) -> Markup {
    html! {
        div.scroll { table {
            thead { tr { th.text { "name" } th.text { "model" } th.text { "serial number" } th.text { } } }
            tbody {
                @for (name, identity) in &p.instruments {
                    tr {
                        td.text { (name) }
                        td.text { (identity.model) }
                        td.text { (identity.serial.as_deref().unwrap_or("–")) }
                        td.text { @if identity.simulated { "simulated" } }
                    }
                }
            }
        } }
    }
}

fn text(what: &str, text: &str) -> Markup {
    html! {
        @if !text.trim().is_empty() {
            details {
                summary { (what) }
                pre { code { (text) } }
            }
        }
    }
}
