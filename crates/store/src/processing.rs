//! Processings, solutions, poses and results. Each processing stands beside the others: nothing
//! here overwrites what is stored.

use std::collections::BTreeSet;

use beampose_core::{CaptureId, Pose, SessionId};
use sqlx::FromRow;
use sqlx::sqlite::SqliteConnection;

use crate::error::failed_to;
use crate::inputs::insert_files;
use crate::rows::{NewProcessing, PoseRow, Processing, ProcessingId, ResultRow, SolutionRow};
use crate::stamp::{count, damaged, from_json, session_id, timestamp, to_json};
use crate::writer::begin;
use crate::{Store, StoreError};

/// A name for processings that are begun together.
#[must_use]
pub fn fresh_batch() -> String {
    uuid::Uuid::now_v7().to_string()
}

impl Store {
    /// Begins a processing of a session.
    ///
    /// # Errors
    /// [`StoreError::Refused`] where there is no such session or a text is no JSON.
    pub async fn start_processing(&self, new: &NewProcessing) -> Result<ProcessingId, StoreError> {
        let doing = "begin a processing";
        let mut transaction = begin(&self.writer, doing).await?;
        let id = insert_processing(&mut transaction, new).await.map_err(failed_to(doing))?;
        transaction.commit().await.map_err(failed_to(doing))?;
        Ok(id)
    }

    /// Begins several processings at once: all or none.
    ///
    /// # Errors
    /// As [`Store::start_processing`].
    pub async fn start_processings(
        &self,
        all: &[NewProcessing],
    ) -> Result<Vec<ProcessingId>, StoreError> {
        let doing = "begin processings";
        let mut transaction = begin(&self.writer, doing).await?;
        let mut ids = Vec::with_capacity(all.len());
        for new in all {
            let id = insert_processing(&mut transaction, new).await.map_err(failed_to(doing))?;
            ids.push(id);
        }
        transaction.commit().await.map_err(failed_to(doing))?;
        Ok(ids)
    }

    /// The captures that have a solution in a processing.
    ///
    /// # Errors
    /// [`StoreError::Damaged`], [`StoreError::Busy`] or [`StoreError::Database`].
    pub async fn solved_captures(
        &self,
        processing: ProcessingId,
    ) -> Result<BTreeSet<CaptureId>, StoreError> {
        let ids: Vec<String> =
            sqlx::query_scalar("SELECT capture FROM solutions WHERE processing = ?")
                .bind(processing.0)
                .fetch_all(&self.readers)
                .await
                .map_err(failed_to("read what is solved"))?;
        Ok(ids.into_iter().map(CaptureId).collect())
    }

    /// Stores what solving one capture gave: solution, poses and observations in one transaction.
    ///
    /// # Errors
    /// [`StoreError::Refused`] where the processing is finished or unknown, has that capture
    /// already, or where a solved pose has a number that is none.
    pub async fn save_solution(
        &self,
        processing: ProcessingId,
        solution: &SolutionRow,
    ) -> Result<(), StoreError> {
        let doing = format!("store the solution of capture {}", solution.capture);
        let mut transaction = begin(&self.writer, &doing).await?;
        let inserted = sqlx::query(
            "INSERT INTO solutions (processing, session, capture, seconds_json, solution_json)
             SELECT id, session, ?, ?, ? FROM processings WHERE id = ? AND finished_utc IS NULL",
        )
        .bind(solution.capture.as_str())
        .bind(&solution.seconds_json)
        .bind(&solution.solution_json)
        .bind(processing.0)
        .execute(&mut *transaction)
        .await
        .map_err(failed_to(&*doing))?;
        if inserted.rows_affected() != 1 {
            let reason = format!("there is no processing {processing} under way");
            return Err(StoreError::Refused { doing, reason });
        }
        for pose in &solution.poses {
            insert_pose(&mut transaction, &doing, processing, pose).await?;
        }
        for (camera, json) in &solution.observations_json {
            sqlx::query("INSERT INTO observations VALUES (?, ?, ?, ?)")
                .bind(processing.0)
                .bind(solution.capture.as_str())
                .bind(camera)
                .bind(json)
                .execute(&mut *transaction)
                .await
                .map_err(failed_to(&*doing))?;
        }
        transaction.commit().await.map_err(failed_to(doing))
    }

