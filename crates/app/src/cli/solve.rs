//! `beampose solve`: reprocessing of one, many or all sessions.

use std::collections::BTreeSet;
use std::sync::Arc;

use beampose_core::SessionId;
use beampose_photogrammetry::rotation::{from_wxyz, omega_phi_kappa};
use beampose_photogrammetry::solve::{Method, MethodResult};
use beampose_photogrammetry::{Setup, WavelengthUse};
use beampose_store::{SessionSummary, Store};

use super::filter::Filter;
use super::{Database, Ended, close, find};
use crate::batch::{Batch, Job, Outcome, Work};
use crate::calibration::MeasuredWith;
use crate::other_inputs::{Inputs, OtherInputs};
use crate::output::{Exit, complain, print};
use crate::pipeline::{Pipeline, Solved, Told};
use crate::progress::Progress;
use crate::session_lock::SessionLock;

/// Solve stored sessions again, as new processings beside the old ones
///
/// Nothing is overwritten: each session gets a further processing, and with the same options the same
/// bits. Sessions and captures are solved on all cores. Interrupted (Ctrl-C, or worse), the same
/// command goes on where it was. SESSION is an id, a unique beginning of one, or `latest`.
#[derive(clap::Args)]
pub struct Solve {
    /// Which sessions
    #[arg(required_unless_present = "all", value_name = "SESSION")]
    sessions: Vec<String>,
    /// All sessions with captures, or those that the filters below leave
    #[arg(long, conflicts_with = "sessions")]
    all: bool,
    /// How the module is found: virtual-camera, inter-beam-angles (without it both), or
    /// session-adjustment, all captures of the session in one adjustment
    #[arg(long = "method", value_name = "METHOD", value_parser = super::method)]
    methods: Vec<Method>,
    /// Which wavelength the fan is corrected to at each capture: best, live, read, interpolated,
    /// temperature or nominal
    ///
    /// `best`: the one read at the capture; else interpolated between the readings before and after it,
    /// or from the diode's temperature, whichever is less uncertain. `live`: the same by what had been
    /// read until then, as the run itself. `read`: only a reading at the capture. `interpolated`: only
    /// readings. `temperature`: only the diode's temperature. Where nothing is known it has a wide
    /// prior. `nominal`: no correction, the fan is as it is at its reference wavelength.
    #[arg(long, value_name = "SOURCE", value_parser = wavelength, default_value = "best")]
    wavelength: WavelengthUse,
    /// Print one JSON object for each capture and method, then one for the session
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
    #[command(flatten)]
    inputs: OtherInputs,
    #[command(flatten)]
    filter: Filter,
}

impl Solve {
    pub async fn execute(self) -> Result<Exit, Ended> {
        if !self.all && !self.filter.is_empty() {
            return Err(Ended::input("filters choose among all sessions: they need --all"));
        }
        let inputs = self.inputs.read().map_err(Ended::input)?;
        let store = self.database.open_existing().await?;
        let (ids, captures) = self.chosen(&store).await?;
        let wanted = Told { methods: methods(&self.methods), wavelength: self.wavelength };
        let work = Work::new(Progress::solving(captures, !self.json));
        let listening = tokio::spawn(listen(work.clone()));
        let mut jobs = Vec::new();
        let mut failed = 0;
        for id in ids {
            match job(&store, id, &wanted, &inputs).await {
                Ok(job) => jobs.push(job),
                // Of one session it is the answer; of many, the others are solved all the same.
                Err(error) if !self.all && self.sessions.len() == 1 => return Err(error.into()),
                Err(error) => {
                    complain(&format!("session {id}: {error:#}"));
                    failed += 1;
                }
            }
        }
        let batch = Batch::begin(&store, jobs).await?;
        if batch.continued > 0 {
            let sessions = batch.continued;
            complain(&format!("{sessions} of these were begun before: going on with them"));
        }
        let told = self.solve(&store, batch, &work, &wanted.methods).await;
        listening.abort();
        work.progress.finish();
        close(store).await;
        told.exit(failed)
    }

