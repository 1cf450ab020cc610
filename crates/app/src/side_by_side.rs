//! The processings of a session side by side: which are shown, and what is particular to each.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::Context as _;
use beampose_analysis::{Evaluation, TranslationResult};
use beampose_photogrammetry::solve::Method;
use beampose_photogrammetry::{Pattern, PatternModel, Setup};
use beampose_store::{PoseRow, Processing, ProcessingId, Store};

use crate::loaded::{Loaded, load_processing};

/// At most so many lines are drawn where nobody says which.
const MOST: usize = 12;

/// A processing that somebody wants to see.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Wanted {
    /// Its number.
    pub processing: i64,
    /// What to call it, instead of what is particular to it.
    pub label: Option<String>,
}

impl Wanted {
    /// Reads `3` or `3=data sheet`.
    ///
    /// # Errors
    /// What is expected.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (number, label) = match text.split_once('=') {
            Some((number, label)) => (number, Some(label.trim().to_owned())),
            None => (text, None),
        };
        let processing = number.trim().parse();
        let label = label.filter(|label| !label.is_empty());
        match processing {
            Ok(processing) => Ok(Self { processing, label }),
            Err(_) => Err("expected a processing's number, as in 3 or 3=\"data sheet\"".to_owned()),
        }
    }
}

/// The evaluations of a loaded session, of the processings `wanted`, or without any of all that are
/// finished. What two processings have in common to the bit is shown once; empty where that leaves
/// fewer than two processings, and where the session is no translation test. `shown` is the analysis
/// of the loaded processing.
///
/// # Errors
/// When a wanted processing does not exist, or what is stored cannot be read.
pub async fn side_by_side(
    store: &Store,
    loaded: &Loaded,
    shown: Option<&TranslationResult>,
    wanted: &[Wanted],
) -> anyhow::Result<Vec<Evaluation>> {
    let Some(shown) = shown else {
        anyhow::ensure!(wanted.is_empty(), "--compare: the session is no translation test");
        return Ok(Vec::new());
    };
    let id = loaded.session.header.id;
    let mut chosen = Vec::new();
    for processing in chosen_of(store.processings(id).await?, wanted)? {
        let mut by_method = ByMethod::new();
        for row in store.poses(processing.id).await? {
            by_method.entry(row.method.clone()).or_default().push(row);
        }
        chosen.push((processing, by_method));
    }
    let kept = kept(&chosen, wanted.is_empty());
    let processings: BTreeSet<ProcessingId> = kept.iter().map(|(id, _)| *id).collect();
    if processings.len() < 2 {
        return Ok(Vec::new());
    }
    let own: Setup = serde_json::from_str(&loaded.session.header.measurement_json)
        .context("the session's measurement setup cannot be read")?;
    let mut all = Vec::new();
    for (processing, rows) in chosen.iter().filter(|(p, _)| processings.contains(&p.id)) {
        let result = if processing.id == loaded.processing.id {
            Some(shown.clone())
        } else {
            result(store, loaded, processing).await?
        };
        let called = wanted.iter().find(|w| w.processing == processing.id.0);
        let called = called.and_then(|wanted| wanted.label.clone());
        let methods = result.into_iter().flat_map(|result| result.methods);
        for (method, result) in methods.filter(|(m, _)| kept.contains(&(processing.id, m.name()))) {
            let rows = rows.get(method.name()).map_or(&[][..], Vec::as_slice);
            let label = match &called {
                Some(label) => label.clone(),
                None => particular(&own, processing, rows)?,
            };
            all.push(Evaluation { processing: processing.id.0, label, method, result });
        }
    }
    if wanted.is_empty() {
        // The newest say most of what is being done, beside the one that is reported.
        let mut over = all.len().saturating_sub(MOST);
        all.retain(|one| {
            let left_out = over > 0 && one.processing != loaded.processing.id.0;
            over -= usize::from(left_out);
            !left_out
        });
    }
    Ok(all)
}

fn chosen_of(all: Vec<Processing>, wanted: &[Wanted]) -> anyhow::Result<Vec<Processing>> {
    if wanted.is_empty() {
        return Ok(all.into_iter().filter(|p| p.finished.is_some()).collect());
    }
    let find = |wanted: &Wanted| {
        let found = all.iter().find(|p| p.id.0 == wanted.processing).cloned();
        found.with_context(|| {
            let there: Vec<String> = all.iter().map(|p| p.id.to_string()).collect();
            let there = if there.is_empty() { "none".to_owned() } else { there.join(", ") };
            format!("there is no processing {}; the session has {there}", wanted.processing)
        })
    };
    wanted.iter().map(find).collect()
}

