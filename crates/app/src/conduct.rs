//! A session from its first step (or the first that is left) to its report: the engine, beside it
//! the solving of captures, then analysis and report.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use beampose_analysis::{ReportInput, TranslationResult};
use beampose_core::{CaptureId, Gap, RunSink, SessionHeader, SessionId, SessionOutcome};
use beampose_engine::{Control, Earlier, EngineError, Observers, RunSummary, Surroundings};
use beampose_photogrammetry::solve::Method;
use beampose_store::{Store, StoredCapture};
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};
use tracing::Instrument as _;

use crate::calibration_record::{record_run, told};
use crate::cli::report::exit_of;
use crate::cli::sessions::plain_table;
use crate::cli::solve::solve_session;
use crate::cli::{Ended, close};
use crate::input::Checked;
use crate::loaded::{Analysed, load, method_of};
use crate::notify::Hook;
use crate::operator::{Answers, Desk, answers};
use crate::output::{Exit, complain, print};
use crate::pipeline::{Pipeline, adjust_session};
use crate::progress::Progress;
use crate::remote::{Mailbox, listen};
use crate::rescue::rescue;
use crate::rig_lock::RigLock;
use crate::session_lock::SessionLock;
use crate::session_report::{input, prepare, write};
use crate::truth;
use crate::wiring::person::WithPerson;
use crate::wiring::{Laboratory, Recorder};

/// A session about to run.
pub struct Session {
    /// Its plan and rig.
    pub checked: Checked,
    /// Its instruments.
    pub laboratory: Laboratory,
    /// What the store knows of it.
    pub header: SessionHeader,
    /// What an earlier run did, and the gap since; `None` where it begins now.
    pub earlier: Option<(Earlier, Gap)>,
    /// Captures of the earlier run.
    pub captures: Vec<CaptureId>,
    /// Answers to the plan's prompts.
    pub answers: Answers,
}

/// How long a run waits for a store that does not take what it is given: somebody has to come and
/// make room.
const STORE_PATIENCE: Duration = Duration::from_secs(24 * 3600);

/// A task that ends with whoever waits for nothing of it.
struct AbortOnDrop(tokio::task::JoinHandle<()>);

impl Drop for AbortOnDrop {
    fn drop(&mut self) {
        self.0.abort();
    }
}

/// How it is shown.
#[derive(Debug, Clone, clap::Args)]
pub struct Shown {
    /// Where to write the report [default: reports/SESSION]
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
    /// Print one JSON object instead of the table: session, outcome, verdict, report
    #[arg(long)]
    pub json: bool,
    /// No progress bar
    #[arg(short, long)]
    pub quiet: bool,
    /// Answers to the plan's prompts, a YAML map from their names to answers; without it the
    /// terminal is asked
    #[arg(long, value_name = "FILE")]
    pub answers: Option<PathBuf>,
    /// A command that is run when the run ends or needs a person, with a JSON object on its standard
    /// input: `event` (paused, asked, laser_unknown, ended), `session`, and what belongs to it
    #[arg(long, value_name = "COMMAND", env = "BEAMPOSE_NOTIFY")]
    pub notify: Option<String>,
    /// Keep what goes over the lines to instruments, byte for byte, one JSON object a line
    #[arg(long, value_name = "FILE")]
    pub record_wire: Option<PathBuf>,
}

impl Shown {
    /// Who keeps what goes over lines, if that is wanted.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn recorder(&self) -> Result<Option<Arc<Recorder>>, Ended> {
        let Some(path) = &self.record_wire else { return Ok(None) };
        let recorder = Recorder::create(path);
        recorder
            .map(|it| Some(Arc::new(it)))
            .map_err(|error| Ended::input(format!("--record-wire {}: {error}", path.display())))
    }

    /// The answers of the file, if there is one.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn read_answers(&self) -> Result<Answers, Ended> {
        self.answers.as_deref().map_or_else(|| Ok(Answers::new()), answers).map_err(Ended::input)
    }

    /// The folder of a session's report: `--out`, else `reports/` and the session's id.
    ///
    /// # Errors
    /// When a file is in its place: better now than after an hour.
    pub fn folder(&self, session: SessionId) -> Result<PathBuf, Ended> {
        self.refuse_a_file()?;
        Ok(crate::cli::report_folder(self.out.as_ref(), session))
    }

    /// # Errors
    /// When a file is where the report's folder should be.
    pub fn refuse_a_file(&self) -> Result<(), Ended> {
        match &self.out {
            Some(out) if out.exists() && !out.is_dir() => {
                Err(Ended::input(format!("{} is a file, not a folder", out.display())))
            }
            _ => Ok(()),
        }
    }
}