    /// The sessions that the command line names, each once, in its order; how many captures they
    /// have together.
    async fn chosen(&self, store: &Store) -> Result<(Vec<SessionId>, u64), Ended> {
        let all = self.filter.sessions(store).await?;
        let mut chosen: Vec<&SessionSummary> = Vec::new();
        for session in all.iter().filter(|session| self.all && session.captures > 0) {
            match SessionLock::holder(store.path(), session.id) {
                None => chosen.push(session),
                Some(holder) => complain(&format!("left out: {}", is_running(session.id, &holder))),
            }
        }
        for wanted in &self.sessions {
            let id = find(store, wanted).await?;
            if let Some(holder) = SessionLock::holder(store.path(), id) {
                let help = "\n  help: it is solved while it runs; solve it again when it is done";
                return Err(Ended::input(is_running(id, &holder) + help));
            }
            let is_new = !chosen.iter().any(|session| session.id == id);
            chosen.extend(all.iter().find(|session| session.id == id).filter(|_| is_new));
        }
        let captures = chosen.iter().map(|session| session.captures).sum();
        Ok((chosen.into_iter().map(|session| session.id).collect(), captures))
    }

    async fn solve(
        &self,
        store: &Arc<Store>,
        batch: Batch,
        work: &Work,
        methods: &[Method],
    ) -> Ends {
        let mut told = Ends::default();
        batch
            .solve(store, work, |id, outcome| match outcome {
                Ok(Outcome::Solved(processing, solved)) => {
                    work.progress.suspend(|| self.tell(id, processing.0, solved, methods));
                }
                Ok(Outcome::Stopped) => told.stopped += 1,
                Err(error) => told.errors.push((id, error)),
            })
            .await;
        told
    }

    /// Prints what came out of one session.
    fn tell(&self, id: SessionId, processing: i64, mut solved: Vec<Solved>, methods: &[Method]) {
        for one in &mut solved {
            for picture in &one.damaged {
                complain(&format!("damaged in the database: {picture}"));
            }
            one.solution.results.retain(|r| methods.contains(&r.method));
        }
        let mut unsolved = 0;
        for one in &solved {
            for result in &one.solution.results {
                unsolved += usize::from(result.pose.is_err());
                if self.json {
                    print(&line(one, result).to_string());
                } else if let Err(reason) = &result.pose {
                    print(&format!("{} {}: {reason}", one.capture, result.method.name()));
                }
            }
        }
        if self.json {
            let last = serde_json::json!({ "session": id.to_string(), "processing": processing });
            print(&last.to_string());
        } else {
            let results: usize = solved.iter().map(|s| s.solution.results.len()).sum();
            print(&format!("session {id}: {} of {results} poses solved", results - unsolved));
        }
    }
}

/// A session that runs is not solved beside its own solving: half of it would be its newest
/// processing, and the run's report would be made of that.
fn is_running(id: SessionId, holder: &str) -> String {
    format!("session {id} is being run by {holder}")
}

/// What became of a command's sessions, those that are solved aside.
#[derive(Default)]
struct Ends {
    stopped: usize,
    errors: Vec<(SessionId, anyhow::Error)>,
}

impl Ends {
    fn exit(mut self, failed: usize) -> Result<Exit, Ended> {
        if self.stopped > 0 {
            let sessions = self.stopped;
            complain(&format!(
                "beampose: stopped; {sessions} sessions are not done, what is solved is kept\n  \
                 help: the same command goes on where it was"
            ));
            return Ok(Exit::Aborted);
        }
        if let ([_], 0) = (self.errors.as_slice(), failed)
            && let Some((_, error)) = self.errors.pop()
        {
            return Err(error.into());
        }
        for (id, error) in &self.errors {
            complain(&format!("session {id}: {error:#}"));
        }
        Ok(if self.errors.len() + failed > 0 { Exit::Failed } else { Exit::Success })
    }
}

