//! Whether what is stored is still what was put there, and all of it.

use std::collections::BTreeSet;

use beampose_core::{SessionId, SessionOutcome, StepNumber, StepOutcome};

use crate::error::failed_to;
use crate::rows::{StoredCapture, StoredSession, StoredStep, Verification};
use crate::{Store, StoreError};

/// The kind of the steps that take captures, as plans have it.
const CAPTURE: &str = "capture";

impl Store {
    /// Hashes every picture of a session again, accounts for every step, and lets SQLite check the
    /// whole file: its structure, its CHECKs and its foreign keys; calibrations, which belong to no
    /// session, are hashed again too. One picture at a time is in
    /// memory.
    ///
    /// # Errors
    /// [`StoreError::NotFound`] where there is no such session; [`StoreError::Busy`] or
    /// [`StoreError::Database`] where it cannot be looked at. Damage is no error of the
    /// verification: it is in [`Verification::problems`].
    pub async fn verify(&self, session: SessionId) -> Result<Verification, StoreError> {
        let mut found = self.verify_session(session).await?;
        found.problems.extend(self.verify_file().await?);
        Ok(found)
    }

    /// As [`Store::verify`], without the file as a whole.
    ///
    /// # Errors
    /// As [`Store::verify`].
    pub async fn verify_session(&self, session: SessionId) -> Result<Verification, StoreError> {
        let stored = self.session(session).await?;
        let steps = self.steps(session).await?;
        let captures = self.captures(session).await?;
        let mut found = Verification { steps: steps.len() as u64, ..Verification::default() };
        for capture in &captures {
            if capture.pictures.is_empty() {
                found.problems.push(format!("capture {} has no picture", capture.id));
            }
            for info in &capture.pictures {
                match self.picture(session, &capture.id, &info.camera).await {
                    Ok(bytes) if bytes.len() as u64 != info.size_bytes => {
                        found.problems.push(format!(
                            "the picture of {} in capture {} has {} bytes, stored as {}",
                            info.camera,
                            capture.id,
                            bytes.len(),
                            info.size_bytes
                        ));
                    }
                    Ok(bytes) => {
                        found.pictures += 1;
                        found.bytes += bytes.len() as u64;
                    }
                    Err(error @ StoreError::Damaged { .. }) => {
                        found.problems.push(error.to_string());
                    }
                    Err(other) => return Err(other),
                }
            }
        }
        self.verify_attempts(session, &mut found).await?;
        let missing = self.missing(session).await?.into_iter().map(|(step, _)| step).collect();
        found.problems.extend(unaccounted(&stored, &steps, &captures, &missing));
        found.problems.extend(self.other_inputs(&stored).await?);
        Ok(found)
    }