    /// Ends a processing; nothing can be added to it afterwards.
    ///
    /// # Errors
    /// [`StoreError::Refused`] where it is finished or unknown.
    pub async fn finish_processing(
        &self,
        processing: ProcessingId,
        at: jiff::Timestamp,
    ) -> Result<(), StoreError> {
        let doing = "finish a processing";
        let mut transaction = begin(&self.writer, doing).await?;
        let updated = sqlx::query(
            "UPDATE processings SET finished_utc = ? WHERE id = ? AND finished_utc IS NULL",
        )
        .bind(at.to_string())
        .bind(processing.0)
        .execute(&mut *transaction)
        .await
        .map_err(failed_to(doing))?;
        if updated.rows_affected() != 1 {
            let reason = format!("there is no processing {processing} under way");
            return Err(StoreError::Refused { doing: doing.to_owned(), reason });
        }
        transaction.commit().await.map_err(failed_to(doing))
    }

    /// All processings of a session, the oldest first.
    ///
    /// # Errors
    /// [`StoreError::Damaged`], [`StoreError::Busy`] or [`StoreError::Database`].
    pub async fn processings(&self, session: SessionId) -> Result<Vec<Processing>, StoreError> {
        let rows: Vec<ProcessingColumns> = sqlx::query_as(
            "SELECT id, session, created_utc, finished_utc, software, options_json, lineage_json,
                measurement_json, batch
             FROM processings WHERE session = ? ORDER BY id",
        )
        .bind(session.to_string())
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to("read the processings"))?;
        let mut files = self.files_of_processings(session).await?;
        let with_files = |columns: ProcessingColumns| {
            let mut processing = columns.processing()?;
            processing.start.files = files.remove(&processing.id).unwrap_or_default();
            Ok(processing)
        };
        rows.into_iter().map(with_files).collect()
    }

    /// The newest finished processing of a session; the newest of all where none is finished.
    ///
    /// # Errors
    /// As [`Store::processings`].
    pub async fn latest_processing(
        &self,
        session: SessionId,
    ) -> Result<Option<Processing>, StoreError> {
        let all = self.processings(session).await?;
        Ok(all.into_iter().max_by_key(|processing| (processing.finished.is_some(), processing.id)))
    }

    /// The poses of a processing, in the order of the captures, then of the methods' names.
    ///
    /// # Errors
    /// [`StoreError::Damaged`], [`StoreError::Busy`] or [`StoreError::Database`].
    pub async fn poses(&self, processing: ProcessingId) -> Result<Vec<PoseRow>, StoreError> {
        let rows: Vec<PoseColumns> = sqlx::query_as(
            "SELECT p.capture, p.method, p.status, p.reason, p.x_mm, p.y_mm, p.z_mm, p.qw, p.qx,
                p.qy, p.qz, p.covariance_json, p.beams_used, p.sigma0, p.wavelength_nm,
                p.ambiguous, p.wavelength_source, p.wavelength_u_nm, p.wavelength_age_s
             FROM poses p
             JOIN processings q ON q.id = p.processing
             JOIN captures c ON c.session = q.session AND c.id = p.capture
             WHERE p.processing = ? ORDER BY c.step, p.method",
        )
        .bind(processing.0)
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to("read the poses"))?;
        rows.into_iter().map(PoseColumns::pose).collect()
    }

    /// What solving `capture` gave in a processing, poses and observations included.
    ///
    /// # Errors
    /// [`StoreError::NotFound`] where the capture was not solved in it.
    pub async fn solution(
        &self,
        processing: ProcessingId,
        capture: &CaptureId,
    ) -> Result<SolutionRow, StoreError> {
        let doing = "read a solution";
        let row: Option<(String, String)> = sqlx::query_as(
            "SELECT seconds_json, solution_json FROM solutions
             WHERE processing = ? AND capture = ?",
        )
        .bind(processing.0)
        .bind(capture.as_str())
        .fetch_optional(&self.readers)
        .await
        .map_err(failed_to(doing))?;
        let Some((seconds_json, solution_json)) = row else {
            let what = format!("solution of capture {capture} in processing {processing}");
            return Err(StoreError::NotFound { what, nearest: Vec::new() });
        };
        let observations: Vec<(String, String)> = sqlx::query_as(
            "SELECT camera, observations_json FROM observations
             WHERE processing = ? AND capture = ?",
        )
        .bind(processing.0)
        .bind(capture.as_str())
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to(doing))?;
        let mut poses = self.poses(processing).await?;
        poses.retain(|pose| pose.capture == *capture);
        let observations_json = observations.into_iter().collect();
        let capture = capture.clone();
        Ok(SolutionRow { capture, seconds_json, solution_json, poses, observations_json })
    }

    /// Stores a result. Results of one processing stand beside each other too.
    ///
    /// # Errors
    /// [`StoreError::Refused`] where there is no such processing or the text is no JSON.
    pub async fn save_result(&self, result: &ResultRow) -> Result<(), StoreError> {
        let doing = "store a result";
        let mut transaction = begin(&self.writer, doing).await?;
        sqlx::query("INSERT INTO results (processing, created_utc, result_json) VALUES (?, ?, ?)")
            .bind(result.processing.0)
            .bind(result.created.to_string())
            .bind(&result.result_json)
            .execute(&mut *transaction)
            .await
            .map_err(failed_to(doing))?;
        transaction.commit().await.map_err(failed_to(doing))
    }

    /// The results of a processing, the oldest first.
    ///
    /// # Errors
    /// [`StoreError::Damaged`], [`StoreError::Busy`] or [`StoreError::Database`].
    pub async fn results(&self, processing: ProcessingId) -> Result<Vec<ResultRow>, StoreError> {
        let rows: Vec<(String, String)> = sqlx::query_as(
            "SELECT created_utc, result_json FROM results WHERE processing = ? ORDER BY id",
        )
        .bind(processing.0)
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to("read the results"))?;
        rows.into_iter()
            .map(|(created, result_json)| {
                Ok(ResultRow { processing, created: timestamp(&created)?, result_json })
            })
            .collect()
    }
}

