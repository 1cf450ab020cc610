//! A stored session with one of its processings, and what the plan's analysis makes of it.

use std::collections::BTreeMap;

use anyhow::Context as _;
use beampose_analysis::report::ReportCapture;
use beampose_analysis::{
    BeamAngles, Decision, DistanceRule, JointCovariance, Limits, ReportInput, StatedScale,
    TranslationInput, TranslationResult, TravelCapture, Verdict, WavelengthDrift, translation,
};
use beampose_core::units::Millimetre;
use beampose_core::{CaptureId, SessionHeader, SessionId, SessionOutcome};
use beampose_photogrammetry::solve::{
    CaptureSolution, Method, SessionSolution, SolvedCapture, solve_session,
};
use beampose_photogrammetry::{Setup, WavelengthUse};
use beampose_plan::{Accept, Analyse, Plan, read_plan};
use beampose_store::{Processing, Store, StoreError, StoredCapture, StoredSession};

use crate::angle_report::{self, Angles};
use crate::drift_report::{self, Series};
use crate::journal_notes::out_of_limits;
use crate::pipeline::{SOFTWARE, solution_of};
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

    /// Why that verdict, for people.
    pub fn reasons(&self, analysed: &Analysed) -> Vec<String> {
        let of_analysis = analysed.verdict().map(|(_, reasons)| reasons).unwrap_or_default();
        of_analysis.iter().chain(&self.out_of_limits).cloned().collect()
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