impl Session {
    /// Runs it to its end; the exit code is that of its verdict. The lock is held all the while.
    ///
    /// # Errors
    /// When an instrument, the store or the program fails.
    pub async fn conduct(
        self,
        store: Arc<Store>,
        _lock: SessionLock,
        shown: &Shown,
    ) -> Result<Exit, Ended> {
        let folder = shown.folder(self.header.id)?;
        prepare(&folder).map_err(|error| Ended::input(format!("{error:#}")))?;
        let session = self.header.id;
        let purpose = format!("session {session}");
        let rig_lock = RigLock::take(&self.checked.rig, &purpose).map_err(Ended::input)?;
        let plan = &self.checked.plan;
        let methods: Vec<Method> = plan.methods.iter().map(|m| method_of(*m)).collect();
        let progress = Progress::new(&self.checked.summary, !shown.quiet && !shown.json);
        let control = Control::new();
        let mailbox = Mailbox::of(store.path(), session);
        let _listening = [
            AbortOnDrop(tokio::spawn(listen(control.clone()))),
            AbortOnDrop(tokio::spawn(mailbox.obey(control.clone()))),
        ];

        crate::log::to_session(&folder)
            .map_err(|error| Ended::input(format!("{}: {error}", folder.display())))?;
        let (captured, to_solve) = unbounded_channel();
        let (triggered, to_note) = unbounded_channel();
        for id in &self.captures {
            // Solved again with those to come: one processing holds them all.
            let _gone = captured.send(id.clone());
        }
        let mut observers = Observers::none().display(progress.clone());
        if let Some(command) = &shown.notify {
            observers = observers.display(Hook::new(command, session));
        }
        let observers = observers.on_capture(move |capture| {
            // A receiver that is gone has told its own error.
            let at = capture.pictures.first().map(|p| p.requested);
            let _gone = captured.send(capture.id.clone());
            let _gone = at.map(|at| triggered.send((capture.id, at)));
        });
        let solving = solve_captures(
            store.clone(),
            session,
            Arc::new(self.laboratory.setup.clone()),
            methods,
            to_solve,
            progress.clone(),
        );
        let span = tracing::info_span!("session", id = %session);
        let solving = tokio::spawn(solving.instrument(span));
        let recording = self.laboratory.world.clone().map(|world| {
            let store = store.clone();
            tokio::spawn(async move { truth::record(&store, session, &world, to_note).await })
        });

        let desk = Desk::new(self.answers.clone(), &control);
        let desk = WithPerson::new(&desk, &self.checked.rig, &self.laboratory);
        let ended = self.engine(&store, observers, &control, &desk).await;
        // From here on nothing is driven any more.
        drop(rig_lock);
        if let Err(EngineError::NotStored { summary, .. }) = &ended {
            match rescue(&folder, &summary.unstored) {
                Ok(rescued) => complain(&format!(
                    "beampose: what could not be stored is in {}",
                    rescued.display()
                )),
                Err(error) => {
                    complain(&format!("beampose: what could not be stored is lost: {error:#}"))
                }
            }
        }
        let solved = solving.await?;
        let recorded = match recording {
            Some(recording) => recording.await?,
            None => Ok(()),
        };
        progress.finish();
        // The run's own failure is said first: the others may follow from it.
        let summary = ended?;
        let damaged = solved?;
        recorded?;
        if plan.methods.contains(&beampose_plan::Method::SessionAdjustment)
            && let Err(error) = adjust_session(&store, session).await
        {
            // The captures' own results stand.
            complain(&format!("beampose: no session adjustment: {error:#}"));
        }
        for failure in &summary.failures {
            complain(&format!("{}: {}", failure.doing, failure.reason));
        }
        for picture in &damaged {
            complain(&format!("beampose: damaged in the database: {picture}"));
        }
        let is_sound = damaged.is_empty();
        let (outcome, captures) = (summary.outcome, summary.captures);
        let ending = Ending { session, outcome, captures, is_sound };
        let exit = conclude(&store, ending, &folder, shown).await?;
        close(store).await;
        Ok(exit)
    }

