//! Two sessions, or two processings, side by side.

use std::collections::BTreeMap;

use beampose_analysis::Comparison;
use beampose_analysis::compare::{PoseComparison, Side, compare};
use beampose_photogrammetry::Setup;
use beampose_store::{ProcessingId, Store};
use serde_json::{Value, json};

use super::{outcome, plain_table, right};
use crate::cli::{Database, Ended, close, find};
use crate::loaded::{Analysed, Loaded, load, load_processing};
use crate::output::{Exit, print};

/// Compare two sessions, or two processings of one
///
/// A and B are each SESSION, for its newest processing, or SESSION@PROCESSING: `latest@1 latest@3`.
/// B may be @PROCESSING alone, for the session of A: `latest@1 @3`. SESSION is an id, a unique
/// beginning of one, or `latest`; `sessions show` lists its processings.
///
/// Shown are the settings that differ, how the poses differ capture by capture (those of the same
/// name and setpoints), and the results at each stop, B minus A. The uncertainty of a difference is
/// made as if both were independent: where they share pictures or calibrations it is an upper bound.
#[derive(clap::Args)]
pub struct Compare {
    /// SESSION or SESSION@PROCESSING
    a: String,
    /// SESSION, SESSION@PROCESSING or @PROCESSING
    b: String,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

impl Compare {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let store = self.database.open_existing().await?;
        let a = processing_of(&store, &self.a, None).await?;
        let b = processing_of(&store, &self.b, Some(&self.a)).await?;
        close(store).await;
        let (results_a, results_b) = (a.analysed(), b.analysed());
        let side = |loaded: &'_ Loaded| loaded.captures.clone();
        let (captures_a, captures_b) = (side(&a), side(&b));
        let comparison = compare(
            &Side { captures: &captures_a, translation: results_a.translation.as_ref() },
            &Side { captures: &captures_b, translation: results_b.translation.as_ref() },
        );
        let settings = [settings(&a, &results_a)?, settings(&b, &results_b)?];
        if self.json {
            print(&object(&settings, &comparison)?.to_string());
        } else {
            print(&text(&settings, &comparison));
        }
        Ok(Exit::Success)
    }
}

/// Loads what a word of the command line means (`latest`, `latest@2`); `other` is the word of the
/// other side, whose session `@2` alone means.
///
/// # Errors
/// When there is no such session or processing, or it cannot be read.
pub async fn processing_of(
    store: &Store,
    word: &str,
    other: Option<&str>,
) -> Result<Loaded, Ended> {
    let (session, processing) = match word.split_once('@') {
        Some((session, number)) => (session, Some(number)),
        None => (word, None),
    };
    let of_other = other.map(|other| other.split_once('@').map_or(other, |(session, _)| session));
    let session = if session.is_empty() { of_other.unwrap_or_default() } else { session };
    let id = find(store, session).await?;
    let Some(number) = processing else {
        return load(store, id).await.map_err(|error| Ended::input(format!("{error:#}")));
    };
    let all = store.processings(id).await?;
    let wanted = number.parse().ok().map(ProcessingId);
    match all.iter().find(|processing| Some(processing.id) == wanted) {
        Some(found) => Ok(load_processing(store, id, found.clone()).await?),
        None => {
            let there: Vec<String> = all.iter().map(|p| p.id.to_string()).collect();
            let there = if there.is_empty() { "none".to_owned() } else { there.join(", ") };
            Err(Ended::input(format!("session {id} has no processing {number}; it has {there}")))
        }
    }
}