/// The poses of a processing, by the names of the methods.
type ByMethod = BTreeMap<String, Vec<PoseRow>>;

/// Which methods of which processings are shown. Where `once`, of two with the same poses only the
/// one whose processing has more methods, then the older.
fn kept(chosen: &[(Processing, ByMethod)], once: bool) -> BTreeSet<(ProcessingId, &'static str)> {
    let mut order: Vec<&(Processing, ByMethod)> = chosen.iter().collect();
    order.sort_by_key(|(processing, rows)| (std::cmp::Reverse(rows.len()), processing.id));
    let mut seen: Vec<(Method, &[PoseRow])> = Vec::new();
    let mut kept = BTreeSet::new();
    for (processing, by_method) in order {
        for method in Method::ALL {
            let Some(rows) = by_method.get(method.name()) else { continue };
            if once && seen.iter().any(|(m, of)| *m == method && same_poses(of, rows)) {
                continue;
            }
            seen.push((method, rows));
            kept.insert((processing.id, method.name()));
        }
    }
    kept
}

/// The same poses to the bit; what an earlier version did not record beside them does not count.
fn same_poses(a: &[PoseRow], b: &[PoseRow]) -> bool {
    let alike = |(a, b): (&PoseRow, &PoseRow)| a.capture == b.capture && a.pose == b.pose;
    a.len() == b.len() && a.iter().zip(b).all(alike)
}

/// The stored result of a processing; where none was stored, it is analysed now.
async fn result(
    store: &Store,
    loaded: &Loaded,
    processing: &Processing,
) -> anyhow::Result<Option<TranslationResult>> {
    let stored = store.results(processing.id).await?.pop();
    let stored = stored.and_then(|row| serde_json::from_str(&row.result_json).ok());
    if stored.is_some() {
        return Ok(stored);
    }
    let other = load_processing(store, loaded.session.header.id, processing.clone()).await?;
    Ok(tokio::task::spawn_blocking(move || other.translation()).await?)
}

/// What is particular to a processing: inputs other than the run's, and whence its wavelengths are.
fn particular(own: &Setup, processing: &Processing, rows: &[PoseRow]) -> anyhow::Result<String> {
    let other: Option<Setup> =
        processing.start.measurement_json.as_deref().map(serde_json::from_str).transpose()?;
    let mut parts = other.map_or_else(Vec::new, |other| differences(own, &other));
    if parts.is_empty() {
        parts.push("inputs of the run".to_owned());
    }
    let sources: BTreeSet<&str> =
        rows.iter().map(|row| row.wavelength_source.as_deref().unwrap_or("not recorded")).collect();
    let sources: Vec<String> = sources.into_iter().map(|s| s.replace('_', " ")).collect();
    parts.push(format!("wavelength: {}", sources.join(", ")));
    Ok(parts.join("; "))
}

fn differences(own: &Setup, other: &Setup) -> Vec<String> {
    let law = own.wavelength_by_temperature != other.wavelength_by_temperature;
    let mut parts = Vec::new();
    if other.pattern != own.pattern {
        parts.push(format!("fan: {}", fan(&other.pattern)));
    }
    for (differs, what) in [
        (other.cameras != own.cameras, "other camera calibrations"),
        (other.artefact != own.artefact, "another artefact"),
        (other.tie_targets != own.tie_targets, "other tie targets"),
        (other.module_prior != own.module_prior, "another prior of the module"),
        (other.wavelength_u_nm != own.wavelength_u_nm, "another u of the wavelength"),
        (law, "another line of the wavelength over temperature"),
    ] {
        parts.extend(differs.then(|| what.to_owned()));
    }
    parts
}

fn fan(pattern: &Pattern) -> String {
    match &pattern.model {
        PatternModel::RadialGrid { pitch_mm, k1_per_mm2, distance_mm } => {
            let radial = if *k1_per_mm2 == 0.0 {
                "no radial term".to_owned()
            } else {
                format!("k = {k1_per_mm2:e} / mm²")
            };
            format!("pitch {pitch_mm} mm at {distance_mm} mm, {radial}")
        }
        PatternModel::Table { .. } => "another table of beams".to_owned(),
    }
}
