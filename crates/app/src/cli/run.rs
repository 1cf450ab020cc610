//! `beampose run`.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use beampose_analysis::{ReportInput, TranslationResult};
use beampose_core::{SessionHeader, SessionId, SessionOutcome, Stamp};
use beampose_engine::{AbortHandle, EngineError, Observers, RunSummary, Surroundings};
use beampose_photogrammetry::solve::Method;
use beampose_store::{Store, StoredCapture};
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};

use super::report::exit_of;
use super::sessions::plain_table;
use super::{Database, Ended, close, report_folder};
use crate::calibration;
use crate::input::{Checked, checked};
use crate::output::{Exit, complain, print};
use crate::pipeline::{Pipeline, SOFTWARE, adjust_session};
use crate::progress::Progress;
use crate::session_report::{input, load, method_of, prepare, write};
use crate::settings::Overrides;
use crate::truth;
use crate::wiring::{self, Laboratory};

/// Run a plan on a rig, solve while it runs, analyse and report
///
/// Everything that is acquired goes into the database, one durable transaction a step; each capture
/// is solved while the run goes on. Ctrl-C stops at the next step: laser off first, `finally` runs,
/// the session closes as aborted and what it has is kept.
#[derive(clap::Args)]
pub struct Run {
    /// The plan, a YAML file
    plan: PathBuf,
    /// The rig, a YAML file; without it the one that the plan names
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// Where to write the report [default: reports/SESSION]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Print one JSON object instead of the table: session, outcome, verdict, report
    #[arg(long)]
    json: bool,
    /// No progress bar
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    overrides: Overrides,
    #[command(flatten)]
    database: Database,
}

impl Run {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let checked =
            checked(&self.plan, self.rig.as_deref(), &self.overrides).map_err(Ended::input)?;
        for warning in &checked.summary.warnings {
            complain(&warning.to_string());
        }
        let setup = calibration::setup(&checked.rig, &checked.rig_folder).map_err(Ended::input)?;
        let laboratory = wiring::laboratory(&checked.rig, setup).map_err(Ended::input)?;
        let header = header(&checked, &laboratory)?;
        let session = header.id;
        let folder = report_folder(self.out.as_ref(), session);
        // Better now than after an hour.
        if folder.exists() && !folder.is_dir() {
            return Err(Ended::input(format!("{} is a file, not a folder", folder.display())));
        }
        let store = self.database.open().await?;
        prepare(&folder).map_err(|error| Ended::input(format!("{error:#}")))?;
        let methods: Vec<Method> = checked.plan.methods.iter().map(|m| method_of(*m)).collect();
        let progress = Progress::new(
            checked.summary.steps.len() as u64,
            checked.summary.captures as u64,
            !self.quiet && !self.json,
        );
        let abort = AbortHandle::new();
        tokio::spawn(listen(abort.clone()));

        let (captured, to_solve) = unbounded_channel();
        let (triggered, to_note) = unbounded_channel();
        let observers = Observers::none().display(progress.clone()).on_capture(move |capture| {
            // A receiver that is gone has told its own error.
            let at = capture.pictures.first().map(|p| p.requested);
            let _gone = captured.send(capture.id.clone());
            let _gone = at.map(|at| triggered.send((capture.id, at)));
        });
        let solving = tokio::spawn(solve_captures(
            store.clone(),
            session,
            Arc::new(laboratory.setup.clone()),
            methods,
            to_solve,
            progress.clone(),
        ));
        let recording = laboratory.world.clone().map(|world| {
            let store = store.clone();
            tokio::spawn(async move { truth::record(&store, session, &world, to_note).await })
        });

        let ended = engine(&checked, &header, &laboratory, &store, observers, &abort).await;
        let solved = solving.await?;
        let recorded = match recording {
            Some(recording) => recording.await?,
            None => Ok(()),
        };
        progress.finish();
        // The run's own failure is said first: the others may follow from it.
        let summary = ended?;
        solved?;
        recorded?;
        if checked.plan.methods.contains(&beampose_plan::Method::SessionAdjustment)
            && let Err(error) = adjust_session(&store, session).await
        {
            // The captures' own results stand.
            complain(&format!("beampose: no session adjustment: {error:#}"));
        }
        let exit = self.conclude(&store, &summary, &folder).await?;
        close(store).await;
        Ok(exit)
    }

    /// Analysis, report, last words.
    async fn conclude(
        &self,
        store: &Store,
        summary: &RunSummary,
        folder: &Path,
    ) -> Result<Exit, Ended> {
        let id = summary.session;
        for failure in &summary.failures {
            complain(&format!("{}: {}", failure.doing, failure.reason));
        }
        let loaded = load(store, id).await?;
        let input = input(store, &loaded).await?;
        let written = write(&input, folder)?;
        if let Some(result) = &input.translation {
            store
                .save_result(&beampose_store::ResultRow {
                    processing: loaded.processing.id,
                    created: jiff::Timestamp::now(),
                    result_json: serde_json::to_string(result)?,
                })
                .await?;
        }
        if self.json {
            print(
                &serde_json::json!({
                    "session": id.to_string(),
                    "outcome": summary.outcome.as_str(),
                    "verdict": input.verdict.as_str(),
                    "captures": summary.captures,
                    "report": written.html.display().to_string(),
                })
                .to_string(),
            );
        } else {
            print(&last_words(summary, &input));
            print(&format!("report   {}", written.html.display()));
        }
        Ok(match summary.outcome {
            SessionOutcome::Completed => exit_of(input.verdict),
            SessionOutcome::Aborted => Exit::Aborted,
            SessionOutcome::Error => Exit::Failed,
        })
    }
}

