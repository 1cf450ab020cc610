//! Solving stored sessions again, one or many: what is begun, what an interrupted command left, and
//! the work on all cores.
//!
//! All processings of a command are begun together, under one batch. A command that is the same as
//! an interrupted one finds that one's batch, and goes on with it: what is finished in it is not
//! solved again, what is not is gone on with, capture by capture. The batch's lock tells a command
//! that died from one that runs.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context as _;
use beampose_core::SessionId;
use beampose_photogrammetry::Setup;
use beampose_photogrammetry::solve::Method;
use beampose_store::{
    NewProcessing, Processing, ProcessingId, ResultRow, Store, StoredCapture, fresh_batch,
};
use futures::StreamExt as _;
use tokio::sync::Semaphore;

use crate::calibration::MeasuredWith;
use crate::loaded::load_processing;
use crate::pipeline::{Pipeline, Solved, Told, adjusted, described, of_captures, solution_of};
use crate::progress::Progress;
use crate::session_lock::SessionLock;

/// Solving one session.
pub struct Job {
    session: SessionId,
    setup: Arc<Setup>,
    /// Capture by capture.
    told: Told,
    alone: Stage,
    /// All captures together, if that is wanted.
    together: Option<Stage>,
}

/// A processing that is to be made, or is made already.
struct Stage {
    new: NewProcessing,
    id: Option<ProcessingId>,
    finished: bool,
}

impl Stage {
    fn new(new: NewProcessing) -> Self {
        Self { new, id: None, finished: false }
    }

    /// The processing of `batch` that is this one.
    fn find<'a>(&self, all: &'a [Processing], batch: &str) -> Option<&'a Processing> {
        all.iter().find(|p| p.start.batch.as_deref() == Some(batch) && self.is(&p.start))
    }

    fn is(&self, start: &NewProcessing) -> bool {
        let of = |p: &NewProcessing| {
            (p.options_json.clone(), p.lineage_json.clone(), p.software.clone())
        };
        of(start) == of(&self.new)
    }

    fn take(&mut self, found: &Processing) {
        (self.id, self.finished) = (Some(found.id), found.finished.is_some());
    }
}

impl Job {
    /// Solving `session` as `wanted`; `other` are other calibrations, pattern or options than those
    /// of the session.
    ///
    /// # Errors
    /// When the session cannot be read.
    pub async fn new(
        store: &Store,
        session: SessionId,
        wanted: &Told,
        other: Option<MeasuredWith>,
    ) -> anyhow::Result<Self> {
        let stored = store.session(session).await?.header.measurement_json;
        let mut files = Vec::new();
        let (setup, other) = match other {
            Some(told) => {
                let json = serde_json::to_string(&told.setup)?;
                // Told the same, it is the same processing.
                let json = Some(json).filter(|json| *json != stored);
                files = if json.is_some() { told.files } else { files };
                (told.setup, json)
            }
            None => {
                let setup = serde_json::from_str(&stored)
                    .context("the session's measurement setup cannot be read")?;
                (setup, None)
            }
        };
        let begun = |told: &Told| {
            let new = described(session, told, other.as_ref().unwrap_or(&stored));
            let (measurement_json, files) = (other.clone(), files.clone());
            Stage::new(NewProcessing { measurement_json, files, ..new })
        };
        let told = Told { methods: of_captures(&wanted.methods), wavelength: wanted.wavelength };
        let together = wanted.methods.contains(&Method::SessionAdjustment).then(|| {
            let methods = [told.methods.as_slice(), &[Method::SessionAdjustment]].concat();
            begun(&Told { methods, wavelength: told.wavelength.of_session() })
        });
        Ok(Self { session, setup: Arc::new(setup), alone: begun(&told), together, told })
    }

    fn stages(&mut self) -> impl Iterator<Item = &mut Stage> {
        std::iter::once(&mut self.alone).chain(&mut self.together)
    }

    /// Takes over what `batch` has of this job; all of it or none.
    fn take(&mut self, all: &[Processing], batch: &str) -> bool {
        let found: Vec<Option<&Processing>> =
            self.stages().map(|stage| stage.find(all, batch)).collect();
        if found.iter().any(Option::is_none) {
            return false;
        }
        self.stages().zip(found.into_iter().flatten()).for_each(|(stage, p)| stage.take(p));
        true
    }
}