async fn insert_processing(
    connection: &mut SqliteConnection,
    new: &NewProcessing,
) -> Result<ProcessingId, sqlx::Error> {
    let inserted = sqlx::query(
        "INSERT INTO processings (session, created_utc, software, options_json, lineage_json,
            measurement_json, batch)
         VALUES (?, ?, ?, ?, ?, ?, ?)",
    )
    .bind(new.session.to_string())
    .bind(new.created.to_string())
    .bind(&new.software)
    .bind(&new.options_json)
    .bind(&new.lineage_json)
    .bind(&new.measurement_json)
    .bind(&new.batch)
    .execute(&mut *connection)
    .await?;
    let id = ProcessingId(inserted.last_insert_rowid());
    insert_files(connection, new.session, Some(id), &new.files).await?;
    Ok(id)
}

async fn insert_pose(
    connection: &mut SqliteConnection,
    doing: &str,
    processing: ProcessingId,
    row: &PoseRow,
) -> Result<(), StoreError> {
    let pose = row.pose.as_ref().ok();
    if let Some(pose) = pose.filter(|pose| !is_finite(pose)) {
        let reason =
            format!("{} gave a pose that has a number which is none: {pose:?}", row.method);
        return Err(StoreError::Refused { doing: doing.to_owned(), reason });
    }
    let covariance = pose.map(|pose| to_json(doing, &pose.covariance)).transpose()?;
    let mut query = sqlx::query(
        "INSERT INTO poses (processing, capture, method, status, reason, x_mm, y_mm, z_mm, qw, qx,
            qy, qz, covariance_json, beams_used, sigma0, wavelength_nm, ambiguous,
            wavelength_source, wavelength_u_nm, wavelength_age_s)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
    )
    .bind(processing.0)
    .bind(row.capture.as_str())
    .bind(&row.method)
    .bind(if pose.is_some() { "solved" } else { "failed" })
    .bind(row.pose.as_ref().err());
    for i in 0..3 {
        query = query.bind(pose.map(|pose| pose.position_mm[i]));
    }
    for i in 0..4 {
        query = query.bind(pose.map(|pose| pose.quaternion_wxyz[i]));
    }
    query
        .bind(covariance)
        .bind(i64::try_from(row.beams_used).unwrap_or(i64::MAX))
        .bind(Some(row.sigma0).filter(|value| value.is_finite()))
        .bind(Some(row.wavelength_nm).filter(|value| value.is_finite()))
        .bind(row.ambiguous)
        .bind(&row.wavelength_source)
        .bind(row.wavelength_u_nm)
        .bind(row.wavelength_age_s)
        .execute(connection)
        .await
        .map_err(failed_to(doing))?;
    Ok(())
}

