//! Calibrations with what they were made from. A calibration is known by the hash of its file: the
//! same bytes are the same calibration, recorded once. Nothing here changes or deletes one.

use beampose_core::SessionId;
use sqlx::{FromRow, SqliteConnection};

use crate::error::failed_to;
use crate::rows::{Calibration, CalibrationHead, CalibrationSource, Kept};
use crate::stamp::{damaged, from_word, session_id, timestamp, word_of};
use crate::writer::begin;
use crate::{Store, StoreError};

/// The calibrations that a session (`?1`) used, and those that were made from it, by their hashes.
pub(crate) fn calibrations_of_session(schema: &str) -> String {
    format!(
        "SELECT blake3 FROM {schema}.calibrations
         WHERE blake3 IN (SELECT blake3 FROM {schema}.input_files WHERE session = ?1)
            OR blake3 IN (SELECT calibration FROM {schema}.calibration_sources WHERE made_from = ?1)
         ORDER BY blake3"
    )
}

/// How a calibration's content is not what its hash says; `None` where it is.
pub(crate) fn damage(blake3: &str, content: &str) -> Option<String> {
    let found = blake3::hash(content.as_bytes()).to_hex();
    (found.as_str() != blake3).then(|| format!("its BLAKE3 is {found}"))
}

#[derive(FromRow)]
struct HeadColumns {
    blake3: String,
    kind: String,
    name: String,
    method: String,
    created_utc: String,
    software: String,
}

#[derive(FromRow)]
struct SourceColumns {
    kind: String,
    name: String,
    blake3: String,
    made_from: Option<String>,
    processing_utc: Option<String>,
    deleted_utc: Option<String>,
    stored: bool,
}

impl SourceColumns {
    fn source(self) -> Result<CalibrationSource, StoreError> {
        let Some(id) = self.made_from.filter(|_| self.kind == "session") else {
            return Ok(CalibrationSource::File { name: self.name, blake3: self.blake3 });
        };
        let kept = match (self.stored, self.deleted_utc) {
            (true, _) => Kept::Here,
            (false, Some(at)) => Kept::Deleted(timestamp(&at)?),
            (false, None) => Kept::Elsewhere,
        };
        Ok(CalibrationSource::Session {
            id: session_id(&id)?,
            title: self.name,
            plan_hash: self.blake3,
            processing: self.processing_utc.as_deref().map(timestamp).transpose()?,
            kept,
        })
    }
}