    /// Runs the steps on the laboratory's clock.
    async fn engine(
        &self,
        store: &Arc<Store>,
        observers: Observers,
        control: &Control,
        desk: &WithPerson<'_>,
    ) -> Result<RunSummary, EngineError> {
        let clock = self.laboratory.run_clock();
        let sink: &dyn RunSink = &**store;
        let faulty = self.laboratory.faulty_sink(store);
        let around = Surroundings {
            bench: &self.laboratory.bench,
            sink: faulty.as_ref().map_or(sink, |faulty| faulty),
            observers: &observers,
            clock: &*clock,
            control,
            operator: desk,
            rules: &self.checked.summary.rules,
            store_patience: STORE_PATIENCE,
        };
        let (steps, header) = (&self.checked.summary.steps, &self.header);
        let drive = &self.laboratory.clock;
        let ended = match &self.earlier {
            None => drive.drive(Box::pin(beampose_engine::run(steps, header, &around))).await,
            Some((earlier, gap)) => {
                let resumed = beampose_engine::resume(steps, header, earlier.clone(), gap, &around);
                drive.drive(Box::pin(resumed)).await
            }
        };
        observers.finish(Duration::from_secs(2));
        ended
    }
}

/// Solves, analyses and reports a session whose steps are all done: what is left of it where the
/// program died after the last.
///
/// # Errors
/// When the store or the program fails.
pub async fn finish(
    store: Arc<Store>,
    (session, _lock): (SessionId, SessionLock),
    outcome: SessionOutcome,
    methods: &[Method],
    shown: &Shown,
) -> Result<Exit, Ended> {
    let folder = shown.folder(session)?;
    prepare(&folder).map_err(|error| Ended::input(format!("{error:#}")))?;
    let solved = solve_session(&store, session, methods, !shown.quiet && !shown.json).await?;
    if methods.contains(&Method::SessionAdjustment) {
        adjust_session(&store, session).await?;
    }
    for picture in solved.iter().flat_map(|one| &one.damaged) {
        complain(&format!("beampose: damaged in the database: {picture}"));
    }
    let is_sound = solved.iter().all(|one| one.damaged.is_empty());
    let ending = Ending { session, outcome, captures: solved.len(), is_sound };
    let exit = conclude(&store, ending, &folder, shown).await?;
    close(store).await;
    Ok(exit)
}

/// How a session ended.
#[derive(Clone, Copy)]
struct Ending {
    session: SessionId,
    outcome: SessionOutcome,
    captures: usize,
    /// All pictures were read back as they were stored.
    is_sound: bool,
}