/// Several sessions that are solved by one command.
pub struct Batch {
    jobs: Vec<Job>,
    /// Held until all is done.
    _locks: Vec<SessionLock>,
    /// How many sessions an interrupted command had begun.
    pub continued: usize,
}

impl Batch {
    /// Begins all processings that an interrupted command has not begun already.
    ///
    /// # Errors
    /// When the store fails or a lock cannot be made.
    pub async fn begin(store: &Store, mut jobs: Vec<Job>) -> anyhow::Result<Self> {
        let mut stored = Vec::new();
        for job in &jobs {
            stored.push(store.processings(job.session).await?);
        }
        let mut locks = Vec::new();
        let mut continued = 0;
        let mut waiting: Vec<usize> = (0..jobs.len()).collect();
        for batch in interrupted(&mut jobs, &stored) {
            // Who holds it is at work on it.
            let Ok(lock) = SessionLock::of_batch(store.path(), &batch) else { continue };
            let before = waiting.len();
            waiting.retain(|&i| !jobs[i].take(&stored[i], &batch));
            continued += before - waiting.len();
            locks.push(lock);
        }
        let batch = fresh_batch();
        if !waiting.is_empty() {
            let lock = SessionLock::of_batch(store.path(), &batch);
            locks.push(lock.map_err(anyhow::Error::msg)?);
        }
        let mut fresh: Vec<&mut Stage> = Vec::new();
        for (i, job) in jobs.iter_mut().enumerate() {
            if waiting.contains(&i) {
                fresh.extend(job.stages());
            }
        }
        for stage in &mut fresh {
            stage.new.batch = Some(batch.clone());
        }
        let new: Vec<NewProcessing> = fresh.iter().map(|stage| stage.new.clone()).collect();
        let ids = store.start_processings(&new).await?;
        fresh.into_iter().zip(ids).for_each(|(stage, id)| stage.id = Some(id));
        Ok(Self { jobs, _locks: locks, continued })
    }

    /// Solves all, on all cores; `done` hears of each session in the order of the jobs.
    pub async fn solve(
        self,
        store: &Arc<Store>,
        work: &Work,
        mut done: impl FnMut(SessionId, anyhow::Result<Outcome>),
    ) {
        let mut sessions = futures::stream::iter(self.jobs)
            .map(|job| async move { (job.session, job.solve(store, work).await) })
            .buffered(work.width);
        while let Some((session, outcome)) = sessions.next().await {
            done(session, outcome);
        }
    }
}

/// The batches in which something of these jobs was begun and not finished, the newest first.
fn interrupted(jobs: &mut [Job], stored: &[Vec<Processing>]) -> Vec<String> {
    let mut batches = BTreeSet::new();
    for (job, all) in jobs.iter_mut().zip(stored) {
        for processing in all.iter().filter(|p| p.finished.is_none()) {
            if job.stages().any(|stage| stage.is(&processing.start)) {
                batches.extend(processing.start.batch.clone());
            }
        }
    }
    // Their names begin with the time.
    batches.into_iter().rev().collect()
}

/// What all sessions of a command share.
#[derive(Clone)]
pub struct Work {
    /// Captures that are solved at once.
    captures: Arc<Semaphore>,
    /// How many that are.
    width: usize,
    /// Set when somebody wants to stop.
    stop: Arc<AtomicBool>,
    /// Where it is shown.
    pub progress: Progress,
}

impl Work {
    /// Work on all cores.
    pub fn new(progress: Progress) -> Self {
        // More than cores: who waits for the disk leaves its core to another.
        let width = 2 * std::thread::available_parallelism().map_or(2, usize::from);
        let captures = Arc::new(Semaphore::new(width));
        Self { captures, width, stop: Arc::new(AtomicBool::new(false)), progress }
    }