fn is_finite(pose: &Pose) -> bool {
    let covariance = pose.covariance.iter().flatten();
    pose.position_mm.iter().chain(&pose.quaternion_wxyz).chain(covariance).all(|v| v.is_finite())
}

#[derive(FromRow)]
struct ProcessingColumns {
    id: i64,
    session: String,
    created_utc: String,
    finished_utc: Option<String>,
    software: String,
    options_json: String,
    lineage_json: String,
    measurement_json: Option<String>,
    batch: Option<String>,
}

impl ProcessingColumns {
    fn processing(self) -> Result<Processing, StoreError> {
        Ok(Processing {
            id: ProcessingId(self.id),
            finished: self.finished_utc.as_deref().map(timestamp).transpose()?,
            start: NewProcessing {
                session: session_id(&self.session)?,
                created: timestamp(&self.created_utc)?,
                software: self.software,
                options_json: self.options_json,
                lineage_json: self.lineage_json,
                measurement_json: self.measurement_json,
                files: Vec::new(),
                batch: self.batch,
            },
        })
    }
}

#[derive(FromRow)]
struct PoseColumns {
    capture: String,
    method: String,
    status: String,
    reason: Option<String>,
    x_mm: Option<f64>,
    y_mm: Option<f64>,
    z_mm: Option<f64>,
    qw: Option<f64>,
    qx: Option<f64>,
    qy: Option<f64>,
    qz: Option<f64>,
    covariance_json: Option<String>,
    beams_used: i64,
    sigma0: Option<f64>,
    wavelength_nm: Option<f64>,
    ambiguous: bool,
    wavelength_source: Option<String>,
    wavelength_u_nm: Option<f64>,
    wavelength_age_s: Option<f64>,
}

impl PoseColumns {
    fn pose(self) -> Result<PoseRow, StoreError> {
        let pose = match (self.status.as_str(), &self.reason) {
            ("solved", _) => Ok(self.solved()?),
            (_, Some(reason)) => Err(reason.clone()),
            (other, None) => return Err(damaged("a pose's status", other)),
        };
        Ok(PoseRow {
            capture: CaptureId(self.capture),
            method: self.method,
            pose,
            beams_used: count(self.beams_used),
            sigma0: self.sigma0.unwrap_or(f64::NAN),
            wavelength_nm: self.wavelength_nm.unwrap_or(f64::NAN),
            wavelength_source: self.wavelength_source,
            wavelength_u_nm: self.wavelength_u_nm,
            wavelength_age_s: self.wavelength_age_s,
            ambiguous: self.ambiguous,
        })
    }

    fn solved(&self) -> Result<Pose, StoreError> {
        let number =
            |value: Option<f64>| value.ok_or_else(|| damaged("a pose", "a number is missing"));
        let covariance = self.covariance_json.as_deref().unwrap_or_default();
        Ok(Pose {
            position_mm: [number(self.x_mm)?, number(self.y_mm)?, number(self.z_mm)?],
            quaternion_wxyz: [
                number(self.qw)?,
                number(self.qx)?,
                number(self.qy)?,
                number(self.qz)?,
            ],
            covariance: from_json("a pose's covariance", covariance)?,
        })
    }
}
