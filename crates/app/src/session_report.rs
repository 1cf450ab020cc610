//! A stored session as the input of analysis and report, and the report's files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use beampose_analysis::report::{Provenance, ReportCapture, ReportPicture, Trace};
use beampose_analysis::{
    BeamAngles, Decision, DistanceRule, JointCovariance, Limits, ReportInput, StatedScale,
    TranslationInput, TranslationResult, TravelCapture, Verdict, WavelengthDrift, translation,
};
use beampose_core::units::Millimetre;
use beampose_core::{
    CaptureId, EventKind, Identity, InstrumentName, Quantity, SessionHeader, SessionId,
    SessionOutcome,
};
use beampose_photogrammetry::solve::{
    CaptureSolution, Method, SessionSolution, SolvedCapture, solve_session,
};
use beampose_photogrammetry::{Setup, WavelengthUse, decode};
use beampose_plan::{Accept, Analyse, Plan, read_plan};
use beampose_store::{Processing, Store, StoreError, StoredCapture, StoredSession};

use crate::angle_report::{self, Angles};
use crate::drift_report::{self, Series};
use crate::interruptions::interruptions;
use crate::journal_notes::{notes, out_of_limits};
use crate::origins::{files_of, origins};
use crate::pipeline::{SOFTWARE, solution_of};
use crate::side_by_side::{Wanted, side_by_side};
use crate::wavelengths::{self, Readings};

/// A stored session with one of its processings.
pub struct Loaded {
    /// The session.
    pub session: StoredSession,
    /// Its plan, read again from its stored text; none where the session was imported.
    pub plan: Option<Plan>,
    /// What solving was told.
    pub setup: Setup,
    /// The processing shown.
    pub processing: Processing,
    /// Its captures with what solving gave.
    pub captures: Vec<ReportCapture>,
    /// The captures as stored.
    pub stored: Vec<StoredCapture>,
    /// What the instruments read that tells the wavelength.
    readings: Readings,
    /// Readings outside the limits that the plan accepts.
    out_of_limits: Vec<String>,
    /// The readings of a wavelength drift.
    series: Option<Series>,
    /// The closings-in of a beam-angle calibration.
    angles: Option<Angles>,
}

/// What the plan's analysis gives; each experiment has its own.
#[derive(Default)]
pub struct Analysed {
    /// Of a translation test.
    pub translation: Option<TranslationResult>,
    /// Of a wavelength drift.
    pub drift: Option<WavelengthDrift>,
    /// Of a beam-angle calibration.
    pub angles: Option<BeamAngles>,
}

impl Analysed {
    /// Its verdict and reasons; none where nothing is analysed.
    fn verdict(&self) -> Option<(Verdict, &[String])> {
        let of_translation = self.translation.as_ref().map(|r| (r.verdict, r.reasons.as_slice()));
        let of_drift = self.drift.as_ref().map(|d| (d.result.verdict, d.result.reasons.as_slice()));
        let of_angles = self.angles.as_ref().map(|a| (a.verdict, a.reasons.as_slice()));
        of_translation.or(of_drift).or(of_angles)
    }
}

impl Analysed {
    /// What a report is about to show.
    pub fn of(input: &ReportInput) -> Self {
        let (translation, drift) = (input.translation.clone(), input.drift.clone());
        Self { translation, drift, angles: input.angles.clone() }
    }

    /// The result as it is stored; none where nothing is analysed.
    ///
    /// # Errors
    /// None in practice: the types are plain data.
    pub fn result_json(&self) -> Result<Option<String>, serde_json::Error> {
        if let Some(result) = &self.translation {
            return serde_json::to_string(result).map(Some);
        }
        if let Some(drift) = &self.drift {
            return serde_json::to_string(&drift.result).map(Some);
        }
        let angles = self.angles.as_ref();
        let fan = angles.and_then(|angles| angles.fan("fan", &[], String::new(), SOFTWARE));
        Ok(fan.map(|fan| beampose_analysis::fan_json(&fan).to_string()))
    }
}

/// Loads a session with its newest processing.
///
/// # Errors
/// When there is no processing yet, or what is stored cannot be read.
pub async fn load(store: &Store, id: SessionId) -> anyhow::Result<Loaded> {
    let processing = store
        .latest_processing(id)
        .await?
        .with_context(|| format!("session {id} was not solved yet: beampose solve {id}"))?;
    load_processing(store, id, processing).await
}

