//! Stored captures in, solutions in the store: decode, detect, solve. Runs beside a session and on
//! stored ones alike, and knows nothing of instruments.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use anyhow::Context as _;
use beampose_core::{CaptureId, InstrumentName, SessionId, UsedFile};
use beampose_photogrammetry::sight::{Stage, sight_all};
use beampose_photogrammetry::solve::{
    CaptureSolution, Method, MethodResult, SessionSolution, StageSeconds, solve_capture,
};
use beampose_photogrammetry::{
    GrayImage, Setup, Wavelength, WavelengthSource, WavelengthUse, decode,
};
use beampose_store::{NewProcessing, PoseRow, ProcessingId, SolutionRow, Store, StoredCapture};

use crate::loaded::Loaded;
use crate::wavelengths::Readings;

/// The program's version, as stored with what it makes.
pub const SOFTWARE: &str = concat!("beampose ", env!("CARGO_PKG_VERSION"));

/// A processing under way.
#[derive(Clone)]
pub struct Pipeline {
    store: Arc<Store>,
    session: SessionId,
    processing: ProcessingId,
    setup: Arc<Setup>,
    told: Arc<Told>,
    /// What the session's instruments read; `None` where it runs, and reads on.
    readings: Option<Arc<Readings>>,
}

/// What a processing is told beside the setup.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Told {
    /// How the module is found.
    pub methods: Vec<Method>,
    /// Which wavelength the fan is corrected to.
    pub wavelength: WavelengthUse,
}

/// A capture that was solved (or not, with the reason inside).
pub struct Solved {
    /// Which capture.
    pub capture: CaptureId,
    /// What came out.
    pub solution: CaptureSolution,
    /// Pictures that the store gave back damaged, with how. They were left out.
    pub damaged: Vec<String>,
    /// Where the time went.
    pub seconds: StageSeconds,
}

/// The methods that solve a capture by itself when `methods` are wanted. The adjustment of the
/// session is a further processing, and starts from them.
pub fn of_captures(methods: &[Method]) -> Vec<Method> {
    let alone = |method: &&Method| **method != Method::SessionAdjustment;
    let alone: Vec<Method> = methods.iter().filter(alone).copied().collect();
    if alone.is_empty() { Method::USUAL.to_vec() } else { alone }
}

/// What the store is told of a processing before its first capture. `measurement_json` is what
/// solving is told.
pub fn described(session: SessionId, told: &Told, measurement_json: &str) -> NewProcessing {
    let names: Vec<&str> = told.methods.iter().map(|m| m.name()).collect();
    let wavelength = told.wavelength.name();
    let hash = blake3::hash(measurement_json.as_bytes()).to_hex();
    NewProcessing {
        session,
        created: jiff::Timestamp::now(),
        software: SOFTWARE.to_owned(),
        options_json: serde_json::json!({ "methods": names, "wavelength": wavelength }).to_string(),
        lineage_json: serde_json::json!({ "measurement_blake3": hash.as_str() }).to_string(),
        measurement_json: None,
        files: Vec::new(),
        batch: None,
    }
}

impl Pipeline {
    /// Begins a run's own processing of `session`, capture by capture: each by what had been read
    /// when it was taken.
    ///
    /// # Errors
    /// When the store refuses it.
    pub async fn begin(
        store: Arc<Store>,
        session: SessionId,
        setup: Arc<Setup>,
        methods: &[Method],
    ) -> anyhow::Result<Self> {
        let told = Told { methods: of_captures(methods), wavelength: WavelengthUse::Live };
        let new = described(session, &told, &serde_json::to_string(&*setup)?);
        let processing = store.start_processing(&new).await?;
        Ok(Self { store, session, processing, setup, told: Arc::new(told), readings: None })
    }

    /// Goes on with a processing of a stored session that was begun.
    ///
    /// # Errors
    /// When the session cannot be read.
    pub async fn of(
        store: Arc<Store>,
        (session, processing): (SessionId, ProcessingId),
        setup: Arc<Setup>,
        told: Told,
    ) -> anyhow::Result<Self> {
        let readings = Some(Arc::new(Readings::of(&setup, &store.readings(session).await?)));
        Ok(Self { store, session, processing, setup, told: Arc::new(told), readings })
    }

    async fn wavelength(&self, capture: &StoredCapture) -> anyhow::Result<Wavelength> {
        let using = self.told.wavelength;
        if let Some(readings) = &self.readings {
            return Ok(readings.at(&self.setup, capture, using));
        }
        // Where it was read at the capture, no other reading is looked for.
        let alone = Readings::default().at(&self.setup, capture, using);
        if alone.source == WavelengthSource::Read {
            return Ok(alone);
        }
        let stored = self.store.readings(self.session).await?;
        Ok(Readings::of(&self.setup, &stored).at(&self.setup, capture, using))
    }