    /// No capture is begun from now on.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// True where somebody wanted to stop.
    pub fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Solves captures, several at once; their order is kept. `None` where it was stopped.
    ///
    /// # Errors
    /// When the store fails.
    pub async fn captures(
        &self,
        pipeline: &Pipeline,
        captures: &[StoredCapture],
    ) -> anyhow::Result<Option<Vec<Solved>>> {
        let mut solving = futures::stream::iter(captures)
            .map(|capture| async move {
                let _permit = self.captures.acquire().await?;
                if self.is_stopped() {
                    return Ok(None);
                }
                let solved = pipeline.solve(capture).await?;
                self.progress.solved(&solved);
                anyhow::Ok(Some(solved))
            })
            .buffered(self.width);
        let mut all = Some(Vec::new());
        while let Some(one) = solving.next().await {
            match (one?, &mut all) {
                (Some(solved), Some(all)) => all.push(solved),
                _ => all = None,
            }
        }
        Ok(all)
    }
}

/// What became of a session.
pub enum Outcome {
    /// It is solved; the processing that shows it, and what is in it.
    Solved(ProcessingId, Vec<Solved>),
    /// It was stopped; what is solved is kept.
    Stopped,
}

impl Job {
    async fn solve(self, store: &Arc<Store>, work: &Work) -> anyhow::Result<Outcome> {
        let begun = "the processing is not begun";
        let alone = self.alone.id.context(begun)?;
        let Some(mut solved) = self.alone(store, work, alone).await? else {
            return Ok(Outcome::Stopped);
        };
        let Some(together) = &self.together else { return Ok(Outcome::Solved(alone, solved)) };
        if work.is_stopped() {
            return Ok(Outcome::Stopped);
        }
        let shown = together.id.context(begun)?;
        solved = if together.finished {
            stored(store, shown, self.session).await?
        } else {
            let processing = processing(store, self.session, alone).await?;
            let loaded = load_processing(store, self.session, processing).await?;
            let using = self.told.wavelength.of_session();
            let solved = adjusted(loaded, using).await?.save(store, shown).await?;
            finish(store, self.session, shown).await?;
            solved
        };
        Ok(Outcome::Solved(shown, solved))
    }

    /// Capture by capture: those that are left.
    async fn alone(
        &self,
        store: &Arc<Store>,
        work: &Work,
        id: ProcessingId,
    ) -> anyhow::Result<Option<Vec<Solved>>> {
        let there = store.solved_captures(id).await?;
        let captures = store.captures(self.session).await?;
        let left: Vec<StoredCapture> =
            captures.into_iter().filter(|capture| !there.contains(&capture.id)).collect();
        work.progress.skip(there.len() as u64);
        if !self.alone.finished {
            let of = (self.session, id);
            let (setup, told) = (self.setup.clone(), self.told.clone());
            let pipeline = Pipeline::of(store.clone(), of, setup, told).await?;
            let Some(solved) = work.captures(&pipeline, &left).await? else { return Ok(None) };
            finish(store, self.session, id).await?;
            if there.is_empty() {
                return Ok(Some(solved));
            }
        }
        stored(store, id, self.session).await.map(Some)
    }
}

async fn processing(
    store: &Store,
    session: SessionId,
    id: ProcessingId,
) -> anyhow::Result<Processing> {
    let all = store.processings(session).await?;
    let found = all.into_iter().find(|processing| processing.id == id);
    found.with_context(|| format!("session {session} has no processing {id}"))
}

/// What a processing holds, in the order of the captures.
async fn stored(
    store: &Store,
    id: ProcessingId,
    session: SessionId,
) -> anyhow::Result<Vec<Solved>> {
    let there = store.solved_captures(id).await?;
    let mut all = Vec::new();
    for capture in store.captures(session).await? {
        if there.contains(&capture.id) {
            let (solution, seconds) = solution_of(&store.solution(id, &capture.id).await?)?;
            all.push(Solved { capture: capture.id, solution, damaged: Vec::new(), seconds });
        }
    }
    Ok(all)
}

/// Ends a processing. Before that the result of the session's analysis is stored beside it, if it has
/// one: what is finished has its result.
async fn finish(store: &Store, session: SessionId, id: ProcessingId) -> anyhow::Result<()> {
    let loaded = load_processing(store, session, processing(store, session, id).await?).await?;
    let found = tokio::task::spawn_blocking(move || loaded.analysed()).await?;
    if let Some(result_json) = found.result_json()?
        && store.results(id).await?.is_empty()
    {
        let created = jiff::Timestamp::now();
        store.save_result(&ResultRow { processing: id, created, result_json }).await?;
    }
    Ok(store.finish_processing(id, jiff::Timestamp::now()).await?)
}
