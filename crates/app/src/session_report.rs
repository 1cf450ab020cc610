//! The input of a stored session's report, and the report's files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use beampose_analysis::ReportInput;
use beampose_analysis::report::{Provenance, ReportPicture, Trace};
use beampose_core::{EventKind, Identity, InstrumentName, Quantity, SessionId};
use beampose_photogrammetry::decode;
use beampose_store::{Store, StoredCapture};

use crate::angle_report;
use crate::interruptions::interruptions;
use crate::journal_notes::notes;
use crate::loaded::Loaded;
use crate::origins::{files_of, origins};
use crate::side_by_side::{Wanted, side_by_side};

/// The report's input, decoded pictures of one capture included.
///
/// # Errors
/// When the store fails.
pub async fn input(store: &Store, loaded: &Loaded) -> anyhow::Result<ReportInput> {
    input_beside(store, loaded, &[]).await
}

/// As [`input`], with the processings that are shown side by side; without any all that differ.
///
/// # Errors
/// When the store fails, or one of them does not exist.
pub async fn input_beside(
    store: &Store,
    loaded: &Loaded,
    beside: &[Wanted],
) -> anyhow::Result<ReportInput> {
    let id = loaded.session.header.id;
    let analysed = loaded.analysed();
    let frames_px = loaded
        .setup
        .cameras
        .iter()
        .map(|(name, c)| (name.clone(), [c.model.width, c.model.height]))
        .collect();
    Ok(ReportInput {
        title: loaded.session.header.title.clone(),
        experiment: loaded.session.header.experiment.clone(),
        verdict: loaded.verdict(&analysed),
        reasons: loaded.reasons(&analysed),
        methods: loaded.methods(),
        captures: loaded.captures.clone(),
        side_by_side: side_by_side(store, loaded, analysed.translation.as_ref(), beside).await?,
        translation: analysed.translation,
        drift: analysed.drift,
        angles: analysed.angles,
        scores: BTreeMap::new(),
        pictures: pictures(store, loaded).await?,
        frames_px,
        environment: environment(store, id).await?,
        provenance: provenance(store, loaded).await?,
        interruptions: interruptions(store, id).await?,
        notes: notes(store, &loaded.session).await?,
    })
}

/// The pictures of the capture in the middle of those that were solved.
async fn pictures(store: &Store, loaded: &Loaded) -> anyhow::Result<Vec<ReportPicture>> {
    let solved: Vec<&StoredCapture> = loaded
        .stored
        .iter()
        .zip(&loaded.captures)
        .filter(|(_, c)| c.solution.as_ref().is_ok_and(|s| !s.cameras.is_empty()))
        .map(|(stored, _)| stored)
        .collect();
    let Some(capture) = solved.get(solved.len() / 2).or(loaded.stored.first().as_ref()).copied()
    else {
        return Ok(Vec::new());
    };
    let mut pictures = Vec::new();
    for picture in &capture.pictures {
        let bytes = store.picture(loaded.session.header.id, &capture.id, &picture.camera).await;
        // A damaged picture is not shown; that it is damaged, `sessions --verify` says.
        if let Some(image) = bytes.ok().and_then(|bytes| decode(&bytes).ok()) {
            pictures.push(ReportPicture {
                capture: capture.id.clone(),
                camera: picture.camera.as_str().to_owned(),
                image,
            });
        }
    }
    Ok(pictures)
}

async fn environment(store: &Store, id: SessionId) -> anyhow::Result<Vec<Trace>> {
    let mut traces: BTreeMap<(InstrumentName, Quantity), Trace> = BTreeMap::new();
    for row in store.readings(id).await? {
        let quantity = row.reading.quantity;
        if !matches!(quantity, Quantity::Wavelength | Quantity::Temperature | Quantity::Current) {
            continue;
        }
        traces
            .entry((row.instrument.clone(), quantity))
            .or_insert_with(|| Trace {
                instrument: row.instrument.clone(),
                quantity,
                readings: Vec::new(),
            })
            .readings
            .push(row.reading);
    }
    Ok(traces.into_values().collect())
}