    /// Solves one stored capture and stores what came out. A capture that cannot be solved is no
    /// error: its reason is stored.
    ///
    /// # Errors
    /// When the store fails.
    pub async fn solve(&self, capture: &StoredCapture) -> anyhow::Result<Solved> {
        let mut files = Vec::new();
        let mut unread = Vec::new();
        for picture in &capture.pictures {
            match self.store.picture(self.session, &capture.id, &picture.camera).await {
                Ok(bytes) => files.push((picture.camera.clone(), bytes)),
                // The other cameras may do: a corrupt picture is said, and left out.
                Err(error) => unread.push(format!("{}: {error}", picture.camera)),
            }
        }
        let (setup, told) = (self.setup.clone(), self.told.clone());
        let wavelength = self.wavelength(capture).await?;
        let id = capture.id.clone();
        let (solved, row) = tokio::task::spawn_blocking(move || {
            let (mut solution, seconds) =
                solve_pictures(&setup, &files, &wavelength, &told.methods);
            solution.notes.extend_from_slice(&unread);
            let solved = Solved { capture: id, solution, damaged: unread, seconds };
            let row = row(&solved);
            (solved, row)
        })
        .await
        .with_context(|| format!("failed to solve capture {}", capture.id))?;
        self.store.save_solution(self.processing, &row?).await?;
        Ok(solved)
    }

    /// Ends the processing.
    ///
    /// # Errors
    /// When the store refuses it.
    pub async fn finish(&self) -> anyhow::Result<()> {
        Ok(self.store.finish_processing(self.processing, jiff::Timestamp::now()).await?)
    }
}

/// Pictures to solution, the cameras in parallel; the order of cameras is that of their names, so
/// the result does not depend on the number of threads.
fn solve_pictures(
    setup: &Setup,
    files: &[(InstrumentName, Vec<u8>)],
    wavelength: &Wavelength,
    methods: &[Method],
) -> (CaptureSolution, StageSeconds) {
    let begun: Vec<Mutex<Instant>> = files.iter().map(|_| Mutex::new(Instant::now())).collect();
    let spent: Vec<Mutex<[f64; 2]>> = files.iter().map(|_| Mutex::default()).collect();
    let told = |i: usize, stage: Stage| {
        let mut begun = begun[i].lock().unwrap_or_else(PoisonError::into_inner);
        let passed = begun.elapsed().as_secs_f64();
        *begun = Instant::now();
        let mut spent = spent[i].lock().unwrap_or_else(PoisonError::into_inner);
        match stage {
            Stage::Begun => {}
            Stage::Decoded => spent[0] = passed,
            Stage::Detected => spent[1] += passed,
        }
    };
    let seen = sight_all(files, |(camera, bytes)| read(setup, camera.as_str(), bytes), told);
    let mut seconds = StageSeconds::default();
    let mut sightings = BTreeMap::new();
    let mut notes = Vec::new();
    for (((camera, _), result), spent) in files.iter().zip(seen).zip(&spent) {
        // Cameras go in parallel: the slowest one counts.
        let [decode, detect] = *spent.lock().unwrap_or_else(PoisonError::into_inner);
        seconds.decode = decode.max(seconds.decode);
        seconds.detect = detect.max(seconds.detect);
        match result {
            Ok(sighting) => {
                sightings.insert(camera.as_str().to_owned(), sighting);
            }
            Err(reason) => notes.push(format!("{camera}: {reason}")),
        }
    }
    let before = Instant::now();
    let mut identified = 0.0;
    let mut solution = solve_capture(setup, &sightings, wavelength, methods, &mut || {
        identified = before.elapsed().as_secs_f64();
    });
    seconds.identify = identified;
    seconds.adjust = before.elapsed().as_secs_f64() - identified;
    solution.notes.append(&mut notes);
    (solution, seconds)
}

/// A picture, if it is of the size that its camera's calibration is for.
fn read(setup: &Setup, camera: &str, bytes: &[u8]) -> Result<GrayImage, String> {
    let image = decode(bytes).map_err(|error| error.to_string())?;
    if let Some(c) = setup.cameras.get(camera)
        && (c.model.width, c.model.height) != (image.width, image.height)
    {
        return Err(format!(
            "the picture has {} x {} pixels, its calibration is for {} x {}",
            image.width, image.height, c.model.width, c.model.height
        ));
    }
    Ok(image)
}

/// Adjusts all captures of a solved session together, as a further processing that holds the
/// captures' own results as well.
///
/// # Errors
/// When the session cannot be adjusted as a whole, or the store fails.
pub async fn adjust_session(store: &Arc<Store>, id: SessionId) -> anyhow::Result<Vec<Solved>> {
    let loaded = crate::loaded::load(store, id).await?;
    let mut methods = loaded.methods();
    methods.retain(|method| *method != Method::SessionAdjustment);
    methods.push(Method::SessionAdjustment);
    let told = Told { methods, wavelength: WavelengthUse::Live.of_session() };
    let joint = adjusted(loaded, told.wavelength).await?;
    let mut new = described(id, &told, &serde_json::to_string(&*joint.setup)?);
    new.measurement_json.clone_from(&joint.told);
    new.files.clone_from(&joint.files);
    let processing = store.start_processing(&new).await?;
    let solved = joint.save(store, processing).await?;
    store.finish_processing(processing, jiff::Timestamp::now()).await?;
    Ok(solved)
}