/// Analysis, report, last words.
async fn conclude(
    store: &Store,
    ending: Ending,
    folder: &std::path::Path,
    shown: &Shown,
) -> Result<Exit, Ended> {
    let id = ending.session;
    let loaded = load(store, id).await?;
    let input = input(store, &loaded).await?;
    let result_json = Analysed::of(&input).result_json()?;
    let written = write(&input, folder)?;
    if let Some(result_json) = result_json {
        let (processing, created) = (loaded.processing.id, jiff::Timestamp::now());
        let row = beampose_store::ResultRow { processing, created, result_json };
        store.save_result(&row).await?;
    }
    let recorded = record_run(store, &input, &loaded.session.header).await?;
    if let Some(command) = &shown.notify {
        let hook = Hook::new(command, id);
        let report = written.html.display().to_string();
        let (outcome, verdict) = (ending.outcome.as_str(), input.verdict.as_str());
        let ended = serde_json::json!({ "outcome": outcome, "verdict": verdict, "report": report });
        tokio::task::spawn_blocking(move || hook.tell("ended", ended)).await?;
    }
    if shown.json {
        print(
            &serde_json::json!({
                "session": id.to_string(),
                "outcome": ending.outcome.as_str(),
                "verdict": input.verdict.as_str(),
                "captures": ending.captures,
                "report": written.html.display().to_string(),
                "calibration": recorded.map(|record| record.head.blake3),
            })
            .to_string(),
        );
    } else {
        print(&last_words(ending, &input));
        if let Some(record) = &recorded {
            print(&told(record));
        }
        print(&format!("report   {}", written.html.display()));
    }
    Ok(match ending.outcome {
        SessionOutcome::Completed if !ending.is_sound => Exit::Failed,
        SessionOutcome::Completed => exit_of(input.verdict),
        SessionOutcome::Stopped | SessionOutcome::Aborted | SessionOutcome::Halted => Exit::Aborted,
        SessionOutcome::Error => Exit::Failed,
    })
}

/// Solves captures as they are stored. They are read back from the store, so that memory does not
/// grow when the run is faster than the solver, and that a picture which the disk damaged is known
/// at once; those are returned.
async fn solve_captures(
    store: Arc<Store>,
    session: SessionId,
    setup: Arc<beampose_photogrammetry::Setup>,
    methods: Vec<Method>,
    mut captured: UnboundedReceiver<CaptureId>,
    progress: Progress,
) -> anyhow::Result<Vec<String>> {
    let mut pipeline: Option<Pipeline> = None;
    let mut damaged = Vec::new();
    while let Some(id) = captured.recv().await {
        let pipeline = match &mut pipeline {
            Some(pipeline) => pipeline,
            None => pipeline
                .insert(Pipeline::begin(store.clone(), session, setup.clone(), &methods).await?),
        };
        let stored = store.captures(session).await?;
        let capture: Option<&StoredCapture> = stored.iter().find(|c| c.id == id);
        if let Some(capture) = capture {
            let solved = pipeline.solve(capture).await?;
            progress.solved(&solved);
            damaged.extend(solved.damaged);
        }
    }
    // A session without captures has a processing all the same: the report says what there is.
    match pipeline {
        Some(pipeline) => pipeline.finish().await?,
        None => Pipeline::begin(store, session, setup, &methods).await?.finish().await?,
    }
    Ok(damaged)
}

fn last_words(ending: Ending, input: &ReportInput) -> String {
    let mut lines = vec![
        format!("session  {} ({})", ending.session, ending.outcome.as_str()),
        format!("verdict  {}", input.verdict.as_str()),
    ];
    lines.extend(input.reasons.iter().map(|r| format!("         {r}")));
    if let Some(result) = &input.translation {
        lines.push(positions(result));
    }
    if let Some(rig_lines) = input.drift.as_ref().and_then(|drift| drift.rig_lines.as_ref()) {
        lines.push(format!("for the rig, below `measurement:`\n{}", rig_lines.trim_end()));
    }
    lines.join("\n")
}

fn positions(result: &TranslationResult) -> String {
    let mut table = plain_table();
    let mut header = vec!["rail mm".to_owned()];
    for method in result.methods.keys() {
        header.push(format!("{} mm", method.name()));
        header.push("U (k = 2)".to_owned());
    }
    table.set_header(header);
    let Some(first) = result.methods.values().max_by_key(|m| m.positions.len()) else {
        return String::new();
    };
    for stop in &first.positions {
        let mut row = vec![format!("{:.0}", stop.rail_mm)];
        for method in result.methods.values() {
            let same = |p: &&beampose_analysis::translation::PositionResult| {
                (p.rail_mm - stop.rail_mm).abs() < 1e-3
            };
            match method.positions.iter().find(same) {
                Some(p) => {
                    row.push(format!("{:+.3}", p.mean_difference_mm));
                    row.push(format!("{:.3}", p.expanded_uncertainty_mm));
                }
                None => row.extend(["none".to_owned(), String::new()]),
            }
        }
        table.add_row(row);
    }
    table.to_string()
}