    /// The pictures of earlier attempts, which only their records name.
    async fn verify_attempts(
        &self,
        session: SessionId,
        found: &mut Verification,
    ) -> Result<(), StoreError> {
        let doing = "check the pictures of earlier attempts";
        let named: Vec<(i64, String, Option<String>)> = sqlx::query_as(
            "SELECT a.step, json_extract(p.value, '$.camera'), json_extract(p.value, '$.blake3')
             FROM attempts a, json_each(a.capture_json, '$.pictures') p
             WHERE a.session = ? ORDER BY a.gap, a.step",
        )
        .bind(session.to_string())
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to(doing))?;
        for (step, camera, hash) in named {
            let hash = hash.unwrap_or_default();
            let bytes: Option<Vec<u8>> =
                sqlx::query_scalar("SELECT bytes FROM blobs WHERE blake3 = ?")
                    .bind(&hash)
                    .fetch_optional(&self.readers)
                    .await
                    .map_err(failed_to(doing))?;
            match bytes {
                Some(bytes) if blake3::hash(&bytes).to_hex().as_str() == hash => {
                    found.pictures += 1;
                    found.bytes += bytes.len() as u64;
                }
                Some(_) => found.problems.push(format!(
                    "the picture of {camera} in an earlier attempt at step {step} is damaged"
                )),
                None => found.problems.push(format!(
                    "the picture of {camera} in an earlier attempt at step {step} is missing"
                )),
            }
        }
        Ok(())
    }

    /// Processings whose calibrations are not those that they say they had.
    async fn other_inputs(&self, stored: &StoredSession) -> Result<Vec<String>, StoreError> {
        let mut problems = Vec::new();
        for processing in self.processings(stored.header.id).await? {
            let told = processing.start.measurement_json.as_ref();
            let told = told.unwrap_or(&stored.header.measurement_json);
            let lineage: Option<serde_json::Value> =
                serde_json::from_str(&processing.start.lineage_json).ok();
            let said = lineage.as_ref().and_then(|l| l.get("measurement_blake3")?.as_str());
            if said.is_some_and(|said| said != blake3::hash(told.as_bytes()).to_hex().as_str()) {
                problems.push(format!(
                    "the calibrations, pattern and artefact of processing {} do not have the hash \
                     that it was made with",
                    processing.id
                ));
            }
        }
        Ok(problems)
    }

    /// Lets SQLite check the file, whatever session, and hashes every recorded calibration again: one
    /// sentence for each thing that is wrong.
    ///
    /// # Errors
    /// [`StoreError::Busy`] or [`StoreError::Database`] where it cannot be looked at.
    pub async fn verify_file(&self) -> Result<Vec<String>, StoreError> {
        let lines: Vec<String> = sqlx::query_scalar("PRAGMA integrity_check")
            .fetch_all(&self.readers)
            .await
            .map_err(failed_to("check the database's structure"))?;
        let mut problems: Vec<String> = lines.into_iter().filter(|line| line != "ok").collect();
        let orphans: Vec<(String, i64)> = sqlx::query_as(
            "SELECT \"table\" || ' -> ' || parent, count(*) FROM pragma_foreign_key_check
             GROUP BY \"table\", parent",
        )
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to("check the foreign keys"))?;
        problems.extend(
            orphans.into_iter().map(|(relation, rows)| {
                format!("{rows} rows refer to what is not there: {relation}")
            }),
        );
        problems.extend(self.verify_calibrations().await?);
        Ok(problems)
    }
}

/// Steps that should be there and are not, or the other way round.
fn unaccounted(
    stored: &StoredSession,
    steps: &[StoredStep],
    captures: &[StoredCapture],
    missing: &BTreeSet<StepNumber>,
) -> Vec<String> {
    let mut problems = missing_steps(stored, steps);
    let last = stored.header.steps;
    if let Some(beyond) = steps.iter().find(|step| step.number.0 > last) {
        problems.push(format!("step {} is stored, the plan has {last}", beyond.number));
    }
    let took: BTreeSet<_> = captures.iter().map(|capture| capture.step).collect();
    let without = steps.iter().filter(|step| {
        let is_done = step.kind == CAPTURE && step.outcome == StepOutcome::Done;
        // Where all cameras are recorded as missing there is nothing to store.
        is_done && !took.contains(&step.number) && !missing.contains(&step.number)
    });
    problems.extend(
        without.map(|step| format!("step {} is done, and its capture is not stored", step.number)),
    );
    problems
}

/// A completed session has every step. One that ended otherwise has the steps up to where it
/// stopped and, behind one hole, the steps of `finally`; one that is not closed may have both too,
/// where it went on after an abort.
fn missing_steps(stored: &StoredSession, steps: &[StoredStep]) -> Vec<String> {
    let there: BTreeSet<u32> = steps.iter().map(|step| step.number.0).collect();
    let until = match stored.outcome {
        Some(SessionOutcome::Completed) => stored.header.steps,
        _ => there.last().copied().unwrap_or(0),
    };
    let missing: Vec<u32> = (1..=until).filter(|number| !there.contains(number)).collect();
    let mut holes: Vec<(u32, u32)> = Vec::new();
    for number in missing {
        match holes.last_mut() {
            Some((_, end)) if *end + 1 == number => *end = number,
            _ => holes.push((number, number)),
        }
    }
    let forgiven = usize::from(stored.outcome != Some(SessionOutcome::Completed));
    let told = holes.iter().skip(forgiven).map(|&(from, to)| {
        let which =
            if from == to { format!("step {from}") } else { format!("steps {from} to {to}") };
        format!("{which} of {} left no record", stored.header.steps)
    });
    told.collect()
}