/// All captures of a session, adjusted together.
pub struct Adjusted {
    setup: Arc<Setup>,
    /// What solving was told, where that is not what the session was run with.
    told: Option<String>,
    /// The files that it was read from.
    files: Vec<UsedFile>,
    solved: Vec<Solved>,
}

/// Adjusts the captures of a processing together, the wavelength at each as `using` says.
///
/// # Errors
/// When they cannot be adjusted as a whole.
pub async fn adjusted(mut loaded: Loaded, using: WavelengthUse) -> anyhow::Result<Adjusted> {
    loaded.use_wavelength(using);
    let id = loaded.session.header.id;
    tokio::task::spawn_blocking(move || {
        let before = Instant::now();
        let joint = crate::loaded::adjust_together(&loaded.setup, &loaded.captures)
            .map_err(|reason| anyhow::anyhow!("session {id}: {reason}"))?;
        let share = before.elapsed().as_secs_f64() / loaded.captures.len().max(1) as f64;
        let solved = with_joint(&loaded, joint, share);
        let NewProcessing { measurement_json: told, files, .. } = loaded.processing.start;
        Ok(Adjusted { setup: Arc::new(loaded.setup), told, files, solved })
    })
    .await?
}

/// The captures' own solutions with the joint ones beside them.
fn with_joint(loaded: &Loaded, joint: SessionSolution, share: f64) -> Vec<Solved> {
    let mut all = Vec::new();
    for (i, (capture, pose)) in loaded.captures.iter().zip(joint.poses).enumerate() {
        let Ok(solution) = &capture.solution else { continue };
        let mut solution = solution.clone();
        for knock in joint.knocks.iter().filter(|knock| knock.capture == i) {
            let note = "was knocked before this capture; it has a new orientation from here on";
            solution.notes.push(format!("{} {note}", knock.camera));
        }
        solution.results.retain(|r| r.method != Method::SessionAdjustment);
        let alike = solution.results.iter().find(|r| r.method == Method::VirtualCamera);
        let reference_nm = loaded.setup.pattern.reference_wavelength_nm;
        solution.results.push(MethodResult {
            method: Method::SessionAdjustment,
            pose,
            beams_used: alike.map_or(0, |r| r.beams_used),
            sigma0: joint.sigma0,
            wavelength_nm: alike.map_or(reference_nm, |r| r.wavelength_nm),
            wavelength: capture.wavelength,
            ambiguous: alike.is_some_and(|r| r.ambiguous),
        });
        let seconds = StageSeconds { adjust: capture.seconds.adjust + share, ..capture.seconds };
        all.push(Solved { capture: capture.id.clone(), solution, damaged: Vec::new(), seconds });
    }
    all
}

impl Adjusted {
    /// Stores it in a processing that was begun, beside what that has already.
    ///
    /// # Errors
    /// When the store fails.
    pub async fn save(
        self,
        store: &Store,
        processing: ProcessingId,
    ) -> anyhow::Result<Vec<Solved>> {
        let there = store.solved_captures(processing).await?;
        for solved in self.solved.iter().filter(|solved| !there.contains(&solved.capture)) {
            store.save_solution(processing, &row(solved)?).await?;
        }
        Ok(self.solved)
    }
}

fn row(solved: &Solved) -> anyhow::Result<SolutionRow> {
    let poses = solved
        .solution
        .results
        .iter()
        .map(|r| PoseRow {
            capture: solved.capture.clone(),
            method: r.method.name().to_owned(),
            pose: r.pose.clone(),
            beams_used: r.beams_used as u64,
            sigma0: r.sigma0,
            wavelength_nm: r.wavelength_nm,
            wavelength_source: r.wavelength.map(|known| known.source.name().to_owned()),
            wavelength_u_nm: r.wavelength.map(|known| known.u_nm()),
            wavelength_age_s: r.wavelength.and_then(|known| known.age_s),
            ambiguous: r.ambiguous,
        })
        .collect();
    // Observations are kept apart, by camera.
    let mut bare = solved.solution.clone();
    let mut observations_json = BTreeMap::new();
    for (name, camera) in &mut bare.cameras {
        let taken = std::mem::take(&mut camera.observations);
        observations_json.insert(name.clone(), serde_json::to_string(&taken)?);
    }
    Ok(SolutionRow {
        capture: solved.capture.clone(),
        seconds_json: serde_json::to_string(&solved.seconds)?,
        solution_json: serde_json::to_string(&bare)?,
        poses,
        observations_json,
    })
}

/// The solution that a row holds.
///
/// # Errors
/// When its JSON is not what this program writes.
pub fn solution_of(row: &SolutionRow) -> anyhow::Result<(CaptureSolution, StageSeconds)> {
    let mut solution: CaptureSolution = serde_json::from_str(&row.solution_json)?;
    for (name, json) in &row.observations_json {
        if let Some(camera) = solution.cameras.get_mut(name) {
            camera.observations = serde_json::from_str(json)?;
        }
    }
    Ok((solution, serde_json::from_str(&row.seconds_json)?))
}