/// Loads a session with one of its processings.
///
/// # Errors
/// When what is stored cannot be read.
pub async fn load_processing(
    store: &Store,
    id: SessionId,
    processing: Processing,
) -> anyhow::Result<Loaded> {
    let session = store.session(id).await?;
    let plan = plan_of(&session.header)?;
    let told = processing.start.measurement_json.as_ref();
    let setup = serde_json::from_str(told.unwrap_or(&session.header.measurement_json))
        .context("the session's measurement setup cannot be read")?;
    let stored = store.captures(id).await?;
    let mut captures = Vec::new();
    for capture in &stored {
        captures.push(report_capture(store, &processing, capture).await?);
    }
    let out_of_limits = out_of_limits(store, session.header.id).await?;
    let series = drift_report::series(store, id, plan.as_ref()).await?;
    let angles = angle_report::angles(store, id, plan.as_ref(), &session.header.rig_text).await?;
    let readings = Readings::of(&setup, &store.readings(id).await?);
    let using = wavelengths::used(&processing.start.options_json).of_session();
    let mut loaded = Loaded {
        session,
        plan,
        setup,
        processing,
        captures,
        stored,
        readings,
        out_of_limits,
        series,
        angles,
    };
    loaded.use_wavelength(using);
    Ok(loaded)
}

/// A session's plan; an imported one has none, since another program took its pictures.
fn plan_of(header: &SessionHeader) -> anyhow::Result<Option<Plan>> {
    if header.plan_text.is_empty() {
        return Ok(None);
    }
    read_plan("stored plan", header.plan_text.as_bytes())
        .map(Some)
        .map_err(|faults| anyhow::anyhow!("the session's plan cannot be read:\n{faults}"))
}

async fn report_capture(
    store: &Store,
    processing: &Processing,
    capture: &StoredCapture,
) -> anyhow::Result<ReportCapture> {
    let (solution, seconds) = match store.solution(processing.id, &capture.id).await {
        Ok(row) => {
            let (solution, seconds) = solution_of(&row)
                .with_context(|| format!("the solution of capture {} is damaged", capture.id))?;
            (Ok(solution), seconds)
        }
        Err(StoreError::NotFound { .. }) => {
            (Err("not solved in this processing".to_owned()), Default::default())
        }
        Err(error) => return Err(error.into()),
    };
    Ok(ReportCapture {
        id: capture.id.clone(),
        at: Some(capture.triggered),
        setpoints: capture.setpoints.clone(),
        readings: capture.readings.clone(),
        wavelength: None,
        solution,
        seconds,
    })
}

impl Loaded {
    /// Notes at each capture which wavelength an adjustment of them all takes.
    pub fn use_wavelength(&mut self, using: WavelengthUse) {
        for (capture, stored) in self.captures.iter_mut().zip(&self.stored) {
            capture.wavelength = Some(self.readings.at(&self.setup, stored, using));
        }
    }

    /// The methods of the processing.
    pub fn methods(&self) -> Vec<Method> {
        let solutions = self.captures.iter().filter_map(|c| c.solution.as_ref().ok());
        let used: Vec<Method> =
            solutions.flat_map(|s: &CaptureSolution| s.results.iter().map(|r| r.method)).collect();
        Method::ALL.into_iter().filter(|m| used.contains(m)).collect()
    }

    /// The plan's analysis, whatever it is.
    pub fn analysed(&self) -> Analysed {
        let drift = self.plan.as_ref().zip(self.series.as_ref());
        Analysed {
            translation: self.translation(),
            drift: drift.and_then(|(plan, series)| series.analysed(plan, &self.setup.pattern)),
            angles: self.plan.as_ref().zip(self.angles.as_ref()).and_then(|(p, a)| a.analysed(p)),
        }
    }

    /// The plan's analysis, where it is a translation test.
    pub fn translation(&self) -> Option<TranslationResult> {
        let plan = self.plan.as_ref()?;
        let Some(Analyse::Translation { pass, axis_key, .. }) = &plan.analyse else {
            return None;
        };
        let of = |methods: &[Method], rule: DistanceRule<'_>| {
            let travel = |c| travel_capture(c, pass, axis_key, methods);
            // Captures outside the passes (with the module turned) help the adjustment only.
            let has_pass = |c: &&ReportCapture| c.setpoints.contains_key(pass.as_str());
            let all_alike = !self.captures.iter().any(|c| has_pass(&c));
            let of_passes = self.captures.iter().filter(|c| all_alike || has_pass(c));
            translation(&TranslationInput {
                captures: of_passes.map(travel).collect(),
                scale_relative_u: self.setup.artefact.scale_relative_u,
                stated_scale: StatedScale::Included,
                rule,
                limits: limits(&plan.accept, methods),
            })
        };
        let alone = of(&Method::OF_A_CAPTURE, DistanceRule::AlongTravel);
        // What the poses of a session share cancels in their distances: its joint covariance says
        // how far. It is not stored, since it follows from what is.
        Some(match self.joint() {
            Some(joint) => {
                alone.merged(of(&[Method::SessionAdjustment], DistanceRule::Joint(&joint)))
            }
            None => alone,
        })
    }

    fn joint(&self) -> Option<Joint> {
        if !self.methods().contains(&Method::SessionAdjustment) {
            return None;
        }
        let solution = adjust_together(&self.setup, &self.captures).ok()?;
        let ids = self.captures.iter().enumerate().map(|(i, c)| (c.id.clone(), i)).collect();
        Some(Joint { solution, ids })
    }

    /// How the session ended; one that never closed ended by an error.
    pub fn outcome(&self) -> SessionOutcome {
        self.session.outcome.unwrap_or(SessionOutcome::Error)
    }

    /// The verdict on the session with its analysis.
    pub fn verdict(&self, analysed: &Analysed) -> Verdict {
        let mut analysis = analysed.verdict().map_or(Verdict::Inconclusive, |(verdict, _)| verdict);
        if !self.out_of_limits.is_empty() {
            analysis = analysis.worse(Verdict::Fail);
        }
        Verdict::of_session(self.outcome(), analysis)
    }
}