/// What a side was made with, by name, in the order in which it is shown.
type Settings = Vec<(&'static str, String)>;

fn settings(loaded: &Loaded, result: &Analysed) -> Result<Settings, Ended> {
    let header = &loaded.session.header;
    let start = &loaded.processing.start;
    let short = |bytes: &[u8]| blake3::hash(bytes).to_hex()[..12].to_owned();
    let mut all = vec![
        ("session", header.id.to_string()),
        ("processing", loaded.processing.id.to_string()),
        ("title", header.title.clone()),
        ("experiment", header.experiment.clone()),
        ("began", header.opened.utc.strftime("%Y-%m-%d %H:%M:%S UTC").to_string()),
        ("outcome", outcome(loaded.session.outcome).to_owned()),
        ("captures", loaded.captures.len().to_string()),
        ("acquired with", header.software.clone()),
        ("seed", header.seed.map_or_else(|| "none".to_owned(), |seed| seed.to_string())),
        ("plan (steps)", header.plan_hash.chars().take(12).collect()),
        ("rig (text)", short(header.rig_text.as_bytes())),
        ("processed with", start.software.clone()),
        ("options", start.options_json.clone()),
    ];
    all.extend(inputs(&loaded.setup)?);
    let verdict = loaded.verdict(result).as_str();
    all.push(("verdict", verdict.to_owned()));
    Ok(all)
}

/// What solving was told, part by part, as short hashes.
fn inputs(setup: &Setup) -> Result<Settings, serde_json::Error> {
    fn short(part: &impl serde::Serialize) -> Result<String, serde_json::Error> {
        Ok(blake3::hash(&serde_json::to_vec(part)?).to_hex()[..12].to_owned())
    }
    Ok(vec![
        ("calibrations", short(&setup.cameras)?),
        ("pattern", short(&setup.pattern)?),
        ("artefact", short(&setup.artefact)?),
        ("tie targets", short(&setup.tie_targets)?),
        ("prior", short(&setup.module_prior)?),
        ("wavelength u", format!("{} nm", setup.wavelength_u_nm)),
    ])
}

fn object([a, b]: &[Settings; 2], comparison: &Comparison) -> Result<Value, serde_json::Error> {
    let map = |settings: &Settings| -> BTreeMap<&str, String> {
        settings.iter().map(|(name, value)| (*name, value.clone())).collect()
    };
    let differing: Vec<&str> =
        a.iter().zip(b).filter(|(a, b)| a.1 != b.1).map(|(a, _)| a.0).collect();
    Ok(json!({
        "a": map(a),
        "b": map(b),
        "settings_that_differ": differing,
        "poses": serde_json::to_value(&comparison.poses)?,
        "positions": serde_json::to_value(&comparison.positions)?,
    }))
}

fn text([a, b]: &[Settings; 2], comparison: &Comparison) -> String {
    let mut table = plain_table();
    table.set_header(["", "A", "B"]);
    for ((name, a), (_, b)) in a.iter().zip(b) {
        let always = ["session", "processing", "verdict"].contains(name);
        if always || a != b {
            table.add_row([*name, a.as_str(), b.as_str()]);
        }
    }
    let mut parts = vec![table.to_string()];
    for (method, poses) in &comparison.poses {
        parts.push(format!("poses by {}: {}", method.name(), pose_text(poses)));
    }
    if !comparison.positions.is_empty() {
        parts.push(position_table(comparison));
    }
    parts.join("\n")
}

fn pose_text(poses: &PoseComparison) -> String {
    let mut text = format!("{} compared, {} the same bits", poses.compared, poses.identical);
    for (count, side) in [(poses.only_a, "A"), (poses.only_b, "B")] {
        if count > 0 {
            text.push_str(&format!(", {count} in {side} alone"));
        }
    }
    if let (Some(largest), Some(rms)) = (poses.largest(), poses.rms_distance_mm) {
        text.push_str(&format!(
            "; rms {rms:.4} mm, largest {:.4} mm and {:.5} deg ({}), {} beyond 2 u",
            largest.distance_mm, largest.rotation_deg, largest.capture, poses.beyond_uncertainty
        ));
    }
    text
}

fn position_table(comparison: &Comparison) -> String {
    let mut table = plain_table();
    table.set_header(["method", "rail mm", "A mm", "U", "B mm", "U", "B - A mm", "U (k = 2)"]);
    for (method, stops) in &comparison.positions {
        for stop in stops {
            table.add_row([
                comfy_table::Cell::new(method.name()),
                right(format!("{:.0}", stop.rail_mm)),
                right(format!("{:+.3}", stop.a_mm)),
                right(format!("{:.3}", stop.a_expanded_uncertainty_mm)),
                right(format!("{:+.3}", stop.b_mm)),
                right(format!("{:.3}", stop.b_expanded_uncertainty_mm)),
                right(format!("{:+.3}", stop.difference_mm)),
                right(format!("{:.3}", stop.expanded_uncertainty_mm)),
            ]);
        }
    }
    table.to_string()
}