impl Store {
    /// Records a calibration; false where its file is recorded already: that stays as it is.
    ///
    /// # Errors
    /// [`StoreError::Refused`] where its hash is not that of its content, or a text is no JSON.
    pub async fn record_calibration(&self, new: &Calibration) -> Result<bool, StoreError> {
        let doing = "record a calibration";
        if let Some(reason) = damage(&new.head.blake3, &new.content) {
            return Err(StoreError::Refused { doing: doing.to_owned(), reason });
        }
        let kind = word_of(doing, &new.head.kind)?;
        let mut transaction = begin(&self.writer, doing).await?;
        let inserted = sqlx::query(
            "INSERT INTO calibrations (blake3, kind, name, method, created_utc, software,
                options_json, content_text, parameters_json, covariance_json, result_json)
             VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT (blake3) DO NOTHING",
        )
        .bind(&new.head.blake3)
        .bind(kind)
        .bind(&new.head.name)
        .bind(&new.head.method)
        .bind(new.head.created.to_string())
        .bind(&new.head.software)
        .bind(&new.options_json)
        .bind(&new.content)
        .bind(&new.parameters_json)
        .bind(&new.covariance_json)
        .bind(&new.result_json)
        .execute(&mut *transaction)
        .await
        .map_err(failed_to(doing))?;
        let is_new = inserted.rows_affected() == 1;
        if is_new {
            for (place, source) in (1..).zip(&new.head.sources) {
                insert_source(&mut transaction, &new.head.blake3, place, source)
                    .await
                    .map_err(failed_to(doing))?;
            }
        }
        transaction.commit().await.map_err(failed_to(doing))?;
        Ok(is_new)
    }

    /// All recorded calibrations, the oldest first.
    ///
    /// # Errors
    /// [`StoreError::Damaged`], [`StoreError::Busy`] or [`StoreError::Database`].
    pub async fn calibrations(&self) -> Result<Vec<CalibrationHead>, StoreError> {
        let rows: Vec<HeadColumns> = sqlx::query_as(
            "SELECT blake3, kind, name, method, created_utc, software FROM calibrations
             ORDER BY created_utc, rowid",
        )
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to("list the calibrations"))?;
        let mut all = Vec::new();
        for row in rows {
            all.push(self.head(row).await?);
        }
        Ok(all)
    }

    /// The recorded calibration whose file has this hash, if there is one.
    ///
    /// # Errors
    /// [`StoreError::Damaged`], [`StoreError::Busy`] or [`StoreError::Database`].
    pub async fn calibration_of_file(
        &self,
        blake3: &str,
    ) -> Result<Option<CalibrationHead>, StoreError> {
        let row: Option<HeadColumns> = sqlx::query_as(
            "SELECT blake3, kind, name, method, created_utc, software FROM calibrations
             WHERE blake3 = ?",
        )
        .bind(blake3)
        .fetch_optional(&self.readers)
        .await
        .map_err(failed_to("look for a calibration"))?;
        match row {
            Some(row) => self.head(row).await.map(Some),
            None => Ok(None),
        }
    }

    /// The calibration that `wanted` means: the unique beginning of its hash, or `latest`.
    ///
    /// # Errors
    /// [`StoreError::NotFound`]; [`StoreError::Ambiguous`] with all that fit;
    /// [`StoreError::Damaged`] where its content does not have its hash.
    pub async fn calibration(&self, wanted: &str) -> Result<Calibration, StoreError> {
        let head = self.find_calibration(wanted).await?;
        let doing = "read a calibration";
        let (options_json, content, parameters_json, covariance_json, result_json) =
            sqlx::query_as::<_, (String, String, String, String, String)>(
                "SELECT options_json, content_text, parameters_json, covariance_json, result_json
                 FROM calibrations WHERE blake3 = ?",
            )
            .bind(&head.blake3)
            .fetch_one(&self.readers)
            .await
            .map_err(failed_to(doing))?;
        if let Some(reason) = damage(&head.blake3, &content) {
            return Err(damaged(&format!("calibration {}", head.blake3), reason));
        }
        Ok(Calibration {
            head,
            options_json,
            content,
            parameters_json,
            covariance_json,
            result_json,
        })
    }

    async fn find_calibration(&self, wanted: &str) -> Result<CalibrationHead, StoreError> {
        let mut all = self.calibrations().await?;
        let wanted = wanted.trim().to_lowercase();
        let named = |head: &CalibrationHead| format!("{}  {}", head.blake3, head.name);
        let known: Vec<String> = all.iter().rev().take(3).map(named).collect();
        match wanted.as_str() {
            "latest" => all = all.pop().into_iter().collect(),
            "" => all.clear(),
            beginning => all.retain(|head| head.blake3.starts_with(beginning)),
        }
        if all.len() > 1 {
            let candidates = all.iter().map(named).collect();
            return Err(StoreError::Ambiguous { wanted, candidates });
        }
        all.pop().ok_or_else(|| StoreError::NotFound {
            what: format!("calibration {wanted:?}"),
            nearest: known,
        })
    }

    async fn head(&self, row: HeadColumns) -> Result<CalibrationHead, StoreError> {
        let sources: Vec<SourceColumns> = sqlx::query_as(
            "SELECT kind, name, blake3, made_from, processing_utc, deleted_utc,
                EXISTS (SELECT 1 FROM sessions t WHERE t.id = made_from) AS stored
             FROM calibration_sources WHERE calibration = ? ORDER BY place",
        )
        .bind(&row.blake3)
        .fetch_all(&self.readers)
        .await
        .map_err(failed_to("read what a calibration was made from"))?;
        Ok(CalibrationHead {
            kind: from_word("a calibration's kind", &row.kind)?,
            blake3: row.blake3,
            name: row.name,
            method: row.method,
            created: timestamp(&row.created_utc)?,
            software: row.software,
            sources: sources.into_iter().map(SourceColumns::source).collect::<Result<_, _>>()?,
        })
    }

    /// Hashes every calibration again; one is in memory at a time.
    pub(crate) async fn verify_calibrations(&self) -> Result<Vec<String>, StoreError> {
        let doing = "check the calibrations";
        let all: Vec<(String, String)> =
            sqlx::query_as("SELECT blake3, name FROM calibrations ORDER BY rowid")
                .fetch_all(&self.readers)
                .await
                .map_err(failed_to(doing))?;
        let mut problems = Vec::new();
        for (blake3, name) in all {
            let content: String =
                sqlx::query_scalar("SELECT content_text FROM calibrations WHERE blake3 = ?")
                    .bind(&blake3)
                    .fetch_one(&self.readers)
                    .await
                    .map_err(failed_to(doing))?;
            let reason = damage(&blake3, &content);
            problems.extend(reason.map(|why| format!("calibration {name} {blake3}: {why}")));
        }
        Ok(problems)
    }
}

async fn insert_source(
    connection: &mut SqliteConnection,
    calibration: &str,
    place: i64,
    source: &CalibrationSource,
) -> Result<(), sqlx::Error> {
    let (kind, name, blake3) = match source {
        CalibrationSource::Session { title, plan_hash, .. } => ("session", title, plan_hash),
        CalibrationSource::File { name, blake3 } => ("file", name, blake3),
    };
    let of_session: Option<(SessionId, Option<jiff::Timestamp>)> = match source {
        CalibrationSource::Session { id, processing, .. } => Some((*id, *processing)),
        CalibrationSource::File { .. } => None,
    };
    sqlx::query(
        "INSERT INTO calibration_sources (calibration, place, kind, name, blake3, made_from,
            processing_utc)
         VALUES (?, ?, ?, ?, ?, ?, ?)",
    )
    .bind(calibration)
    .bind(place)
    .bind(kind)
    .bind(name)
    .bind(blake3)
    .bind(of_session.map(|(id, _)| id.to_string()))
    .bind(of_session.and_then(|(_, processing)| processing).map(|at| at.to_string()))
    .execute(connection)
    .await?;
    Ok(())
}