fn limits(accept: &Accept, methods: &[Method]) -> Limits {
    let max_abs_difference = accept
        .limits
        .iter()
        .filter_map(|(method, limits)| Some((method_of(*method), limits.max_abs_mean_difference?)))
        .filter(|(method, _)| methods.contains(method))
        .collect();
    Limits {
        max_abs_difference,
        min_solved_fraction: accept.min_solved_fraction,
        decision: Decision::Simple,
    }
}

/// A plan's method as the solver's.
pub fn method_of(method: beampose_plan::Method) -> Method {
    match method {
        beampose_plan::Method::InterBeamAngles => Method::InterBeamAngles,
        beampose_plan::Method::InterBeamAnglesGls => Method::InterBeamAnglesGls,
        beampose_plan::Method::RayFit => Method::RayFit,
        beampose_plan::Method::VirtualCamera => Method::VirtualCamera,
        beampose_plan::Method::SessionAdjustment => Method::SessionAdjustment,
    }
}

/// The joint covariance of a session's positions.
struct Joint {
    solution: SessionSolution,
    ids: BTreeMap<CaptureId, usize>,
}

impl JointCovariance for Joint {
    fn block(&self, a: &CaptureId, b: &CaptureId) -> Option<[[f64; 3]; 3]> {
        let covariance = self.solution.between(*self.ids.get(a)?, *self.ids.get(b)?)?;
        Some(std::array::from_fn(|r| std::array::from_fn(|c| covariance[(r, c)])))
    }
}

/// Adjusts all captures of a session together, from their own solutions.
///
/// # Errors
/// Why there is no solution, in words.
pub fn adjust_together(
    setup: &Setup,
    captures: &[ReportCapture],
) -> Result<SessionSolution, String> {
    let solved = solved_captures(setup, captures)
        .ok_or("not all captures were solved by themselves in this processing")?;
    solve_session(setup, &solved)
}

/// The captures as the session's adjustment takes them; `None` where one was not solved by itself.
pub fn solved_captures<'a>(
    setup: &Setup,
    captures: &'a [ReportCapture],
) -> Option<Vec<SolvedCapture<'a>>> {
    let solved = captures.iter().map(|ReportCapture { solution, wavelength, .. }| {
        let wavelength = wavelength.unwrap_or_else(|| setup.wavelength(None));
        Some(SolvedCapture { solution: solution.as_ref().ok()?, wavelength })
    });
    solved.collect()
}

fn travel_capture(
    capture: &ReportCapture,
    pass: &str,
    axis_key: &str,
    methods: &[Method],
) -> TravelCapture {
    let setpoint = capture.setpoints.get(axis_key).copied().unwrap_or_default();
    let readback = capture.readings.get(axis_key).copied().unwrap_or(setpoint);
    let turn = capture.setpoints.get(pass).copied().unwrap_or(1.0);
    let poses = match &capture.solution {
        Ok(solution) => solution
            .results
            .iter()
            .filter(|r| methods.contains(&r.method))
            .map(|r| (r.method, r.pose.clone()))
            .collect(),
        Err(reason) => methods.iter().map(|m| (*m, Err(reason.clone()))).collect(),
    };
    TravelCapture {
        id: capture.id.clone(),
        // Loop counters are small whole numbers.
        pass: turn as u32,
        setpoint: Millimetre(setpoint),
        readback: Millimetre(readback),
        poses,
    }
}

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
    let mut reasons = analysed.verdict().map(|(_, reasons)| reasons.to_vec()).unwrap_or_default();
    reasons.extend(loaded.out_of_limits.iter().cloned());
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
        reasons,
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
