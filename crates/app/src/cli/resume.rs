//! `beampose resume`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;

use beampose_core::{Gap, Look, SessionId, SessionOutcome, Stamp, StepNumber, StepOutcome};
use beampose_engine::{Earlier, restoration};
use beampose_photogrammetry::solve::Method;
use beampose_plan::{Section, Step};
use beampose_store::{Store, StoredSession, StoredStep};

use super::{Database, Ended, close, find};
use crate::conduct::{self, Session, Shown};
use crate::input::{Checked, Origin, checked};
use crate::loaded::method_of;
use crate::output::{Exit, complain};
use crate::pipeline::SOFTWARE;
use crate::session_lock::SessionLock;
use crate::wiring::{self, Before, Recorder};

/// Go on with a session that was stopped or died
///
/// Goes on at the first step that is not done. Before that it says what it re-establishes: stages
/// back where they were, the laser on again and settled as the plan let it settle. `finally` runs
/// as after an uninterrupted run. Where all steps are done and only solving or the report is missing,
/// that is done. Plan, rig, calibrations and software must be those of the session; what differs
/// is listed, and needs --accept-changes.
#[derive(clap::Args)]
pub struct Resume {
    /// Which session: an id, a unique beginning of one, or `latest`
    #[arg(default_value = "latest")]
    session: String,
    /// The plan, where its file moved since
    #[arg(long, value_name = "FILE")]
    plan: Option<PathBuf>,
    /// The rig, where its file moved since
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// Go on although plan, rig or software changed
    #[arg(long)]
    accept_changes: bool,
    #[command(flatten)]
    shown: Shown,
    #[command(flatten)]
    database: Database,
}

impl Resume {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let store = self.database.open_existing().await?;
        let id = find(&store, &self.session).await?;
        // Before anything is looked at: what is stored does not change from here on.
        let lock = SessionLock::take(store.path(), id).map_err(Ended::input)?;
        let stored = store.session(id).await?;
        let steps = store.steps(id).await?;
        let origin = self.origin(&stored)?;
        let checked =
            checked(&origin.plan, Some(&origin.rig), &origin.overrides).map_err(Ended::input)?;
        if let Some(outcome @ SessionOutcome::Completed) = stored.outcome {
            let methods: Vec<Method> = checked.plan.methods.iter().map(|m| method_of(*m)).collect();
            if is_solved(&store, id, &methods).await? {
                close(store).await;
                return Err(Ended::input(format!("session {id} is complete: nothing to resume")));
            }
            complain(&format!("session {id}: all steps are done; its captures are solved"));
            return conduct::finish(store, (id, lock), outcome, &methods, &self.shown).await;
        }
        let earlier = behind(&checked.summary.steps, &steps);
        refuse_other_steps(&checked, &steps, &earlier)?;
        let answers = self.shown.read_answers()?;
        let recorder = self.shown.recorder()?;
        let session = prepare(&store, &stored, steps, checked, earlier, recorder).await?;
        let session = Session { answers, ..session };
        self.refuse_changes(&stored, &session)?;
        if let Some((_, gap)) = &session.earlier {
            tell(&session, gap);
        }
        session.conduct(store, lock, &self.shown).await
    }

    fn origin(&self, stored: &StoredSession) -> Result<Origin, Ended> {
        let id = stored.header.id;
        let json = stored.header.origin_json.as_deref().ok_or_else(|| {
            Ended::input(format!("session {id} was imported, not run: nothing to resume"))
        })?;
        let mut origin: Origin = serde_json::from_str(json)?;
        for (named, path, option) in
            [(&self.plan, &mut origin.plan, "--plan"), (&self.rig, &mut origin.rig, "--rig")]
        {
            if let Some(named) = named {
                path.clone_from(named);
            }
            if !path.is_file() {
                return Err(Ended::input(format!(
                    "{}: this file of session {id} is gone\n  help: {option} names another",
                    path.display()
                )));
            }
        }
        Ok(origin)
    }

    fn refuse_changes(&self, stored: &StoredSession, session: &Session) -> Result<(), Ended> {
        let (header, checked) = (&stored.header, &session.checked);
        let mut changes = Vec::new();
        if header.plan_hash != checked.summary.plan_hash {
            changes.push("the plan's steps".to_owned());
        } else if header.plan_text != checked.plan.source.text() {
            changes.push("the plan's text (its steps are the same)".to_owned());
        }
        if header.rig_text != checked.rig.source.text() {
            changes.push("the rig's text".to_owned());
        }
        if header.measurement_json != serde_json::to_string(&session.laboratory.setup)? {
            changes.push("calibrations, pattern or artefact that the rig names".to_owned());
        }
        if header.software != SOFTWARE {
            changes.push(format!("the program: it was {}, this is {SOFTWARE}", header.software));
        }
        if changes.is_empty() || self.accept_changes {
            changes.iter().for_each(|change| complain(&format!("changed since: {change}")));
            return Ok(());
        }
        Err(Ended::input(format!(
            "since session {} began, these changed:\n  {}\n  help: --accept-changes goes on all the same",
            header.id,
            changes.join("\n  ")
        )))
    }
}