/// Runs the steps on the laboratory's clock.
async fn engine(
    checked: &Checked,
    header: &SessionHeader,
    laboratory: &Laboratory,
    store: &Arc<Store>,
    observers: Observers,
    abort: &AbortHandle,
) -> Result<RunSummary, EngineError> {
    let clock = laboratory.clock.shared();
    let around = Surroundings {
        bench: &laboratory.bench,
        sink: &**store,
        observers: &observers,
        clock: &*clock,
        abort,
    };
    let run = Box::pin(beampose_engine::run(&checked.summary.steps, header, &around));
    let ended = laboratory.clock.drive(run).await;
    observers.finish(Duration::from_secs(2));
    ended
}

fn header(checked: &Checked, laboratory: &Laboratory) -> anyhow::Result<SessionHeader> {
    let opened: Stamp = laboratory.clock.shared().now();
    Ok(SessionHeader {
        id: SessionId::fresh(),
        title: checked.summary.title.clone(),
        experiment: checked.plan.experiment.as_str().to_owned(),
        plan_text: checked.plan.source.text().to_owned(),
        rig_text: checked.rig.source.text().to_owned(),
        measurement_json: serde_json::to_string(&laboratory.setup)?,
        plan_hash: checked.summary.plan_hash.clone(),
        software: SOFTWARE.to_owned(),
        seed: wiring::seed(&checked.rig),
        steps: u32::try_from(checked.summary.steps.len())?,
        opened,
    })
}

/// Solves captures as they are stored. They are read back from the store, so that memory does not
/// grow when the run is faster than the solver.
async fn solve_captures(
    store: Arc<Store>,
    session: SessionId,
    setup: Arc<beampose_photogrammetry::Setup>,
    methods: Vec<Method>,
    mut captured: UnboundedReceiver<beampose_core::CaptureId>,
    progress: Progress,
) -> anyhow::Result<()> {
    let mut pipeline: Option<Pipeline> = None;
    while let Some(id) = captured.recv().await {
        let pipeline = match &mut pipeline {
            Some(pipeline) => pipeline,
            None => pipeline
                .insert(Pipeline::begin(store.clone(), session, setup.clone(), &methods).await?),
        };
        let stored = store.captures(session).await?;
        let capture: Option<&StoredCapture> = stored.iter().find(|c| c.id == id);
        if let Some(capture) = capture {
            progress.solved(&pipeline.solve(capture).await?);
        }
    }
    // A session without captures has a processing all the same: the report says what there is.
    match pipeline {
        Some(pipeline) => pipeline.finish().await,
        None => Pipeline::begin(store, session, setup, &methods).await?.finish().await,
    }
}

/// Turns signals into the wish to stop.
async fn listen(abort: AbortHandle) {
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        let (Ok(mut term), Ok(mut hangup)) =
            (signal(SignalKind::terminate()), signal(SignalKind::hangup()))
        else {
            complain("beampose: signals cannot be caught; only Ctrl-C stops the run tidily");
            return;
        };
        loop {
            let reason = tokio::select! {
                _ = tokio::signal::ctrl_c() => "Ctrl-C",
                _ = term.recv() => "SIGTERM",
                _ = hangup.recv() => "SIGHUP",
            };
            if abort.reason().is_some() {
                complain("beampose: already stopping: laser off first, then `finally`");
            }
            abort.request(reason);
        }
    }
    #[cfg(not(unix))]
    if tokio::signal::ctrl_c().await.is_ok() {
        abort.request("Ctrl-C");
    }
}

fn last_words(summary: &RunSummary, input: &ReportInput) -> String {
    let mut lines = vec![
        format!("session  {} ({})", summary.session, summary.outcome.as_str()),
        format!("verdict  {}", input.verdict.as_str()),
    ];
    lines.extend(input.reasons.iter().map(|r| format!("         {r}")));
    if let Some(result) = &input.translation {
        lines.push(positions(result));
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