fn wavelength(text: &str) -> Result<WavelengthUse, String> {
    WavelengthUse::named(text).ok_or_else(|| {
        let names = WavelengthUse::ALL.map(WavelengthUse::name);
        format!("expected one of {}", names.join(", "))
    })
}

/// The methods of the command line, each once; without any the usual ones.
fn methods(named: &[Method]) -> Vec<Method> {
    if named.is_empty() {
        return Method::USUAL.to_vec();
    }
    let once: BTreeSet<Method> = named.iter().copied().collect();
    once.into_iter().collect()
}

async fn job(store: &Store, id: SessionId, wanted: &Told, inputs: &Inputs) -> anyhow::Result<Job> {
    let other = if inputs.is_none() {
        None
    } else {
        let header = store.session(id).await?.header;
        let setup = serde_json::from_str(&header.measurement_json)?;
        let own = MeasuredWith { setup, files: header.files };
        Some(inputs.instead(own).map_err(anyhow::Error::msg)?)
    };
    Job::new(store, id, wanted, other).await
}

/// Stops at the first wish to: no capture is begun any more, those under way are finished.
async fn listen(work: Work) {
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        let (Ok(mut term), Ok(mut hangup)) =
            (signal(SignalKind::terminate()), signal(SignalKind::hangup()))
        else {
            return;
        };
        tokio::select! {
            _ = tokio::signal::ctrl_c() => {}
            _ = term.recv() => {}
            _ = hangup.recv() => {}
        }
        work.stop();
    }
    #[cfg(not(unix))]
    if tokio::signal::ctrl_c().await.is_ok() {
        work.stop();
    }
}

/// Solves all captures of a stored session as a new processing, as the run itself would have.
///
/// # Errors
/// When the session cannot be read, or the store fails.
pub async fn solve_session(
    store: &Arc<Store>,
    id: SessionId,
    methods: &[Method],
    shown: bool,
) -> anyhow::Result<Vec<Solved>> {
    let session = store.session(id).await?;
    let setup: Setup = serde_json::from_str(&session.header.measurement_json)?;
    let captures = store.captures(id).await?;
    let work = Work::new(Progress::solving(captures.len() as u64, shown));
    let pipeline = Pipeline::begin(store.clone(), id, Arc::new(setup), methods).await?;
    let solved = work.captures(&pipeline, &captures).await?;
    pipeline.finish().await?;
    work.progress.finish();
    // Nobody can stop it: all captures are there.
    Ok(solved.unwrap_or_default())
}

/// One capture and method as DESIGN fixes it.
fn line(one: &Solved, result: &MethodResult) -> serde_json::Value {
    let seconds = serde_json::json!(one.seconds);
    let common = serde_json::json!({
        "id": one.capture.as_str(),
        "method": result.method.name(),
        "beams_used": result.beams_used,
        "sigma0": result.sigma0,
        "wavelength_nm": result.wavelength_nm,
        "wavelength_source": result.wavelength.map(|known| known.source.name()),
        "wavelength_u_nm": result.wavelength.map(|known| known.u_nm()),
        "wavelength_age_s": result.wavelength.and_then(|known| known.age_s),
        "ambiguous": result.ambiguous,
        "seconds": seconds,
        "notes": one.solution.notes,
    });
    let mut object = common.as_object().cloned().unwrap_or_default();
    match &result.pose {
        Ok(pose) => {
            let angles = omega_phi_kappa(&from_wxyz(pose.quaternion_wxyz)).map(f64::to_degrees);
            object.insert("status".to_owned(), "solved".into());
            object.insert("position_mm".to_owned(), serde_json::json!(pose.position_mm));
            object.insert("quaternion_wxyz".to_owned(), serde_json::json!(pose.quaternion_wxyz));
            object.insert("rotation_omega_phi_kappa_deg".to_owned(), serde_json::json!(angles));
            object.insert("covariance".to_owned(), serde_json::json!(pose.covariance));
        }
        Err(reason) => {
            object.insert("status".to_owned(), reason.clone().into());
        }
    }
    serde_json::Value::Object(object)
}