/// Refuses a plan in which a step that is done is another.
fn refuse_other_steps(
    checked: &Checked,
    steps: &[StoredStep],
    earlier: &Earlier,
) -> Result<(), Ended> {
    let by_number: BTreeMap<StepNumber, &Step> =
        checked.summary.steps.iter().map(|step| (step.number, step)).collect();
    for step in steps.iter().filter(|step| earlier.is_behind(step.number)) {
        let now = by_number.get(&step.number).map(ToString::to_string);
        if now.as_deref() != Some(step.label.as_str()) {
            return Err(Ended::input(format!(
                "step {} is done as {:?}, the plan now says {:?}: such a session cannot go on\n  \
                 help: run the changed plan as a session of its own",
                step.number,
                step.label,
                now.unwrap_or_else(|| "nothing".to_owned())
            )));
        }
    }
    Ok(())
}

/// Whether every capture has a result, be it a reason, for each of `methods`.
async fn is_solved(store: &Store, id: SessionId, methods: &[Method]) -> Result<bool, Ended> {
    let finished = store.processings(id).await?.into_iter().rfind(|p| p.finished.is_some());
    let Some(processing) = finished else { return Ok(false) };
    let poses = store.poses(processing.id).await?;
    let captures = store.captures(id).await?;
    Ok(captures.iter().all(|capture| {
        let has =
            |m: &Method| poses.iter().any(|p| p.capture == capture.id && p.method == m.name());
        methods.iter().all(has)
    }))
}

/// The main steps that need not be done again, as they are stored.
fn behind(steps: &[Step], stored: &[StoredStep]) -> Earlier {
    let main = steps.iter().filter(|step| step.section == Section::Main).map(|step| step.number);
    let main: BTreeSet<StepNumber> = main.collect();
    let mut earlier = Earlier::default();
    for step in stored.iter().filter(|step| main.contains(&step.number)) {
        if step.outcome == StepOutcome::Done {
            earlier.done.insert(step.number);
        } else if step.outcome.is_settled() {
            earlier.passed.insert(step.number);
        }
    }
    earlier
}

async fn prepare(
    store: &Store,
    stored: &StoredSession,
    steps: Vec<StoredStep>,
    checked: Checked,
    mut earlier: Earlier,
    recorder: Option<Arc<Recorder>>,
) -> Result<Session, Ended> {
    let id = stored.header.id;
    let answers = store.answers(id).await?;
    earlier.answers = answers.into_iter().map(|(_, answer)| (answer.name, answer.value)).collect();
    for row in store.readings(id).await? {
        if earlier.done.contains(&row.step) {
            let of_step = earlier.readings.entry(row.step).or_default();
            of_step.push((row.instrument, row.reading));
        }
    }
    let mut looks: BTreeMap<StepNumber, Vec<Look>> = BTreeMap::new();
    for (step, look) in store.looks(id).await? {
        looks.entry(step).or_default().push(look);
    }
    let captures = store.captures(id).await?;
    let captures: Vec<_> =
        captures.into_iter().filter(|c| earlier.done.contains(&c.step)).collect();
    let restored = restoration(&checked.summary.steps, &earlier.done);
    let stopped = last_known(stored, &steps);
    let pictures = captures.iter().flat_map(|c| &c.pictures).map(|p| p.camera.as_str());
    let before = Before {
        times: Some((stored.header.opened, stopped)),
        history: wiring::history(&checked, &earlier, &looks, &restored, pictures),
    };
    let (rig, folder) = (&checked.rig, &checked.rig_folder);
    let laboratory = wiring::laboratory(rig, folder, &before, recorder).map_err(Ended::input)?;
    let gap = Gap {
        stopped,
        resumed: laboratory.clock.shared().now(),
        reason: stored.outcome.map_or("the program died", |o| o.as_str()).to_owned(),
        redone: steps.iter().map(|s| s.number).filter(|n| !earlier.is_behind(*n)).collect(),
        restored: restored.iter().map(ToString::to_string).collect(),
    };
    let captures = captures.into_iter().map(|capture| capture.id).collect();
    let header = stored.header.clone();
    let (earlier, answers) = (Some((earlier, gap)), crate::operator::Answers::new());
    Ok(Session { checked, laboratory, header, earlier, captures, answers })
}

/// When the last thing that is known of a session happened.
fn last_known(stored: &StoredSession, steps: &[StoredStep]) -> Stamp {
    let finished = steps.iter().map(|step| step.finished).chain(stored.closed);
    finished.max_by_key(|stamp| stamp.monotonic).unwrap_or(stored.header.opened)
}

/// Says what comes before anything moves.
fn tell(session: &Session, gap: &Gap) {
    let steps = &session.checked.summary.steps;
    let next = steps.iter().find(|step| {
        session.earlier.as_ref().is_some_and(|(earlier, _)| !earlier.is_behind(step.number))
    });
    complain(&format!("session {}: {} at {}", session.header.id, gap.reason, gap.stopped.utc));
    for restored in &gap.restored {
        complain(&format!("  first again: {restored}"));
    }
    if let Some(next) = next {
        complain(&format!("  then on with step {}: {next}", next.number));
    }
}
