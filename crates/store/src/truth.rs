//! What a simulation knows and the measurement must not. It is stored apart, for scoring alone:
//! no other module reads or writes these tables, and nothing that solves calls this one.

use std::collections::BTreeMap;

use beampose_core::{CaptureId, SessionId};

use crate::error::failed_to;
use crate::writer::{Write, begin};
use crate::{Store, StoreError};

/// Stores where everything truly was in a stored capture, as JSON.
///
/// # Errors
/// [`StoreError::Refused`] where there is no such capture, or its truth is stored already.
pub async fn save_capture(
    store: &Store,
    session: SessionId,
    capture: &CaptureId,
    truth_json: &str,
) -> Result<(), StoreError> {
    let doing = "store a capture's truth";
    let mut transaction = begin(&store.writer, doing).await?;
    sqlx::query("INSERT INTO simulation_truth (session, capture, truth_json) VALUES (?, ?, ?)")
        .bind(session.to_string())
        .bind(capture.as_str())
        .bind(truth_json)
        .execute(&mut *transaction)
        .await
        .map_err(failed_to(doing))?;
    transaction.commit().await.map_err(failed_to(doing))
}

/// Stores the true parameters of a simulated session, as JSON.
///
/// # Errors
/// [`StoreError::Refused`] where there is no such session, or they are stored already.
pub async fn save_parameters(
    store: &Store,
    session: SessionId,
    truth_json: &str,
) -> Result<(), StoreError> {
    let doing = "store a session's true parameters";
    let mut transaction = begin(&store.writer, doing).await?;
    // A session that goes on has the world it had.
    sqlx::query(
        "INSERT INTO simulation_truth_parameters (session, truth_json) VALUES (?, ?)
         ON CONFLICT (session) DO NOTHING",
    )
    .bind(session.to_string())
    .bind(truth_json)
    .execute(&mut *transaction)
    .await
    .map_err(failed_to(doing))?;
    let kept: String =
        sqlx::query_scalar("SELECT truth_json FROM simulation_truth_parameters WHERE session = ?")
            .bind(session.to_string())
            .fetch_one(&mut *transaction)
            .await
            .map_err(failed_to(doing))?;
    if kept != truth_json {
        let reason = format!("session {session} has another world");
        return Err(StoreError::Refused { doing: doing.to_owned(), reason });
    }
    transaction.commit().await.map_err(failed_to(doing))
}

/// Forgets the truth of a capture that is taken again.
pub(crate) async fn forget_capture(
    transaction: &mut Write,
    session: &str,
    capture: &str,
) -> Result<(), sqlx::Error> {
    sqlx::query("DELETE FROM simulation_truth WHERE session = ? AND capture = ?")
        .bind(session)
        .bind(capture)
        .execute(&mut **transaction)
        .await?;
    Ok(())
}

/// The truth of each capture that has one, as JSON.
///
/// # Errors
/// [`StoreError::Damaged`], [`StoreError::Busy`] or [`StoreError::Database`].
pub async fn captures(
    store: &Store,
    session: SessionId,
) -> Result<BTreeMap<CaptureId, String>, StoreError> {
    let rows: Vec<(String, String)> =
        sqlx::query_as("SELECT capture, truth_json FROM simulation_truth WHERE session = ?")
            .bind(session.to_string())
            .fetch_all(&store.readers)
            .await
            .map_err(failed_to("read the captures' truth"))?;
    Ok(rows.into_iter().map(|(capture, json)| (CaptureId(capture), json)).collect())
}

/// The true parameters of a simulated session, as JSON; `None` where there are none.
///
/// # Errors
/// [`StoreError::Damaged`], [`StoreError::Busy`] or [`StoreError::Database`].
pub async fn parameters(store: &Store, session: SessionId) -> Result<Option<String>, StoreError> {
    sqlx::query_scalar("SELECT truth_json FROM simulation_truth_parameters WHERE session = ?")
        .bind(session.to_string())
        .fetch_optional(&store.readers)
        .await
        .map_err(failed_to("read a session's true parameters"))
}