async fn provenance(store: &Store, loaded: &Loaded) -> anyhow::Result<Provenance> {
    let header = &loaded.session.header;
    let start = &loaded.processing.start;
    let options: serde_json::Value = serde_json::from_str(&start.options_json)?;
    let options = options
        .as_object()
        .map(|o| o.iter().map(|(k, v)| (k.clone(), plain(v))).collect())
        .unwrap_or_default();
    let lineage: serde_json::Value = serde_json::from_str(&start.lineage_json)?;
    let mut hashes: BTreeMap<String, String> = lineage
        .as_object()
        .map(|o| o.iter().map(|(k, v)| (k.clone(), plain(v))).collect())
        .unwrap_or_default();
    let hashed = if loaded.plan.is_some() { "plan (expanded steps)" } else { "session.yaml" };
    hashes.insert(hashed.to_owned(), header.plan_hash.clone());
    Ok(Provenance {
        session: header.id,
        outcome: loaded.outcome(),
        opened: header.opened,
        closed: loaded.session.closed,
        processing: loaded.processing.id.to_string(),
        acquired_with: header.software.clone(),
        processed_with: start.software.clone(),
        options,
        hashes,
        inputs: origins(store, files_of(&loaded.session, &loaded.processing)).await?,
        seed: header.seed,
        instruments: instruments(store, header.id).await?,
        plan_text: header.plan_text.clone(),
        rig_text: header.rig_text.clone(),
    })
}

fn plain(value: &serde_json::Value) -> String {
    match value {
        serde_json::Value::String(text) => text.clone(),
        serde_json::Value::Array(items) => items.iter().map(plain).collect::<Vec<_>>().join(", "),
        other => other.to_string(),
    }
}

/// What the instruments said of themselves: the journal has it as `name: model, serial ...`.
async fn instruments(
    store: &Store,
    id: SessionId,
) -> anyhow::Result<BTreeMap<InstrumentName, Identity>> {
    let said = store.events(id).await?;
    Ok(said
        .iter()
        .filter(|e| e.event.kind == EventKind::Identified)
        .filter_map(|e| {
            let (name, model) = e.event.message.split_once(": ")?;
            let (model, simulated) = match model.strip_suffix(", simulated") {
                Some(model) => (model, true),
                None => (model, false),
            };
            let (model, serial) = match model.split_once(", serial ") {
                Some((model, serial)) => (model, Some(serial.to_owned())),
                None => (model, None),
            };
            let identity = Identity { model: model.to_owned(), serial, simulated };
            Some((InstrumentName::from(name), identity))
        })
        .collect())
}

/// Where a report was written.
pub struct Written {
    /// The page.
    pub html: PathBuf,
    /// The result as JSON, as `report --json` prints it.
    pub json: serde_json::Value,
}

/// Makes the folder of a report.
///
/// # Errors
/// That it cannot be made.
pub fn prepare(folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder)
        .with_context(|| format!("the report's folder {} cannot be made", folder.display()))
}

/// Writes `report.html`, `report.json`, `poses.csv` and, where there are any, `positions.csv`,
/// `side_by_side.csv` and `wavelength.csv`, or the files of a calibrated fan, into `folder`.
///
/// # Errors
/// Which file cannot be written.
pub fn write(input: &ReportInput, folder: &Path) -> anyhow::Result<Written> {
    prepare(folder)?;
    let put = |name: &str, text: &str| {
        let path = folder.join(name);
        std::fs::write(&path, text)
            .with_context(|| format!("{} cannot be written", path.display()))
            .map(|()| path)
    };
    let json = beampose_analysis::json(input)?;
    let html = put("report.html", &beampose_analysis::html(input))?;
    put("report.json", &serde_json::to_string_pretty(&json)?)?;
    put("poses.csv", &beampose_analysis::poses_csv(&input.captures))?;
    if let Some(result) = &input.translation {
        put("positions.csv", &beampose_analysis::positions_csv(result))?;
    }
    if !input.side_by_side.is_empty() {
        put("side_by_side.csv", &beampose_analysis::side_by_side_csv(&input.side_by_side))?;
    }
    if let Some(drift) = &input.drift {
        put("wavelength.csv", &beampose_analysis::series_csv(&drift.series))?;
    }
    if let Some(angles) = &input.angles {
        angle_report::write_fan(angles, input.provenance.session, folder)?;
    }
    Ok(Written { html, json })
}
